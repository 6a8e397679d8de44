"""Mini-batches for training: several data sets as one, augmented in a thread of their own."""

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import cv2
import numpy as np

from cospeech.errors import CospeechError
from cospeech.posenet.samples import Batch
from cospeech.posenet.store import LABELS, Store
from cospeech.posenet.training.augment import augment, augment_labels

IN_MEMORY = 1 << 30  # bytes: a store whose decoded crops are fewer is decoded once, which is nine tenths of reading it

BACKGROUNDS = 500  # at most so many pictures to put people of other data sets in front of


class Mixture:
    """The people of several stores, counted through.

    backgrounds : whether `crops` may put people in front of what is behind those without 3D labels (stores with masks).
    part : what all of them show. labelled3d (N,) bool. bone_lengths (subjects, J) mm, of those who have 3D labels;
    mean_pose (J, 3) mm is theirs too, None without any. licence_note : of all stores.
    """

    def __init__(self, paths, backgrounds=False):
        self.stores = [Store(path) for path in paths]
        if not self.stores:
            raise CospeechError("pose network: no data set was named to train on; see `cospeech posenet prepare`")
        self.part = self.stores[0].part
        for store in self.stores:
            if store.part != self.part:
                raise CospeechError(f"{store.path}: shows a {store.part}, {self.stores[0].path} a {self.part}")
        self.people = [_decoded(store, backgrounds) for store in self.stores]
        self.backgrounds = _backgrounds(self.stores) if backgrounds else None
        self.labelled3d = np.concatenate([store.labelled3d for store in self.stores])
        self.bone_lengths = np.concatenate([store.bone_lengths for store in self.stores])
        poses = np.concatenate([store.joints3d[store.labelled3d] for store in self.stores])
        self.mean_pose = poses.mean(axis=0) if len(poses) else None
        notes = dict.fromkeys(f"{store.attrs['source']}: {store.attrs['licence_note']}" for store in self.stores)
        self.licence_note = "; ".join(notes)
        self.starts = np.cumsum([0, *map(len, self.stores)])

    def crops(self, chosen, rng, size, **options):
        """Augmented Batch of the people with these numbers, store by store; options are those of `augment`."""
        pieces = []
        for store, people, low in zip(self.stores, self.people, self.starts[:-1], strict=True):
            mine = chosen[(chosen >= low) & (chosen < low + len(store))] - low
            if len(mine):
                pieces.append(
                    augment(
                        people[mine],
                        rng,
                        size,
                        part=self.part,
                        margin=store.margin,
                        background=self.backgrounds,
                        **options,
                    )
                )
        return _joined(pieces, ("images", *LABELS))

    def labels(self, chosen, rng, size, **options):
        """The same without images, thousands a second; options are those of `augment_labels`."""
        pieces = []
        for store, low in zip(self.stores, self.starts[:-1], strict=True):
            mine = chosen[(chosen >= low) & (chosen < low + len(store))] - low
            if len(mine):
                batch = Batch(None, *(getattr(store, name)[mine] for name in LABELS))
                options |= {"part": self.part, "margin": store.margin, "side": store.size}
                pieces.append(augment_labels(batch, rng, size, **options))
        return _joined(pieces, LABELS)


def _joined(batches, names):
    return Batch(**{"images": None} | {n: np.concatenate([getattr(batch, n) for batch in batches]) for n in names})


def _decoded(store, masks):
    """A Batch of the whole store, with masks if they are needed, or the store itself when it is large."""
    if len(store) * store.size**2 * 3 > IN_MEMORY:
        return store
    people = store[:]
    return people if masks else replace(people, mask=None)


def _backgrounds(stores):
    """(M, h, w, 3) uint8: what is behind people without 3D labels, or None where no store has such with masks."""
    for store in stores:
        batch = store[np.flatnonzero(~store.labelled3d)[:BACKGROUNDS]]
        if batch.mask is not None and len(batch):
            return np.stack([_emptied(image, mask) for image, mask in zip(batch.images, batch.mask, strict=True)])
    return None


def _emptied(image, mask):
    """A picture without its person, painted over from around (Telea 2004)."""
    edge = max(3, len(image) // 24) | 1  # blurred outlines and contact shadows, too, would keep the person's shape
    person = cv2.dilate((mask > 0).astype(np.uint8), np.ones((edge, edge), np.uint8))
    return cv2.inpaint(np.ascontiguousarray(image), person, 3, cv2.INPAINT_TELEA)


class Loader:
    """Makes mini-batches in a thread while the network learns from the ones before.

    draw(step) makes one from its number alone, so that neither the thread's pace nor an interruption changes anything.
    prefetch : how many are made before they are needed; with 0 each is made when it is taken, which is faster where the
    network computes on every core: its threads wait for one another, and so for whoever else has a core.
    waited : seconds that `take` has waited so far, the part of a training that the data holds up.
    """

    def __init__(self, draw, steps, prefetch=3):
        self.draw, self.steps, self.prefetch = draw, steps, prefetch
        self.thread = ThreadPoolExecutor(1, "loader")
        self.coming, self.waited = {}, 0.0

    def take(self, step):
        """What draw(step) returns."""
        began = time.perf_counter()
        taken = self._coming(step).result() if self.prefetch else self.draw(step)
        self.waited += time.perf_counter() - began
        return taken

    def _coming(self, step):
        for number in range(step, min(step + 1 + self.prefetch, self.steps)):
            if number not in self.coming:
                self.coming[number] = self.thread.submit(self.draw, number)
        return self.coming.pop(step)

    def close(self):
        """Drop what is not begun yet; called at the end, and when a training is interrupted."""
        self.thread.shutdown(wait=True, cancel_futures=True)
