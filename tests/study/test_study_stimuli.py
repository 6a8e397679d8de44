"""Which clips a study shows, and the folder it makes of them."""

import argparse
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from cospeech.clip import Clip, Words
from cospeech.commands import study as command
from cospeech.errors import CospeechError, CospeechNotice
from cospeech.speech import load_audio
from cospeech.study.build import Design, build_study
from cospeech.study.stimuli import cut, excerpt_starts, from_manifest, from_results
from tests.study.conftest import METHODS

WRIST = 7


def heard(samples, rate=16000):
    """The loudest frequency, Hz."""
    return np.fft.rfftfreq(len(samples), 1 / rate)[np.abs(np.fft.rfft(samples)).argmax()]


def test_every_method_moves_to_every_track_and_mismatched_is_the_truth_of_another_take(results, stimuli):
    assert sorted((s.condition, s.track) for s in stimuli) == sorted(
        (method, f"anna/{take}@0.00") for method in METHODS for take in ("take01", "take02")
    )
    truth = {take: Clip.read(results / "anna/synthesis/ground_truth" / f"{take}.h5") for take in ("take01", "take02")}
    for stimulus in stimuli:
        clip, (samples, rate) = cut(stimulus)
        take = stimulus.track[5:11]
        assert clip.frames == 9 and len(samples) == round(0.6 * rate)
        assert heard(samples) == pytest.approx(200 if take == "take01" else 300, abs=2)
        other = {"take01": "take02", "take02": "take01"}[take]
        first = round(stimulus.start * 15)
        expected = truth[other if stimulus.condition == "mismatched" else take].positions[first : first + 9]
        apart = np.abs(clip.positions - expected).max()
        assert apart == (pytest.approx(0.05, abs=1e-6) if stimulus.condition == "knn" else 0)
        np.testing.assert_array_equal(clip.expression, truth[take].expression[:9])  # the face of what is heard, on all
        assert clip.face_model == "cospeech64"


def test_faces_are_ones_own_or_nobodys_if_asked(results):
    own = {s.condition: cut(s)[0] for s in from_results(results, ["anna"], METHODS, 0.6, 1, face="own")}
    assert own["ground_truth"].expression is not None and own["knn"].expression is None
    none = from_results(results, ["anna"], METHODS, 0.6, 1, face="none")
    assert all(cut(s)[0].expression is None and cut(s)[0].rotation is None for s in none)
    with pytest.raises(CospeechError, match="no face for the others"):
        cut(from_results(results, ["anna"], METHODS, 0.6, 1, face="knn")[0])


def test_excerpts_do_not_overlap_and_start_in_pauses(make_clip):
    clip = make_clip(300, words=False)  # 20 s
    assert excerpt_starts(clip, 6.0) == pytest.approx([0, 6 + 2 / 3, 13 + 1 / 3], abs=1 / 15)
    assert excerpt_starts(clip, 20.0) == [0.0] and excerpt_starts(clip, 20.1) == []
    clip.words = Words(np.array([0.0, 0.5, 7.0]), np.array([0.2, 6.4, 20.0]), ["a", "b", "c"])
    starts = excerpt_starts(clip, 6.0)
    assert 0.2 <= starts[0] <= 0.5 and 6.4 < starts[1] < 7.0 and starts[2] == pytest.approx(13 + 1 / 3, abs=1 / 15)
    assert np.diff([*starts, 20.0]).min() >= 6.0


def test_takes_take_turns_and_badly_tracked_stretches_are_passed_over(results):
    path = results / "anna/synthesis/ground_truth/take01.h5"
    clip = Clip.read(path)
    assert [s.track for s in from_results(results, ["anna"], METHODS, 0.5, 4)][::3] == [
        "anna/take01@0.00",
        "anna/take02@0.00",
        "anna/take01@0.53",
        "anna/take02@0.53",
    ]
    clip.valid[10:14] = False
    clip.write(path)
    tracks = {s.track for s in from_results(results, ["anna"], METHODS, 0.5, 6)}
    assert "anna/take01@0.53" not in tracks and len(tracks) == 5


