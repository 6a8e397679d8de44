"""What generated motion is compared with: the test part and the training part of one speaker, or of many."""

from dataclasses import dataclass, replace

import numpy as np

from cospeech.errors import CospeechError, notice
from cospeech.evaluation.metrics.fgd import OURS, FeatureNet
from cospeech.evaluation.metrics.summary import SummaryMetrics
from cospeech.evaluation.metrics.wholeness import window_borders
from cospeech.evaluation.takes import Take


@dataclass
class Reference:
    """Made once with `build`; every row is judged against it.

    subject : the speaker, or what the speakers are called together. takes : {id: Take}, the test part under its own
    speech. nets : {name: FeatureNet}. latents : {name: (of the test part (N, L), of the training part (M, L))}.
    mean_poses : {speaker: ((55, 3), head rotation (3,) or None)} of the training part; of speakers who are not in it,
    everyone's. metrics : what is measured, fitted to the training part. sigma : low-pass in frames of every motion.
    seed : of random draws.
    """

    subject: str
    takes: dict
    nets: dict
    latents: dict
    mean_poses: dict
    metrics: object
    fps: float
    sigma: float
    seed: int

    @classmethod
    def build(
        cls, truth, train, nets, audio, *, metrics=SummaryMetrics, sigma=None, threshold=None, seed=0, subject=None
    ):
        """From the test part, the training part and feature networks trained on the latter.

        Parameters
        ----------
        truth : {clip id: Clip}, the test part; its `valid` holds for every row.
        train : list of Clip, the training part: what is measured is fitted to it alone.
        nets : FeatureNet, or {name: FeatureNet}.
        audio : {clip id: (samples (N,), rate)} of the test clips; a clip without has no beat consistency.
        metrics : SummaryMetrics, HA2GMetrics or MotionMetrics.
        sigma : low-pass in frames for every motion; threshold : of motion beats; None for the metrics' own.
        seed : of the pairs of diversity, and of shuffled frames. subject : None for the first speaker's name.
        """
        if not truth or not train:
            raise CospeechError("evaluation: the training or the test part has no clip; change 'split:'")
        fps, sigma = train[0].fps, metrics.SIGMA if sigma is None else sigma
        odd = next((name for name, clip in truth.items() if clip.fps != fps), None)
        if odd:
            raise CospeechError(f"{odd}: {truth[odd].fps} frames a second, the training part {fps}; use one rate")
        takes = {name: Take.of(truth[name], sigma, audio.get(name)) for name in sorted(truth)}
        takes = {name: take for name, take in takes.items() if _usable(name, take)}
        pieces = [piece for clip in train for piece in Take.of(clip, sigma).pieces()]
        if not takes or not pieces:
            raise CospeechError(
                "evaluation: the training or the test part has no valid frame; change 'split:' or look at the captures"
            )
        nets = {OURS: nets} if isinstance(nets, FeatureNet) else nets
        test = [piece for take in takes.values() for piece in take.pieces()]
        compared = {name: (latents(net, test), latents(net, pieces)) for name, net in nets.items()}
        poses = {one: _mean_pose([p for p in pieces if p.speaker == one] or pieces) for one in speakers(takes.values())}
        fitted = metrics.fit(pieces, fps, threshold)
        return cls(subject or train[0].subject, takes, nets, compared, poses, fitted, fps, sigma, seed)

    def under_speech(self, row, clips):
        """{clip id: Clip} that a model made for the test clips -> {clip id: Take} under the test clips' speech.

        CospeechError for a test clip that is missing or of another length.
        """
        takes = {}
        for name, truth in self.takes.items():
            if name not in clips:
                raise CospeechError(
                    f"{self.subject}: {row}: no generated clip for test clip {name!r}; synthesise it first"
                )
            clip = clips[name]
            if clip.frames != len(truth.positions) or clip.fps != truth.fps:
                raise CospeechError(
                    f"{self.subject}: {row}: {name}: {clip.frames} frames at {clip.fps} fps, its truth "
                    f"{len(truth.positions)} at {truth.fps}; make it from the same audio"
                )
            done = float(clip.extra.get("smoothing", 0.0))
            made = truth.showing(clip.positions, clip.rotation, done).low_passed(self.sigma)
            takes[name] = replace(made, borders=window_borders(clip.frames, clip.trace, clip.fps))
        return takes


def latents(net, pieces):
    """Latents of all windows of some Takes: (N, L)."""
    return np.concatenate([net.latents(piece.positions, piece.rotation) for piece in pieces])


def speakers(takes):
    """Whose motion some Takes are, in their order."""
    return list(dict.fromkeys(take.speaker for take in takes))


def _mean_pose(pieces):
    turns = [piece.rotation for piece in pieces if piece.rotation is not None]
    positions = np.concatenate([piece.positions for piece in pieces]).mean(axis=0)
    return positions, np.concatenate(turns).mean(axis=0) if turns else None


def _usable(name, take):
    if take.valid.any():
        return True
    notice(f"test clip {name}: no valid frame, so it is left out of the evaluation")
    return False
