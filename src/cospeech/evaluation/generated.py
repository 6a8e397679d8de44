"""What a generator makes of the speech of test clips: the one place where evaluation lets a generator speak."""

from dataclasses import replace

import numpy as np

from cospeech.gestures.generator import smoothing_of
from cospeech.synthesis import finished


def generate_clips(generator, truth, row, seed=0, smoothing=None, **options):
    """Motion for the speech of {clip id: Clip}, finished as `synthesize` does: {clip id: Clip}.

    generator : has `generate(features (T, 28), *, seed, ...) -> Motion`. row : what the motion's generator is called.
    smoothing : sigma in frames; None for what is usual for `row`. options : of the generator.
    """
    sigma = smoothing_of(row) if smoothing is None else smoothing
    made = {}
    for name, clip in truth.items():
        motion = finished(generator.generate(clip.features, seed=seed, **options), sigma)
        made[name] = replace(
            clip,
            positions=motion.positions.astype(np.float32),
            rotation=motion.rotation,
            expression=motion.expression,
            face_model=motion.face_model,
            generator=row,
            extra={"seed": seed, "smoothing": sigma},
            trace=motion.trace,
        )
    return made
