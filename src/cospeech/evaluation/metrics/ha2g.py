"""The metrics of HA2G's Table 1: FGD, beat consistency and diversity over the test clips of all speakers at once.

Every row is judged on clips, so HA2G, its baselines and the generators of chapters 4 and 5 stand in one table. Motion
is judged as its generator leaves it, without a common low-pass, as the publication does; beats are found after one too.
"""

from dataclasses import dataclass

import numpy as np

from cospeech.errors import CospeechError, notice
from cospeech.evaluation import columns
from cospeech.evaluation.metrics import beats, genea
from cospeech.evaluation.metrics import gesture_metrics as metrics
from cospeech.evaluation.metrics.expressive import STRIDE
from cospeech.evaluation.metrics.fgd import FRAMES
from cospeech.evaluation.metrics.summary import DRAWS, SummaryMetrics
from cospeech.formats.result_table import mean_and_deviation
from cospeech.gestures.ha2g.dataset.bones import bone_vectors
from cospeech.gestures.ha2g.dataset.levels import level_table

ANGLES = "expressive43"  # the level table whose angles beats are found in
LOW_PASS = SummaryMetrics.SIGMA  # frames: what chapter 4's models are smoothed with, and every row of the summary
SILENCE = np.zeros(0)


@dataclass
class HA2GMetrics:
    """Fitted to a training part: maac (P,) of every included angle, and the threshold of motion beats."""

    maac: np.ndarray
    threshold: float

    SIGMA = 0.0  # frames: no low-pass

    @classmethod
    def fit(cls, pieces, fps, threshold=None):
        """From the Takes of the training part; threshold : of motion beats, None measures it."""
        del fps
        changes = _angle_changes(pieces)
        maac = beats.mean_angle_change(changes)
        return cls(maac, beats.beat_threshold(changes, maac) if threshold is None else threshold)

    def measure(self, row, takes, reference):
        """{name: Take} -> ({metric: (value, deviation)} of all clips, None as none is of single clips, attributes)."""
        pieces = [piece for take in takes.values() for piece in take.pieces()]
        if not pieces:
            raise CospeechError(f"{row}: no valid frame in any test clip; look at what was captured")
        found = _of_latents(pieces, reference) | self._of_beats(pieces, reference.fps)
        found |= {columns.BC_RELEASED: (self._released_bc(takes), np.nan)} | _of_genea(pieces, reference.fps)
        attributes = {
            "fps": reference.fps,
            "beat_threshold": self.threshold,
            "beat_sigma": beats.SIGMA,
            "low_pass": LOW_PASS,
            "window_frames": FRAMES,
            "window_stride": STRIDE,
        }
        attributes |= {f"feature_net_{name}_sha256": net.sha256 for name, net in reference.nets.items()}
        return found, None, attributes

    def _of_beats(self, pieces, fps):
        """{metric: (value, nan)}: beat consistency by every threshold, and of low-passed motion, without ripple."""
        changes, onsets = _angle_changes(pieces), [SILENCE if p.onsets is None else p.onsets for p in pieces]
        ways = {columns.MEASURED: (changes, self.threshold)}
        ways |= {data: (changes, threshold) for data, threshold in beats.PUBLISHED.items()}
        ways[columns.LOW_PASSED] = _angle_changes([piece.low_passed(LOW_PASS) for piece in pieces]), self.threshold
        seconds = sum(len(piece.positions) for piece in pieces) / fps
        found = {}
        for way, (changes, threshold) in ways.items():
            bc = beats.beat_consistency(changes, onsets, self.maac, threshold=threshold, fps=fps)
            found[columns.BC[way]] = bc.with_still, np.nan
            found[columns.BC_WITHOUT_STILL[way]] = bc.without_still, np.nan
            found[columns.BC_EXCESS[way]] = bc.excess, np.nan
            found[columns.BC_BEAT_RATE[way]] = bc.beats / seconds, np.nan
            if way == columns.MEASURED:
                found |= {columns.CLIPS_SILENT: (bc.silent, np.nan), columns.CLIPS_STILL: (bc.still, np.nan)}
                found[columns.ONSETS] = bc.onsets, np.nan
        return found

    def _released_bc(self, takes):
        """BC of the windows of whole clips, as released code has it."""
        changes, onsets = [], []
        for take, turns in zip(takes.values(), _angle_changes(takes.values()), strict=True):
            for start in range(0, len(take.positions) - FRAMES + 1, STRIDE):
                changes.append(turns[start : start + FRAMES - 1])
                onsets.append(SILENCE if take.sound is None else take.sound.window_onsets(start, take.fps))
        return beats.released_beat_consistency(changes, onsets, self.maac, fps=next(iter(takes.values())).fps)


def _angle_changes(takes):
    table = level_table(ANGLES)
    return [beats.angle_changes(bone_vectors(take.positions, take.rotation, table), table) for take in takes]


def _of_latents(pieces, reference):
    """{metric: (value, deviation)}: FGD and diversity by every feature network."""
    found = {}
    for name, net in reference.nets.items():
        own = np.concatenate([net.latents(piece.positions, piece.rotation) for piece in pieces])
        test, train = reference.latents[name]
        if min(len(own), len(test), len(train)) < 2:
            notice(f"test clips hold fewer than two windows of {FRAMES} frames, so FGD and diversity do not apply")
            continue
        draws = [metrics.diversity(own, seed=reference.seed + i, norm=1) for i in range(DRAWS)]
        for fgd, others in ((columns.FGD_BY_NET[name], test), (columns.FGD_TRAIN_BY_NET[name], train)):
            # Rounded, so that rounding does not stand for a distance.
            found[fgd] = round(metrics.frechet_distance(own, others), 9), np.nan
        found[columns.DIVERSITY_BY_NET[name]] = mean_and_deviation(draws)
        batches = metrics.diversity_of_batches(own, seed=reference.seed)
        found[columns.DIVERSITY_BATCHES_BY_NET[name]] = batches, np.nan
        found[columns.WINDOWS] = len(own), np.nan
    return found


def _of_genea(pieces, fps):
    motions, truths = [piece.positions for piece in pieces], [piece.recorded for piece in pieces]
    groups = {}
    for i, piece in enumerate(pieces):
        groups.setdefault(piece.speaker, []).append(i)
    correlations = [genea.cca_global([motions[i] for i in own], [truths[i] for i in own]) for own in groups.values()]
    return {
        columns.GENEA_JERK: genea.average_jerk(motions, fps),
        columns.GENEA_ACCELERATION: genea.average_acceleration(motions, fps),
        columns.GENEA_HELLINGER_SPEED: (genea.hellinger(motions, truths, 1, fps), np.nan),
        columns.GENEA_HELLINGER_ACCELERATION: (genea.hellinger(motions, truths, 2, fps), np.nan),
        columns.GENEA_CCA_GLOBAL: (np.mean(correlations), np.nan),
        columns.GENEA_CCA_PER_CLIP: (genea.cca_per_clip(motions, truths), np.nan),
    }
