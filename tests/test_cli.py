"""The `cospeech` command on a small trained subject: files of the right length out, and one line on a mistake."""

import subprocess
import sys

import av
import numpy as np
import pytest

from cospeech.cli import main
from cospeech.clip import Clip
from cospeech.formats.bvh import read_bvh
from cospeech.gestures.generator import Recordings
from cospeech.matching import Database
from cospeech.skeleton import UPPER55, to_parent_relative
from cospeech.speech import load_audio, write_wav
from cospeech.split import split_clips
from cospeech.synthesis import train

RATE = 16000


@pytest.fixture(scope="module")
def project(tmp_path_factory, toy_clips):
    """A folder with a configuration and the results of one subject `toy`."""
    folder = tmp_path_factory.mktemp("project")
    subject = folder / "out" / "toy"
    split_clips({c.clip: c.frames for c in toy_clips}, {}, {"train": 0.8, "test": 0.2}).write(subject / "split.h5")
    Database.from_arrays(
        [c.positions for c in toy_clips],
        [c.features for c in toy_clips],
        [c.clip for c in toy_clips],
        rotations=[c.rotation for c in toy_clips],
    ).save(subject / "database.h5")
    settings = {"steps": 3, "batch": 4, "width": 0.05}
    train("regression", Recordings(toy_clips), settings, seed=0, folder=subject / "models" / "regression")
    toy_clips[0].write(subject / "clips" / "take00.h5")
    (folder / "config.yaml").write_text(f"results_dir: {folder / 'out'}\nfps: 15\n")
    write_wav(folder / "talk.wav", noise(3.21), RATE)
    (folder / "talk.tsv").write_text("word\tstart\tend\nhello\t0.5\t0.9\n")
    return folder


def noise(seconds):
    rng = np.random.default_rng(0)
    return (rng.normal(size=round(seconds * RATE)) * 0.05).astype(np.float32)


def generate(project, out, *more, model="regression", audio="talk.wav"):
    return main(
        [
            "generate",
            "--subject",
            "toy",
            "--model",
            model,
            "--audio",
            str(project / audio),
            "--out",
            str(out),
            "--config",
            str(project / "config.yaml"),
            *more,
        ]
    )


@pytest.mark.parametrize("model", ["regression", "knn"])
def test_bvh_and_film_have_the_length_of_the_speech(project, tmp_path, model):
    frames = round(3.21 * 15)
    assert generate(project, tmp_path / "talk.bvh", model=model) == 0
    animation = read_bvh(tmp_path / "talk.bvh")
    assert (len(animation), animation.fps) == (frames, pytest.approx(15))
    assert generate(project, tmp_path / "talk.mp4", model=model) == 0
    with av.open(str(tmp_path / "talk.mp4")) as film:
        assert {s.type for s in film.streams} == {"video", "audio"}
        video = film.streams.video[0]
        assert float(video.duration * video.time_base) == pytest.approx(frames / 15, abs=1e-3)


def test_clip_knows_how_it_was_made(project, tmp_path):
    assert generate(project, tmp_path / "talk.h5", "--seed", "5", "--initial", "random", model="knn") == 0
    clip = Clip.read(tmp_path / "talk.h5")
    assert (clip.subject, clip.generator, clip.clip, clip.extra["seed"]) == ("toy", "knn", "talk", 5)
    assert clip.words.text == ["hello"] and clip.source == "talk.wav" and len(clip.source_sha256) == 64
    assert load_audio(clip.audio)[1] == RATE


def test_seed_and_k_choose_other_motion(project, tmp_path):
    made, runs = {}, {"a": [], "b": [], "k2": ["--k", "2"], "seed": ["--seed", "1"], "mean": ["--initial", "mean"]}
    for name, more in runs.items():
        assert generate(project, tmp_path / f"{name}.h5", *more, model="knn") == 0
        made[name] = Clip.read(tmp_path / f"{name}.h5").positions
    assert np.array_equal(made["a"], made["b"])
    assert not any(np.array_equal(made["a"], made[other]) for other in ("k2", "seed", "mean"))


