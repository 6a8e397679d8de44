"""Table 1 of HA2G for any generator: FGD, beat consistency and diversity over the test clips of all speakers at once.

Every row is judged on clips, so HA2G, its baselines and the generators of chapters 4 and 5 stand in one table. Motion
is judged as its generator leaves it, without a common low-pass, as the publication does; beats are found after one too.
"""

from dataclasses import dataclass, replace

import numpy as np

from cospeech.clip import Clip
from cospeech.errors import CospeechError, notice
from cospeech.evaluation import columns
from cospeech.evaluation.evaluate import DRAWS, low_passed, stretches
from cospeech.evaluation.ha2g_result import Judgement
from cospeech.evaluation.metrics import beats, genea
from cospeech.evaluation.metrics import gesture_metrics as metrics
from cospeech.evaluation.metrics.expressive import STRIDE, clip_vectors
from cospeech.evaluation.metrics.fgd import FRAMES
from cospeech.formats.result_table import mean_and_deviation
from cospeech.gestures.ha2g.dataset.levels import level_table

ANGLES = "expressive43"  # the level table whose angles beats are found in
LOW_PASS = 1.5  # frames: what chapter 4's models are smoothed with, and every row of the summary


@dataclass
class Heard:
    """A test clip's speech: onsets in seconds, and the onsets of each 34-frame window, as released code hears them."""

    onsets: np.ndarray
    windows: list

    @classmethod
    def of(cls, samples, rate, frames, fps):
        """From the sound of a clip of so many frames."""
        from cospeech.speech import speech_onsets

        starts = range(0, frames - FRAMES + 1, STRIDE)
        cuts = [slice(round(s / fps * rate), round((s + FRAMES) / fps * rate)) for s in starts]
        onsets = speech_onsets(samples, rate)
        return cls(onsets[onsets < frames / fps], [speech_onsets(samples[cut], rate) for cut in cuts])


@dataclass
class Yardstick:
    """What every row is judged against; make it once with `build`.

    truth {id: Clip}, heard {id: Heard}, rulers {name: Ruler}; latents {name: (of the test part, of the training part)};
    mean_poses {subject: (positions (55, 3), rotation (3,))}.
    """

    truth: dict
    heard: dict
    rulers: dict
    latents: dict
    mean_poses: dict
    maac: np.ndarray
    threshold: float
    sigma: float
    fps: float
    seed: int

    @classmethod
    def build(cls, truth, train, rulers, audio, *, threshold=None, sigma=beats.SIGMA, seed=0):
        """From the test part, the training part and the rulers.

        Parameters
        ----------
        truth : {id: Clip} of all speakers' test parts; an id is "<subject>/<clip>".
        train : list of Clip, all speakers' training parts: MAAC, threshold, mean poses and `fgd_train` come from it.
        rulers : {name: Ruler}, trained on `train`.
        audio : {id: (samples (N,), rate)}; a clip without counts as silent.
        threshold : of motion beats; None measures it (`beats.beat_threshold`). sigma : of BC, seconds. seed : of draws.
        """
        if not truth or not train:
            raise CospeechError("evaluation: the training or the test part has no clip; change 'split:'")
        fps = train[0].fps
        odd = next((name for name, clip in truth.items() if clip.fps != fps), None)
        if odd:
            raise CospeechError(f"{odd}: {truth[odd].fps} frames a second, the training part {fps}; use one rate")
        pieces = [clip.section(*run) for clip in train for run in stretches(clip.valid)]
        test = [clip.section(*run) for clip in truth.values() for run in stretches(clip.valid)]
        if not pieces or not test:
            raise CospeechError("evaluation: the training or the test part has no valid frame; look at the captures")
        changes = _angle_changes(pieces)
        maac = beats.mean_angle_change(changes)
        threshold = beats.beat_threshold(changes, maac) if threshold is None else threshold
        silence = np.zeros(1), 16000
        heard = {i: Heard.of(*audio.get(i, silence), clip.frames, fps) for i, clip in truth.items()}
        means = {s: _mean_pose([p for p in pieces if p.subject == s] or pieces) for s in _subjects(truth.values())}
        latents = {name: (_latents(ruler, test), _latents(ruler, pieces)) for name, ruler in rulers.items()}
        return cls(truth, heard, rulers, latents, means, maac, threshold, sigma, fps, seed)


