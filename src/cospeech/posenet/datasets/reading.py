"""What all readers share: images, films, MATLAB files and joint maps, and how they say what is wrong with them."""

from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from cospeech.errors import CospeechError, notice
from cospeech.posenet import EVALUATED, JOINTS21

MISSING, UNDECODABLE = "image is not there", "image does not decode"
NOBODY, NOWHERE = "image without an annotated person", "no joint inside the image"


# ---- joints ---------------------------------------------------------------------------------------------------------


def body2d(points, skeleton):
    """Points (..., K0, D) of a data set's skeleton -> (..., 14, D), the evaluated joints, by name."""
    return points[..., skeleton.joints(*EVALUATED), :]


def body3d(points, skeleton):
    """Points (..., J0, 3) mm of a data set's skeleton -> (..., 21, 3) float32 relative to the pelvis, by name.

    Joints of JOINTS21 that the data set does not have are NaN.
    """
    result = np.full((*points.shape[:-2], len(JOINTS21), 3), np.nan, np.float32)
    shared = [name for name in JOINTS21.names if name in skeleton.index]
    pelvis = points[..., skeleton.joints("pelvis"), :]
    result[..., JOINTS21.joints(*shared), :] = points[..., skeleton.joints(*shared), :] - pelvis
    return result


def inside(points, image):
    """(K,) bool: which points (K, 2) lie in an image (H, W, ...)."""
    with np.errstate(invalid="ignore"):
        return ((points >= -0.5) & (points < np.array(image.shape[1::-1]) - 0.5)).all(axis=-1)


def seen(points, labelled, image):
    """(joints2d (K, 2) float32, zeros where not labelled; visible (K,) bool, labelled and inside the image)."""
    labelled = np.asarray(labelled, bool) & np.isfinite(points).all(axis=-1)
    joints2d = np.where(labelled[:, None], points, 0).astype(np.float32)
    return joints2d, labelled & inside(points, image)


# ---- images and films -----------------------------------------------------------------------------------------------


def read_image(path, dropped):
    """(H, W, 3) uint8 RGB of an image file, or None, counted in `dropped`, when it is missing, damaged or cut off.

    The picture is not turned by what its camera noted (EXIF), as the annotations are about the pixels in the file.
    """
    try:
        data = Path(path).read_bytes()
    except FileNotFoundError:
        dropped[MISSING] += 1
        return None
    except OSError as error:
        raise CospeechError(f"{path}: cannot be read ({error.strerror})") from error
    cut_off = data[:2] == b"\xff\xd8" and b"\xff\xd9" not in data[-4096:]  # a JPEG without its end decodes to grey
    flags = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
    image = cv2.imdecode(np.frombuffer(data, np.uint8), flags) if data and not cut_off else None
    if image is None:
        dropped[UNDECODABLE] += 1
    return image


def frames(path, wanted):
    """Yield (H, W, 3) uint8 RGB of frames `wanted` (ascending numbers, from 0) of a film, decoded as it is read.

    Ends early, with a notice, where the film does. Raises CospeechError when it does not open.
    """
    import av

    rest = iter(wanted)
    target, index = next(rest, None), -1
    try:
        with av.open(str(path)) as film:
            film.streams.video[0].thread_type = "AUTO"
            for index, frame in enumerate(film.decode(video=0)):
                if target is None:
                    return
                if index == target:
                    yield frame.to_ndarray(format="rgb24")
                    target = next(rest, None)
    except (av.FFmpegError, IndexError, OSError) as error:
        if index < 0:
            raise CospeechError(f"{path}: not a readable film ({getattr(error, 'strerror', None) or error})") from error
        notice(f"{path}: damaged after frame {index}; the rest is left out")
    if target is not None:
        notice(f"{path}: ends after {index + 1} frames, frame {target} and later ones are left out")


# ---- annotation files -----------------------------------------------------------------------------------------------


def load_mat(path, *names):
    """Variables of a MATLAB file up to v7 as scipy reads them (structs as objects): {name: array}."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    path = existing(path)
    try:
        found = loadmat(path, struct_as_record=False, squeeze_me=True)
    except NotImplementedError as error:
        raise CospeechError(f"{path}: is MATLAB v7.3, expected v5 to v7 as its owners ship it") from error
    except (MatReadError, ValueError, TypeError, OSError, EOFError, IndexError, KeyError) as error:
        raise CospeechError(f"{path}: not a readable MATLAB file (truncated, or another format)") from error
    except Exception as error:  # zlib.error and whatever else scipy lets through of a damaged file
        raise CospeechError(f"{path}: damaged MATLAB file ({error})") from error
    if missing := [name for name in names if name not in found]:
        raise CospeechError(f"{path}: has no variable {missing[0]!r}")
    return found


def existing(path):
    """`path` as a Path; CospeechError when there is no such file."""
    path = Path(path)
    if not path.is_file():
        raise CospeechError(f"{path}: no such file; give the data set's folder as its owners ship it, unpacked")
    return path


def find(folder, *patterns):
    """The first file that matches one of the glob patterns in a folder or up to two folders down, or None."""
    for pattern in patterns:
        for depth in ("", "*/", "*/*/"):
            if found := sorted(Path(folder).glob(depth + pattern)):
                return found[0]
    return None


@contextmanager
def skipping(dropped, reason, number=1):
    """Turn a CospeechError about one file of many into a notice and a count, so that the rest is used."""
    try:
        yield
    except CospeechError as error:
        notice(f"{error}; left out")
        dropped[reason] += number
