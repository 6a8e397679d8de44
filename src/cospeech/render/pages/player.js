// The player: panels in a grid, one clock (the sound's), one camera. Written by cospeech (docs/player.md).

const STYLE = `
.cospeech { display: flex; flex-direction: column; height: 100%; min-height: 260px; box-sizing: border-box;
  font: 15px/1.4 system-ui, sans-serif; color: #2e343e; background: var(--stage); user-select: none }
.cospeech .stages { flex: 1; display: grid; gap: 1px; min-height: 0 }
.cospeech figure { margin: 0; position: relative; overflow: hidden; min-width: 0; min-height: 0;
  background: var(--stage); outline: 1px solid #d6d8dc }
.cospeech canvas { position: absolute; inset: 0; width: 100%; height: 100%; display: block; cursor: grab;
  touch-action: none }
.cospeech canvas:active { cursor: grabbing }
.cospeech figure::after { content: ""; position: absolute; inset: auto 0 0; height: 9%; pointer-events: none;
  background: linear-gradient(transparent, var(--stage)) }
.cospeech figcaption { position: absolute; inset: 2.2% 4px auto; text-align: center; font-weight: 600;
  pointer-events: none; z-index: 1 }
.cospeech .words { margin: 0; padding: 4px 12px; min-height: 1.4em; text-align: center; font-size: 17px }
.cospeech .bar { display: flex; flex-wrap: wrap; align-items: center; gap: 8px; padding: 6px 12px 10px }
.cospeech button { font: inherit; color: inherit; min-width: 5.4em; padding: 4px 12px; border: 1px solid #b9bec6;
  border-radius: 6px; background: #fff; cursor: pointer }
.cospeech button:disabled { color: #9aa0a8; cursor: default }
.cospeech button:focus-visible, .cospeech input:focus-visible, .cospeech:focus-visible { outline: 2px solid #3a82be }
.cospeech input { flex: 1; min-width: 120px; accent-color: #3a82be }
.cospeech output { font-variant-numeric: tabular-nums; min-width: 7.5em; text-align: right }
.cospeech .wrong { color: #a3261b }`;

const LEAST_MS = 14, MOST_MS = 24;  // a picture's drawing time: above, fewer samples; below, more
const DENSITIES = [0.7, 1, 1.4, 2];  // samples per pixel of the screen, in each direction
const MOST_SAMPLES = 6e6;  // of all panels together

class CospeechPlayer extends EventTarget {
  /**
   * Shows `data` (what player_page.py, player_data, returns) inside `element`, as large as it is.
   *
   * options: controls (true) shows the bar; once (false) lets the whole be played a single time, without jumping;
   * wheel (true) comes nearer with the mouse wheel; keys, the element or document whose keys are heard (the player itself).
   * Events: ready, play, pause, ended, error. `ready` is also a promise.
   */
  constructor(element, data, options = {}) {
    super();
    this.data = data;
    this.options = { controls: true, once: false, wheel: true, keys: null, ...options };
    this.finished = false;
    this.density = DENSITIES.length - 1;
    this.drawn = 0;  // rounds of pictures so far, and the milliseconds they took
    this.spent = 0;
    this._slow = 0;
    this.camera = new OrbitCamera(data.camera);
    this._build(element);
    this._listen();
    this.ready = this._load();
  }

  get duration() { return this.data.duration; }
  get time() { return Math.min(this.audio.currentTime, this.duration); }
  get paused() { return this.audio.paused; }

  async play() {
    if (this.options.once && this.finished) return;
    await this.ready;
    await this.audio.play();
  }

  pause() { this.audio.pause(); }

  toggle() {
    if (!this.paused) return this.pause();
    this.play().catch((error) => error.name === "AbortError" || this._fail(error));  // aborted: paused again at once
  }

  /** Jump to `time` seconds; not where the whole may be played once only. */
  seek(time) {
    if (this.options.once) return;
    this.audio.currentTime = Math.max(0, Math.min(time, this.duration));
    this.redraw();
  }

  resetView() {
    this.camera.reset();
    this.redraw();
  }

