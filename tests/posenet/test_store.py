"""The store of crops: what was put in comes out, in any order, whatever the batches looked like."""

import h5py
import numpy as np
import pytest

from cospeech.errors import CospeechError
from cospeech.posenet import JOINTS21
from cospeech.posenet.samples import Batch
from cospeech.posenet.store import Store, write_store


def batch(count, seed=0, side=48, mask=False, **tags):
    """Smooth pictures, as JPEG is for those."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:side, :side] / side
    waves = rng.uniform(1, 4, (count, 3, 1, 1)) * x + rng.uniform(1, 4, (count, 3, 1, 1)) * y
    images = (127 + 100 * np.sin(waves)).transpose(0, 2, 3, 1).astype(np.uint8)
    labelled = rng.random(count) < 0.7
    return Batch(
        images,
        rng.uniform(0, side, (count, 14, 2)).astype(np.float32),
        rng.random((count, 14)) < 0.8,
        np.where(labelled[:, None, None], rng.normal(0, 300, (count, 21, 3)), 0).astype(np.float32),
        labelled,
        np.where(images[..., 0] > 128, 255, 0).astype(np.uint8) if mask else None,
        {name: np.array([f"{value}{i % 2}" for i in range(count)]) for name, value in tags.items()},
    )


def test_any_selection_comes_back_in_its_order(tmp_path):
    parts = [batch(5, 0, subject="S", activity=""), batch(1, 1, subject="S"), batch(7, 2, scene="G")]
    count = write_store(
        tmp_path / "a.h5", iter(parts), part="body", source="made up", margin=1.5, licence_note="none", dropped={"x": 2}
    )
    store = Store(tmp_path / "a.h5")
    assert count == len(store) == 13
    assert (store.part, store.size, store.margin, store.attrs["dropped"]) == ("body", 48, 1.5, {"x": 2})
    chosen = np.array([12, 0, 5, 5, 3])
    found = store[chosen]
    for name in ("joints2d", "visible", "joints3d", "labelled3d"):
        np.testing.assert_array_equal(getattr(found, name), np.concatenate([getattr(p, name) for p in parts])[chosen])
    images = np.concatenate([p.images for p in parts])[chosen]
    assert np.abs(found.images.astype(int) - images).mean() < 1.5  # JPEG, and not red for blue
    assert found.tags["subject"].tolist() == ["", "S0", "S0", "S0", "S1"]
    assert found.tags["scene"].tolist() == ["G0", "", "", "", ""]
    assert len(store[2:4]) == 2 and len(store[-1]) == 1 and found.mask is None
    np.testing.assert_array_equal(store[-1].joints2d, found[:1].joints2d)


def test_masks_are_exact_and_samples_without_one_are_all_foreground(tmp_path):
    parts = [batch(3, 0), batch(2, 1, mask=True), batch(2, 2)]
    write_store(tmp_path / "a.h5", parts, part="body", source="made up")
    mask = Store(tmp_path / "a.h5")[:].mask
    assert (mask[[0, 1, 2, 5, 6]] == 255).all()
    np.testing.assert_array_equal(mask[3:5], parts[1].mask)


def test_bone_lengths_are_each_labelled_subjects_median(tmp_path):
    made = batch(40, 3, subject="S")
    made.tags["subject"][-1] = "nobody"
    made.labelled3d[-1] = False
    write_store(tmp_path / "a.h5", [made], part="body", source="made up")
    store = Store(tmp_path / "a.h5")
    expected = np.zeros((2, 21))
    for s, subject in enumerate(("S0", "S1")):
        poses = made.joints3d[made.labelled3d & (made.tags["subject"] == subject)]
        for joint, parent in enumerate(JOINTS21.parents):
            if parent >= 0:
                expected[s, joint] = np.median([np.linalg.norm(p[joint] - p[parent]) for p in poses])
    np.testing.assert_allclose(store.bone_lengths, expected, rtol=1e-5)


def test_the_same_crops_give_the_same_bytes(tmp_path):
    for name in ("a.h5", "b.h5"):
        write_store(tmp_path / name, [batch(4, mask=True, subject="S")], part="body", source="made up")
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


def test_what_does_not_fit_is_refused_and_leaves_no_file(tmp_path):
    path = tmp_path / "a.h5"
    cases = [
        ([batch(2), batch(2, side=32)], "body", r"crops of \(32, 32, 3\) after crops of side 48"),
        ([batch(2)], "face", "expected 68 joints in 2D and 68 in 3D"),
        ([batch(2)], "foot", "part 'foot' is unknown; known: body, hand, face"),
        ([], "body", "made up: no usable sample in it"),
    ]
    for batches, part, line in cases:
        with pytest.raises(CospeechError, match=line):
            write_store(path, batches, part=part, source="made up")
        assert not list(tmp_path.iterdir())


def test_a_foreign_or_damaged_file_is_told_in_one_line(tmp_path):
    path = tmp_path / "a.h5"
    write_store(path, [batch(3)], part="body", source="made up")
    with h5py.File(path, "r+") as file:
        start, end = file["images/ends"][:2]
        file["images/bytes"][start:end] = 0
    with pytest.raises(CospeechError, match="crop 1 does not decode"):
        Store(path)[1]
    with h5py.File(path, "r+") as file:
        del file["visible"]
    with pytest.raises(CospeechError, match="has no 'visible'"):
        Store(path)
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(CospeechError, match="not a readable HDF5"):
        Store(path)
