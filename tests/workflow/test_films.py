"""Subjects of films: what a subject file may say, and which takes run when some cannot be had."""

import pytest
import yaml
from configuration import on_film, read_subject

from cospeech.errors import CospeechError

TAKES = [{"id": name, "video": f"{name}.mp4"} for name in ("a", "b", "c")]


def subject(content):
    with open("ada.yaml", "w", encoding="utf-8") as file:
        yaml.safe_dump({"name": "ada"} | content, file)
    return read_subject("ada.yaml", results="out")


@pytest.fixture
def films(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for take in TAKES:
        (tmp_path / take["video"]).touch()
    return tmp_path


@pytest.fixture
def offline(monkeypatch):
    monkeypatch.setattr("video_takes.can_fetch", lambda: False)


def test_local_films_are_used_in_place(films):
    found = subject({"source": {"kind": "video", "takes": TAKES}})
    assert [take["film"] for take in found.takes.values()] == ["a.mp4", "b.mp4", "c.mp4"]
    assert found.tracker == {"name": "mediapipe"} and not found.absent


def test_a_list_of_intervals(films):
    (films / "list.csv").write_text(
        "id,video,start,end,part\none,a.mp4,0,1,train\ntwo,a.mp4,1,2,dev\n../x,b.mp4,,,test\n"
    )
    found = subject({"source": {"kind": "video", "manifest": "list.csv"}, "tracker": "posenet"})
    assert {name: take.get("part") for name, take in found.takes.items()} == {"one": "train", "two": "val", "x": "test"}


def test_addresses_that_cannot_be_fetched_leave_the_others_alone(films, offline):
    url = "https://example.org/talk"
    takes = [*TAKES, {"id": "d", "video": url}, {"id": "e", "video": url, "start": 5.0}]
    found = subject({"source": {"kind": "video", "takes": takes}})
    assert list(found.takes) == ["a", "b", "c"] and list(found.absent) == ["d", "e"]
    assert all(word in found.absent["d"] for word in (url, "out/ada/media/d.mp4", "by hand"))
    place = films / "out" / "ada" / "media" / "d.mp4"
    place.parent.mkdir(parents=True)
    place.touch()
    found = subject({"source": {"kind": "video", "takes": takes}})
    assert {found.takes[name]["film"] for name in "de"} == {"out/ada/media/d.mp4"} and not found.absent


def test_nothing_at_all_is_an_error(films, offline):
    with pytest.raises(CospeechError, match="by hand"):
        subject({"source": {"kind": "video", "takes": [{"id": "d", "video": "https://example.org/talk"}]}})


DEMO = {"kind": "demo", "speaker": "calm", "minutes": 1.0, "takes": 6}


def test_films_of_the_virtual_speaker_are_a_subject_of_their_own(films):
    """The first takes, each with a film to be made; the speaker's own takes and split stay what they are without."""
    played = subject({"source": DEMO | {"film": {"domain": "wild", "takes": 3}}, "tracker": "posenet"})
    plain = subject({"source": DEMO})
    assert played.takes == plain.takes and played.parts == plain.parts
    assert on_film({"ada": plain}, "out") == {}
    (seen,) = on_film({"ada": played}, "out").values()
    assert (seen.name, seen.played_by, seen.source["domain"]) == ("ada_on_film", "ada", "wild")
    assert [take["film"] for take in seen.takes.values()] == [f"out/ada_on_film/media/take0{i}.mp4" for i in (1, 2, 3)]
    assert seen.tracker == {"name": "posenet"} and seen.takes_of("train") and seen.takes_of("test")


def test_a_face_model_goes_with_any_tracker(films):
    found = subject({"source": {"kind": "video", "takes": TAKES}, "tracker": "mediapipe", "face_model": "own.h5"})
    assert found.tracker == {"name": "mediapipe", "face_model": "own.h5"}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"source": DEMO | {"film": {"domain": "moon", "takes": 2}}}, ["source.film.domain", "moon"]),
        ({"source": DEMO | {"film": {"domain": "wild", "takes": 1}}}, ["source.film.takes"]),
        ({"source": {"kind": "video"}}, []),
        ({"source": {"kind": "video", "takes": TAKES, "manifest": "list.csv"}}, []),
        ({"source": {"kind": "video", "takes": TAKES}, "tracker": "sonar"}, ["tracker", "sonar", "mediapipe"]),
        ({"source": {"kind": "video", "takes": TAKES}, "tracker": "onnx"}, ["onnx", "manifest"]),
        ({"source": {"kind": "video", "takes": TAKES}, "tracker": "tracks"}, ["tracks", "folder"]),
        ({"source": {"kind": "video", "takes": TAKES}, "folder": "x"}, ["folder", "tracks", "mediapipe"]),
        ({"source": {"kind": "video", "takes": [{"id": "a", "vidoe": "a.mp4"}]}}, ["vidoe"]),
    ],
)
def test_mistakes(films, content, words):
    with pytest.raises(CospeechError) as error:
        subject(content)
    assert str(error.value).startswith("ada.yaml") and all(word in str(error.value) for word in words), error.value
