// The page of a study: welcome, one clip after the other, a file to send back. Written by cospeech (docs/study.md).

const study = JSON.parse(document.getElementById("design").textContent);
const place = document.getElementById("study");
const CODE = /^[A-Za-z0-9_-]{1,32}$/;
const CHECK_FROM = 0.3, CHECK_TO = 0.85;  // share of a clip in which its text of an attention check stands there
const PAUSE = 500;  // milliseconds between the two clips of a pair

function el(name, properties = {}, ...children) {
  const element = Object.assign(document.createElement(name), properties);
  element.append(...children);
  return element;
}

const now = () => Math.round(performance.now());

/** CRC-32 (IEEE) of a text's UTF-8 bytes, as 8 hexadecimal digits. */
function checksum(text) {
  let crc = -1;
  for (const byte of new TextEncoder().encode(text)) {
    crc ^= byte;
    for (let bit = 0; bit < 8; bit++) crc = (crc >>> 1) ^ (crc & 1 ? 0xedb88320 : 0);
  }
  return (~crc >>> 0).toString(16).padStart(8, "0");
}

// ------------------------------------------------------------------------------------------------- where it stands

/** What is kept in this browser, so that a reload goes on where it was; without storage the page works all the same. */
const memory = {
  key: (code) => `cospeech-study/${study.id}/${code}`,
  read(code) {
    try {
      return JSON.parse(localStorage.getItem(this.key(code)));
    } catch {
      return null;
    }
  },
  write(code, state) {
    try {
      localStorage.setItem(this.key(code), JSON.stringify(state));
    } catch { /* private mode, or full */ }
  },
};

let state = null, plan = [];

function begin(code) {
  state = memory.read(code) ?? { participant: code, started: new Date().toISOString(), finished: "", at: 0, views: 0,
    answers: [] };
  memory.write("", code);
  plan = makePlan(study, code);
  next();
}

function next() {
  if (state.at < plan.length) show(plan[state.at]);
  else finish();
}

// --------------------------------------------------------------------------------------------------------- welcome

function welcome() {
  const asked = new URLSearchParams(location.search).get("participant") ?? "";
  const known = asked || memory.read("") || "";
  if (CODE.test(known) && memory.read(known) && (asked || !memory.read(known).finished)) return begin(known);
  const code = el("input", { type: "text", id: "code", value: asked, required: true, pattern: "[A-Za-z0-9_\\-]{1,32}",
    maxLength: 32, autocomplete: "off", title: "letters, digits, - and _" });
  const agree = el("input", { type: "checkbox", id: "agree", required: true });
  const minutes = Math.max(1, Math.ceil(study.minutes));
  const form = el("form", {},
    el("p", { className: "text", textContent: study.instructions }),
    el("p", { textContent: `It takes about ${minutes} minute${minutes > 1 ? "s" : ""}. Please use headphones or `
      + "loudspeakers. Each clip is played once, and the next comes after your answer. If you close this page, it goes "
      + "on where you were when you open it again in the same browser." }),
    el("div", { className: "row" }, el("label", { htmlFor: "code", textContent: "Your participant code " }), code),
    el("div", { className: "row" }, agree, el("label", { htmlFor: "agree", textContent: ` ${study.consent}` })),
    el("button", { id: "start", textContent: "Start" }));
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    begin(code.value);
  });
  place.replaceChildren(heading(study.title), form);
  code.focus();
}

function heading(text) {
  return el("h1", { textContent: text, tabIndex: -1 });
}

// ------------------------------------------------------------------------------------------------------------ clips

const arriving = new Map();  // number of a track -> [promise, resolve]

window.cospeechTrack = (name, data) => arriving.get(study.files.indexOf(name))?.[1](data);

/** The data of a track, from its file beside this page (a script: browsers read no other kind of file from disk). */
function track(number) {
  if (!arriving.has(number)) {
    const script = el("script", { src: `clips/${study.files[number]}.js` });
    let resolve;
    const promise = new Promise((done, failed) => {
      resolve = done;
      script.onerror = () => failed(new Error(`${script.getAttribute("src")} cannot be read; the folder is not whole`));
    });
    promise.catch(() => {});  // told where it is shown
    arriving.set(number, [promise, resolve]);
    document.head.append(script);
  }
  return arriving.get(number)[0];
}

