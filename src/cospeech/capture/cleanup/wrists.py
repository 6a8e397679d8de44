"""Wrists where the hands are: a hand's root is seen larger than the body's wrist, in a crop of its own."""

from cospeech.capture.cleanup.gates import flat_fit
from cospeech.capture.cleanup.stretch import SIDES
from cospeech.skeleton import BODY, UPPER55


def wrists_at_hands(observed, believed):
    """Positions (F, 55, 3) of `Observations`, wrists moved, across the picture alone, to the roots of their hands.

    believed (F, 55) bool: where either is not believed, or fewer than three joints of the body tell how large it is in
    the picture, the wrist stays. Their depth stays the body's; clean-up gives the forearm its length back.
    """
    positions = observed.positions.copy()
    body = believed[:, BODY]
    _, _, scale = flat_fit(positions[:, BODY], observed.pixels[:, BODY], body)
    sized = (body.sum(axis=1) >= 3) & (scale > 0)
    for side in SIDES:
        wrist, root = UPPER55.joints(f"{side}_wrist", f"{side}_hand_root")
        known = sized & believed[:, wrist] & believed[:, root] & observed.pixels[:, root].any(axis=1)
        step = (observed.pixels[known, root] - observed.pixels[known, wrist]) / scale[known, None]
        positions[known, wrist, :2] += step * [1.0, -1.0]
    return positions
