"""The speaker through shots and beside others: which frames of a track show somebody else."""

import numpy as np

from cospeech.capture.film.shots import colour_histogram
from cospeech.errors import notice

SURE = 0.5  # score from which a point counts for the person's box
JUMP = 1.0  # box sizes that a person does not move from one frame to the next
GROWTH = 1.8  # factor by which a person does not grow or shrink from one frame to the next
GAP = 1.0  # seconds out of sight, after which the next person seen may be another
ALIKE = 0.55  # least intersection of two colour histograms of the same person
SAMPLES = 5  # pictures of each stretch whose colours are counted
HISTOGRAM_SIZE = 480  # pixels of the longer side


def frames_of_others(film, body, cuts):
    """(F,) bool: frames in which the body is somebody else's than the speaker's.

    The body's course is cut at shots and where its box jumps. Stretches whose persons look alike (colours of head and
    torso) are one person; the one seen most (frames times box size) is the speaker. One look at the film is taken
    again, and only if there are several stretches. A body that is not in the picture at all is the speaker's.
    """
    if not body.xy.any():
        return np.zeros(len(body), bool)
    boxes = person_boxes(body)
    stretches = _stretches(boxes, body.observed, cuts, film.fps)
    others = np.zeros(len(body), bool)
    if len(stretches) < 2:
        return others
    histograms = _histograms(film, boxes, stretches)
    weights = [np.sum(boxes[s, 2]) for s in stretches]
    persons = []  # [indices of stretches] of each person, beginning with the longest stretch
    for i in np.argsort(weights)[::-1]:
        like = [np.mean([np.minimum(histograms[i], histograms[j]).sum() for j in person]) for person in persons]
        if like and max(like) >= ALIKE:
            persons[int(np.argmax(like))].append(i)
        else:
            persons.append([i])
    speaker = max(persons, key=lambda person: sum(weights[i] for i in person))
    for i in set(range(len(stretches))) - set(speaker):
        others[stretches[i]] = True
    if others.any():
        notice(f"{film.path}: {others.sum()} of {len(others)} frames show another person than the speaker; not used")
    return others


def person_boxes(body):
    """(F, 3) centre x, y and size (the longer side) in pixels about the points that are sure; 0 where unobserved."""
    sure = body.score >= np.minimum(SURE, body.score.max(axis=1, keepdims=True))
    low = np.where(sure[..., None], body.xy, np.inf).min(axis=1)
    high = np.where(sure[..., None], body.xy, -np.inf).max(axis=1)
    boxes = np.column_stack([(low + high) / 2, (high - low).max(axis=1)])
    return np.where(body.observed[:, None], boxes, 0.0)


def _stretches(boxes, observed, cuts, fps):
    """[indices of frames] in which one person is followed without a break."""
    frames = np.flatnonzero(observed)
    if not len(frames):
        return []
    before, after = boxes[frames[:-1]], boxes[frames[1:]]
    size = np.maximum(np.maximum(before[:, 2], after[:, 2]), 1.0)
    grown = np.maximum(after[:, 2], 1.0) / np.maximum(before[:, 2], 1.0)
    moved = np.linalg.norm(after[:, :2] - before[:, :2], axis=1) > JUMP * size
    shot = np.searchsorted(cuts, frames, side="right")
    parted = (np.diff(shot) > 0) | moved | (np.abs(np.log(grown)) > np.log(GROWTH)) | (np.diff(frames) > GAP * fps)
    return np.split(frames, np.flatnonzero(parted) + 1)


def _histograms(film, boxes, stretches):
    """Colour histogram of the middle of each stretch's boxes, as one row that adds up to 1."""
    wanted = {}
    for number, frames in enumerate(stretches):
        for frame in frames[np.linspace(0, len(frames) - 1, min(SAMPLES, len(frames))).astype(int)]:
            wanted[int(frame)] = number
    histograms, counts = [0.0] * len(stretches), np.zeros(len(stretches))
    scale = film.size(HISTOGRAM_SIZE)[0] / film.width
    for picture in film.pictures(HISTOGRAM_SIZE):
        if picture.index not in wanted:
            continue
        x, y, size = boxes[picture.index] * scale
        height, width = picture.rgb.shape[:2]
        left, right = np.clip([int(x - size / 4), int(x + size / 4) + 1], 0, width)
        top, bottom = np.clip([int(y - size / 2), int(y + size / 4) + 1], 0, height)
        number = wanted[picture.index]
        if right > left + 1 and bottom > top + 1:
            histograms[number] = histograms[number] + colour_histogram(picture.rgb[top:bottom, left:right]).mean(axis=0)
            counts[number] += 1
    return [total / max(count, 1) + np.zeros(1) for total, count in zip(histograms, counts, strict=True)]