const clip = (id) => study.stimuli.find((one) => one[0] === id);

/** A player that shows one clip: the others of its track are hidden, and hidden ones are not drawn. */
async function playerOf(id, stage) {
  const [, condition, number] = clip(id);
  const player = new CospeechPlayer(stage, await track(number), { once: true, controls: false });
  stage.querySelectorAll("figure").forEach((figure, i) => { figure.hidden = i !== condition; });
  await player.ready;
  return player;
}

/** The page of an item, still empty and still: its parts by name. */
function layOut(item) {
  const pair = item.stimuli.length > 1;
  const stages = item.stimuli.map((_, i) => el("div", { className: "stage" },
    ...(pair ? [el("h2", { textContent: i ? "Second clip" : "First clip" })] : [])));
  const play = el("button", { id: "play", type: "button", disabled: true, textContent: pair ? "Play both" : "Play" });
  const status = el("span", { id: "status", role: "status" });
  const form = questions(item);
  const forward = el("button", { id: "next", type: "submit", disabled: true, textContent: "Next" });
  const stop = el("button", { id: "stop", type: "button", className: "quiet", textContent: "Stop and save" });
  form.append(el("footer", {}, forward, stop));
  const title = heading(item.kind === "example" ? "Example: how the speaker moves" : pair ? "Watch both clips" :
    "Watch the clip");
  place.replaceChildren(progress(), title, el("div", { className: "stages" }, ...stages),
    el("div", { className: "bar" }, play, status), form);
  title.focus();
  return { stages, play, status, form, forward, stop, say(text) { Object.assign(status, { textContent: text,
    className: "wrong" }); } };
}

async function show(item) {
  const began = now(), clock = () => now() - began, times = { play: 0, ended: 0, answered: 0 };
  state.views += 1;
  memory.write(state.participant, state);
  const page = layOut(item);
  let players = [], hidden = 0;
  const watch = () => { if (document.hidden) hidden += 1; };
  document.addEventListener("visibilitychange", watch);
  const leave = () => {
    document.removeEventListener("visibilitychange", watch);
    for (const player of players) player.remove();
  };
  page.stop.addEventListener("click", () => { leave(); finish(); });
  page.form.addEventListener("submit", (event) => {
    event.preventDefault();
    times.answered = clock();
    leave();
    keep(record(item, page.form, times, hidden));
  });
  try {
    players = await Promise.all(item.stimuli.map((id, i) => playerOf(id, page.stages[i])));
  } catch (error) {
    return page.say(`This clip cannot be shown: ${error.message}`);
  }
  for (const id of plan[state.at + 1]?.stimuli ?? []) track(clip(id)[2]);  // so that nobody waits for it
  await run(item, page, players, times, clock);
  open(page);
}

/** The questions can be answered, and the next clip follows when all are. */
function open({ form, forward }) {
  for (const fieldset of form.querySelectorAll("fieldset")) fieldset.disabled = false;
  const ready = () => { forward.disabled = !form.checkValidity(); };
  form.addEventListener("change", ready);
  ready();
  (form.querySelector("input") ?? forward).focus();
}

function keep(answer) {
  state.answers.push(answer);
  state.at += 1;
  state.views = 0;
  memory.write(state.participant, state);
  next();
}

/** Play the clips one after the other, each once and whole; resolves after the last. */
async function run(item, { stages, play, say }, players, times, clock) {
  stages.forEach((stage, i) => stage.classList.toggle("waiting", i > 0));
  play.disabled = false;
  play.focus();
  for (const [i, player] of players.entries()) {
    const go = () => player.play().catch(() => { play.disabled = false; });
    const end = new Promise((done) => player.addEventListener("ended", done));
    player.addEventListener("play", () => { play.disabled = true; });
    player.addEventListener("pause", () => { play.disabled = player.finished; });  // by a key of the headset
    player.addEventListener("error", (event) => say(event.message));
    play.onclick = go;
    if (i) await new Promise((done) => setTimeout(done, PAUSE)).then(go);
    else await new Promise((done) => player.addEventListener("play", done, { once: true }));
    stages.forEach((stage, k) => stage.classList.toggle("waiting", k !== i));
    times.play ||= clock();
    const watch = item.kind === "check" && i === players.length - 1 ? ask(item, stages[i], player) : 0;
    await end;
    clearInterval(watch);
    stages[i].querySelector(".notice")?.remove();
  }
  stages.forEach((stage) => stage.classList.remove("waiting"));
  times.ended = clock();
  play.disabled = true;
}

