"""The phases of the chosen gestures as key poses of each arm: preparation, stroke, hold, retraction or the next one."""

import numpy as np

from cospeech.demo.gesture import SHORTEST_PREPARATION
from cospeech.demo.lexicon import ANGLES, POSITION, SHAPE, lexicon

PREPARATION = (0.24, 0.50)  # s, and s per arm length travelled
RETRACTION = (0.50, 0.55)
REST_CHANGE = (1.0, 0.2)  # s, and its random part
HOME = np.array([0.05, -0.48, 0.60])  # the gesture space's middle, about which strokes are scaled
MINIMUM_JERK_PEAK = 1.875  # peak over mean speed of a minimum-jerk movement
FLEX = ANGLES.start + 1


class ArmTrack:
    """The key poses of one arm over a take, grown in order of time; `keys` gives them as arrays."""

    def __init__(self, side, parameters, arm, rests, rng):
        self.side, self.style, self.rng = side, parameters["gestures"], rng
        self.rest_times, self.rest_names = rests
        self.fastest = self.style["speed"] / arm
        self.asymmetry = rng.normal(0, [0.015] * 3 + [4.0] * 4 + [0.03] * 8)
        self.rows = [(0.0, self.rest(0.0), False)]
        self.resting = True

    @property
    def time(self):
        """Seconds of the last key."""
        return self.rows[-1][0]

    def rest(self, time):
        """(15,) the rest pose that the schedule gives for a time."""
        pose = self.rest_names[int(np.searchsorted(self.rest_times, time, side="right")) - 1]
        return lexicon().rests[pose] + self.asymmetry

    def add(self, time, key, via=False):
        """Append a key; one that cannot be reached at the speaker's fastest speed is drawn towards the last one."""
        last_time, last, _ = self.rows[-1]
        time = max(time, last_time + 1 / 60)
        key = key.copy()
        way = key[POSITION] - last[POSITION]
        distance = np.linalg.norm(way)
        reachable = self.fastest * (time - last_time) / MINIMUM_JERK_PEAK
        if distance > reachable:
            key[POSITION] = last[POSITION] + way * reachable / distance
        self.rows.append((time, key, via))

    def stay(self, until):
        """Keep the last pose until a time."""
        if until > self.time:
            self.add(until, self.rows[-1][1])

    def idle(self, until):
        """Stay at rest until a time, changing the rest pose when the schedule does."""
        for time in self.rest_times:
            if self.time <= time < until - 1.5:
                self.stay(time)
                self.add(time + REST_CHANGE[0] + REST_CHANGE[1] * self.rng.random(), self.rest(time))
        self.stay(until)

    def retract(self, start):
        """Hold, sinking a little, until `start`; then go to the rest pose. Returns the time of arrival."""
        sunk = self.rows[-1][1].copy()
        sunk[POSITION] += self.rng.normal(0, 0.012, 3) - [0, 0.015, 0]
        self.add(start, sunk)
        arrival = start + self.travel(RETRACTION, self.rest(start))
        self.add(arrival, self.rest(start))
        return self.time

    def travel(self, law, towards):
        """Seconds for the way from the last pose to another by a (constant, per arm length) law."""
        distance = np.linalg.norm(towards[POSITION] - self.rows[-1][1][POSITION])
        return (law[0] + law[1] * distance) * self.style["tempo"]

    def keys(self):
        """times (K,), values (K, 15), via (K,) bool."""
        times, values, via = zip(*self.rows, strict=True)
        return np.array(times), np.array(values), np.array(via)


def lay_out(gestures, side, track, duration):
    """Give the gestures of one side their keys on an ArmTrack and, on the way, their phases.

    A preparation starts as late as its distance allows; strokes closer than the speaker's `chain` are joined.
    """
    mine = [g for g in gestures if g.hand in (side, "both")]
    performances = [_performed(gesture, side, track) for gesture in mine]
    starts = [times[0] for times, _, _ in performances] + [duration + 9.0]
    for i, (gesture, (times, keys, via)) in enumerate(zip(mine, performances, strict=True)):
        begin = max(track.time, times[0] - track.travel(PREPARATION, keys[0]))
        if i and not track.resting:
            track.stay(begin)
            _note(mine[i - 1], side, retract=begin, end=begin)
        else:
            track.idle(begin)
        begin = track.time
        apex = int(np.flatnonzero(lexicon().strokes[gesture.form].times == 0)[0])
        direct = times[0] - begin < SHORTEST_PREPARATION
        for j in range(apex if direct else 0, len(times)):
            if j <= apex or times[j] < starts[i + 1] - 0.05:
                track.add(times[j], keys[j], via[j] and not direct)
        _note(gesture, side, prep=begin, stroke=max(times[0], begin), hold=track.time)
        _finish(gesture, side, track, starts[i + 1], duration)
    track.idle(duration)


def _performed(gesture, side, track):
    """times (K,), keys (K, 15) and via (K,) of one performance: sized, varied, and this hand's lag."""
    rng, style, stroke = track.rng, track.style, lexicon().strokes[gesture.form]
    keys = stroke.keys[side].copy()
    size = 1.0 + 0.35 * (gesture.size - 1.0) if stroke.fixed else gesture.size
    keys[:, POSITION] = HOME + (keys[:, POSITION] - HOME) * size
    keys[:, POSITION] += rng.normal(0, 0.022, 3) + rng.normal(0, 0.008, (len(keys), 3))
    keys[:, 1] += style["height"]
    keys[:, FLEX] *= 0.5 + 0.5 * size
    keys[:, ANGLES] += rng.normal(0, 5.0, 4)
    keys[:, SHAPE] = np.clip(keys[:, SHAPE] + rng.normal(0, 0.04, 8), 0, 1)
    lag = rng.normal(0, 0.015) if gesture.hand == "both" and side == "left" else 0.0
    pace = style["tempo"] * np.exp(rng.normal(0, 0.08)) * (1.15 - 0.3 * gesture.strength)
    return gesture.apex + lag + stroke.times * pace, keys, stroke.via


def _finish(gesture, side, track, next_start, duration):
    """Hold and retract after a stroke where there is time for it before the next one; else leave the arm raised."""
    hold = lexicon().strokes[gesture.form].hold * track.style["hold"] * track.rng.gamma(4, 0.25)
    back, lift = track.travel(RETRACTION, track.rest(track.time)), track.travel(PREPARATION, track.rest(track.time))
    enough = track.time + hold + back + lift < next_start
    track.resting = enough and next_start - track.time > track.style["chain"]
    if track.resting:
        start = min(track.time + hold, max(duration - back, track.time))
        _note(gesture, side, retract=start, end=track.retract(start))


def _note(gesture, side, **times):
    """Write phases down; of a two-handed gesture those of the right hand."""
    if side == "right" or gesture.hand == "left":
        for name, time in times.items():
            setattr(gesture, name, float(time))
