"""BVH in and out: a skeleton with offsets, then one line of Euler angles in degrees for each frame."""

import codecs
import re
import warnings
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from cospeech.errors import CospeechError, notice
from cospeech.files import writing
from cospeech.formats.animation import Animation
from cospeech.rotation import from_euler

# The rates that motion is recorded at, whole ones preferred.
COMMON_RATES = (
    10,
    12,
    15,
    20,
    24,
    25,
    30,
    48,
    50,
    60,
    72,
    75,
    90,
    100,
    120,
    144,
    150,
    180,
    200,
    240,
    300,
    360,
    480,
    960,
)
NTSC_RATES = tuple(rate * 1000 / 1001 for rate in (15, 24, 30, 60, 120, 240))


def read_bvh(path):
    """Read a BVH file as an `Animation` in the file's own units and axes (`formats.mocap` turns it into a clip).

    Rotations come from any order of channels; position channels replace the joint's OFFSET, as in Blender and
    MotionBuilder. An End Site becomes a joint `<parent>_end`. A frame time that was rounded in the file (0.033) is read
    as the common rate that it stands for (30 fps). Raises CospeechError, in one line, for a file that is no whole BVH.
    """
    path = Path(path)
    if not path.is_file():
        raise CospeechError(f"{path}: no such file")
    text = _text(path)
    if not re.match(r"\s*HIERARCHY\b", text, re.IGNORECASE):
        raise CospeechError(f"{path}: not a BVH file (its first word is not HIERARCHY)")
    motion = re.search(r"^[ \t]*MOTION[ \t]*$", text, re.IGNORECASE | re.MULTILINE)
    names, parents, offsets, channels = _read_hierarchy(path, text[: motion.start() if motion else None].split()[1:])
    if not motion:
        raise CospeechError(f"{path}: has no MOTION section (file cut off, or a skeleton without motion)")
    values, fps = _read_motion(path, text, motion.end(), sum(len(c) for c in channels))
    rotations = _rotations(values, channels)
    translation, local = _translations(path, values, names, channels, offsets)
    return Animation(tuple(names), np.array(parents), offsets, rotations, translation, fps, local)


def _text(path):
    """The file's text: UTF-8, or what a byte order mark says; CospeechError that names the first line in another."""
    content = path.read_bytes()
    encoding = "utf-16" if content[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE) else "utf-8-sig"
    try:
        return content.decode(encoding).replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        if not re.match(rb"\s*HIERARCHY\b", content, re.IGNORECASE):
            return ""
        line = content[: error.start].count(b"\n") + 1
        raise CospeechError(
            f"{path}: line {line} is not UTF-8 text (Shift-JIS, Latin-1 or the like?); convert the file, as in "
            "iconv -f SHIFT_JIS -t UTF-8"
        ) from error


def _read_hierarchy(path, tokens):
    """names, parents, offsets (J, 3), and channels: for each joint the list of its channels' names, lower case."""
    try:
        names, parents, offsets, channels = _walk(path, iter(tokens))
    except (StopIteration, IndexError):
        raise CospeechError(f"{path}: the hierarchy is incomplete (file cut off?)") from None
    except ValueError as error:
        word = str(error).split(": ")[-1]
        raise CospeechError(f"{path}: the hierarchy holds {word} where a number belongs") from None
    known = re.compile("[xyz](position|rotation)")
    for name, offset, own in zip(names, offsets, channels, strict=True):
        if len(set(own)) < len(own) or not all(known.fullmatch(channel) for channel in own):
            raise CospeechError(
                f"{path}: joint {name} has CHANNELS {' '.join(own)}; expected Xposition, Yposition, Zposition, "
                "Xrotation, Yrotation, Zrotation, each at most once"
            )
        if names.count(name) > 1:
            raise CospeechError(f"{path}: two joints are named {name!r}; rename one of them")
        if not np.isfinite(offset).all():
            raise CospeechError(f"{path}: the OFFSET of joint {name} is not a finite number")
    if not any(channels):
        raise CospeechError(f"{path}: no joint has CHANNELS, so there is no motion")
    return names, parents, np.array(offsets), channels


def _walk(path, words):
    names, parents, offsets, channels, branch = [], [], [], [], []  # branch: the joints whose braces are open
    for word in words:
        keyword = word.upper()
        if keyword in ("ROOT", "JOINT", "END"):
            name = " ".join(iter(lambda: next(words), "{"))
            if keyword == "ROOT" and names:
                raise CospeechError(f"{path}: has more than one ROOT; export one character a file")
            parents.append(branch[-1] if names else -1)
            branch.append(len(names))
            names.append(f"{names[parents[-1]]}_end" if keyword == "END" else name)
            offsets.append(np.zeros(3))
            channels.append([])
        elif keyword == "OFFSET":
            offsets[branch[-1]] = np.array([float(next(words)) for _ in range(3)])
        elif keyword == "CHANNELS":
            channels[branch[-1]] = [next(words).lower() for _ in range(int(next(words)))]
        elif keyword == "}":
            branch.pop()
        else:
            raise CospeechError(f"{path}: unexpected word {word!r} in the hierarchy")
    if branch or not names:
        raise StopIteration
    return names, parents, offsets, channels