/** Show the text of an attention check while its clip plays. */
function ask(item, stage, player) {
  const what = study.kind === "pairs" ? `choose the ${item.expected} clip` : `choose ${item.expected}`;
  const text = `Attention! For this one, please ${what} in every question.`;
  const notice = el("div", { className: "notice", role: "alert", textContent: text });
  return setInterval(() => {
    const share = player.time / player.duration;
    if (share < CHECK_FROM || share > CHECK_TO) notice.remove();
    else if (!notice.isConnected) stage.append(notice);
  }, 50);
}

// -------------------------------------------------------------------------------------------------------- questions

/** The form of an item; its fields can be used after the clip. */
function questions(item) {
  const form = el("form", { id: "answers" });
  for (const { key, text } of item.kind === "example" ? [] : study.questions) {
    const scale = el("div", { className: "scale" });
    const [low, high] = study.ends;
    const options = study.kind === "pairs"
      ? [["first", "First"], ...(study.ties ? [["same", "No difference"]] : []), ["second", "Second"]]
      : range(study.points).map((i) => [String(i + 1), String(i + 1)]);
    const choices = options.map(([value, label]) => el("label", {},
      el("input", { type: "radio", name: key, value, required: true }), label));
    if (study.kind === "pairs") scale.append(...choices);
    else scale.append(el("span", { textContent: low }), ...choices, el("span", { textContent: high }));
    form.append(el("fieldset", { disabled: true }, el("legend", { textContent: text }), scale));
  }
  return form;
}

function record(item, form, times, hidden) {
  const values = {}, given = new FormData(form);
  for (const { key } of item.kind === "example" ? [] : study.questions) {
    values[key] = study.kind === "pairs" ? given.get(key) : Number(given.get(key));
  }
  const expected = item.kind === "check" ? { expected: item.expected } : {};
  return { kind: item.kind, stimuli: item.stimuli, values, ...expected, ms: times, views: state.views, hidden };
}

function progress() {
  const text = `${state.at + 1} of ${plan.length}`;
  const bar = el("progress", { max: plan.length, value: state.at });
  bar.setAttribute("aria-label", "How much is done");
  return el("header", {}, el("span", { id: "progress", textContent: text }), bar);
}

// -------------------------------------------------------------------------------------------------------------- end

/** What is given back: text of a JSON file, with a checksum of all that stands before it. */
function answersFile() {
  const { participant, started, finished, answers } = state;
  const whole = { schema: "cospeech.answers", version: 1, study: study.id, title: study.title, participant, started,
    finished, complete: state.at >= plan.length, items: plan.length, answers };
  return JSON.stringify({ ...whole, checksum: checksum(JSON.stringify(whole)) });
}

function finish() {
  const complete = state.at >= plan.length;
  if (complete && !state.finished) state.finished = new Date().toISOString();
  memory.write(state.participant, state);
  const file = new Blob([answersFile()], { type: "application/json" });
  const save = el("a", { id: "download", className: "button", href: URL.createObjectURL(file),
    download: `answers-${state.participant}.json`, textContent: "Save my answers" });
  const button = (textContent, act) => {
    const made = el("button", { type: "button", className: "quiet", textContent });
    made.addEventListener("click", act);
    return made;
  };
  const other = button("Another participant", () => { memory.write("", ""); location.assign(location.pathname); });
  const more = complete ? [other] : [button("Go on", next), other];
  const done = complete ? "Thank you! That was the last one." : `You have answered ${state.at} of ${plan.length}.`;
  place.replaceChildren(heading(done), el("p", { textContent: "One last step: save your answers and send the file "
    + `answers-${state.participant}.json back as you were told. It holds your code, your answers and their times, and `
    + "nothing else." }), el("p", {}, save), el("p", {}, ...more));
  save.focus();
}

welcome();
