"""One row of the results: a model, or a baseline, judged on the test clips of one subject.

Every row goes through the same low-pass, the same pieces of time and the same reference, so rows can be compared.
"""

from dataclasses import dataclass, replace

import numpy as np

from cospeech.errors import CospeechError, notice
from cospeech.evaluation import columns
from cospeech.evaluation.columns import METRICS
from cospeech.evaluation.metrics import gesture_metrics as metrics
from cospeech.evaluation.metrics.fgd import FRAMES
from cospeech.evaluation.metrics.synchrony import SpeechToSpeed
from cospeech.evaluation.result import BASELINES, Evaluation
from cospeech.formats.result_table import mean_and_deviation

# Of motion beats. The published 0.03 lets ripples through that carry no timing: at 0.1 the truth stands farther above
# chance, on motion capture and on the demo speakers alike (docs/evaluation.md).
BEAT_THRESHOLD = 0.1
DRAWS = 10  # of the pairs of diversity, as in HA2G appendix G.3


@dataclass
class Take:
    """A motion (T, 55, 3), already low-passed, and the speech it is judged against; `onsets` None: no sound at hand."""

    positions: np.ndarray
    features: np.ndarray
    valid: np.ndarray
    onsets: np.ndarray | None
    fps: float

    @classmethod
    def of(cls, clip, sigma, onsets=None):
        """A clip's motion, `low_passed`, under its own speech."""
        return cls(low_passed(clip, sigma).positions, clip.features, clip.valid, onsets, clip.fps)

    def cut(self, start, stop):
        """Frames start..stop as a Take of its own."""
        onsets = self.onsets
        if onsets is not None:
            inside = (onsets >= start / self.fps) & (onsets < stop / self.fps)
            onsets = onsets[inside] - start / self.fps
        part = slice(start, stop)
        return Take(self.positions[part], self.features[part], self.valid[part], onsets, self.fps)

    def with_speech_of(self, other):
        """This motion under another take's speech, as long as the shorter of the two."""
        frames = min(len(self.positions), len(other.positions))
        return replace(self.cut(0, frames), features=other.features[:frames], onsets=other.cut(0, frames).onsets)

    def pieces(self):
        """Its `stretches` as Takes."""
        return [self.cut(start, stop) for start, stop in stretches(self.valid)]


def stretches(valid):
    """(start, stop) of the runs of at least 34 valid frames, or of the longest where all are shorter; [] if none is."""
    runs = np.flatnonzero(np.diff(np.concatenate([[0], valid, [0]]))).reshape(-1, 2)
    longest = runs[np.argsort(runs[:, 0] - runs[:, 1])][:1]
    return [run for run in runs if run[1] - run[0] >= FRAMES] or list(longest)


def low_passed(clip, sigma):
    """The clip with joints and head rotation after a Gaussian of `sigma` frames in all.

    Variances add: of what its generator did already, only the rest is done.
    """
    rest = np.sqrt(max(sigma**2 - float(clip.extra.get("smoothing", 0.0)) ** 2, 0.0))
    rotation = None if clip.rotation is None else metrics.low_pass(clip.rotation, rest)
    return replace(clip, positions=metrics.low_pass(clip.positions, rest), rotation=rotation)


