"""How good a take's annotation is: what was seen, what was filled in, what is excluded, and how much it shakes."""

from dataclasses import dataclass, field

import numpy as np

from cospeech import __version__
from cospeech.capture.cleanup.assemble import PARTS
from cospeech.capture.cleanup.fill import EXCLUDED, INTERPOLATED, OBSERVED
from cospeech.files import put, reading_hdf5, writing_hdf5
from cospeech.skeleton import BODY, UPPER55

SCHEMA = "cospeech.quality"
SHARES = {"observed": OBSERVED, "interpolated": INTERPOLATED, "excluded": EXCLUDED}
PARENTS = np.array([p if 0 <= p != j else j for j, p in enumerate(UPPER55.parents)])


@dataclass
class Quality:
    """One take's annotation, judged (schema `cospeech.quality`, version 1).

    observed, interpolated, excluded : {part: share}, which add up to 1 for each of body, left_hand, right_hand and face
        (a part's joints and the clip's frames taken together).
    bone_deviation, bone_deviation_raw : mean difference of the bones from the speaker's, as a share of their length,
        after the clean-up and in the track.
    jitter_raw, jitter_clean : mean acceleration of the joints in m/s^2, body relative to the pelvis and hands to the
        wrist, over frames seen together with both neighbours: in the track at the video's rate, and in the clip.
    valid : share of frames that training may use. tilt : degrees by which the take was turned upright.
    dropped : {gate: share of the seen joints that it dropped}. timeline : {part: (T,) share of its joints known}.
    refused : why the take is not used, or "".
    """

    subject: str
    clip: str
    fps: float
    frames: int
    backend: str
    observed: dict
    interpolated: dict
    excluded: dict
    bone_deviation: float
    bone_deviation_raw: float
    jitter_raw: float
    jitter_clean: float
    valid: float
    tilt: float = 0.0
    dropped: dict = field(default_factory=dict)
    timeline: dict = field(default_factory=dict)
    licence_note: str = ""
    refused: str = ""

    def write(self, path):
        """Write the HDF5 file: scalars `bone_deviation`, `jitter_raw`..., groups `observed/<part>` and so on."""
        head = {key: getattr(self, key) for key in HEAD}
        with writing_hdf5(path, SCHEMA, **head, cospeech_version=__version__) as file:
            for key in SCALARS:
                put(file, key, np.float64(getattr(self, key)))
            for key in GROUPS:
                for name, value in getattr(self, key).items():
                    put(file, f"{key}/{name}", value)

    @classmethod
    def read(cls, path):
        """Read it; CospeechError for another file."""
        with reading_hdf5(path, SCHEMA) as file:
            head = {key: file.attrs[key] for key in HEAD if key in file.attrs}
            scalars = {key: float(file[key][()]) for key in SCALARS}
            groups = {key: {name: item[()] for name, item in file.get(key, {}).items()} for key in GROUPS}
        return cls(**head, **scalars, **groups)


HEAD = ("subject", "clip", "fps", "frames", "backend", "licence_note", "refused")
SCALARS = ("bone_deviation", "bone_deviation_raw", "jitter_raw", "jitter_clean", "valid", "tilt")
GROUPS = (*SHARES, "dropped", "timeline")


def quality_of(cleaned, observed, fps, rate, *, subject, clip, backend="", licence_note=""):
    """`Quality` of a `Cleaned` take at `rate`, made from `Observations` at `fps`."""
    states = {part: cleaned.state[:, joints] for part, joints in PARTS.items()}
    if cleaned.face_state is not None:
        states["face"] = cleaned.face_state[:, None]
    shares = {key: {part: float((s == code).mean()) for part, s in states.items()} for key, code in SHARES.items()}
    seen = cleaned.state == OBSERVED
    return Quality(
        subject,
        clip,
        float(rate),
        len(cleaned.positions),
        backend,
        **shares,
        bone_deviation=bone_deviation(cleaned.positions, seen, cleaned.bones),
        bone_deviation_raw=bone_deviation(observed.positions, observed.seen, cleaned.bones),
        jitter_raw=jitter(observed.positions, observed.seen, fps),
        jitter_clean=jitter(cleaned.positions, seen, rate),
        valid=float(cleaned.valid.mean()),
        tilt=cleaned.tilt,
        dropped=cleaned.dropped,
        timeline={part: (s != EXCLUDED).mean(axis=1).astype(np.float32) for part, s in states.items()},
        licence_note=licence_note,
    )


def bone_deviation(positions, seen, bones):
    """Mean of |length - bone| / bone over all bones that are seen with both ends; 0 if there is none."""
    lengths = np.linalg.norm(positions - positions[:, PARENTS], axis=-1)
    counted = seen & seen[:, PARENTS] & (bones > 0)
    return (
        float((np.abs(lengths - bones)[counted] / np.broadcast_to(bones, lengths.shape)[counted]).mean())
        if (counted.any())
        else 0.0
    )


def jitter(positions, seen, rate):
    """Mean acceleration (m/s^2) of joints that are seen in three frames running; 0 if there is none.

    positions (T, 55, 3), seen (T, 55). The body moves relative to the pelvis, each hand relative to its wrist.
    """
    origin = np.where(np.arange(len(UPPER55)) < BODY.stop, UPPER55.root, -1)
    for joints in list(PARTS.values())[1:]:
        origin[joints] = joints.start
    counted = seen[2:] & seen[1:-1] & seen[:-2] & (origin != np.arange(len(UPPER55)))
    size = np.linalg.norm(np.diff(positions - positions[:, origin], n=2, axis=0), axis=-1) * rate**2
    return float(size[counted].mean()) if counted.any() else 0.0