@pytest.fixture
def gestures(project, tmp_path):
    """A file with the gesture `wave`: from two seconds of a recorded clip, its stroke at 5.0 s."""
    clip = project / "out" / "toy" / "clips" / "take00.h5"
    (tmp_path / "gestures.yaml").write_text(f"wave: {{clip: {clip}, stroke: 5.0, start: 4.5, end: 5.5}}\n")
    return str(tmp_path / "gestures.yaml")


def test_a_keywords_gesture_is_at_its_stroke_where_the_word_is_spoken(project, tmp_path, capsys, gestures):
    """`hello` is spoken from 0.5 to 0.9 s: there, in frame 10, the stroke, frame 75 of the recorded clip."""
    options = ["--keyword", "Hello=wave", "--gestures", gestures, "--explain", "--seams", "off"]
    assert generate(project, tmp_path / "k.h5", *options, model="knn") == 0
    assert "Hello=wave" in capsys.readouterr().out
    clip, truth = Clip.read(tmp_path / "k.h5"), Clip.read(project / "out" / "toy" / "clips" / "take00.h5")
    assert clip.trace.texts("take")[10] == "take00.h5" and clip.trace.columns["time"][10] == pytest.approx(5.0)
    np.testing.assert_allclose(clip.positions[8:16], truth.positions[73:81], atol=1e-5)


def test_frames_are_replaced_whatever_the_model(project, tmp_path):
    source = project / "out" / "toy" / "clips" / "take00.h5"
    for model in ("regression", "knn"):
        out = tmp_path / f"{model}.h5"
        assert generate(project, out, "--replace", f"1.0-2.0={source}@10.2", model=model) == 0
        clip = Clip.read(out)
        found, truth = clip.positions[15:30], Clip.read(source).positions[153:168]
        directions = [to_parent_relative(p)[:, UPPER55.index["left_wrist"]] for p in (found, truth)]
        assert np.degrees(np.arccos(np.clip(cosines(*directions), -1, 1))).max() < 0.1
        assert set(clip.trace.texts("take")[15:30]) == {"take00.h5"}


def cosines(a, b):
    return np.sum(a * b, axis=1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)


def test_seams_change_only_how_windows_follow_each_other(project, tmp_path):
    made = {}
    for name, more in {"none": [], "off": ["off"], "blend": ["blend"], "inertialize": ["inertialize"]}.items():
        assert generate(project, tmp_path / f"{name}.h5", *(["--seams", *more] if more else []), model="knn") == 0
        made[name] = Clip.read(tmp_path / f"{name}.h5")
    assert np.array_equal(made["none"].positions, made["inertialize"].positions)
    assert all(np.array_equal(c.trace.columns["time"], made["off"].trace.columns["time"]) for c in made.values())
    assert len({clip.positions.tobytes() for clip in made.values()}) == 3


def test_export_render_and_info(project, tmp_path, capsys):
    clip = str(project / "out" / "toy" / "clips" / "take00.h5")
    for name in ("a.bvh", "a.glb", "a.csv"):
        assert main(["export", clip, str(tmp_path / name)]) == 0
        assert (tmp_path / name).stat().st_size > 1000
    assert main(["render", clip, clip, str(tmp_path / "a.mp4")]) == 0
    for file in (clip, project / "out/toy/database.h5", project / "out/toy/models/regression/weights.safetensors"):
        capsys.readouterr()
        assert main(["info", str(file)]) == 0
        assert len(capsys.readouterr().out.splitlines()) > 5


