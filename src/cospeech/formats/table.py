"""CSV out: a clip's numbers, one row a frame, for spreadsheets, R and anything else."""

from pathlib import Path

import numpy as np

from cospeech.face.expressions import expression_names
from cospeech.files import writing
from cospeech.skeleton import UPPER55


def write_csv(path, clip):
    """Write a clip as comma-separated text: a header line, then one row a frame.

    Columns: `time` in seconds; `<joint>_x`, `_y`, `_z` of the 55 joints in metres, pelvis-relative (x left, y up, z
    forward); if the clip has them, `root_x..z` (metres), `head_rotation_x..z` (axis-angle, radians) and one column an
    expression coefficient, by its name in the face model or `e0`, `e1`, ...
    """
    names = ["time", *(f"{joint}_{axis}" for joint in UPPER55.names for axis in "xyz")]
    columns = [np.arange(clip.frames)[:, None] / clip.fps, clip.positions.reshape(clip.frames, -1)]
    for name, values in (("root", clip.root), ("head_rotation", clip.rotation)):
        if values is not None:
            names += [f"{name}_{axis}" for axis in "xyz"]
            columns.append(values)
    if clip.expression is not None:
        names += expression_names(clip.face_model) or [f"e{i}" for i in range(clip.expression.shape[1])]
        columns.append(clip.expression)
    with writing(Path(path)) as temporary:
        np.savetxt(temporary, np.hstack(columns), "%.6g", ",", header=",".join(names), comments="")
