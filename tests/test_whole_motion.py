"""Motion of every generator: the speaker's bones, hands at their wrists, hips that do not move, no frame twice."""

from dataclasses import replace

import numpy as np
import pytest

from cospeech.clip import Clip, speaker_bones
from cospeech.errors import CospeechNotice
from cospeech.gestures.generator import Recordings, Speech
from cospeech.matching import Database
from cospeech.matching.knn import RANK
from cospeech.matching.search.similarity import Settings, train_similarity
from cospeech.skeleton import UPPER55, bone_lengths
from cospeech.speech import write_wav
from cospeech.split import split_clips
from cospeech.synthesis import load, synthesize, train
from tests.conftest import make_clip

TINY = {"steps": 3, "batch": 4, "width": 0.05}
NETWORKS = {
    "regression": TINY, "gesture_gan": TINY, "velocity_gan": TINY, "lstm": {"steps": 3, "batch": 4, "hidden": 8},
    "moglow": {"steps": 3, "batch": 4, "frames": 32, "hidden": 8, "flows": 2},
    "resync": {"steps": 3, "batch": 4, "width": 0.05, "residual": False},
}  # fmt: skip
HIPS = UPPER55.joints("right_hip", "left_hip")
WRISTS = UPPER55.joints("right_wrist", "left_wrist")
HAND_ROOTS = UPPER55.joints("right_hand_root", "left_hand_root")
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
    for model, settings in NETWORKS.items():
        given = {"database": database} if model == "resync" else {}
        train(model, Recordings(clips, **given), settings, seed=0, folder=folder / "models" / model, threads=1)
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
    assert np.abs(relative - speaker_bones(clips)).max() < 1e-5
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

    settings = settings_from({**NETWORKS["resync"], "residual": residual})
    network = ResyncTask(clips, settings, 0, Database.from_clips(clips)).generator.eval()
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


def test_bones_of_invalid_frames_do_not_count():
    clip = make_clip(0)
    torn = clip.positions.copy()
    torn[100:] *= 2.0
    half = replace(clip, positions=torn, valid=np.arange(clip.frames) < 100)
    np.testing.assert_allclose(speaker_bones([half]), bone_lengths(clip.positions), atol=1e-6)
    assert np.array_equal(Database.from_clips([half]).bone_lengths, speaker_bones([half]))


def test_a_database_keeps_the_bones(subject, clips):
    extended = Database.from_clips(clips[:2]).extend(clips[2:])
    assert np.array_equal(Database.load(subject / "database.h5").bone_lengths, speaker_bones(clips))
    assert np.array_equal(extended.bone_lengths, speaker_bones(clips))


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
