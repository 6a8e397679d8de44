"""Motion of every generator: the speaker's bones, hands at their wrists, hips that do not move, no frame twice."""

from dataclasses import replace

import numpy as np
import pybvh
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cospeech.body.physique import Build
from cospeech.clip import Clip, speaker_build
from cospeech.errors import CospeechNotice
from cospeech.formats.export import export_clip
from cospeech.formats.ik import NAMES, SOURCES
from cospeech.gestures.generator import Recordings, Speech
from cospeech.matching import Database
from cospeech.matching.knn import RANK
from cospeech.matching.search.similarity import Settings, train_similarity
from cospeech.skeleton import BASES, CHAINS, HAND_ROOTS, UPPER55, bone_lengths, to_parent_relative
from cospeech.speech import write_wav
from cospeech.split import split_clips
from cospeech.synthesis import load, synthesize, train
from tests.conftest import make_clip

TINY = {"steps": 3, "batch": 4, "width": 0.05}
NETWORKS = {
    "regression": TINY,
    "gesture_gan": TINY,
    "velocity_gan": TINY,
    "lstm": {"steps": 3, "batch": 4, "hidden": 8},
    "moglow": {"steps": 3, "batch": 4, "frames": 32, "hidden": 8, "flows": 2},
    "resync": {"steps": 3, "batch": 4, "width": 0.05, "residual": False},
}
HIPS = UPPER55.joints("right_hip", "left_hip")
WRISTS = UPPER55.joints("right_wrist", "left_wrist")
PLACE = np.array([[-0.09, -0.05, 0.01], [0.09, -0.05, 0.01]], np.float32)
RATE = 16000


def still_hips(seed):
    """A toy clip whose hips and last face coefficient never move."""
    clip = make_clip(seed)
    positions, expression = clip.positions.copy(), clip.expression.copy()
    positions[:, HIPS], expression[:, -1] = PLACE, 0.25
    return replace(clip, positions=positions, expression=expression)


@pytest.fixture(scope="module")
def clips():
    return [still_hips(seed) for seed in range(4)]


@pytest.fixture(scope="module")
def subject(tmp_path_factory, clips):
    """The folder of a subject with every network, hardly trained."""
    folder = tmp_path_factory.mktemp("whole")
    split_clips({c.clip: c.frames for c in clips}, {}, {"train": 0.8, "test": 0.2}).write(folder / "split.h5")
    for clip in clips:
        clip.write(folder / "clips" / f"{clip.clip}.h5")
    database = Database.from_clips(clips)
    database.save(folder / "database.h5")
    train_similarity(database, Settings(steps=3, embedding=8))[0].save(folder / RANK)
    for model, budget in NETWORKS.items():
        given = {"database": database} if model == "resync" else {}
        train(model, Recordings(clips, **given), budget, seed=0, folder=folder / "models" / model, threads=1)
    return folder


def speak(subject, model, seconds=9.0, audio_rank=None, **options):
    samples = (np.random.default_rng(3).normal(size=round(seconds * RATE)) * 0.05).astype(np.float32)
    generator = load(model, subject, 1, audio_rank=audio_rank)
    return synthesize(generator, Speech(samples, RATE), subject="toy", clip="talk", model=model, **options)


@pytest.mark.parametrize("smoothing", [None, 4.0])
@pytest.mark.parametrize("model", [*NETWORKS, "knn", "mean_pose"])
def test_bones_are_the_speakers_and_hands_are_at_their_wrists(subject, clips, model, smoothing):
    made = speak(subject, model, smoothing=smoothing).positions
    relative = np.linalg.norm(made - made[:, np.where(UPPER55.tree < 0, UPPER55.root, UPPER55.tree)], axis=-1)
    assert np.abs(relative - speaker_build(clips).bone_lengths).max() < 1e-5
    assert np.linalg.norm(made[:, HAND_ROOTS] - made[:, WRISTS], axis=-1).max() < 1e-6


@pytest.mark.parametrize("model", [*NETWORKS, "knn", "mean_pose"])
def test_what_the_speaker_never_moves_does_not_move(subject, model):
    """Hips are channels that do not vary: networks answer their mean, exactly."""
    made = speak(subject, model)
    np.testing.assert_allclose(
        made.positions[:, HIPS], np.broadcast_to(PLACE, made.positions[:, HIPS].shape), atol=1e-6
    )
    if made.expression is not None:
        assert np.all(made.expression[:, -1] == np.float32(0.25))


@pytest.mark.parametrize("residual", [True, False])
def test_the_refiner_leaves_constant_channels_whatever_it_is_given(clips, residual):
    import torch

    from cospeech.matching.resync.gan import ResyncTask, settings_from

    asked = settings_from({**NETWORKS["resync"], "residual": residual})
    network = ResyncTask(clips, asked, 0, Database.from_clips(clips)).generator.eval()
    torch.nn.init.normal_(network.decoder.head.weight)
    rng = torch.Generator().manual_seed(0)
    features, matched = (torch.randn(2, n, 64, generator=rng) for n in (28, 165))
    with torch.inference_mode():
        refined, critic_sees = network(features, matched), network.refine(network.joined(features, matched))
    hips = [3 * joint + axis for joint in HIPS for axis in range(3)]
    if not residual:  # a residual keeps what it is given, which a search has from the recordings
        assert torch.equal(refined[:, hips], network.motion_mean[hips].expand(2, -1, 64))
        assert not critic_sees[:, hips].any()
    assert torch.equal(refined[:, hips], network.motion_mean[hips].expand(2, -1, 64))


