"""Getting video: lists of takes, names that stay in their folder, addresses that cannot be reached, sound."""

import hashlib
import http.server
import threading
import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cospeech.capture.film.media import fetch, is_address, read_takes, record, safe_name, take_sound
from cospeech.errors import CospeechError, CospeechNotice
from cospeech.speech import write_wav
from tests.capture.films import numbered, write_film

PUBLISHED = """,speaker,video_fn,interval_id,start_time,end_time,dataset,video_link
0,oliver,1-_abc.mp4,cmu0000012,0 days 00:00:10.500000000,0 days 00:00:22.250000,train,https://example.org/watch?v=abc
1,oliver,1-_abc.mp4,cmu0000013,00:01:02.5,00:01:09,dev,https://example.org/watch?v=abc
2,seth,2.mp4,cmu0000014,1:00,2:00,test,https://example.org/watch?v=def
"""


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def test_the_published_interval_list(tmp_path):
    path = write(tmp_path / "intervals.csv", PUBLISHED)
    takes = read_takes(path, speaker="oliver")
    url = "https://example.org/watch?v=abc"
    assert takes == [
        {"id": "cmu0000012", "video": url, "start": 10.5, "end": 22.25, "part": "train"},
        {"id": "cmu0000013", "video": url, "start": 62.5, "end": 69.0, "part": "val"},
    ]
    assert len(read_takes(path)) == 3
    (tmp_path / "films").mkdir()
    write(tmp_path / "films" / "1-_abc.mp4", "film")
    local = read_takes(path, "oliver", tmp_path / "films")
    assert local[0]["video"] == str(tmp_path / "films" / "1-_abc.mp4")


def test_our_own_list(tmp_path):
    path = write(tmp_path / "takes.csv", "video,start,end,part\na.mp4,,,\na.mp4,1.5,2,test\nb c.mp4,,10,\n")
    assert read_takes(path) == [
        {"id": "a", "video": "a.mp4"},
        {"id": "a_2", "video": "a.mp4", "start": 1.5, "end": 2.0, "part": "test"},
        {"id": "b_c", "video": "b c.mp4", "end": 10.0},
    ]


@pytest.mark.parametrize(
    "text",
    [
        "video, id, start, end, part\ntalk.mp4, monday, 0.5, 2.5, test\n",
        " video ,id ,\tstart, end,part\n talk.mp4 ,monday , 0.5,2.5 , test \n",
        '"video", "ID", "start", "end", "part"\r\n"talk.mp4", "monday", 0.5, 2.5, "test"\r\n',
        "\ufeffVideo,Id,Start,End,Part\n\ntalk.mp4,monday,0.5,2.5,Test\n\n",
    ],
)
def test_blanks_around_commas_drop_nothing(tmp_path, text):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        takes = read_takes(write(tmp_path / "takes.csv", text), speaker=None)
    assert takes == [{"id": "monday", "video": "talk.mp4", "start": 0.5, "end": 2.5, "part": "test"}]


def test_unknown_columns_are_named(tmp_path):
    path = write(tmp_path / "takes.csv", "video,begin,id,ende\na.mp4,1,x,2\n")
    with pytest.warns(CospeechNotice, match=r"columns that mean nothing here: begin, ende; known: .*start"):
        assert read_takes(path) == [{"id": "x", "video": "a.mp4"}]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("video;id;start\na.mp4;x;0,5\n", ["semicolons", "commas"]),
        ("video\tid\na.mp4\tx\n", ["tabs", "commas"]),
        ("video,id\na.mp4,x, y\n", ["line 2", "3 cells", "quotes"]),
        ("video,id,ID\na.mp4,x,y\n", ["'id'", "twice"]),
        ("video,id\n\n\na.mp4,x\n,y\n", ["line 5", "no video"]),
        ("video,id\nä.mp4,x\n".encode("latin-1"), ["line 2", "UTF-8"]),
        ('video,id\na.mp4,"x\n', ["not a CSV"]),
        ("film,start\na.mp4,1\n", ["line 2", "video"]),
        ("video,start,end\na.mp4,5,4\n", ["line 2", "ends at 4"]),
        ("video,start\na.mp4,soon\n", ["line 2", "soon", "time"]),
        ("video,part\na.mp4,most\n", ["line 2", "most", "train"]),
        ("video\n", ["no take"]),
        ("video,speaker\na.mp4,seth\n", ["no take", "jon"]),
    ],
)
def test_mistakes_in_a_list_name_the_line(tmp_path, text, words):
    path = tmp_path / "takes.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(CospeechError) as error:
        read_takes(path, "jon" if "jon" in words else None)
    assert all(word in str(error.value) for word in words) and str(error.value).startswith(str(path))


