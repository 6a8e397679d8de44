"""A film with what was seen drawn into it: the quickest way to judge a track or a clip."""

import numpy as np

from cospeech.capture.film.decoding import open_film
from cospeech.errors import CospeechError
from cospeech.speech import audio_duration, load_audio

COLOURS = {"body": (80, 220, 100), "left_hand": (80, 160, 255), "right_hand": (255, 140, 60)}
COLOURS["face_landmarks"] = (235, 235, 235)
FAINT = 0.3  # score below which a point is not drawn
LONGEST = 960  # pixels of the written film's longer side


def track_pictures(track, video, longest=LONGEST):
    """Yield (height, width, 3) uint8 pictures of the film with the points and bones of a Track, one a frame.

    A part that is not observed is not drawn; a mark in the upper left corner tells when a new shot begins.
    """
    film = open_film(video, track.start, fps=track.fps)
    _check_size(track, film, video)
    scale = film.size(longest)[0] / track.width
    for picture in film.pictures(longest):
        if picture.index >= track.frames:
            return
        rgb = np.ascontiguousarray(picture.rgb)
        for part, points in track.parts.items():
            if points.observed[picture.index]:
                _draw(rgb, points, picture.index, scale, COLOURS[part])
        if picture.index in track.cuts:
            rgb[: rgb.shape[0] // 20, : rgb.shape[0] // 20] = (255, 0, 0)
        yield rgb


def clip_pictures(clip, video, start=0.0, longest=LONGEST):
    """Yield pictures of the film with a Clip's figure beside it, seen from the front, one a frame.

    A clip knows no pixels any more: its joints are drawn to a scale of their own, right of the picture; what is not
    valid is grey.
    """
    film = open_film(video, start, fps=clip.fps)
    for picture in film.pictures(longest):
        if picture.index >= clip.frames:
            return
        yield np.hstack([picture.rgb, _figure(clip, picture.index, picture.rgb.shape[0])])


def sound_of(video, start, seconds):
    """(samples, rate) of a stretch of a film's sound, or None for a silent film."""
    try:
        length = audio_duration(video)
    except CospeechError:
        return None
    return load_audio(video, start=start, end=min(start + seconds, length)) if length > start else None


def _check_size(track, film, video):
    if (film.width, film.height) != (track.width, track.height):
        raise CospeechError(
            f"{video}: is {film.width} x {film.height} pixels, the track was made of a film ({track.source}) of "
            f"{track.width} x {track.height}; give that film"
        )


def _draw(rgb, points, frame, scale, colour):
    import cv2

    xy = np.clip((points.xy[frame] + 0.5) * scale, -10000, 10000).astype(int)
    shown = points.score[frame] >= FAINT
    table = points.table
    thickness = max(rgb.shape[0] // 300, 1)
    for joint, parent in enumerate(table.parents):
        if parent >= 0 and parent != joint and shown[joint] and shown[parent] and len(table) < 68:
            cv2.line(rgb, xy[parent].tolist(), xy[joint].tolist(), colour, thickness, cv2.LINE_AA)
    for joint in np.flatnonzero(shown):
        cv2.circle(rgb, xy[joint].tolist(), thickness if len(table) < 68 else 1, colour, -1, cv2.LINE_AA)


def _figure(clip, frame, height):
    """(height, height, 3) picture of one pose of a Clip from the front: 1.5 m of it."""
    import cv2

    from cospeech.skeleton import UPPER55

    picture = np.full((height, height, 3), 30, np.uint8)
    scale = height / 1.5
    # the speaker's left is on the right of a picture taken from the front
    xy = (clip.positions[frame, :, :2] * (scale, -scale) + (height / 2, 0.62 * height)).astype(int)
    for joint, parent in enumerate(UPPER55.tree):
        part = "body" if joint < 13 else "right_hand" if joint < 34 else "left_hand"
        colour = COLOURS[part] if clip.valid[frame] else (120, 120, 120)
        if parent >= 0:
            cv2.line(picture, xy[parent].tolist(), xy[joint].tolist(), colour, max(height // 240, 1), cv2.LINE_AA)
    return picture