@dataclass
class Reference:
    """What every row of a subject is compared with; make it once with `build`."""

    subject: str
    takes: dict
    feature_net: object
    mean_pose: np.ndarray
    maac: np.ndarray
    speeds: np.ndarray
    predictor: SpeechToSpeed
    test_latents: np.ndarray
    train_latents: np.ndarray
    fps: float
    sigma: float
    threshold: float
    seed: int

    @classmethod
    def build(cls, truth, train, feature_net, audio, *, sigma=1.5, threshold=BEAT_THRESHOLD, seed=0):
        """From the test part, the training part and the feature network.

        Parameters
        ----------
        truth : {clip id: Clip}, the test part; its `valid` holds for every row.
        train : list of Clip, the training part: mean pose, MAAC, speeds and synchrony are measured on it alone.
        feature_net : FeatureNet trained on `train`.
        audio : {clip id: (samples (N,), rate)} of the test clips; a clip without has no beat consistency.
        sigma : low-pass in frames for every motion; threshold : of motion beats; seed : of the pairs of diversity.
        """
        from cospeech.speech import speech_onsets

        if not train or not any(clip.valid.any() for clip in truth.values()):
            raise CospeechError("evaluation: the training or the test part has no valid frame; change 'split:'")
        fps = train[0].fps
        takes = {}
        for name in sorted(truth):
            clip = truth[name]
            onsets = speech_onsets(*audio[name]) if name in audio else None
            takes[name] = Take.of(clip, sigma, onsets)
        takes = {name: take for name, take in takes.items() if _usable(name, take)}
        pieces = [p for clip in train for p in Take.of(clip, sigma).pieces()]
        motions = [piece.positions for piece in pieces]
        return cls(
            subject=train[0].subject, takes=takes, feature_net=feature_net,
            mean_pose=np.concatenate(motions).mean(axis=0), maac=metrics.mean_angle_change(motions),
            speeds=metrics.speed_histogram(motions, fps),
            predictor=SpeechToSpeed.fit([piece.features for piece in pieces], motions, fps),
            test_latents=_latents(feature_net, [p for take in takes.values() for p in take.pieces()]),
            train_latents=_latents(feature_net, pieces),
            fps=fps, sigma=sigma, threshold=threshold, seed=seed,
        )  # fmt: skip

    def of_model(self, clips):
        """{clip id: Clip} that a model made for the test clips -> {clip id: Take} under the test clips' speech."""
        missing = [name for name in self.takes if name not in clips]
        if missing:
            raise CospeechError(f"{self.subject}: no generated clip for test clip {missing[0]!r}; synthesise it first")
        takes = {}
        for name, truth in self.takes.items():
            clip = clips[name]
            if clip.frames != len(truth.positions) or clip.fps != truth.fps:
                raise CospeechError(
                    f"{self.subject}/{name}: the clip of {clip.generator or 'a model'} has {clip.frames} frames at "
                    f"{clip.fps} fps, its truth {len(truth.positions)} at {truth.fps}; make it from the same audio"
                )
            takes[name] = replace(truth, positions=low_passed(clip, self.sigma).positions)
        return takes

    def of_baseline(self, row):
        """The takes of one of `BASELINES`."""
        if row == "ground_truth":
            return self.takes
        if row == "mean_pose":
            still = lambda take: np.broadcast_to(self.mean_pose, take.positions.shape)  # noqa: E731
            return {name: replace(take, positions=still(take)) for name, take in self.takes.items()}
        takes = self.takes
        if len(takes) == 1:  # a single clip: its two halves exchange their speech
            ((name, take),) = takes.items()
            half = len(take.positions) // 2
            takes = {f"{name} first half": take.cut(0, half), f"{name} second half": take.cut(half, 2 * half)}
        names = list(takes)
        return {a: takes[b].with_speech_of(takes[a]) for a, b in zip(names, names[1:] + names[:1], strict=True)}


def evaluate_model(row, clips, reference):
    """Judge {clip id: generated Clip} for every test clip; return the Evaluation named `row`."""
    seeds = {int(clip.extra.get("seed", 0)) for clip in clips.values()}
    return _evaluate(row, reference.of_model(clips), reference, seed=min(seeds, default=0))


def evaluate_baseline(row, reference):
    """Judge one of `BASELINES`.

    ground_truth : the test motion itself. mismatched : each test motion under the next test clip's speech, in the order
    of their names (a single clip: its two halves exchanged). mean_pose : the training part's mean, held.
    """
    if row not in BASELINES:
        raise CospeechError(f"baseline {row!r} is not known; known: {', '.join(BASELINES)}")
    return _evaluate(row, reference.of_baseline(row), reference, seed=0)


