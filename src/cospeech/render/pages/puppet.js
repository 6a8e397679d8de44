"use strict";
// The character in the browser: it unpacks what player_page.py packed, poses the mesh of a frame as puppet.py
// describes it, and draws it with a z-buffer, as triangles.py does. No graphics card is needed.

class Puppets {
  /** The characters of one page; `data` is the dict of player_data. Use `await Puppets.unpack(data)`. */
  static async unpack(data) {
    if (data.version !== 2) throw new Error(`player data of version ${data.version}; this script reads version 2`);
    const packed = Uint8Array.from(atob(data.blob), (letter) => letter.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Puppets(data, await new Response(stream).arrayBuffer());
  }

  constructor(data, buffer) {
    this.data = data;
    this.arrays = unpackArrays(data.arrays, buffer);
    const { arrays } = this;
    this.joint = Object.fromEntries(data.joints.map((name, i) => [name, i]));
    const sizes = data.limbs.map(([sides, limbs]) => limbs.length * arrays[`end${sides}`].length);
    this.limbVertices = sizes.reduce((sum, size) => sum + size, 0);
    this.trunkStart = this.limbVertices * 3;
    this.headStart = this.trunkStart + arrays.trunk_mean.length;
    this.propStart = this.headStart + arrays.head_mean.length;
    const length = this.propStart + arrays.props.length;
    this.points = new Float32Array(length);
    this.normals = new Float32Array(length);
    this.joints = new Float32Array(data.joints.length * 3);
    this.shape = { trunk: new Float32Array(arrays.trunk_mean.length), head: new Float32Array(arrays.head_mean.length) };
    this.bent = this._trianglesFrom(this.limbVertices);
  }

  /** Triangles (flat) whose vertices are no limb's: their normals are computed anew each frame. */
  _trianglesFrom(first) {
    const all = this.arrays.triangles;
    const kept = [];
    for (let i = 0; i < all.length; i += 3) if (all[i] >= first) kept.push(all[i], all[i + 1], all[i + 2]);
    return Uint16Array.from(kept);
  }

  /** Frame below, frame above and the share of the latter at `time` seconds; motion holds still beyond its ends. */
  _at(panel, time) {
    const { frames, fps } = this.data.panels[panel];
    const at = Math.min(Math.max(time * fps, 0), frames - 1);
    const low = Math.min(Math.floor(at), Math.max(frames - 2, 0));
    return [low, Math.min(low + 1, frames - 1), at - low];
  }

  _between(name, width, panel, time, step, out) {
    const series = this.arrays[name];
    const [low, high, share] = this._at(panel, time);
    for (let i = 0; i < width; i++) {
      const a = series[low * width + i], b = series[high * width + i];
      out[i] = (a + (b - a) * share) * step;
    }
    return out;
  }

  /** Joints (J * 3) in metres of a panel at `time` seconds, in the order of data.joints. The array is reused. */
  jointsAt(panel, time) {
    return this._between(`joints${panel}`, this.joints.length, panel, time, this.data.step.joints, this.joints);
  }

  /** Pose the mesh: fills `points` and `normals` (V * 3), metres. */
  pose(panel, time) {
    const { data, points } = this;
    const scale = data.panels[panel].scale;
    const joints = this.jointsAt(panel, time);
    this._limbs(joints, scale);
    const trunk = this._bend("trunk", panel, time);
    for (let i = 0; i < trunk.length; i++) points[this.trunkStart + i] = trunk[i] * scale;
    this._head(panel, time, joints, scale);
    const { props } = this.arrays;
    for (let i = 0; i < props.length; i++) points[this.propStart + i] = props[i] * data.panels[0].scale;
    this._smooth();
  }

  _limbs(joints, scale) {
    const { points, normals } = this;
    let at = 0;
    for (const [sides, limbs] of this.data.limbs) {
      const directions = this.arrays[`directions${sides}`], end = this.arrays[`end${sides}`];
      for (const [from, to, radius0, radius1] of limbs) {
        const ax = joints[from * 3], ay = joints[from * 3 + 1], az = joints[from * 3 + 2];
        const dx = joints[to * 3] - ax, dy = joints[to * 3 + 1] - ay, dz = joints[to * 3 + 2] - az;
        const length = Math.max(Math.hypot(dx, dy, dz), 1e-9);
        const zx = dx / length, zy = dy / length, zz = dz / length;
        const upright = Math.abs(zz) < 0.9;  // the helper axis of mesh.capsules
        let xx = upright ? -zy : 0, xy = upright ? zx : -zz, xz = upright ? 0 : zy;
        const across = Math.max(Math.hypot(xx, xy, xz), 1e-9);
        xx /= across; xy /= across; xz /= across;
        const yx = zy * xz - zz * xy, yy = zz * xx - zx * xz, yz = zx * xy - zy * xx;
        for (let v = 0; v < end.length; v++, at += 3) {
          const u = directions[v * 3], w = directions[v * 3 + 1], t = directions[v * 3 + 2], far = end[v];
          const nx = u * xx + w * yx + t * zx, ny = u * xy + w * yy + t * zy, nz = u * xz + w * yz + t * zz;
          const radius = (far ? radius1 : radius0) * scale;
          normals[at] = nx; normals[at + 1] = ny; normals[at + 2] = nz;
          points[at] = ax + far * dx + nx * radius;
          points[at + 1] = ay + far * dy + ny * radius;
          points[at + 2] = az + far * dz + nz * radius;
        }
      }
    }
  }

  /** A shape's points: its mean, moved by the weights of this moment along its basis. */
  _bend(name, panel, time) {
    const out = this.shape[name], basis = this.arrays[`${name}_basis`], moving = this.arrays[`${name}_moving`];
    const count = moving.length * 3, { step } = this.data;
    const components = count ? basis.length / count : 0;
    const weights = this._between(`${name}${panel}`, components, panel, time, step[name], new Float32Array(components));
    out.set(this.arrays[`${name}_mean`]);
    for (let k = 0; k < components; k++) {
      const weight = weights[k] * step[`${name}_basis`];
      for (let i = 0, b = k * count; i < moving.length; i++, b += 3) {
        const to = moving[i] * 3;
        out[to] += weight * basis[b]; out[to + 1] += weight * basis[b + 1]; out[to + 2] += weight * basis[b + 2];
      }
    }
    return out;
  }

  _head(panel, time, joints, scale) {
    const local = this._bend("head", panel, time), { points } = this;
    const turn = this._between(`turn${panel}`, 4, panel, time, 1, new Float32Array(4));
    const length = Math.max(Math.hypot(...turn), 1e-9);
    const [x, y, z, w] = turn.map((value) => value / length);
    const c = this.joint.head_center * 3;
    const m = [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
      2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
      2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)];
    for (let i = 0, to = this.headStart; i < local.length; i += 3) {
      for (let row = 0; row < 3; row++) {
        const turned = m[row * 3] * local[i] + m[row * 3 + 1] * local[i + 1] + m[row * 3 + 2] * local[i + 2];
        points[to++] = joints[c + row] + turned * scale;
      }
    }
  }