def _read_motion(path, text, begin, width):
    """values (T, width) and frames per second, from the MOTION section that begins at character `begin`."""
    head = re.compile(r"\s*Frames:\s*(\S+)\s+Frame\s+Time:\s*(\S+)[ \t]*", re.IGNORECASE).match(text, begin)
    if not head:
        raise CospeechError(f"{path}: 'Frames:' and 'Frame Time:' do not follow MOTION")
    try:
        declared, fps = int(head[1]), _rate(path, head[2])
    except ValueError:
        raise CospeechError(f"{path}: 'Frames: {head[1]}' and 'Frame Time: {head[2]}' must be numbers") from None
    first = text.count("\n", 0, head.end())  # lines before the one that the motion begins on
    lines = [(first + i, line) for i, line in enumerate(text[head.end() :].split("\n"), 1) if line.strip()]
    if 1 < len(lines) <= declared and len(lines[-1][1].split()) < width:
        lines.pop()  # a file that was cut off within its last line
    if not lines:
        raise CospeechError(f"{path}: has 0 frames of motion")
    if len(lines) != declared:
        notice(f"{path}: Frames: {declared}, but {len(lines)} whole lines of motion; these {len(lines)} are used")
    return _parse(path, lines, width), fps


def _rate(path, text):
    """Frames per second of a printed frame time; one that was rounded in print means the common rate beside it."""
    seconds = float(text)
    if not 0 < seconds < np.inf:
        raise CospeechError(f"{path}: the frame time is {text} s; it must be more than 0")
    if abs(1 / seconds - round(1 / seconds)) < 1e-6:
        return float(round(1 / seconds))
    mantissa, _, exponent = text.lower().partition("e")
    digit = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))  # the last one that was printed
    # rounded, or cut off (0.016 for 60 fps): then the whole digit above what is printed is possible
    for rates, below, above in ((COMMON_RATES, 0.5, 0.5), (NTSC_RATES, 0.5, 0.5), (COMMON_RATES, 0.0, 1.0)):
        rate = min(rates, key=lambda rate: abs(1 / rate - seconds - (above - below) / 2 * digit))
        if -below * 1.001 <= (1 / rate - seconds) / digit <= above * 1.001:
            if abs(rate * seconds - 1) > 1e-3:
                notice(f"{path}: the frame time {text} s is taken as {rate:g} frames per second, rounded in print")
            return float(rate)
    return 1 / seconds


def _parse(path, lines, width):
    """(T, width) float64 from (line number, line) pairs; CospeechError names the first bad line."""
    try:
        values = np.loadtxt([line for _, line in lines], ndmin=2, comments=None)
    except ValueError:
        values = np.zeros((0, 0))
    if values.shape == (len(lines), width) and np.isfinite(values).all():
        return values
    for number, line in lines:
        words = line.split()
        if len(words) != width:
            raise CospeechError(f"{path}: line {number} holds {len(words)} numbers, the hierarchy has {width} channels")
        for word in words:
            if not re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?", word, re.IGNORECASE):
                raise CospeechError(f"{path}: line {number} holds {word!r}, which is not a finite number")
    raise CospeechError(f"{path}: the motion holds numbers too large to be read")


def _columns(channels):
    """For each joint the index of its first column."""
    return np.concatenate([[0], np.cumsum([len(c) for c in channels])[:-1]]).astype(int)


def _rotations(values, channels):
    """(T, J, 4): local rotations; joints that share an order of axes are converted together."""
    rotations = np.zeros((len(values), len(channels), 4))
    rotations[..., 3] = 1.0
    groups = {}
    for joint, (own, first) in enumerate(zip(channels, _columns(channels), strict=True)):
        places = [(c[0].upper(), first + i) for i, c in enumerate(own) if c.endswith("rotation")]
        if places:
            axes, columns = zip(*places, strict=True)
            groups.setdefault("".join(axes), []).append((joint, columns))
    for order, members in groups.items():
        joints, columns = map(list, zip(*members, strict=True))
        rotations[:, joints] = from_euler(order, values[:, columns])
    return rotations


def _translations(path, values, names, channels, offsets):
    """The root's translation (T, 3), and (T, J, 3) offsets where a joint's position channels change them, else None."""
    local = np.broadcast_to(offsets, (len(values), *offsets.shape)).copy()
    for joint, (own, first) in enumerate(zip(channels, _columns(channels), strict=True)):
        axes = ["xyz".index(c[0]) for c in own if c.endswith("position")]
        moved = values[:, [first + i for i, c in enumerate(own) if c.endswith("position")]]
        if joint and axes and not moved.any() and offsets[joint].any():
            notice(f"{path}: the position channels of {names[joint]} are all zero; its OFFSET is used")
            continue
        local[:, joint, axes] = moved
    fixed = np.allclose(local[:, 1:], offsets[1:], atol=1e-6)
    return local[:, 0].copy(), None if fixed else local