def test_mistakes_of_results_get_one_line(results):
    truth = results / "anna/synthesis/ground_truth"
    for methods, line in (
        (["knn"], "two or more"),
        (["knn", "knn"], "different ones"),
        (["ground_truth", "resync"], r"resync/take01\.h5: no such file"),
    ):
        with pytest.raises(CospeechError, match=line):
            from_results(results, ["anna"], methods, 0.6)
    with (
        pytest.warns(CospeechNotice, match="no stretch of 2 s"),
        pytest.raises(CospeechError, match=r"longest is 1\.60 s"),
    ):
        from_results(results, ["anna"], METHODS, 2.0)
    (truth / "take02.h5").unlink()
    with pytest.raises(CospeechError, match="one test take cannot be mismatched"):
        from_results(results, ["anna"], METHODS, 0.6)
    assert from_results(results, ["anna"], ["ground_truth", "knn"], 0.6)


def test_the_folder_holds_a_page_that_does_not_tell_who_made_what(make_study):
    folder, study = make_study()
    assert sorted(path.name for path in folder.iterdir()) == ["clips", "index.html", "study.json"]
    page, clips = (folder / "index.html").read_text(), "".join(p.read_text() for p in (folder / "clips").glob("*.js"))
    clips = re.sub('"(blob|audio)": ?"[^"]*"', "", clips)  # base64 spells any short word
    assert len(list((folder / "clips").iterdir())) == 2
    for word in ("ground_truth", "mismatched", "knn", "anna", "take01"):
        assert word not in page and len(clips) > 1000 and word not in clips
    assert study["items"] == 6 and study["checks"] == 1 and len(study["stimuli"]) == 6
    assert study["questions"]["naturalness"].startswith("Does the clip appear natural and the gesture follows")
    assert all(re.fullmatch("[0-9a-f]{12}", one["id"]) for one in study["stimuli"])


def test_same_input_same_bytes_and_another_seed_is_another_study(make_study):
    one, two, other = (make_study(name, seed=seed) for name, seed in (("a", 0), ("b", 0), ("c", 1)))
    for path in one[0].rglob("*.*"):
        assert path.read_bytes() == (two[0] / path.relative_to(one[0])).read_bytes()
    assert one[1]["id"] == two[1]["id"] != other[1]["id"]