def evaluate_ha2g(row, clips, yardstick, run=0):
    """Judge {id: Clip} that a generator made for every test clip: the Judgement of `row`, its run number `run`.

    CospeechError for a test clip that is missing or of another length.
    """
    for name, truth in yardstick.truth.items():
        if name not in clips:
            raise CospeechError(f"{row}: no generated clip for test clip {name!r}; synthesise it first")
        made = clips[name]
        if made.frames != truth.frames or made.fps != truth.fps:
            raise CospeechError(
                f"{row}: {name}: {made.frames} frames at {made.fps} fps, its truth {truth.frames} at {truth.fps}; "
                "make it from the same audio"
            )
    return _judge(
        row, run, {name: replace(clips[name], valid=c.valid) for name, c in yardstick.truth.items()}, yardstick
    )


def evaluate_baselines(yardstick):
    """Judgements of `ha2g_result.BASELINES`, in their order; mismatched truth once for every way to mismatch the clips.

    ground_truth : the test motion. mismatched : each test motion under the speech of the k-th next test clip of its
    speaker, by name; run k (a speaker's only clip: its own motion, half its length later). shuffled : the test motion
    with its frames in random order. mean_pose : each speaker's mean over the training part, held; of speakers
    who are not in it, everyone's.
    """
    truth, rng = yardstick.truth, np.random.default_rng(yardstick.seed)
    groups = {s: sorted(n for n, c in truth.items() if c.subject == s) for s in _subjects(truth.values())}
    ways = max(1, max(map(len, groups.values())) - 1)
    made = [("ground_truth", 0, truth)]
    made += [("mismatched", k, _mismatched(truth, groups, k)) for k in range(1, ways + 1)]
    order = {name: rng.permutation(clip.frames) for name, clip in truth.items()}
    made += [("shuffled", 0, {n: _frames(clip, order[n]) for n, clip in truth.items()})]
    made += [("mean_pose", 0, {n: _held(clip, *yardstick.mean_poses[clip.subject]) for n, clip in truth.items()})]
    return [_judge(row, run, clips, yardstick) for row, run, clips in made]


def _judge(row, run, clips, yardstick):
    pieces, truths, onsets = [], [], []
    for name, clip in clips.items():
        truth, heard = yardstick.truth[name], yardstick.heard[name].onsets
        frames = min(clip.frames, truth.frames)
        for start, stop in stretches(clip.valid[:frames] & truth.valid[:frames]):
            pieces.append(clip.section(start, stop))
            truths.append(truth.positions[start:stop])
            inside = (heard >= start / yardstick.fps) & (heard < stop / yardstick.fps)
            onsets.append(heard[inside] - start / yardstick.fps)
    if not pieces:
        raise CospeechError(f"{row}: no valid frame in any test clip; look at what was captured")
    found = _of_latents(pieces, yardstick)
    found |= _of_beats(pieces, onsets, yardstick) | {columns.BC_RELEASED: (_compatible_bc(clips, yardstick), np.nan)}
    found |= _of_genea(pieces, truths, yardstick.fps)
    attributes = {
        "fps": yardstick.fps, "beat_threshold": yardstick.threshold, "beat_sigma": yardstick.sigma,
        "low_pass": LOW_PASS, "window_frames": FRAMES, "window_stride": STRIDE, "clips": len(clips),
    }  # fmt: skip
    attributes |= {f"ruler_{name}_sha256": ruler.sha256 for name, ruler in yardstick.rulers.items()}
    return Judgement(row, run, found, attributes)


def _of_latents(pieces, yardstick):
    """{metric: (value, deviation)}: FGD and diversity by every ruler."""
    found = {}
    for name, ruler in yardstick.rulers.items():
        latents, (test, train) = _latents(ruler, pieces), yardstick.latents[name]
        if min(len(latents), len(test), len(train)) < 2:
            notice(f"test clips hold fewer than two windows of {FRAMES} frames, so FGD and diversity do not apply")
            continue
        draws = [metrics.diversity(latents, seed=yardstick.seed + i, norm=1) for i in range(DRAWS)]
        for fgd, others in ((columns.FGD_BY_NET[name], test), (columns.FGD_TRAIN_BY_NET[name], train)):
            distance = metrics.frechet_distance(latents, others)
            found[fgd] = round(distance, 9), np.nan  # so that rounding does not stand for a distance
        found[columns.DIVERSITY_BY_NET[name]] = mean_and_deviation(draws)
        batches = metrics.diversity_of_batches(latents, seed=yardstick.seed)
        found[columns.DIVERSITY_BATCHES_BY_NET[name]] = batches, np.nan
        found[columns.WINDOWS] = len(latents), np.nan
    return found


