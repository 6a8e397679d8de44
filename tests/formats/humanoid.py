"""A small person written as BVH text, by hand and without the code under test."""

import numpy as np

FINGERS = {"Thumb": (3, -1, 3), "Index": (9.5, 0, 2.5), "Middle": (9.5, 0, 0), "Ring": (9, 0, -2), "Pinky": (8, 0, -4)}
SPINE = [
    ("Hips", None, (0, 90, 0)),
    ("Spine", "Hips", (0, 9, -2)),
    ("Spine1", "Spine", (0, 9, 0)),
    ("Spine2", "Spine1", (0, 12, 0)),
    ("Spine3", "Spine2", (0, 12, 0)),
    ("Neck", "Spine3", (0, 18, 0)),
    ("Neck1", "Neck", (0, 5, 0)),
    ("Head", "Neck1", (0, 5, 0)),
    ("HeadEnd", "Head", (0, 12, 0)),
]
CARPALS = {"Index": (3, 0, 1.5), "Ring": (3, 0, -1), "Pinky": (1, 0, -1)}  # BEAT only


def person(fingers=True, carpals=False):
    """Rows (name, parent, offset in cm), T-pose, y up, facing +z; `carpals` makes it the hierarchy of BEAT."""
    rows = list(SPINE)
    for side, x in (("Right", -1), ("Left", 1)):
        arm = [("Shoulder", (3, 11, 0)), ("Arm", (10, 0, 0)), ("ForeArm", (29, 0, 0)), ("Hand", (25, 0, 0))]
        leg = [("UpLeg", (11, 0, 0)), ("Leg", (0, -40, 0)), ("Foot", (0, -40, 0)), ("ToeBase", (0, -5, 15))]
        rows += _chain(side, x, arm, "Spine3") + _chain(side, x, leg, "Hips")
        if fingers:
            rows += _hand(side, x, carpals)
    return rows


def _chain(side, x, parts, parent):
    rows = []
    for name, (dx, dy, dz) in parts:
        rows.append((side + name, parent, (x * dx, dy, dz)))
        parent = side + name
    return rows


def _hand(side, x, carpals):
    rows, hand = [], f"{side}Hand"
    for finger, knuckle in FINGERS.items():
        parent, at = hand, np.zeros(3)
        if carpals and finger != "Middle":
            carrier = {"Thumb": "Index", "Pinky": "Ring"}.get(finger)
            if carrier:
                parent, at = hand + carrier, np.array(CARPALS[carrier], float)
            if finger in CARPALS:
                rows.append((hand + finger, parent, (x * CARPALS[finger][0], *CARPALS[finger][1:])))
                parent, at = hand + finger, at + CARPALS[finger]
        for i, (dx, dy, dz) in enumerate([np.array(knuckle) - at, (4, 0, 0), (3, 0, 0), (2, 0, 0)]):
            rows.append((f"{hand}{finger}{i + 1}", parent, (x * dx, dy, dz)))
            parent = f"{hand}{finger}{i + 1}"
    order = {name: i for i, (name, _, _) in enumerate(rows)}  # carriers before what hangs on them
    return sorted(rows, key=lambda row: (row[1] in order and order[row[1]] > order[row[0]], order[row[0]]))


def bvh_text(rows, frames, fps, angles=None, root=None, order="ZYX", scale=1.0, turn=None, frame_time=None):
    """BVH of `rows`; angles {joint: (T, 3) degrees in `order`}, root (T, 3), `scale` times centimetres.

    turn="z up" writes the same motion in axes x left, -y forward, z up: what turned about y turns about z, what
    turned about z turns the other way about -y.
    """
    angles, root = angles or {}, np.tile([0.0, 90.0, 0.0], (frames, 1)) if root is None else root
    z_up = turn == "z up"
    axes = [{"X": "X", "Y": "Z", "Z": "Y"}[a] if z_up else a for a in order]
    signs = np.array([-1.0 if z_up and a == "Z" else 1.0 for a in order])
    place = (lambda v: np.stack([v[..., 0], -v[..., 2], v[..., 1]], -1)) if z_up else np.asarray
    children = {name: [row for row in rows if row[1] == name] for name, _, _ in rows}
    lines, columns = ["HIERARCHY"], [place(root) * scale]

    def write(row, depth):
        name, parent, offset = row
        tab = "  " * depth
        lines.append(f"{tab}{'JOINT' if parent else 'ROOT'} {name}\n{tab}{{")
        lines.append(f"{tab}  OFFSET {' '.join(f'{v:.8f}' for v in place(np.array(offset, float)) * scale)}")
        channels = ["Xposition", "Yposition", "Zposition"] * (parent is None) + [f"{a}rotation" for a in axes]
        lines.append(f"{tab}  CHANNELS {len(channels)} {' '.join(channels)}")
        columns.append(angles.get(name, np.zeros((frames, 3))) * signs)
        for child in children[name]:
            write(child, depth + 1)
        if not children[name]:
            lines.append(f"{tab}  End Site\n{tab}  {{\n{tab}    OFFSET 0 0 0\n{tab}  }}")
        lines.append(f"{tab}}}")

    write(rows[0], 0)
    lines.append(f"MOTION\nFrames: {frames}\nFrame Time: {frame_time or 1 / fps}")
    lines += [" ".join(f"{v:.8f}" for v in frame) for frame in np.concatenate(columns, axis=1)]
    return "\n".join(lines) + "\n"