def mistakes(project, tmp_path):
    """{what is done wrong: (arguments of generate, words that the line must hold)}."""
    (tmp_path / "empty.wav").write_bytes(b"")
    (tmp_path / "text.wav").write_text("this is no sound")
    (tmp_path / "bad.yaml").write_text("a: [1")
    write_wav(tmp_path / "short.wav", noise(0.01), RATE)
    good = {"--subject": "toy", "--model": "regression", "--audio": project / "talk.wav", "--out": tmp_path / "o.bvh"}
    good["--config"] = project / "config.yaml"
    return good, {
        "model": ({"--model": "resnyc"}, ["resnyc", "resync"]),
        "subject": ({"--subject": "nobody"}, ["nobody", "toy"]),
        "subject path": ({"--subject": "../toy"}, ["../toy"]),
        "not trained": ({"--model": "gesture_gan"}, ["model.onnx", "train"]),
        "suffix": ({"--out": tmp_path / "o.fbx"}, [".fbx", ".bvh"]),
        "no audio": ({"--audio": tmp_path / "absent.wav"}, ["absent.wav"]),
        "empty audio": ({"--audio": tmp_path / "empty.wav"}, ["empty.wav"]),
        "no sound": ({"--audio": tmp_path / "text.wav"}, ["text.wav"]),
        "under a frame": ({"--audio": tmp_path / "short.wav"}, ["short.wav", "frame"]),
        "config": ({"--config": tmp_path / "absent.yaml"}, ["absent.yaml"]),
        "yaml": ({"--config": tmp_path / "bad.yaml"}, ["bad.yaml", "YAML"]),
        "k": ({"--k": "2"}, ["--k", "regression"]),
        "large k": ({"--model": "knn", "--k": "5000"}, ["5000"]),
        "no model": ({"--model": None}, ["--model"]),
        "unknown control": ({"--model": "knn", "--control": "left_wrst=high"}, ["left_wrst", "left_wrist_height"]),
        "unknown level": ({"--model": "knn", "--control": "reach=far"}, ["far", "low, high"]),
        "outside": ({"--model": "knn", "--control": "reach=low@8-9"}, ["8-9", "3.2"]),
        "contradiction": ({"--model": "knn", "--control": "reach=low and reach=high"}, ["contradicts"]),
        "never spoken": ({"--model": "knn", "--keyword": "huge=wave"}, ["huge", "never spoken"]),
        "no gesture": ({"--model": "knn", "--keyword": "hello=wave"}, ["wave", "--gestures"]),
        "no keyword": ({"--model": "knn", "--keyword": "hello"}, ["hello", "WORD=GESTURE"]),
        "gestures alone": ({"--model": "knn", "--gestures": "g.yaml"}, ["--keyword"]),
        "words": ({"--words": tmp_path / "absent.tsv"}, ["absent.tsv"]),
        "network's keyword": ({"--keyword": "hello=wave"}, ["--keyword", "regression"]),
        "network's seams": ({"--seams": "blend"}, ["--seams", "regression"]),
        "replace": ({"--replace": "1-2=absent.h5"}, ["absent.h5"]),
        "replace outside": ({"--replace": f"3-4={project / 'out/toy/clips/take00.h5'}"}, ["3-4", "3.20 s"]),
    }


def test_each_mistake_is_one_line_and_exit_2(project, tmp_path, capsys):
    good, wrong = mistakes(project, tmp_path)
    for what, (change, words) in wrong.items():
        capsys.readouterr()
        arguments = [str(x) for pair in (good | change).items() if pair[1] is not None for x in pair]
        assert main(["generate", *arguments]) == 2, what
        lines = [line for line in capsys.readouterr().err.splitlines() if ": note: " not in line]
        assert len(lines) == 1 and all(word in lines[0] for word in words), (what, lines)
        assert not (tmp_path / "o.bvh").exists(), what


def test_silence_and_eight_kilohertz_give_a_correct_result(project, tmp_path, capsys):
    write_wav(tmp_path / "silent.wav", np.zeros(8000 * 2, np.float32), 8000)
    assert generate(project, tmp_path / "silent.bvh", audio=tmp_path / "silent.wav") == 0
    assert len(read_bvh(tmp_path / "silent.bvh")) == 30
    assert "silent" in capsys.readouterr().err


def test_the_installed_command_starts_without_torch(project, tmp_path):
    code = "import sys; from cospeech.cli import main; print(main(sys.argv[1:]), 'torch' in sys.modules)"
    arguments = ["generate", "--subject", "toy", "--model", "regression", "--audio", project / "talk.wav"]
    arguments += ["--out", tmp_path / "o.bvh", "--config", project / "config.yaml"]
    run = subprocess.run([sys.executable, "-c", code, *map(str, arguments)], capture_output=True, text=True)
    assert run.stdout.splitlines()[-1] == "0 False", run.stderr
