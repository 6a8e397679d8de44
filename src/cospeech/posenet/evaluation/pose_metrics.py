"""The metrics of 3D pose estimation: MPJPE, 3D PCK, AUC, three alignments, and the tables of thesis chapter 3.

Poses are (N, J, 3) in millimetres, of any joint set; PCK and AUC are percentages. `mpjpe`, `pck` and `auc` score the
poses as they are passed: nothing is centred, scaled or left out behind the caller's back. `official` and the tables
apply the rules of the MPI-INF-3DHP evaluation (its MATLAB scripts) to that data set's 17 joints.
"""

import numpy as np

from cospeech.errors import CospeechError
from cospeech.posenet import EVALUATED, JOINTS17

THRESHOLD = 150.0  # mm
THRESHOLDS = np.arange(0.0, 151.0, 5.0)  # of AUC: 31 of them; 0 is one, so a perfect prediction scores 96.8
PROTOCOLS = {"unscaled": "none", "globally scaled": "scale", "Procrustes": "procrustes"}  # thesis 3.4.1
ACTIVITIES = (
    *("Standing/Walking", "Exercising", "Sitting", "Reaching/Crouching"),
    *("On The Floor", "Sports", "Miscellaneous"),
)  # `activity_annotation` 1 to 7
SCENES = ("GS", "GS", "No GS", "No GS", "Outdoor", "Outdoor")  # of test sequences TS1 to TS6
GROUPS = {
    "Head": ("head_top",),
    "Neck": ("neck",),
    "Shou": ("right_shoulder", "left_shoulder"),
    "Elbow": ("right_elbow", "left_elbow"),
    "Wrist": ("right_wrist", "left_wrist"),
    "Hip": ("right_hip", "left_hip"),
    "Knee": ("right_knee", "left_knee"),
    "Ankle": ("right_ankle", "left_ankle"),
}  # the columns of Table 3.5


def joint_errors(pred, truth):
    """Euclidean distance of every joint: (N, J, 3), (N, J, 3) mm -> (N, J) float64 mm.

    Raises CospeechError unless both have one shape, at least one joint and finite values.
    """
    pred, truth = _pair(pred, truth)
    return np.linalg.norm(pred - truth, axis=-1)


def mpjpe(pred, truth):
    """Mean per-joint position error over all poses and joints passed, mm: float."""
    return float(joint_errors(pred, truth).mean())


def pck(pred, truth, threshold=THRESHOLD):
    """Share of joints strictly closer than `threshold` mm (Mehta et al. 2017), in percent: float."""
    return _pck(joint_errors(pred, truth), threshold)


def auc(pred, truth):
    """Mean of PCK at 0, 5, ..., 150 mm, in percent: float, at most 100 * 30 / 31 (official 3DHP)."""
    return _auc(joint_errors(pred, truth))


def velocity_error(pred, truth):
    """Mean error of the joints' change from one frame to the next, mm per frame: jitter (VideoPose3D's MPJVE).

    The N poses are consecutive frames of one recording; NaN for a single frame.
    """
    pred, truth = _pair(pred, truth)
    return mpjpe(np.diff(pred, axis=0), np.diff(truth, axis=0)) if len(pred) > 1 else float("nan")


def align(pred, truth, how):
    """Move each predicted pose onto its truth as a protocol allows: (N, J, 3) -> (N, J, 3) float64, pose by pose.

    how : "none" leaves the pose; "scale" multiplies it by <p, g> / <p, p> (n-MPJPE; both poses root-relative);
        "procrustes" applies the least-squares rotation, scale and translation, never a reflection (Umeyama 1991).

    A prediction whose joints coincide has no scale: it stays ("scale") or lands on the truth's centroid.
    """
    pred, truth = _pair(pred, truth)
    if how == "none":
        return pred
    if how == "scale":
        return pred * _scale(pred, truth)
    if how == "procrustes":
        return _procrustes(pred, truth)
    raise CospeechError(f"align: unknown alignment {how!r}; known: none, scale, procrustes")


def _scale(pred, truth):
    """(N, 1, 1) factor s that minimises |s p - g|^2; 1 where p is zero."""
    size = np.einsum("njc,njc->n", pred, pred)
    product = np.einsum("njc,njc->n", pred, truth)
    return np.divide(product, size, out=np.ones_like(size), where=size > 0)[:, None, None]


def _procrustes(pred, truth):
    center = truth.mean(axis=1, keepdims=True)
    p, g = pred - pred.mean(axis=1, keepdims=True), truth - center
    u, _, vt = np.linalg.svd(np.einsum("njc,njd->ncd", p, g))
    # least agreement is along the last axis: flipped, it turns a reflection into the best rotation
    u[:, :, 2] *= np.sign(np.linalg.det(u @ vt))[:, None]
    rotated = p @ (u @ vt)
    return rotated * _scale(rotated, g) + center


# ---- MPI-INF-3DHP ---------------------------------------------------------------------------------------------------


def root_relative(poses, root=JOINTS17.root):
    """Poses with joint `root` at the origin: (N, J, 3) -> (N, J, 3)."""
    poses = np.asarray(poses, np.float64)
    return poses - poses[:, root : root + 1]