  /** Normals of all that bends: the sum of the normals of the triangles about each vertex. */
  _smooth() {
    const { points: p, normals: n, bent } = this;
    n.fill(0, this.trunkStart);
    for (let i = 0; i < bent.length; i += 3) {
      const a = bent[i] * 3, b = bent[i + 1] * 3, c = bent[i + 2] * 3;
      const ux = p[b] - p[a], uy = p[b + 1] - p[a + 1], uz = p[b + 2] - p[a + 2];
      const vx = p[c] - p[a], vy = p[c + 1] - p[a + 1], vz = p[c + 2] - p[a + 2];
      const x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;
      n[a] += x; n[a + 1] += y; n[a + 2] += z;
      n[b] += x; n[b + 1] += y; n[b + 2] += z;
      n[c] += x; n[c + 1] += y; n[c + 2] += z;
    }
    for (let i = this.trunkStart; i < n.length; i += 3) {
      const length = Math.max(Math.sqrt(n[i] * n[i] + n[i + 1] * n[i + 1] + n[i + 2] * n[i + 2]), 1e-12);
      n[i] /= length; n[i + 1] /= length; n[i + 2] /= length;
    }
  }
}

/** {name: typed array} of the deflated bytes: see player_page.py, pack. */
function unpackArrays(meta, buffer) {
  const kinds = { u1: Uint8Array, u2: Uint16Array, i2: Int16Array, f4: Float32Array, series: Uint8Array };
  const arrays = {};
  let at = 0;
  for (const [name, type, shape] of meta) {
    const count = shape.reduce((product, size) => product * size, 1);
    const raw = new kinds[type](buffer, at, type === "series" ? count * 3 : count);
    arrays[name] = type === "series" ? unfold(raw, shape[0], count / shape[0]) : raw;
    at += Math.ceil(raw.byteLength / 4) * 4;
  }
  return arrays;
}