def test_no_frame_is_shown_twice_unless_published(subject, clips):
    """The published search shows the frame that resembles the last one: often that very frame, once more."""
    still = {
        model: np.abs(np.diff(speak(subject, model, 30.0).positions, axis=0)).max(axis=(1, 2)) < 1e-6
        for model in ("knn", "knn_published", "resync")
    }
    assert not still["knn"].any() and not still["resync"].any() and still["knn_published"].any()


def test_the_published_search_is_the_recordings_own_frames(subject, clips):
    made = speak(subject, "knn_published")
    known = {frame.tobytes() for clip in clips for frame in clip.positions}
    assert all(frame.tobytes() in known for frame in made.positions)
    named = speak(subject, "knn", audio_rank="plain", placement="published", seams="off")
    assert named.trace.settings["seams"] == "off" and np.array_equal(named.positions, made.positions)


def test_the_learned_rank_is_the_default_where_there_is_one(subject, tmp_path):
    (tmp_path / "database.h5").write_bytes((subject / "database.h5").read_bytes())
    features = make_clip(8).features

    def made(folder, rank=None):
        return load("knn", folder, audio_rank=rank).generate(features).positions

    with pytest.warns(CospeechNotice, match="audio_rank"):
        plain = made(tmp_path)
    assert np.array_equal(made(subject), made(subject, "learned")) and not np.array_equal(made(subject), plain)


def test_build_of_valid_frames_alone():
    clip = make_clip(0)
    torn = clip.positions.copy()
    torn[100:] *= 2.0
    half = replace(clip, positions=torn, valid=np.arange(clip.frames) < 100)
    np.testing.assert_allclose(speaker_build([half]).bone_lengths, bone_lengths(clip.positions), atol=1e-6)
    assert same(Database.from_clips([half]).build, speaker_build([half]))


def test_a_database_keeps_the_build(subject, clips):
    extended = Database.from_clips(clips[:2]).extend(clips[2:])
    assert same(Database.load(subject / "database.h5").build, speaker_build(clips))
    assert same(extended.build, speaker_build(clips))


def same(one, other):
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in ("bone_lengths", "palms"))


def turned_hands(rng, frames):
    """A motion whose palms are rigid and turn anyhow."""
    positions = np.repeat(make_clip(0, 1).positions, frames, axis=0).astype(float)
    turns = Rotation.random(2 * frames, random_state=rng).as_matrix().reshape(frames, 2, 3, 3)
    palms = rng.normal(size=(2, 5, 3)) * 0.05
    moved = np.einsum("thab,hpb->thpa", turns, palms) + positions[:, HAND_ROOTS, None] - positions[:, BASES]
    for i in range(4):
        positions[:, CHAINS[..., i]] += moved
    return positions


def distances(positions):
    """Between the bases of each hand's fingers, and to the hand root: (T, 2, 6, 6)."""
    points = np.concatenate([positions[:, HAND_ROOTS, None], positions[:, BASES]], axis=2)
    return np.linalg.norm(points[..., None, :] - points[..., None, :, :], axis=-1)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_rigid_palms_stay_as_they_are_and_torn_ones_become_rigid(seed):
    rng = np.random.default_rng(seed)
    positions = turned_hands(rng, 6)
    build = Build.measure(positions)
    np.testing.assert_allclose(build.restored(positions), positions, atol=1e-9)
    torn = positions + rng.normal(size=positions.shape) * 0.01
    whole = build.restored(torn)
    np.testing.assert_allclose(distances(whole), np.broadcast_to(distances(positions)[:1], (6, 2, 6, 6)), atol=1e-9)
    fingers = np.linalg.norm(to_parent_relative(whole), axis=-1)[:, 13:]
    np.testing.assert_allclose(fingers, np.broadcast_to(build.bone_lengths[13:], fingers.shape), atol=1e-9)
    assert np.linalg.norm(whole - positions, axis=-1).max() < 0.2  # fingers still point where they did, nearly


@pytest.mark.parametrize("model", [*NETWORKS, "knn"])
def test_exported_bones_are_the_clips(subject, model, tmp_path):
    """A BVH can only turn bones, so it agrees with a clip where palms are as rigid as its bones are long."""
    clip = speak(subject, model)
    export_clip(clip, tmp_path / "talk.bvh")
    read = pybvh.read_bvh_file(str(tmp_path / "talk.bvh"))
    found = read.joint_positions()[:, [list(read.joint_names).index(name) for name in NAMES]] / 100
    hands = [i for i, name in enumerate(NAMES) if "Hand" in name]
    wrist = [NAMES.index("LeftHand" if "Left" in NAMES[i] else "RightHand") for i in hands]
    made = clip.positions[:, SOURCES]
    apart = (found[:, hands] - found[:, wrist]) - (made[:, hands] - made[:, wrist])
    assert np.linalg.norm(apart, axis=-1).max() < 1e-3


def test_command_line_names_the_published_search(subject, clips, tmp_path):
    from cospeech.cli import main

    write_wav(tmp_path / "talk.wav", (np.random.default_rng(3).normal(size=5 * RATE) * 0.05).astype("f4"), RATE)
    (tmp_path / "config.yaml").write_text(f"results_dir: {subject.parent}\nfps: 15\n")
    made = {}
    for name, model, more in [
        ("named", "knn", ["--placement", "published", "--seams", "off", "--audio-rank", "plain"]),
        ("row", "knn_published", []),
        ("default", "knn", []),
    ]:
        out = tmp_path / f"{name}.h5"
        asked = ["--subject", subject.name, "--model", model, "--audio", str(tmp_path / "talk.wav"), "--out", str(out)]
        assert main(["generate", *asked, "--config", str(tmp_path / "config.yaml"), *more]) == 0
        made[name] = Clip.read(out).positions
    assert np.array_equal(made["named"], made["row"]) and not np.array_equal(made["named"], made["default"])
