"""How good a pose network is: its ONNX file against people that it has not seen, and the mean pose beside it."""

from dataclasses import dataclass, field

import numpy as np

from cospeech.errors import CospeechError
from cospeech.files import put, sha256, writing_hdf5
from cospeech.posenet import JOINTS17
from cospeech.posenet.evaluation.pose_metrics import PROTOCOLS, align, auc, joint_group_table, mpjpe, official, pck
from cospeech.posenet.predict import AT_ONCE, PosePredictor
from cospeech.posenet.store import Store
from cospeech.posenet.training.augment import center

SCHEMA = "cospeech.posenet.evaluation"
METRICS = ("PCK", "AUC", "MPJPE")
# mm at which PCK counts a joint and up to which AUC integrates: published for bodies; ours for the smaller parts
THRESHOLDS = {"body": 150.0, "hand": 50.0, "face": 15.0}


@dataclass
class PoseEvaluation:
    """What a network scores.

    table {(domain, row, protocol): {metric: value}}: domains or scenes of the people, then "all"; rows "posenet" and
    "mean pose"; the three protocols of thesis 3.4.1. groups {domain: row of Table 3.5}, globally scaled, bodies only.
    pred, truth (N, J, 3) float32 mm, domain (N,) str : what it was computed from.
    """

    part: str
    table: dict
    groups: dict
    pred: np.ndarray
    truth: np.ndarray
    domain: np.ndarray
    attributes: dict = field(default_factory=dict)

    def __getitem__(self, key):
        """(domain, metric) -> the network's value, globally scaled."""
        domain, metric = key
        return self.table[domain, "posenet", "globally scaled"][metric]

    def write(self, path):
        """Write evaluation.h5 (schema `cospeech.posenet.evaluation`, version 1)."""
        with writing_hdf5(path, SCHEMA, part=self.part, **self.attributes) as file:
            file["metric"] = [name.encode() for name in METRICS]
            for i, name in enumerate(("domain", "row", "protocol")):
                file[f"table/{name}"] = [key[i].encode() for key in self.table]
            put(file, "table/values", np.array([[row[m] for m in METRICS] for row in self.table.values()]))
            for domain, row in self.groups.items():
                file.create_group(f"groups/{domain}").attrs.update(row)
            put(file, "poses/pred", self.pred)
            put(file, "poses/truth", self.truth)
            file["poses/domain"] = [name.encode() for name in self.domain]

    def lines(self):
        """The table as text, a line a row."""
        yield f"{'domain':8s} {'row':10s} {'protocol':16s} " + " ".join(f"{metric:>7s}" for metric in METRICS)
        for (domain, row, protocol), values in self.table.items():
            yield f"{domain:8s} {row:10s} {protocol:16s} " + " ".join(f"{values[m]:7.1f}" for m in METRICS)


def evaluate(onnx, paths, threads=None):
    """Score an ONNX file on stores of people with 3D truth -> PoseEvaluation.

    3D truth counts here whether it may be trained on or not; poses are compared in the virtual camera that both are in.
    Raises CospeechError when a store shows another part or has no 3D truth.
    """
    predictor = PosePredictor(onnx, threads)
    found = [_predict(predictor, Store(path)) for path in paths]
    pred, truth, domain = (np.concatenate(pieces) for pieces in zip(*found, strict=True))
    mean = np.broadcast_to(np.float32(predictor.description["mean_pose"]), pred.shape)
    table, groups = {}, {}
    for name in [*sorted(set(domain.tolist())), "all"]:
        chosen = domain == name if name != "all" else np.ones(len(domain), bool)
        for row, poses in {"posenet": pred, "mean pose": mean}.items():
            for protocol, how in PROTOCOLS.items():
                table[name, row, protocol] = scores(poses[chosen], truth[chosen], how, predictor)
        if predictor.part == "body":
            groups[name] = joint_group_table(*(_seventeen(p[chosen], predictor) for p in (pred, truth)), "scale")
    return PoseEvaluation(predictor.part, table, groups, pred, truth, domain, {"model_sha256": sha256(onnx)})


def _predict(predictor, store):
    """(pred, truth (N, J, 3) mm, domain (N,) str) of a store's people."""
    if store.part != predictor.part:
        raise CospeechError(f"{store.path}: shows a {store.part}, the network predicts a {predictor.part}")
    known = np.flatnonzero(np.abs(store.joints3d).any(axis=(1, 2)))
    if not len(known):
        raise CospeechError(f"{store.path}: nobody in it has 3D truth to compare with")
    poses = []
    for start in range(0, len(known), AT_ONCE):
        batch = store[known[start : start + AT_ONCE]]
        crops = center(batch, predictor.size, part=store.part, margin=store.margin).images
        poses.append(predictor.predict(crops).joints3d)
    tags = [store.tags[name] for name in ("domain", "scene") if name in store.tags]
    domain = tags[0] if tags else np.full(len(store), store.attrs["source"])
    return np.concatenate(poses), store.joints3d[known], domain[known]


def scores(pred, truth, how, predictor):
    """{metric: value} of (N, J, 3) poses: the official 3DHP numbers for bodies, over all joints for the other parts."""
    if predictor.part == "body":
        row = official(_seventeen(pred, predictor), _seventeen(truth, predictor), how)
        return {metric: row[metric] for metric in METRICS}
    pred, truth = (poses - poses[:, predictor.root, None] for poses in (pred, truth))
    pred, threshold = align(pred, truth, how), THRESHOLDS[predictor.part]
    scale = THRESHOLDS["body"] / threshold  # AUC's thresholds are those of a body
    return {"PCK": pck(pred, truth, threshold), "AUC": auc(scale * pred, scale * truth), "MPJPE": mpjpe(pred, truth)}


def _seventeen(poses, predictor):
    return poses[:, [predictor.joints.index(name) for name in JOINTS17.names]]
