"""The search on speech that is still being spoken."""

import numpy as np

from cospeech.clip import FEATURES
from cospeech.matching.database.descriptors import LOOKAHEAD, WINDOW
from cospeech.matching.search.masks import Masks
from cospeech.matching.search.match import STEP, Match
from cospeech.matching.search.queries import check_options, checked, tell

COMPILED_CLIPS = 500  # from which compiled kernels are used, as nobody knows how long the speech will be


class Stream:
    """Speech features in, gestures out, as they come. A window is out once 15 frames from its first have been fed.

    latency, latency_seconds : those 15 frames (1 s at 15 fps), the look-ahead of the audio feature; always the same.
    clip, frame, positions : everything so far.
    """

    latency = LOOKAHEAD + 1

    def __init__(self, matcher, k, mask, initial, seed, variant, exclude_take):
        check_options(np.array([k]), variant)
        self.matcher = matcher
        self._masks = Masks(matcher.database, mask, None)
        self._k, self._excluded = np.array([k]), np.array([matcher.span(exclude_take)], np.int64)
        self._pose = matcher.initial(initial, [seed], self._masks)
        self._step = matcher.stepper(variant, len(matcher.database) > COMPILED_CLIPS)
        self._features = np.zeros((0, FEATURES), np.float32)  # from the first frame of the next window on
        self._fed = 0
        self._found = np.zeros(0, STEP)

    def feed(self, features):
        """(n, 28) further speech features, any n -> Match of the windows that are now certain (perhaps none)."""
        features = checked(features, empty=True)
        self._features = np.concatenate([self._features, features])
        self._fed += len(features)
        return self._advance(max(0, (len(self._features) - LOOKAHEAD - 1) // WINDOW + 1))

    def finish(self):
        """The speech is over -> Match of the remaining windows, the last one cut to the speech's end."""
        return self._advance(-(-len(self._features) // WINDOW))

    @property
    def latency_seconds(self):
        """Seconds of speech from a window's first frame on that must be known before it is out."""
        return self.latency / self.matcher.database.fps

    @property
    def match(self):
        """Match of all windows so far."""
        return Match.of(self.matcher.database, self._found, min(self._fed, WINDOW * len(self._found)))

    clip = property(lambda self: self.match.clip)
    frame = property(lambda self: self.match.frame)
    positions = property(lambda self: self.match.positions)

    def _advance(self, windows):
        done, database = len(self._found), self.matcher.database
        frames = min(windows * WINDOW, len(self._features))
        audio = self.matcher.query_features(self._features, frames) if windows else ()
        for query in audio:
            found = self._step(self._masks, len(self._found), self._pose, query[None], self._k, self._excluded)
            self._found = np.concatenate([self._found, found])
            self._pose = database.pose_after(found["clip"], found["frame"])
        tell(self._found["unmasked"][done:], done)
        self._features = self._features[frames:]
        return Match.of(database, self._found[done:], frames)
