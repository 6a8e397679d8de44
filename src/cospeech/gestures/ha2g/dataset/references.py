"""Reference frames: a few pictures of a speaker, by which HA2G knows whom it shall move like (Liu et al. 2022, 3.3).

Square crops of head and upper body, from the films of the training takes, where the track is surest of the speaker.
What lies around the body is black: of few films a network would learn the rooms.
"""

from dataclasses import dataclass

import numpy as np

from cospeech.clip import put_strings
from cospeech.errors import CospeechError, notice
from cospeech.files import put, reading_hdf5, writing_hdf5
from cospeech.learning.settings import COUNT, UNPUBLISHED, Section, key

SCHEMA = "cospeech.reference_frames"
SIDE = 2.8  # of what a picture shows, in shoulder widths: from above the head to the waist
BELOW = 0.2  # its centre, below the middle of the shoulders, in shoulder widths
PROFILE = 1.2  # shoulder widths in the distance of head and shoulders, for who stands sideways
HEAD, LIMB = 0.55, 0.4  # radius of a head and width of a limb with its sleeve, in shoulder widths
SUFFIX = ".h5"


@dataclass(frozen=True)
class Settings(Section, section="reference_frames"):
    """Of the pictures of each speaker; the published size is not known."""

    count: int = key(16, "pictures of each speaker", limits=COUNT, published=UNPUBLISHED)
    size: int = key(224, "side of a picture", "pixels", {"minimum": 64, "multipleOf": 32}, published=UNPUBLISHED)


@dataclass
class ReferenceFrames:
    """Pictures of one speaker.

    pictures : (K, size, size, 3) uint8, RGB. takes : K names. times : (K,) seconds from each take's start.
    sureness : (K,) the track's score of head and shoulders. licence_note : of the trackers.
    """

    subject: str
    pictures: np.ndarray
    takes: list
    times: np.ndarray
    sureness: np.ndarray
    licence_note: str = ""

    def write(self, path):
        """Write the HDF5 file (schema `cospeech.reference_frames`, docs/ha2g.md)."""
        with writing_hdf5(path, SCHEMA, subject=self.subject, licence_note=self.licence_note) as file:
            put(file, "pictures", self.pictures)
            put_strings(file, "take", self.takes)
            put(file, "time", self.times)
            put(file, "sureness", self.sureness)

    @classmethod
    def read(cls, path):
        with reading_hdf5(path, SCHEMA) as file:
            takes = list(file["take"].asstr()[()])
            arrays = file["pictures"][()], takes, file["time"][()], file["sureness"][()]
            return cls(str(file.attrs["subject"]), *arrays, str(file.attrs["licence_note"]))


def take_reference_frames(subject, films, stretches, *, count=Settings.count, size=Settings.size):
    """`ReferenceFrames` of a speaker: `count`, or all there are, spread evenly over the takes and over each take.

    Parameters
    ----------
    films : {take: (path of its film, its Track)}. stretches : {take: [(start, end), ...]}, seconds from the take's
        start that may be looked at; takes without are not opened.
    count : pictures. size : their side in pixels.

    Raises CospeechError when the speaker is seen in none of them, or a film is not the one that was tracked.
    """
    seen = {take: _frames_of_speaker(films[take][1], stretches[take]) for take in films if stretches.get(take)}
    shares = evenly([len(frames) for frames, _ in seen.values()], count)
    if sum(shares) < count:
        if not sum(shares):
            raise CospeechError(
                f"{subject}: no reference frames: nobody is seen in the films of the training takes; "
                "give others, or set ensemble.identity: speaker"
            )
        notice(f"{subject}: {sum(shares)} reference frames instead of {count}: the speaker is seen in no more")
    pictures, takes, times, sureness = [], [], [], []
    for (take, (frames, scores)), share in zip(seen.items(), shares, strict=True):
        if not share:
            continue
        video, track = films[take]
        chosen = _surest(scores, share)
        boxes = upper_body_boxes(track.body)
        pictures += [_picture(video, track, frame, boxes[frame], size) for frame in frames[chosen]]
        takes += [take] * share
        times += (frames[chosen] / track.fps).tolist()
        sureness += scores[chosen].tolist()
    notes = dict.fromkeys(note for take in takes if (note := films[take][1].licence_note))
    return ReferenceFrames(
        subject, np.stack(pictures), takes, np.array(times), np.array(sureness, np.float32), "; ".join(notes)
    )