  /** Joints of a panel at `time` seconds: [[x, y, z] metres, ...] in the order of data.joints. */
  jointsAt(panel, time) {
    const flat = this.puppets.jointsAt(panel, time);
    return this.data.joints.map((_, i) => [flat[3 * i], flat[3 * i + 1], flat[3 * i + 2]]);
  }

  /** Where a point in metres is seen in a panel: [x, y] in CSS pixels from its upper left corner. */
  project(panel, point) {
    const box = this.canvases[panel].getBoundingClientRect();
    return project(this.camera.view(box.width, box.height), point).slice(0, 2);
  }

  /** Stop and leave the page. */
  remove() {
    this.audio.pause();
    this._watch.disconnect();
    cancelAnimationFrame(this._next);
    this._keys.removeEventListener("keydown", this._onKey);
    this.root.remove();
  }

  _build(element) {
    const { data } = this;
    if (!document.getElementById("cospeech-style")) {
      document.head.append(make("style", { id: "cospeech-style", textContent: STYLE }));
    }
    this.root = make("div", { className: "cospeech", tabIndex: -1 });
    this.root.style.setProperty("--stage", `rgb(${data.background.join(" ")})`);
    this.stages = make("div", { className: "stages" });
    this.canvases = data.panels.map((panel) => {
      const canvas = make("canvas");
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", `${panel.title}: a person talking with gestures`);
      const figure = make("figure");
      figure.append(canvas, make("figcaption", { textContent: panel.title }));
      this.stages.append(figure);
      return canvas;
    });
    this.words = make("p", { className: "words", hidden: !data.captions.length });
    this.audio = make("audio", { src: data.audio, preload: "auto" });
    this.button = make("button", { type: "button", textContent: "Play", disabled: true });
    this.slider = make("input", { type: "range", min: 0, max: data.duration, step: "any", value: 0 });
    this.slider.setAttribute("aria-label", "Time in seconds");
    this.clock = make("output", { textContent: clockText(0, data.duration) });
    this.reset = make("button", { type: "button", textContent: "Reset view",
      title: "Drag to turn, shift and drag to move, wheel to come nearer" });
    const bar = make("div", { className: "bar", hidden: !this.options.controls });
    bar.style.display = this.options.controls ? "" : "none";
    bar.append(this.button, ...(this.options.once ? [] : [this.slider]), this.clock, this.reset);
    this.root.append(this.stages, this.words, bar, this.audio);
    element.append(this.root);
  }

  _listen() {
    this.button.addEventListener("click", () => this.toggle());
    this.reset.addEventListener("click", () => this.resetView());
    this.slider.addEventListener("input", () => this.seek(Number(this.slider.value)));
    for (const name of ["play", "pause", "ended"]) this.audio.addEventListener(name, () => this._changed(name));
    this.audio.addEventListener("seeked", () => this.redraw());
    this.audio.addEventListener("error", () => this._fail(new Error("the browser cannot play its sound, AAC in mp4")));
    for (const canvas of this.canvases) this._orbit(canvas);
    this._keys = this.options.keys ?? this.root;
    this._onKey = (event) => this._key(event);
    this._keys.addEventListener("keydown", this._onKey);
    this._watch = new ResizeObserver(() => this._arrange());
    this._watch.observe(this.stages);
  }

  async _load() {
    try {
      this.puppets = await Puppets.unpack(this.data);
    } catch (error) {
      this._fail(error);
      throw error;
    }
    this.painter = new Painter(this.puppets);
    this.button.disabled = false;
    this._arrange();
    this.dispatchEvent(new Event("ready"));
  }

  _fail(error) {
    this.words.hidden = false;
    this.words.className = "words wrong";
    this.words.textContent = `Cannot show this: ${error.message}`;
    this.dispatchEvent(new ErrorEvent("error", { error, message: error.message }));
  }

  _changed(name) {
    if (name === "ended") this.finished = true;
    this.button.textContent = this.paused ? "Play" : "Pause";
    this.button.disabled = this.options.once && (this.finished || !this.paused);
    this.redraw();
    this.dispatchEvent(new Event(name));
  }