def _of_beats(pieces, onsets, yardstick):
    """{metric: (value, nan)}: beat consistency by every threshold, and of low-passed motion, without ripple."""
    changes = _angle_changes(pieces)
    ways = {columns.MEASURED: (changes, yardstick.threshold)}
    ways |= {data: (changes, threshold) for data, threshold in beats.PUBLISHED.items()}
    ways[columns.LOW_PASSED] = _angle_changes([low_passed(piece, LOW_PASS) for piece in pieces]), yardstick.threshold
    seconds = sum(piece.frames for piece in pieces) / yardstick.fps
    found = {}
    for way, (changes, threshold) in ways.items():
        bc = beats.beat_consistency(
            changes, onsets, yardstick.maac, threshold=threshold, sigma=yardstick.sigma, fps=yardstick.fps
        )
        found[columns.BC[way]] = bc.with_still, np.nan
        found[columns.BC_WITHOUT_STILL[way]] = bc.without_still, np.nan
        found[columns.BC_EXCESS[way]] = bc.excess, np.nan
        found[columns.BC_BEAT_RATE[way]] = bc.beats / seconds, np.nan
        if way == columns.MEASURED:
            found |= {columns.CLIPS_SILENT: (bc.silent, np.nan), columns.CLIPS_STILL: (bc.still, np.nan)}
            found[columns.ONSETS] = bc.onsets, np.nan
    return found


def _angle_changes(clips):
    table = level_table(ANGLES)
    return [beats.angle_changes(clip_vectors(clip, table), table) for clip in clips]


def _compatible_bc(clips, yardstick):
    """BC of the windows of whole clips, as released code has it."""
    table, changes, onsets = level_table(ANGLES), [], []
    for name, clip in clips.items():
        turns = beats.angle_changes(clip_vectors(clip, table), table)
        starts = range(0, clip.frames - FRAMES + 1, STRIDE)
        pairs = list(zip(starts, yardstick.heard[name].windows, strict=False))  # mismatched clips may be shorter
        changes += [turns[start : start + FRAMES - 1] for start, _ in pairs]
        onsets += [heard for _, heard in pairs]
    return beats.released_beat_consistency(changes, onsets, yardstick.maac, sigma=yardstick.sigma, fps=yardstick.fps)


def _of_genea(pieces, truths, fps):
    motions = [piece.positions for piece in pieces]
    groups = [[i for i, piece in enumerate(pieces) if piece.subject == subject] for subject in _subjects(pieces)]
    correlations = [genea.cca_global([motions[i] for i in group], [truths[i] for i in group]) for group in groups]
    return {
        columns.GENEA_JERK: genea.average_jerk(motions, fps),
        columns.GENEA_ACCELERATION: genea.average_acceleration(motions, fps),
        columns.GENEA_HELLINGER_SPEED: (genea.hellinger(motions, truths, 1, fps), np.nan),
        columns.GENEA_HELLINGER_ACCELERATION: (genea.hellinger(motions, truths, 2, fps), np.nan),
        columns.GENEA_CCA_GLOBAL: (np.mean(correlations), np.nan),
        columns.GENEA_CCA_PER_CLIP: (genea.cca_per_clip(motions, truths), np.nan),
    }


def _latents(ruler, clips):
    return np.concatenate([ruler.latents(clip_vectors(clip, ruler.table)) for clip in clips])


def _subjects(clips):
    return list(dict.fromkeys(clip.subject for clip in clips))


def _mean_pose(clips):
    positions = np.concatenate([clip.positions for clip in clips]).mean(axis=0)
    turns = [clip.rotation for clip in clips if clip.rotation is not None]
    return positions, np.concatenate(turns).mean(axis=0) if turns else None


def _held(clip, positions, rotation):
    turn = None if rotation is None else np.repeat(rotation[None], clip.frames, axis=0)
    return _moving(clip, np.repeat(positions[None], clip.frames, axis=0), turn)


def _frames(clip, which):
    return _moving(clip, clip.positions[which], None if clip.rotation is None else clip.rotation[which])


def _moving(clip, positions, rotation):
    return Clip(clip.subject, clip.clip, clip.fps, positions, clip.features, clip.valid, rotation=rotation)


def _mismatched(truth, groups, k):
    """{id: the motion to show under its speech} for the k-th way to mismatch."""
    made = {}
    for names in groups.values():
        for i, name in enumerate(names):
            if len(names) == 1:
                made[name] = _frames(truth[name], np.roll(np.arange(truth[name].frames), truth[name].frames // 2))
                continue
            other = names[(i + 1 + (k - 1) % (len(names) - 1)) % len(names)]
            made[name] = truth[other].section(0, min(truth[other].frames, truth[name].frames))
    return made
