"""Synthetic data sets in the formats of their owners, with known truth.

A person is a random pose in front of a known camera; its image is grey noise with a disc at every evaluated joint,
whose colour names the joint. So a test can see in the pixels whether labels and images still belong together.
"""

import json
from dataclasses import dataclass

import av
import cdflib.cdfwrite
import cv2
import h5py
import numpy as np
from scipy.io import savemat

from cospeech.posenet import EVALUATED, JOINTS28
from cospeech.posenet.camera import camera_matrix, project
from cospeech.skeleton import Skeleton

COLOURS = np.array(
    [[255 * (i % 3) // 2, 255 * (i // 3 % 3) // 2, 255 * (2 - i // 9) // 2] for i in range(14)], np.uint8
)  # one for each evaluated joint


@dataclass
class People:
    """N persons: poses (N, J, 3) mm in the camera frame, points (N, J, 2) pixels, camera (3, 3) and images."""

    skeleton: Skeleton
    poses: np.ndarray
    points: np.ndarray
    camera: np.ndarray
    images: np.ndarray

    @property
    def relative(self):
        root = self.skeleton.root
        return self.poses - self.poses[:, root : root + 1]


def people(count, skeleton=JOINTS28, size=(160, 160), seed=0, aside=0.0, radius=4):
    """Persons four metres away, `aside` mm to the right, in images (width, height); focal length 1.2 widths.

    Their joints lie on cells of a grid in random order, far enough apart that no disc hides another.
    """
    rng = np.random.default_rng(seed)
    cells = np.stack(np.meshgrid(np.arange(6), np.arange(6)), axis=-1).reshape(36, 2) - 2.5
    flat = 420.0 * np.stack([cells[rng.permutation(36)[: len(skeleton)]] for _ in range(count)])
    poses = np.concatenate([flat, rng.uniform(-150, 150, (*flat.shape[:2], 1))], axis=2)
    poses += [aside, 0, 4000]
    camera = camera_matrix(1.2 * size[0], *size)
    points = project(poses, camera)
    images = np.stack([picture(p, skeleton, size, rng, radius) for p in points])
    return People(skeleton, poses, points, camera, images)


def picture(points, skeleton, size, rng, radius=4):
    """(H, W, 3) RGB with a disc of `COLOURS` at every evaluated joint."""
    image = rng.integers(90, 130, (size[1], size[0], 1), np.uint8).repeat(3, axis=2)
    for colour, joint in zip(COLOURS, skeleton.joints(*EVALUATED), strict=True):
        if np.isfinite(points[joint]).all():
            x, y = (round(float(v)) for v in points[joint])
            cv2.circle(image, (x, y), radius, colour.tolist(), -1)
    return image


def disc_error(image, points, chosen):
    """The largest colour difference (0 to 255) between discs and the pixels at the points that claim to be theirs."""
    rows = [
        np.abs(image[round(y), round(x)].astype(int) - COLOURS[k]).max() for k, (x, y) in enumerate(points) if chosen[k]
    ]
    return max(rows)


def write_image(path, image):
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(
        str(path),
        image[..., ::-1],
        [cv2.IMWRITE_JPEG_QUALITY, 98, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444],
    )


def write_film(path, images, codec="mjpeg"):
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as film:
        stream = film.add_stream(codec, rate=25)
        stream.width, stream.height = images.shape[2], images.shape[1]
        stream.pix_fmt = "yuvj444p" if codec == "mjpeg" else "yuv420p"
        stream.options = {"qmin": "1", "qmax": "2"} if codec == "mjpeg" else {"crf": "5"}
        for image in images:
            film.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")))
        film.mux(stream.encode(None))


# ---- MPI-INF-3DHP ---------------------------------------------------------------------------------------------------


def cells(arrays):
    """A MATLAB cell array (n, 1)."""
    column = np.empty((len(arrays), 1), object)
    for i, array in enumerate(arrays):
        column[i, 0] = array
    return column


def write_3dhp_train(folder, who, subject=1, sequence=1, cameras=(0,), rows=None, film=True, shrink=0.8):
    """One sequence. `univ_annot3` is `annot3` times `shrink`. rows: of the annotation, if more than images."""
    place = folder / f"S{subject}" / f"Seq{sequence}"
    place.mkdir(parents=True)
    count = len(who.images)
    extra = (rows or count) - count
    pad = lambda a: np.concatenate([a.reshape(count, -1), np.repeat(a[-1:].reshape(1, -1), extra, axis=0)])
    shrunk = who.relative * shrink + (who.poses - who.relative)
    table = {
        "annot2": cells([pad(who.points)] * 14),
        "annot3": cells([pad(who.poses)] * 14),
        "univ_annot3": cells([pad(shrunk)] * 14),
        "cameras": np.arange(14, dtype=np.uint8)[:, None],
        "frames": np.arange(count + extra, dtype=np.int32)[:, None],
    }
    savemat(place / "annot.mat", table)
    (place / "camera.calibration").write_text(calibration(who.camera, range(14)))
    for camera in cameras if film else ():
        write_film(place / "imageSequence" / f"video_{camera}.avi", who.images)
    return place


def calibration(matrix, cameras):
    """The owners' text: seven lines a camera."""
    k, numbers = np.eye(4), lambda m: " ".join(f"{v:.9g}" for v in np.ravel(m))
    k[:3, :3] = matrix
    blocks = [
        f"name          {i}\n  sensor      10 10\n  size        2048 2048\n  animated    0\n"
        f"  intrinsic   {numbers(k)} \n  extrinsic   {numbers(np.eye(4))} \n  radial      0\n"
        for i in cameras
    ]
    return "Skeletool Camera Calibration File V1.0\n" + "".join(blocks)


def write_3dhp_test(folder, who, sequence=1, valid=None, activity=None, images=None, spelling="activity_annotation"):
    """One test sequence: MATLAB v7.3, whose axes h5py shows reversed, and images that count from 1."""
    place = folder / f"TS{sequence}"
    place.mkdir(parents=True)
    count = len(who.points)
    shrunk = who.relative * 0.8 + (who.poses - who.relative)
    with h5py.File(place / "annot_data.mat", "w", userblock_size=512) as file:
        file["annot2"], file["annot3"] = who.points[:, None], who.poses[:, None]
        file["univ_annot3"] = shrunk[:, None]
        file["valid_frame"] = np.ones((count, 1)) if valid is None else np.asarray(valid, float)[:, None]
        file[spelling] = np.ones((count, 1)) if activity is None else np.asarray(activity, float)[:, None]
    with open(place / "annot_data.mat", "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    for i, image in enumerate(who.images[:images]):
        write_image(place / "imageSequence" / f"img_{i + 1:06d}.jpg", image)
    return place


# ---- Human3.6M ------------------------------------------------------------------------------------------------------


def write_h36m(folder, who, subject=1, action="Directions 1", camera="54138969", film=True, rows2d=None):
    place = folder / f"S{subject}"
    for kind, array in (("D2_Positions", who.points[:rows2d]), ("D3_Positions_mono", who.poses)):
        target = place / "MyPoseFeatures" / kind / f"{action}.{camera}.cdf"
        target.parent.mkdir(parents=True, exist_ok=True)
        rows = array.reshape(1, len(array), -1).astype(np.float32)
        with cdflib.cdfwrite.CDF(str(target)) as file:
            spec = {
                "Variable": "Pose",
                "Data_Type": 44,
                "Num_Elements": 1,
                "Rec_Vary": True,
                "Dim_Sizes": rows.shape[1:],
            }
            file.write_var(spec, var_data=rows)
    if film:
        write_film(place / "Videos" / f"{action}.{camera}.mp4", who.images, "libx264")


def write_h36m_npz(folder, who, subject=1, subset="train", first=1):
    """mmpose's: metres, names that count from 1, and a fourth column of confidences."""
    names = [
        f"S{subject}/S{subject}_Directions_1.54138969/S{subject}_Directions_1.54138969_{i + first:06d}.jpg"
        for i in range(len(who.images))
    ]
    for name, image in zip(names, who.images, strict=True):
        write_image(folder / "images" / name, image)
    ones = np.ones((*who.points.shape[:2], 1))
    path = folder / "annotation_body3d" / "fps50" / f"h36m_{subset}.npz"
    path.parent.mkdir(parents=True)
    part, poses = (np.concatenate([array, ones], axis=2) for array in (who.points, who.poses / 1000))
    box = {"center": np.zeros((len(names), 2)), "scale": np.ones(len(names))}
    np.savez(path, imgname=np.array(names), part=part, S=poses, **box)
    return path


# ---- 2D sets --------------------------------------------------------------------------------------------------------


def write_mpii(folder, who, labelled=None, visible=None, train=None, nobody=()):
    """The owners' nested structs: RELEASE.annolist(i).annorect(j).annopoints.point(k), pixels from 1.

    labelled (N, 16) bool: which points are there. visible (N, 16): their is_visible. nobody: images without annopoints.
    """
    count = len(who.images)
    labelled = np.ones((count, 16), bool) if labelled is None else labelled
    visible = np.ones((count, 16), int) if visible is None else visible
    annolist = np.empty((1, count), object)
    for i in range(count):
        point = [
            {"x": x + 1, "y": y + 1, "id": k, "is_visible": visible[i][k]}
            for k, (x, y) in enumerate(who.points[i])
            if labelled[i][k]
        ]
        rect = {"scale": 1.0, "objpos": {"x": 80.0, "y": 80.0}}
        rect |= {"annopoints": {"point": struct(point)}} if i not in nobody else {"annopoints": np.zeros((0, 0))}
        annolist[0, i] = {"image": {"name": f"{i:09d}.jpg"}, "annorect": struct([rect])}
        write_image(folder / "images" / f"{i:09d}.jpg", who.images[i])
    trained = np.ones((1, count)) if train is None else np.array([train], float)
    release = {"annolist": struct(list(annolist[0])), "img_train": trained, "version": "12"}
    path = folder / "mpii_human_pose_v1_u12_2" / "mpii_human_pose_v1_u12_1.mat"
    path.parent.mkdir(parents=True)
    savemat(path, {"RELEASE": release})
    return path


def struct(rows):
    """Dicts with equal keys -> a MATLAB struct array (1, n)."""
    array = np.empty((1, len(rows)), [(name, object) for name in rows[0]])
    for i, row in enumerate(rows):
        for name, value in row.items():
            array[0, i][name] = value
    return array


def write_mpii_json(folder, who, visible, name="train.json"):
    people = [
        {
            "image": f"{i:09d}.jpg",
            "center": [80, 80],
            "scale": 1.0,
            "joints_vis": v.astype(int).tolist(),
            "joints": np.where(v[:, None], p + 1, -1).tolist(),
        }
        for i, (p, v) in enumerate(zip(who.points, visible, strict=True))
    ]
    for i, image in enumerate(who.images):
        write_image(folder / "images" / f"{i:09d}.jpg", image)
    (folder / "annot").mkdir(parents=True)
    (folder / "annot" / name).write_text(json.dumps(people))


def write_lsp(folder, who, flags, extended=False):
    """flags (N, 14): LSP's third row, 1 where hidden; of the extension 1 where visible."""
    joints = np.concatenate([who.points, flags[..., None]], axis=2)  # (N, 14, 3)
    folder.mkdir(parents=True, exist_ok=True)
    savemat(folder / "joints.mat", {"joints": joints.transpose(1, 2, 0) if extended else joints.transpose(2, 1, 0)})
    for i, image in enumerate(who.images):
        write_image(folder / "images" / f"im{i + 1:0{5 if extended else 4}d}.jpg", image)


def write_coco(folder, annotations, images, subset="train"):
    """annotations: dicts of COCO-WholeBody; images {id: RGB array}."""
    sizes = {i: {"height": image.shape[0], "width": image.shape[1]} for i, image in images.items()}
    listed = [{"id": i, "file_name": f"{i:012d}.jpg", **size} for i, size in sizes.items()]
    for i, image in images.items():
        write_image(folder / f"{subset}2017" / f"{i:012d}.jpg", image)
    path = folder / "annotations" / f"coco_wholebody_{subset}_v1.0.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"images": listed, "annotations": annotations}))
    return path
