"use strict";
// What a participant is shown, and in which order: always the same for the same study and participant.

/** A function that gives numbers in [0, 1), started by a text (FNV-1a, then mulberry32). */
function randomOf(text) {
  let state = 2166136261;
  for (const letter of text) state = Math.imul(state ^ letter.codePointAt(0), 16777619);
  return () => {
    state = (state + 0x6d2b79f5) | 0;
    let mixed = Math.imul(state ^ (state >>> 15), state | 1);
    mixed ^= mixed + Math.imul(mixed ^ (mixed >>> 7), mixed | 61);
    return ((mixed ^ (mixed >>> 14)) >>> 0) / 4294967296;
  };
}

function shuffled(list, random) {
  const out = [...list];
  for (let i = out.length - 1; i > 0; i--) {
    const j = Math.floor(random() * (i + 1));
    [out[i], out[j]] = [out[j], out[i]];
  }
  return out;
}

const range = (count) => Array.from({ length: count }, (_, i) => i);

/**
 * The items of one participant: [{ kind, stimuli: [id, ...], expected }, ...], kind "example", "rating", "pair" or
 * "check".
 *
 * Of all tracks, as many as the study asks for are drawn. In ratings, every round shows every condition once; a Latin
 * square says on which track, so that after all rounds each condition was seen on each of the drawn tracks. In pairs,
 * every round shows every pair of conditions once, and each condition as often first as second (but for one).
 */
function makePlan(study, participant) {
  const random = randomOf(`${study.seed}/${participant}`);
  const conditions = shuffled(range(study.conditions), random), tracks = shuffled(range(study.files.length), random);
  const drawn = tracks.slice(0, study.tracks), left = tracks.slice(study.tracks);
  const at = (condition, track) => study.stimuli.find((one) => one[1] === condition && one[2] === track)[0];
  const rounds = study.kind === "pairs" ? pairRounds : ratingRounds;
  const items = withChecks(study, rounds(conditions, drawn, at, random), left.length ? left : drawn, at, random);
  const examples = study.reference < 0 ? [] : left.slice(0, study.examples);
  return [...examples.map((track) => ({ kind: "example", stimuli: [at(study.reference, track)] })), ...items];
}

function ratingRounds(conditions, tracks, at, random) {
  const items = [];
  let last;
  for (const round of range(tracks.length)) {
    const order = shuffled(conditions, random);
    if (order.length > 1 && order[0] === last) order.push(order.shift());  // never the same condition twice in a row
    for (const one of order) {
      const track = tracks[(conditions.indexOf(one) + round) % tracks.length];
      items.push({ kind: "rating", stimuli: [at(one, track)] });
    }
    last = order.at(-1);
  }
  return items;
}

function pairRounds(conditions, tracks, at, random) {
  const pairs = [];
  for (const i of range(conditions.length)) {
    for (const j of range(i)) pairs.push((i + j) % 2 ? [j, i] : [i, j]);  // each first in half of its pairs
  }
  return range(tracks.length).flatMap((round) => shuffled(pairs.map((pair, i) => {
    const track = tracks[(i + round) % tracks.length];
    const order = round % 2 ? [pair[1], pair[0]] : pair;
    return { kind: "pair", stimuli: order.map((one) => at(conditions[one], track)) };
  }), random));
}

/** Spread the attention checks over the items: clips like the others, in which a text asks for a certain answer. */
function withChecks(study, items, tracks, at, random) {
  const out = [...items], { checks, kind } = study;
  for (const i of range(checks).reverse()) {
    const place = Math.max(1, Math.floor((i + 0.25 + 0.5 * random()) * items.length / checks));
    const track = tracks[Math.floor(random() * tracks.length)];
    const seen = shuffled(range(study.conditions), random).map((condition) => at(condition, track));
    const expected = kind === "pairs" ? (random() < 0.5 ? "first" : "second") : 1 + Math.floor(random() * study.points);
    out.splice(place, 0, { kind: "check", stimuli: seen.slice(0, kind === "pairs" ? 2 : 1), expected });
  }
  return out;
}