def official(pred, truth, how="none"):
    """The official 3DHP numbers of (N, 17, 3) poses in the order of `JOINTS17`.

    Both poses are made relative to the pelvis, then aligned on all 17 joints. Returns {"PCK", "AUC": over the 14
    evaluated joints, "MPJPE": over all 17 with the pelvis, as the official scripts do, "MPJPE 14": over the 14}.
    """
    errors = _official_errors(pred, truth, how)
    counted = errors[:, JOINTS17.joints(*EVALUATED)]
    return {
        "PCK": _pck(counted),
        "AUC": _auc(counted),
        "MPJPE": float(errors.mean()),
        "MPJPE 14": float(counted.mean()),
    }


def joint_group_table(pred, truth, how="none"):
    """One row of Table 3.5: {"Head", ..., "Ankle": PCK of the group, "Total": PCK, "AUC"} of (N, 17, 3) poses."""
    return _group_row(_official_errors(pred, truth, how))


def activity_table(pred, truth, activity, how="none"):
    """Table 3.5: {activity: joint-group row} of the activities that occur, and "All".

    activity (N,) : 1 to 7, as `activity_annotation` counts them.
    """
    errors = _official_errors(pred, truth, how)
    labels = np.array(["", *ACTIVITIES])[_labels(activity, errors, range(1, 8), "activity")]
    rows = {name: _group_row(errors[labels == name]) for name in ACTIVITIES if (labels == name).any()}
    return {**rows, "All": _group_row(errors)}


def scene_table(pred, truth, sequence):
    """Tables 3.1 and 3.4: {protocol: {"GS", "No GS", "Outdoor", "All": PCK, "AUC", "MPJPE": of all}} of (N, 17, 3).

    sequence (N,) : 1 to 6 for TS1 to TS6. Every pose counts once, which weights scenes by their valid frames; a scene
    without poses is NaN. Pass the poses of TS1, 2, 5 and 6 alone for Table 3.7. MPJPE is over all 17 joints.
    """
    table = {}
    for protocol, how in PROTOCOLS.items():
        errors = _official_errors(pred, truth, how)
        scenes = np.array(["", *SCENES])[_labels(sequence, errors, range(1, 7), "sequence")]
        counted = errors[:, JOINTS17.joints(*EVALUATED)]
        row = {scene: _pck(counted[scenes == scene]) for scene in dict.fromkeys(SCENES)}
        table[protocol] = {**row, "All": _pck(counted), "AUC": _auc(counted), "MPJPE": float(errors.mean())}
    return table


def action_table(pred, truth, action, how="none"):
    """Tables 3.2 and 3.3: {action: MPJPE mm, "Avg.": mean over actions} of root-relative (N, J, 3) poses.

    action (N,) : name of each pose's action (Human3.6M). Actions weigh the same, however many frames they have.
    """
    errors = joint_errors(align(pred, truth, how), truth)
    names = np.asarray(action, str)
    if names.shape != errors.shape[:1]:
        raise CospeechError(f"action_table: {names.shape} actions for {len(errors)} poses; give one each")
    rows = {str(name): float(errors[names == name].mean()) for name in np.unique(names)}
    return {**rows, "Avg.": float(np.mean(list(rows.values())))}


def _official_errors(pred, truth, how):
    pred, truth = _pair(pred, truth)
    if pred.shape[1] != len(JOINTS17):
        raise CospeechError(f"3DHP metrics: {pred.shape[1]} joints, expected the 17 of mpi_inf_3dhp17 in its order")
    pred, truth = root_relative(pred), root_relative(truth)
    return joint_errors(align(pred, truth, how), truth)


def _group_row(errors):
    counted = errors[:, JOINTS17.joints(*EVALUATED)]
    groups = {name: _pck(errors[:, JOINTS17.joints(*joints)]) for name, joints in GROUPS.items()}
    return {**groups, "Total": _pck(counted), "AUC": _auc(counted)}


# ---- shared ---------------------------------------------------------------------------------------------------------


def _pck(errors, threshold=THRESHOLD):
    return float(100.0 * np.mean(errors < threshold)) if errors.size else float("nan")


def _auc(errors):
    below = np.searchsorted(
        np.sort(errors, axis=None), THRESHOLDS, side="left"
    )  # strictly less, all thresholds at once
    return float(100.0 * below.mean() / errors.size) if errors.size else float("nan")


def _pair(pred, truth):
    pred, truth = np.asarray(pred, np.float64), np.asarray(truth, np.float64)
    if pred.shape != truth.shape or pred.ndim != 3 or pred.shape[2] != 3 or not pred.size:
        raise CospeechError(f"pose metrics: shapes {pred.shape} and {truth.shape}, expected two equal (N, J, 3)")
    if not (np.isfinite(pred).all() and np.isfinite(truth).all()):
        raise CospeechError("pose metrics: the poses hold NaN or infinity; leave such poses out")
    return pred, truth


def _labels(labels, errors, known, what):
    labels = np.asarray(labels)
    if labels.shape != errors.shape[:1] or not np.isin(labels, list(known)).all():
        raise CospeechError(
            f"3DHP metrics: {what} must be one of {known[0]} to {known[-1]} for each of {len(errors)} poses"
        )
    return labels.astype(int)