def _evaluate(row, takes, reference, seed):
    pieces = {name: take.pieces() for name, take in takes.items()}
    values = np.array([_combined(pieces[name], reference) for name in takes])
    latents = _latents(reference.feature_net, [piece for parts in pieces.values() for piece in parts])
    of_row = _distribution_metrics(latents, reference)
    mean, deviation = mean_and_deviation(np.ma.masked_invalid(values))
    for name, (score, spread) in of_row.items():
        column = list(METRICS).index(name)
        mean[column], deviation[column] = score, spread
    net = reference.feature_net
    attributes = {
        "fps": reference.fps, "low_pass_sigma": reference.sigma, "beat_threshold": reference.threshold,
        "window_frames": FRAMES, "windows": len(latents), "test_windows": len(reference.test_latents),
        "train_windows": len(reference.train_latents), "feature_net_sha256": net.sha256,
    }  # fmt: skip
    frames = np.array([len(take.positions) for take in takes.values()])
    return Evaluation(reference.subject, row, seed, list(takes), frames, values, mean, deviation, attributes)


def _distribution_metrics(latents, reference):
    """{metric: (value, deviation)} of the metrics that compare whole sets of windows."""
    if min(len(latents), len(reference.test_latents)) < 2:
        notice(f"{reference.subject}: test clips hold fewer than two windows of {FRAMES} frames, so FGD does not apply")
        return {}
    draws = [metrics.diversity(latents, seed=reference.seed + i) for i in range(DRAWS)]
    return {
        columns.FGD: (metrics.frechet_distance(latents, reference.test_latents), np.nan),
        columns.FGD_TRAIN: (metrics.frechet_distance(latents, reference.train_latents), np.nan),
        columns.DIVERSITY: mean_and_deviation(draws),
    }


def _combined(pieces, reference):
    """The metrics of one clip (M,): of its pieces, weighted by their frames; NaN for metrics of whole sets."""
    rows = np.ma.masked_invalid([_clip_metrics(piece, reference) for piece in pieces])
    return np.ma.average(rows, axis=0, weights=[len(piece.positions) for piece in pieces]).filled(np.nan)


def _clip_metrics(take, reference):
    positions, fps = np.asarray(take.positions, np.float64), take.fps
    if len(positions) < 2:
        return [np.nan] * len(METRICS)
    beats = metrics.motion_beats(positions, fps, reference.threshold, reference.maac)
    heights, speeds = metrics.wrist_heights(positions), metrics.wrist_speeds(positions, fps)
    found = {
        columns.BEAT_RATE: len(beats) * fps / len(positions),
        columns.SYNCHRONY: reference.predictor.synchrony(take.features, positions),
        columns.MOTION_VARIANCE: metrics.motion_variance(positions),
        columns.WRIST_SPEED_LEFT: speeds[:, 0].mean(),
        columns.WRIST_SPEED_RIGHT: speeds[:, 1].mean(),
        columns.WRIST_SPEED_SPREAD: speeds.std(axis=0).mean(),
        columns.WRIST_HEIGHT_LEFT: heights[:, 0].mean(),
        columns.WRIST_HEIGHT_RIGHT: heights[:, 1].mean(),
        columns.WRIST_HEIGHT_SPREAD: heights.std(axis=0).mean(),
        columns.WRIST_ASYMMETRY: metrics.wrist_asymmetry(positions).mean(),
        columns.SPEED_HELLINGER: metrics.hellinger(metrics.speed_histogram([positions], fps), reference.speeds),
        columns.ACCELERATION: metrics.acceleration(positions, fps),
        columns.JERK: metrics.jerk(positions, fps),
    }
    if take.onsets is not None:
        coverage = metrics.onset_coverage(beats, take.onsets)
        found[columns.BEAT_CONSISTENCY] = coverage
        found[columns.BEAT_EXCESS] = coverage - metrics.chance_coverage(beats, take.onsets, len(positions) / fps)
    return [found.get(name, np.nan) for name in METRICS]


def _latents(feature_net, pieces):
    return np.concatenate([feature_net.latents(piece.positions) for piece in pieces])


def _usable(name, take):
    if take.valid.any():
        return True
    notice(f"test clip {name}: no valid frame, so it is left out of the evaluation")
    return False
