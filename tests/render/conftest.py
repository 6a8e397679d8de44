"""A synthetic speaker: a fixed pose whose arms swing and whose jaw opens and closes."""

import numpy as np
import pytest

from cospeech.clip import Clip, Words
from cospeech.face.expressions import COSPEECH64
from cospeech.skeleton import LEFT_HAND, RIGHT_HAND, UPPER55
from tests.render.browser import Browser, chromium


def standing():
    """(55, 3) metres: forearms forward, fingers spread a little."""
    pose = np.zeros((55, 3), np.float32)

    def put(name, *place):
        pose[UPPER55.index[name]] = place

    (
        put("spine", 0, 0.28, -0.02),
        put("neck", 0, 0.50, -0.02),
        put("head", 0, 0.62, -0.02),
        put("head_top", 0, 0.76, -0.02),
    )
    for side, sign in (("left", 1), ("right", -1)):
        put(f"{side}_shoulder", sign * 0.18, 0.48, -0.02), put(f"{side}_hip", sign * 0.09, -0.03, 0)
        put(f"{side}_elbow", sign * 0.26, 0.22, 0.0), put(f"{side}_wrist", sign * 0.30, 0.28, 0.22)
        wrist = pose[UPPER55.index[f"{side}_wrist"]]
        put(f"{side}_hand_root", *wrist)
        for spread, finger in enumerate(("index", "middle", "ring", "little", "thumb")):
            for bone in range(4):
                away = sign * 0.02 * (1.5 - spread), 0.03 * bone, 0.06 + 0.02 * bone
                put(f"{side}_{finger}_{bone}", *(wrist + away))
    return pose


def pytest_collection_modifyitems(items):
    """Tests that need a browser are skipped on a machine without one."""
    missing = pytest.mark.skipif(not chromium(), reason="no Chromium on this machine")
    for item in items:
        if "browser" in getattr(item, "fixturenames", ()):
            item.add_marker(missing)


@pytest.fixture(scope="session")
def browser(tmp_path_factory):
    with Browser(tmp_path_factory.mktemp("profile"), (900, 560)) as browser:
        yield browser


@pytest.fixture
def make_clip():
    def make(frames=30, fps=15.0, face=True, words=True):
        time = np.arange(frames) / fps
        positions = np.repeat(standing()[None], frames, 0)
        for side, hand in (("left", LEFT_HAND), ("right", RIGHT_HAND)):
            swing = np.stack([0 * time, 0.12 * np.sin(5 * time + len(side)), 0 * time], -1).astype(np.float32)
            positions[:, hand] += swing[:, None]
            positions[:, UPPER55.index[f"{side}_wrist"]] += swing
        expression = np.zeros((frames, len(COSPEECH64)), np.float32)
        expression[:, COSPEECH64.index("jaw_open")] = 0.5 - 0.5 * np.cos(9 * time)
        spoken = Words(np.array([0.2]), np.array([0.6]), ["hello"]) if words else Words.none()
        return Clip(
            "anna",
            "take",
            fps,
            positions,
            np.zeros((frames, 28), np.float32),
            words=spoken,
            expression=expression if face else None,
            face_model="cospeech64" if face else "",
            rotation=np.zeros((frames, 3), np.float32) if face else None,
        )

    return make