def evenly(available, count):
    """How many frames each of some takes gives: `count` in all, or as many as are available, as even as can be."""
    shares = [0] * len(available)
    for _ in range(min(count, sum(available))):
        shares[min((share, i) for i, share in enumerate(shares) if share < available[i])[1]] += 1
    return shares


def upper_body_boxes(body):
    """(F, 4) squares about head and upper body, centre and sides in pixels, by a body's `Points`."""
    head, shoulders = (body.xy[:, joints] for joints in _head_and_shoulders(body))
    middle = shoulders.mean(axis=1)
    width = np.linalg.norm(shoulders[:, 0] - shoulders[:, 1], axis=1)
    width = np.maximum(width, PROFILE * np.linalg.norm(head.mean(axis=1) - middle, axis=1))
    return np.column_stack([middle[:, 0], middle[:, 1] + BELOW * width, SIDE * width, SIDE * width])


def _head_and_shoulders(body):
    from cospeech.capture.trackers.crops import HEADS

    names = next(names for names in HEADS if all(name in body.table.index for name in names))
    return body.table.joints(*names), body.table.joints("left_shoulder", "right_shoulder")


def _frames_of_speaker(track, stretches):
    """Frames (n,) that lie whole in the stretches and show the speaker, and how sure that is, (n,)."""
    body = track.body
    if body is None or track.refused:
        return np.zeros(0, int), np.zeros(0)
    frames = np.arange(track.frames - 1)  # the picture of the last one may lie beyond the film's last
    inside = np.zeros(len(frames), bool)
    for start, end in stretches:
        inside |= (frames / track.fps >= start) & ((frames + 1) / track.fps <= end)
    sureness = body.score[:, np.concatenate(_head_and_shoulders(body))].min(axis=1)[:-1]
    large = upper_body_boxes(body)[:-1, 2] >= 2
    frames = frames[inside & body.observed[:-1] & (sureness > 0) & large]
    return frames, sureness[frames]


def _surest(sureness, count):
    """The numbers of the surest of each of `count` equal parts; the first of equals."""
    return [part[np.argmax(sureness[part])] for part in np.array_split(np.arange(len(sureness)), count)]


def _picture(video, track, frame, box, size):
    """(size, size, 3) uint8: what the film shows in the box at a frame of the track; black beyond its edges."""
    from contextlib import closing

    from cospeech.capture.film.decoding import open_film
    from cospeech.capture.trackers.crops import crop_about

    start = track.start + frame / track.fps
    film = open_film(video, start, start + 1 / track.fps, fps=track.fps)
    if (film.width, film.height) != (track.width, track.height):
        raise CospeechError(
            f"{video}: is {film.width} x {film.height} pixels, its track was made of a film of {track.width} x "
            f"{track.height}; give that film"
        )
    crop = crop_about(box, 1.0, (size, size))
    with closing(film.pictures(max(film.width, film.height))) as pictures:
        picture = crop.cut(next(pictures).rgb)
    return np.where(_outline(track.body, frame, crop)[..., None], picture, 0).astype(np.uint8)


def _outline(body, frame, crop):
    """(size, size) bool: where the body is in a crop, roughly: a disc, the trunk down from the shoulders, limbs."""
    import cv2

    xy, seen = body.xy[frame], body.score[frame] > 0
    points = np.rint(((xy - crop.centre) / crop.size + 0.5) * crop.pixels - 0.5).astype(int)
    head, shoulders = (points[joints].mean(axis=0).astype(int) for joints in _head_and_shoulders(body))
    width = crop.pixels[0] / SIDE
    mask, thick = np.zeros(crop.pixels[::-1], np.uint8), max(round(LIMB * width), 1)
    cv2.circle(mask, head.tolist(), round(HEAD * width), 1, -1)
    cv2.line(mask, head.tolist(), shoulders.tolist(), 1, thick)
    left, right = points[body.table.joints("left_shoulder", "right_shoulder")][:, 0]
    side = np.array([min(left, right) - thick // 2, max(left, right) + thick // 2])
    mask[max(shoulders[1] - thick // 2, 0) :, max(side[0], 0) : max(side[1], 0)] = 1
    for joint, parent in enumerate(body.table.parents):
        if parent >= 0 and seen[joint] and seen[parent]:
            cv2.line(mask, points[parent].tolist(), points[joint].tolist(), 1, thick)
    return mask.astype(bool)