/** Sums of the differences of `player.Series`: Int16Array (rows * channels). */
function unfold(bytes, rows, channels) {
  const count = rows * channels, out = new Int16Array(count);
  for (let channel = 0, i = 0; channel < channels; channel++) {
    for (let row = 0, sum = 0; row < rows; row++, i++) {
      const folded = bytes[i] | (bytes[count + i] << 8) | (bytes[2 * count + i] << 16);
      sum += folded & 1 ? -((folded + 1) >> 1) : folded >> 1;
      out[row * channels + channel] = sum;
    }
  }
  return out;
}

class OrbitCamera {
  /** The camera of all panels: at first where triangles.py's Camera.containing puts it, then as it is turned. */
  constructor(settings) {
    this.settings = settings;
    this.reset();
  }

  reset() {
    this.yaw = 0;
    this.pitch = this.settings.pitch;
    this.zoom = 1;
    this.shift = [0, 0];  // metres to the picture's right and up
  }

  /** Turn by an angle about the character, and lift by another, in radians. */
  turn(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.max(-1.2, Math.min(1.45, this.pitch + pitch));
  }

  /** Come nearer by a factor. */
  approach(factor) {
    this.zoom = Math.max(0.3, Math.min(8, this.zoom * factor));
  }

  /** What `project` needs for pictures of this size in pixels. */
  view(width, height) {
    const { points, above, below, fov, pitch } = this.settings;
    const focal = height / 2 / Math.tan(fov / 2);
    const middle = (axis) => {
      const values = points.map((point) => point[axis]);
      return (Math.min(...values) + Math.max(...values)) / 2;
    };
    const target = [0, middle(1), middle(2)];
    const home = cameraAxes(0, pitch);
    let distance = 0.1;
    for (const point of points) {
      const [x, y, z] = seen(point, target, home);
      for (const edge of [Math.abs(x) / (0.48 * width), y / ((0.5 - above) * height), -y / ((0.5 - below) * height)]) {
        distance = Math.max(distance, z + focal * edge);
      }
    }
    const axes = cameraAxes(this.yaw, this.pitch), [right, up] = this.shift;
    const aim = target.map((value, i) => value + right * axes[i] + up * axes[3 + i]);
    return { target: aim, focal, distance: distance / this.zoom, axes, width, height };
  }
}

/** Rows: the picture's right, its up, and the direction towards the viewer. */
function cameraAxes(yaw, pitch) {
  const cy = Math.cos(yaw), sy = Math.sin(yaw), cp = Math.cos(pitch), sp = Math.sin(pitch);
  return [cy, 0, -sy, -sp * sy, cp, -sp * cy, cp * sy, sp, cp * cy];
}

function seen(point, target, axes) {
  const [x, y, z] = point.map((value, i) => value - target[i]);
  return [0, 3, 6].map((row) => axes[row] * x + axes[row + 1] * y + axes[row + 2] * z);
}

/** Pixel x right, y down, and the inverse distance of a point in metres, as Camera.project. */
function project(view, point) {
  const [x, y, z] = seen(point, view.target, view.axes);
  const inverse = 1 / Math.max(view.distance - z, 0.05);
  return [view.width / 2 + x * inverse * view.focal, view.height / 2 - y * inverse * view.focal, inverse];
}

class Painter {
  /** Draws Puppets onto a canvas: shaded triangles with a z-buffer. */
  constructor(puppets) {
    const { palette } = puppets.arrays, { background, light } = puppets.data;
    this.puppets = puppets;
    this.light = light;
    this.background = packed(...background);
    this.shades = new Uint32Array((palette.length / 3) * 256);  // of each colour, by brightness in 1/160
    for (let i = 0; i < this.shades.length; i++) {
      const color = (i >> 8) * 3, bright = (i & 255) / 160;
      this.shades[i] = packed(palette[color] * bright, palette[color + 1] * bright, palette[color + 2] * bright);
    }
    const count = puppets.points.length / 3;
    this.x = new Float32Array(count);
    this.y = new Float32Array(count);
    this.near = new Float32Array(count);
    this.bright = new Float32Array(count);
    this.depth = new Float32Array(0);
  }

  /** Draw what puppets.pose has made as `view` sees it; the canvas has the view's width and height. */
  draw(canvas, view) {
    const { width, height } = view;
    if (canvas.picture?.width !== width || canvas.picture?.height !== height) {
      canvas.width = width;
      canvas.height = height;
      canvas.picture = canvas.getContext("2d", { alpha: false }).createImageData(width, height);
    }
    if (this.depth.length < width * height) this.depth = new Float32Array(width * height);
    this.depth.fill(0, 0, width * height);
    const pixels = new Uint32Array(canvas.picture.data.buffer);
    pixels.fill(this.background);
    this._place(view);
    this._rasterise(pixels, width, height);
    canvas.getContext("2d").putImageData(canvas.picture, 0, 0);
  }

