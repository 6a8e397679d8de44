"""Long exposures: the last pose as a still has it, earlier ones as ghosts where they were, the wrists' paths."""

import cv2
import numpy as np
import pytest

from cospeech.cli import main
from cospeech.errors import CospeechError
from cospeech.render.character.figure import BACKGROUND, Character, framing
from cospeech.render.exposure import long_exposure
from cospeech.render.video import still
from cospeech.skeleton import RIGHT_HAND, UPPER55

SIZE = 480, 360


@pytest.fixture
def raised(make_clip):
    """Two seconds in which the right forearm goes from far out to the body."""
    clip = make_clip(words=False)
    hand = [*range(*RIGHT_HAND.indices(55)), UPPER55.index["right_wrist"]]
    clip.positions[:, hand] += (np.linspace(-0.35, 0, 30)[:, None, None] * [1, -0.6, 0]).astype(np.float32)
    return clip


def taken(path, clip, *stretch, **options):
    long_exposure(path, [("t", clip)], *stretch, size=SIZE, **options)
    return cv2.imread(str(path)).astype(int)


def test_a_moment_is_a_still(make_clip, tmp_path):
    clip = make_clip(words=False)
    still(tmp_path / "still.png", clip, 0.8, SIZE, title="t")
    np.testing.assert_array_equal(taken(tmp_path / "a.png", clip, 0.8), cv2.imread(str(tmp_path / "still.png")))


def test_who_does_not_move_leaves_no_ghosts(make_clip, tmp_path):
    clip = make_clip(words=False)
    clip.positions[:], clip.expression[:] = clip.positions[3], clip.expression[3]
    one, many = taken(tmp_path / "a.png", clip, 1.0), taken(tmp_path / "b.png", clip, 0.2, 1.0, paths=False)
    assert (np.abs(one - many).max(-1) > 12).mean() < 0.008  # edges: half covered pixels are laid over each other


def test_earlier_poses_are_fainter_and_where_they_were(raised, tmp_path):
    picture = taken(tmp_path / "a.png", raised, 0.0, 1.9, poses=3, paths=False)
    camera = framing([Character(raised.positions)], [raised.positions], *SIZE)
    strength = []
    for frame in (0, 14, 28):
        x, y, _ = camera.project(raised.positions[frame, UPPER55.index["right_wrist"]]).round().astype(int)
        strength.append(np.abs(picture[y - 2 : y + 3, x - 2 : x + 3] - BACKGROUND).max(-1).mean())
    assert 8 < strength[0] < strength[1] < strength[2]


def test_paths_follow_the_wrists(raised, tmp_path):
    plain, traced = (taken(tmp_path / "a.png", raised, 0.0, 1.9, poses=1, paths=paths) for paths in (False, True))
    camera = framing([Character(raised.positions)], [raised.positions], *SIZE)
    seen = camera.project(raised.positions[:29, UPPER55.index["right_wrist"]])[:, :2]
    changed = np.argwhere(np.abs(plain - traced).max(-1) > 30)[:, ::-1]
    right = changed[changed[:, 0] < SIZE[0] / 2]
    apart = np.linalg.norm(right[:, None] - seen[None], axis=-1)
    assert apart.min(0).mean() < 2 and apart.min(1).max() < 8  # the whole path, and nothing else


def test_the_command_and_its_mistakes(raised, tmp_path, capsys):
    raised.write(tmp_path / "a.h5")
    out = tmp_path / "a.png"
    assert main(["render", str(tmp_path / "a.h5"), str(out), "--still", "0.2-1.5", "--poses", "3"]) == 0
    assert cv2.imread(str(out)).shape == (540, 960, 3)
    standing = cv2.imread(str(out))
    assert main(["render", str(tmp_path / "a.h5"), str(out), "--still", "0.2-1.5", "--posture", "sitting"]) == 0
    assert (np.abs(standing.astype(int) - cv2.imread(str(out))).max(-1) > 40).mean() > 0.02
    assert main(["render", str(tmp_path / "a.h5"), str(out), "--still", "1", "--face-model", "gone.h5"]) == 2
    assert "gone.h5" in capsys.readouterr().err
    for still_at, line in (("soon", "expected seconds"), ("1-9", "lasts 2.00 s"), ("1.5-1", "no stretch")):
        assert main(["render", str(tmp_path / "a.h5"), str(out), "--still", still_at]) == 2
        told = capsys.readouterr().err
        assert line in told and told.count("\n") == 1
    with pytest.raises(CospeechError, match="expected 1 or more"):
        long_exposure(out, [("t", raised)], 0.0, 1.0, poses=0)