@given(st.lists(st.text(min_size=1, max_size=100), min_size=1, max_size=6))
def test_names_never_leave_their_folder(names):
    for name in (*names, "../../x", "/etc/passwd", "a/../b", "..", "C:\\x"):
        assert all(c.isascii() and (c.isalnum() or c in "_-") for c in safe_name(name))
    assert safe_name("../../x") == "x" and safe_name("..") == ""


def test_ids_of_a_list_are_safe_and_differ(tmp_path):
    takes = read_takes(write(tmp_path / "t.csv", "id,video\n../../x,a.mp4\nx,b.mp4\n..,c.mp4\n/,d.mp4\n"))
    ids = [take["id"] for take in takes]
    assert len(set(ids)) == 4 and all(i == safe_name(i) != "" for i in ids) and ids[0] == "x"


def test_addresses():
    assert is_address("https://example.org/x") and is_address("HTTP://a.b") and not is_address("films/https.mp4")


def test_without_yt_dlp_one_line_names_the_file_to_put_there(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    path = tmp_path / "results" / "ada" / "media" / "take1.mp4"
    with pytest.raises(CospeechError) as error:
        fetch("https://example.org/x", path)
    assert all(word in str(error.value) for word in ("https://example.org/x", str(path), "by hand", "yt-dlp"))
    assert "\n" not in str(error.value) and not path.parent.exists()


def test_fetching_goes_on_where_it_stopped_and_records_the_sum(tmp_path):
    """A server of our own; the first half lies there already, and only the rest is asked for."""
    film = write_film(tmp_path / "film.mp4", numbered(60))
    content, asked = film.read_bytes(), []

    class Server(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            first = int((self.headers.get("Range") or "bytes=0-")[6:].split("-")[0])
            asked.append(first)
            self.send_response(206 if first else 200)
            self.send_header("Content-Type", "video/mp4")
            self.send_header("Content-Range", f"bytes {first}-{len(content) - 1}/{len(content)}")
            self.send_header("Content-Length", str(len(content) - first))
            self.end_headers()
            self.wfile.write(content[first:])

        do_HEAD = do_GET

        def log_message(self, *_):
            pass

    server = http.server.HTTPServer(("127.0.0.1", 0), Server)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        path = tmp_path / "media" / "take1.mp4"
        path.parent.mkdir()
        (path.parent / ".take1.fetched.mp4.part").write_bytes(content[: len(content) // 2])
        fetch(f"http://127.0.0.1:{server.server_port}/film.mp4", path)
    finally:
        server.shutdown()
    assert path.read_bytes() == content and asked[-1] == len(content) // 2
    assert path.with_name("take1.mp4.sha256").read_text().split()[0] == hashlib.sha256(content).hexdigest()


def test_an_address_that_fails_names_the_file(tmp_path):
    with pytest.raises(CospeechError, match="by hand") as error:
        fetch("http://127.0.0.1:9/film.mp4", tmp_path / "take1.mp4")
    assert "\n" not in str(error.value) and str(tmp_path / "take1.mp4") in str(error.value)


def test_checksums_are_those_of_sha256sum(tmp_path):
    film = write(tmp_path / "film.mp4", "abc")
    record(film, "https://example.org")
    known = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"  # FIPS 180-2, appendix B.1
    assert (tmp_path / "film.mp4.sha256").read_text() == f"{known}  film.mp4\n# https://example.org\n"


def test_sound_of_a_take(tmp_path):
    film = write_film(tmp_path / "film.mp4", numbered(50), sounds=1)
    samples, rate = take_sound(film, start=0.5, end=1.5)
    assert len(samples) == rate
    write_wav(tmp_path / "own.wav", np.linspace(-0.5, 0.5, 8000), 8000)
    own, rate = take_sound(film, tmp_path / "own.wav", start=0.5, end=1.0)
    assert (len(own), rate) == (4000, 8000) and own[0] == pytest.approx(-0.5, abs=1e-3)
    with pytest.warns(CospeechNotice, match="silence"):
        samples, rate = take_sound(write_film(tmp_path / "silent.mp4", numbered(10)))
    assert len(samples) == round(0.4 * rate) and not samples.any()
    with pytest.raises(CospeechError, match="before the take begins"):
        take_sound(film, start=10.0)