  /** Project all vertices, and light them: a soft key light that goes with the viewer, darker towards outlines. */
  _place(view) {
    const { points: p, normals: n } = this.puppets;
    const { target: [tx, ty, tz], axes: m, distance, focal, width, height } = view;
    const [lx, ly, lz] = this.light, halfWidth = width / 2, halfHeight = height / 2;
    for (let v = 0, i = 0; i < p.length; v++, i += 3) {
      const x = p[i] - tx, y = p[i + 1] - ty, z = p[i + 2] - tz;
      const inverse = 1 / Math.max(distance - (m[6] * x + m[7] * y + m[8] * z), 0.05);
      this.x[v] = halfWidth + (m[0] * x + m[1] * y + m[2] * z) * inverse * focal;
      this.y[v] = halfHeight - (m[3] * x + m[4] * y + m[5] * z) * inverse * focal;
      this.near[v] = inverse;
      const right = m[0] * n[i] + m[1] * n[i + 1] + m[2] * n[i + 2];
      const up = m[3] * n[i] + m[4] * n[i + 1] + m[5] * n[i + 2];
      const facing = m[6] * n[i] + m[7] * n[i + 1] + m[8] * n[i + 2];
      const key = lx * right + ly * up + lz * facing, lit = key > 0 ? key * key * key * key : 0;
      this.bright[v] = 160 * (0.58 + 0.26 * key + 0.22 * Math.max(facing, 0) + 0.1 * lit * lit);
    }
  }

  _rasterise(pixels, width, height) {
    const { triangles, colors } = this.puppets.arrays;
    const { x: px, y: py, near, bright, depth, shades } = this;
    for (let f = 0, i = 0; i < triangles.length; f++, i += 3) {
      const a = triangles[i], b = triangles[i + 1], c = triangles[i + 2];
      const ax = px[a], ay = py[a], bx = px[b] - ax, by = py[b] - ay, cx = px[c] - ax, cy = py[c] - ay;
      const area = bx * cy - by * cx;
      if (area >= -1e-6) continue;  // seen from behind: the picture's y runs down
      const top = Math.max(Math.ceil(ay + Math.min(0, by, cy) - 0.5), 0);
      const bottom = Math.min(Math.floor(ay + Math.max(0, by, cy) + 0.5), height);
      const left = ax + Math.min(0, bx, cx), right = ax + Math.max(0, bx, cx);
      if (top >= bottom || right < 0 || left > width) continue;
      const stepB = cy / area, stepC = -by / area, stepA = -stepB - stepC;
      const nearB = near[b] - near[a], nearC = near[c] - near[a];
      const brightB = bright[b] - bright[a], brightC = bright[c] - bright[a];
      const nearStep = stepB * nearB + stepC * nearC, brightStep = stepB * brightB + stepC * brightC;
      const shade = colors[f] << 8;
      for (let y = top; y < bottom; y++) {
        const dx = 0.5 - ax, dy = y + 0.5 - ay;
        const startB = (dx * cy - dy * cx) / area, startC = (dy * bx - dx * by) / area, startA = 1 - startB - startC;
        let first = Math.max(left - 0.5, 0), last = Math.min(right - 0.5, width - 1);
        if (stepB > 0) first = Math.max(first, -startB / stepB);
        else if (stepB < 0) last = Math.min(last, -startB / stepB);
        if (stepC > 0) first = Math.max(first, -startC / stepC);
        else if (stepC < 0) last = Math.min(last, -startC / stepC);
        if (stepA > 0) first = Math.max(first, -startA / stepA);
        else if (stepA < 0) last = Math.min(last, -startA / stepA);
        const from = Math.ceil(first - 1e-3), to = Math.floor(last + 1e-3);  // a little over, so that no crack is left
        const b0 = startB + from * stepB, c0 = startC + from * stepC;
        let z = near[a] + b0 * nearB + c0 * nearC;
        let light = bright[a] + b0 * brightB + c0 * brightC;
        for (let at = y * width + from, end = y * width + to; at <= end; at++) {
          if (z > depth[at]) {
            depth[at] = z;
            pixels[at] = shades[shade + (light > 255 ? 255 : light < 0 ? 0 : light | 0)];
          }
          z += nearStep;
          light += brightStep;
        }
      }
    }
  }
}

/** A pixel of ImageData, as a little-endian 32 bit number. */
function packed(red, green, blue) {
  const byte = (value) => Math.max(0, Math.min(255, Math.round(value)));
  return (255 << 24 | byte(blue) << 16 | byte(green) << 8 | byte(red)) >>> 0;
}
