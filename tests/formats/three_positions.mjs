// Where three.js puts the joints of a BVH or GLB file. Usage: node three_positions.mjs NODE_MODULES FILE FRAME...
// Prints {"duration": s, "frames": [{joint: [x, y, z], ...}, ...], "bones": [[[x, y, z], ...], ...]} as JSON; `bones` are
// the skinned thick ends of the GLB's bones (vertex 0 of each octahedron).
import { readFileSync } from "node:fs";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";

const [modules, file, ...frames] = process.argv.slice(2);
const load = (name) => import(pathToFileURL(join(resolve(modules), "three", name)).href);
const { AnimationMixer, LoopOnce, Vector3 } = await load("build/three.module.js");
const VERTICES_PER_BONE = 24;

async function open() {
  const bytes = readFileSync(file);
  if (file.endsWith(".bvh")) {
    const { BVHLoader } = await load("examples/jsm/loaders/BVHLoader.js");
    const { skeleton, clip } = new BVHLoader().parse(bytes.toString("utf-8"));
    return { root: skeleton.bones[0], clip };
  }
  const { GLTFLoader } = await load("examples/jsm/loaders/GLTFLoader.js");
  const buffer = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length);
  const gltf = await new GLTFLoader().parseAsync(buffer, "");
  return { root: gltf.scene, clip: gltf.animations[0] };
}

const { root, clip } = await open();
const mixer = new AnimationMixer(root);
const action = mixer.clipAction(clip).setLoop(LoopOnce);
action.clampWhenFinished = true;
action.play();
const result = { duration: clip.duration, frames: [], bones: [] };
for (const frame of frames) {
  action.paused = false;
  action.enabled = true;
  mixer.setTime(clip.tracks[0].times[Number(frame)]);
  root.updateMatrixWorld(true);
  const joints = {};
  const bones = [];
  root.traverse((node) => {
    if (node.isBone && node.name !== "ENDSITE") joints[node.name] = node.getWorldPosition(new Vector3()).toArray();
    if (!node.isSkinnedMesh) return;
    for (let i = 0; i < node.geometry.attributes.position.count; i += VERTICES_PER_BONE)
      bones.push(node.localToWorld(node.getVertexPosition(i, new Vector3())).toArray());
  });
  result.frames.push(joints);
  result.bones.push(bones);
}
console.log(JSON.stringify(result));