def test_texts_of_a_manifest_are_text_and_names_stay_in_the_folder(results, tmp_path):
    truth = "results/anna/synthesis/ground_truth/take01.h5"
    nasty = "<script>alert(1)</script>"
    listed = [
        {"condition": name, "track": "../../../etc/passwd", "motion": truth, "start": 0.2}
        for name in (f"{nasty}", "../../up")
    ]
    questions = {"fits": f"{nasty} fits?"}
    (tmp_path / "own.yaml").write_text(json.dumps({"title": nasty, "questions": questions, "stimuli": listed}))
    stimuli, texts = from_manifest(tmp_path / "own.yaml", 0.5)
    build_study(tmp_path / "deep/er/study", stimuli, Design(tracks=1, **texts))
    page = (tmp_path / "deep/er/study/index.html").read_text()
    assert nasty not in page and "&lt;script&gt;" in page.split("</title>")[0]
    assert {path.parent.name for path in (tmp_path / "deep").rglob("*.js")} == {"clips"}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["deep", "own.yaml", "results"]
    clip, (samples, rate) = cut(stimuli[0])
    np.testing.assert_allclose(clip.positions, Clip.read(tmp_path / truth).positions[3:11])
    whole, _ = load_audio(tmp_path / truth.replace("h5", "wav"), start=0.2, end=0.7)
    np.testing.assert_array_equal(samples[rate // 10 : -rate // 10], whole[rate // 10 : -rate // 10])


@pytest.mark.parametrize(
    ("content", "line"),
    [
        ("[1, 2", "not valid YAML"),
        ("- 1", "key `stimuli`"),
        ("stimuli: []", "key `stimuli`"),
        ("colour: red\nstimuli: [{}]", "unknown key 'colour'"),
        ("stimuli: [{condition: a}]", "stimulus 1: expected condition, track, motion"),
        ("stimuli: [{condition: a, track: t, motion: m.h5, start: soon}]", "seconds, 0 or more"),
        ("stimuli: [{condition: a, track: t, motion: no.h5}]", r"no\.h5: no such file"),
        ("stimuli: [{condition: a, track: t, motion: no.h5, audio: no.wav}]", "no sound at"),
    ],
)
def test_mistakes_of_a_manifest_get_one_line(tmp_path, content, line):
    (tmp_path / "own.yaml").write_text(content)
    with pytest.raises(CospeechError, match=line) as error:
        from_manifest(tmp_path / "own.yaml")
    assert "\n" not in str(error.value) and ("own.yaml" in str(error.value) or "no.h5" in str(error.value))


def test_what_cannot_be_a_study_is_refused_before_anything_is_written(stimuli, tmp_path):
    ok = Design(tracks=2)
    elsewhere = [replace(stimuli[0], audio_start=0.4), *stimuli[1:]]
    for chosen, design, line in (
        (stimuli[:5], ok, "has 0 clips on track"),
        ([*stimuli, stimuli[0]], ok, "has 2 clips"),
        ([s for s in stimuli if s.condition == "knn"], ok, "one condition"),
        (elsewhere, ok, "different sounds"),
        (stimuli, Design(tracks=3), "there are 2"),
        (stimuli, Design(tracks=1, points=6), "5 or 7"),
        (stimuli, Design(tracks=1, title=5), "title: expected text"),
        (stimuli, Design(tracks=1, questions={"a b": "?"}), "short names"),
        (stimuli, Design(tracks=1, questions=["?"]), "short names"),
    ):
        with pytest.raises(CospeechError, match=line):
            build_study(tmp_path / "study", chosen, design)
    assert not (tmp_path / "study").exists()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").touch()
    with pytest.raises(CospeechError, match="is not empty and holds no study"):
        build_study(tmp_path / "mine", stimuli, ok)


def test_the_command_builds_like_a_table_of_the_thesis_and_from_a_configuration(results, tmp_path, capsys):
    parser = argparse.ArgumentParser()
    command.add(parser.add_subparsers())
    (tmp_path / "config.yaml").write_text(f"results_dir: {results}\nsubjects: [anna]\nmodels: [knn]\n")

    def run(*arguments):
        options = parser.parse_args(["study", "build", "--config", str(tmp_path / "config.yaml"), *arguments])
        options.run(options)
        return json.loads((tmp_path / "out" / "study.json").read_text())

    out = "--out", str(tmp_path / "out")
    with pytest.warns(CospeechNotice, match="0 of 2 examples"):
        study = run(*out, "--like", "5.4", "--seconds", "1")
    assert (study["points"], study["tracks"], study["items"], study["ends"]) == (7, 2, 6, ["lowest", "highest"])
    assert study["conditions"] == METHODS and "6 judgements" in capsys.readouterr().out
    with pytest.warns(CospeechNotice, match="was replaced by"):
        study = run(*out, "--pairs", "--ties", "--seconds", "0.6", "--examples", "1", "--checks", "0")
    assert (study["kind"], study["items"], study["checks"], study["examples"]) == ("pairs", 3, 0, 1)
    with pytest.raises(CospeechError, match=r"longest is 1\.60 s"), pytest.warns(CospeechNotice):
        run(*out)
    for wrong, line in (
        ("--seconds=0", "seconds is 0"),
        ("--checks=-1", "checks is -1"),
        ("--subjects=bert", "'bert'"),
    ):
        with pytest.raises(CospeechError, match=line):
            run(*out, wrong)