  _key(event) {
    const steps = { ArrowLeft: -1, ArrowRight: 1, ",": -1 / 15, ".": 1 / 15 };
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === " " && event.target.tagName !== "BUTTON") {
      if (!this.options.once || this.paused) this.toggle();
    } else if (event.key in steps) {
      this.seek(this.time + steps[event.key]);
    } else if (event.key === "Home" || event.key === "End") {
      this.seek(event.key === "Home" ? 0 : this.duration);
    } else if (event.key === "r") {
      this.resetView();
    } else {
      return;
    }
    event.preventDefault();
  }

  _orbit(canvas) {
    canvas.addEventListener("pointerdown", (event) => {
      if (event.button === 0) canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!canvas.hasPointerCapture(event.pointerId)) return;
      const size = canvas.clientHeight, x = event.movementX / size, y = event.movementY / size;
      if (event.shiftKey) {
        this.camera.shift = [this.camera.shift[0] - x / this.camera.zoom, this.camera.shift[1] + y / this.camera.zoom];
      } else {
        this.camera.turn(-4 * x, 4 * y);
      }
      this.redraw();
    });
    if (this.options.wheel) canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.camera.approach(Math.exp(-event.deltaY * 0.0012));
      this.redraw();
    }, { passive: false });
    canvas.addEventListener("dblclick", () => this.resetView());
  }

  /** As many columns as show the characters largest. */
  _arrange() {
    const { width, height } = this.stages.getBoundingClientRect(), count = this.canvases.length;
    const size = (columns) => Math.min(width / columns, height / Math.ceil(count / columns));
    let best = 1;
    for (let columns = 2; columns <= count; columns++) if (size(columns) > size(best) * 1.02) best = columns;
    this.stages.style.gridTemplateColumns = `repeat(${best}, 1fr)`;
    this.stages.style.gridAutoRows = "1fr";
    this.redraw();
  }

  /** Draw soon, and go on drawing while the sound plays. */
  redraw() {
    this._next ??= requestAnimationFrame(() => {
      this._next = undefined;
      this._draw();
      if (!this.paused) this.redraw();
    });
  }

  _draw() {
    if (!this.painter) return;
    const { time } = this, began = performance.now();
    const { width: across, height: down } = this.stages.getBoundingClientRect();
    const ratio = window.devicePixelRatio || 1, most = Math.sqrt(MOST_SAMPLES / Math.max(across * down, 1));
    const density = Math.min(DENSITIES[this.density] * ratio, Math.max(most, 0.7));
    for (const [panel, canvas] of this.canvases.entries()) {
      const width = Math.round(canvas.clientWidth * density), height = Math.round(canvas.clientHeight * density);
      if (!width || !height) continue;
      this.puppets.pose(panel, time);
      this.painter.draw(canvas, this.camera.view(width, height));
    }
    this._pace(performance.now() - began);
    this.slider.value = time;
    this.clock.textContent = clockText(time, this.duration);
    if (this.data.captions.length && !this.words.classList.contains("wrong")) {
      this.words.textContent = this.data.captions.find(([start, end]) => start <= time && time < end)?.[2] ?? "\u00a0";
    }
  }

  /** Fewer samples where drawing is slow, more where it is quick; only ever a step at a time. */
  _pace(took) {
    this.drawn++;
    this.spent += took;
    this._slow = took > MOST_MS ? Math.max(this._slow, 0) + 1 : took < LEAST_MS / 2 ? Math.min(this._slow, 0) - 1 : 0;
    if (this._slow > 4 && this.density > 0) this.density--;
    else if (this._slow < -60 && this.density < DENSITIES.length - 1) this.density++;
    else return;
    this._slow = 0;
  }
}

function make(name, properties = {}) {
  return Object.assign(document.createElement(name), properties);
}

function clockText(time, duration) {
  const text = (seconds) => `${Math.floor(seconds / 60)}:${(seconds % 60).toFixed(1).padStart(4, "0")}`;
  return `${text(time)} / ${text(duration)}`;
}