def write_bvh(path, animation, scale=100.0, order="ZYX"):
    """Write an `Animation` (metres) as BVH: centimetres by default, Euler angles in `order`, six decimals.

    The root has six channels, every other joint three (six when `animation.local` moves it); a leaf gets an End Site,
    and a leaf named `<parent>_end` becomes one. The root's OFFSET is zero, since readers disagree on whether its
    position channels replace or add to it. The file is written whole or not at all.
    """
    children = [[] for _ in animation.names]
    for joint, parent in enumerate(animation.parents):
        if parent >= 0:
            children[parent].append(joint)
    lines, joints = ["HIERARCHY"], []
    _describe(animation, int(np.argmin(animation.parents)), children, scale, order, 0, lines, joints)
    values = _frames(animation, joints, scale, order)
    if not np.isfinite(values).all() or not values.size:
        raise CospeechError(
            f"{path}: not written, the animation has {'NaN or infinity' if values.size else '0 frames'}"
        )
    lines += ["MOTION", f"Frames: {len(animation)}", f"Frame Time: {1 / animation.fps:.10f}", ""]
    with writing(path) as temporary:
        temporary.write_bytes("\n".join(lines).encode() + _six_decimals(values))


def _frames(animation, joints, scale, order):
    """(T, C) values of the motion section, columns in the order of `joints`."""
    with warnings.catch_warnings():  # at gimbal lock one angle is free; scipy warns and sets it to zero, as wanted
        warnings.simplefilter("ignore", UserWarning)
        turns = Rotation.from_quat(animation.rotations[:, joints].reshape(-1, 4)).as_euler(order, degrees=True)
    turns = turns.reshape(len(animation), len(joints), 3)
    columns = []
    for i, joint in enumerate(joints):
        if animation.parents[joint] < 0:
            columns.append(animation.translation * scale)
        elif animation.local is not None:
            columns.append(animation.local[:, joint] * scale)
        columns.append(turns[:, i])
    return np.concatenate(columns, axis=1)


def _six_decimals(values):
    """(T, C) floats as text, a line for each row; digit by digit for all at once takes half the time of `%.6f`."""
    millionths = np.rint(np.abs(values) * 1e6).astype(np.int64)
    negative = (values < 0) & (millionths > 0)
    whole = max(1, len(str(millionths.max())) - 6)  # digits before the point
    text = np.full((*values.shape, whole + 9), ord(" "), np.uint8)  # sign, whole, point, 6 decimals, separator
    if millionths.max() < 2**31:
        millionths = millionths.astype(np.int32)
    for column in [*range(whole + 7, whole + 1, -1), *range(whole, 0, -1)]:
        shown = (millionths > 0) | (column >= whole)  # no zeros in front
        rest = millionths // 10
        text[..., column] = np.where(shown, ord("0") + millionths - 10 * rest, ord(" "))
        millionths = rest
    text[..., whole + 1] = ord(".")
    first = np.argmax(text != ord(" "), axis=-1)[..., None]
    np.put_along_axis(text, first - 1, np.where(negative, ord("-"), ord(" ")).astype(np.uint8)[..., None], axis=-1)
    text[:, -1, -1] = ord("\n")
    return text.tobytes()


def _describe(animation, joint, children, scale, order, depth, lines, joints):
    """Append the joint's block to `lines` and, depth first as BVH orders its columns, the joint to `joints`."""
    name, parent, indent = animation.names[joint], animation.parents[joint], "\t" * depth
    offset = np.zeros(3) if parent < 0 else np.round(animation.offsets[joint] * scale, 6) + 0.0
    if parent >= 0 and not children[joint] and name == f"{animation.names[parent]}_end":
        lines += _end_site(offset, indent)
        return
    joints.append(joint)
    place = "Xposition Yposition Zposition " if parent < 0 or animation.local is not None else ""
    turn = " ".join(f"{axis}rotation" for axis in order)
    lines += [f"{indent}{'ROOT' if parent < 0 else 'JOINT'} {name}", f"{indent}{{"]
    lines += [f"{indent}\tOFFSET {' '.join(f'{v:.6f}' for v in offset)}"]
    lines += [f"{indent}\tCHANNELS {6 if place else 3} {place}{turn}"]
    for child in children[joint]:
        _describe(animation, child, children, scale, order, depth + 1, lines, joints)
    if not children[joint]:
        lines += _end_site(np.zeros(3), indent + "\t")
    lines.append(f"{indent}}}")


def _end_site(offset, indent):
    numbers = " ".join(f"{v:.6f}" for v in offset)
    return [f"{indent}End Site", f"{indent}{{", f"{indent}\tOFFSET {numbers}", f"{indent}}}"]
