"""The virtual speaker on film: a take drawn frame by frame, with its voice, so that capture can be checked.

What is seen in a film was really so: `take.read_motion` of the same take at the film's rate.
"""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from cospeech.demo.lexicon import speaker_parameters
from cospeech.demo.take import SCHEMA, read_motion
from cospeech.errors import CospeechError
from cospeech.face.model import embedded
from cospeech.files import reading_hdf5
from cospeech.people import Canvas, draw_appearance, faces, person_solids, views
from cospeech.people.dice import Dice
from cospeech.people.painting import raster, scenes
from cospeech.people.painting.solids import THING, Solids
from cospeech.skeleton import UPPER55
from cospeech.track import Camera

DOMAINS = ("studio", "wild")  # of `people`: an even wall, or wherever people film each other
SETTINGS = ("plain", "desk", "company", "close")  # of take 0, 1, 2, 3, 4...: again from the first
# The lowest and the highest point of the speaker's plane that the picture shows, metres above the pelvis at stature 1.
SHOWN = {"plain": (-0.20, 0.86), "desk": (-0.14, 0.88), "company": (-0.20, 0.92), "close": (0.14, 0.84)}
SIZE = (480, 360)  # width, height in pixels
BATCH = 64  # frames made into solids at once
DESK_BELOW = 0.05  # metres of the desk below where the lower wrist mostly is
WARDROBE = 5  # seed of everybody's appearance, chosen by eye
BESIDE = np.array([0.62, 0.02, -1.1])  # where the second person stands: left, up, forward of the speaker, metres


@dataclass
class Set:
    """Where a take is filmed. camera: `Camera`. rotation (3, 3), translation (3,): the speaker's axes to the camera's.
    background (H, W, 3) float32; light (6,) as `raster.trace` takes it; gain (3,), gamma, grain (of 255): what the
    camera makes of light. domain, setting: see DOMAINS, SETTINGS. seed : of the grain."""

    domain: str
    setting: str
    camera: Camera
    rotation: np.ndarray
    translation: np.ndarray
    background: np.ndarray
    light: np.ndarray
    gain: np.ndarray
    gamma: float
    grain: int
    seed: int

    def see(self, points):
        """Points (..., 3) of the speaker's axes -> the camera's."""
        return points @ self.rotation.T + self.translation


def film_take(path, *, truth, wav, domain="studio", fps=15.0, size=SIZE):
    """Film a take of `write_take` as an mp4 with its voice.

    truth, wav : the take's two files. domain : one of DOMAINS; the speaker looks the same in all takes of a domain.
    size : (width, height), even. The setting follows from the take's number: an empty room, behind a desk, with
    somebody else in the room, or so close that hands leave the picture. Same input, same bytes.
    Raises CospeechError for another domain, or files that do not belong together.
    """
    from cospeech.render.video import write_film
    from cospeech.speech import load_audio

    if domain not in DOMAINS:
        raise CospeechError(f"{path}: film domain {domain!r} is not one of {', '.join(DOMAINS)}")
    with reading_hdf5(truth, SCHEMA) as file:
        speaker, take, seed = str(file.attrs["speaker"]), int(file.attrs["take"]), int(file.attrs["seed"])
    positions, rotation, expression, _ = read_motion(truth, wav, fps)
    stage = build_set(speaker, take, seed, domain, size)
    pictures = draw_take(positions, rotation, expression, stage, speaker)
    write_film(path, pictures, len(positions), fps, load_audio(wav))


def build_set(speaker, take, seed, domain, size=SIZE):
    """The `Set` of a take; nothing but the arguments decides it."""
    dice = Dice(seed, ("film", speaker, domain), [take])
    setting, camera = SETTINGS[take % len(SETTINGS)], Camera.assumed(*size)
    low, high = np.array(SHOWN[setting]) * speaker_parameters(speaker)["stature"]
    steady = 0.5 if domain == "studio" else 1.0  # how far a camera stands from straight before the speaker
    directions = np.stack([dice.normal(0, 12), dice.normal(4, 3), dice.normal(0, 2)], axis=1) * steady
    distance = camera.fy * (high - low) / size[1]
    rotation, translation = views.look_at(directions, np.array([distance]), np.array([[0.0, (low + high) / 2, 0.0]]))
    rng = dice.generator(0)
    background = scenes.background(rng, max(size), domain)[: size[1], : size[0]]
    light, wild = scenes.draw_lights(dice, domain)[0], domain == "wild"
    gain = (rng.uniform(0.85, 1.15) * rng.uniform(0.9, 1.1, 3) if wild else np.ones(3)).astype(np.float32)
    gamma = np.float32(rng.uniform(0.75, 1.15) if wild else 1.0)
    return Set(
        domain,
        setting,
        camera,
        rotation[0],
        translation[0],
        background,
        light,
        gain,
        gamma,
        8 if wild else 3,
        int(rng.integers(1 << 30)),
    )


def draw_take(positions, rotation, expression, stage, speaker):
    """Yield the pictures (H, W, 3) uint8 of T frames: positions (T, 55, 3), rotation (T, 3), expression (T, 64)."""
    female = speaker_parameters(speaker)["voice"]["female"]
    appearance = draw_appearance(speaker, stage.domain, WARDROBE, female)
    other = draw_appearance(f"beside {speaker}", stage.domain, WARDROBE, not female)
    rng = np.random.default_rng(stage.seed)
    things = _desk(positions, stage) if stage.setting == "desk" else np.zeros((0, raster.COLUMNS))
    for start in range(0, len(positions), BATCH):
        now = slice(start, start + BATCH)
        solids = _person(positions[now], rotation[now], expression[now], stage, appearance)
        if stage.setting == "company":  # the same take backwards: somebody who talks of something else
            now = slice(-1 - start, -1 - start - BATCH if start + BATCH < len(positions) else None, -1)
            beside = _person(positions[now] + BESIDE, rotation[now], expression[now], stage, other)
            solids = np.concatenate([solids, beside], axis=1)
        for frame in solids:
            yield _picture(np.concatenate([frame, things]), stage, rng)


def _person(positions, rotation, expression, stage, appearance):
    """Solids (T, P, raster.COLUMNS) of somebody in the speaker's axes."""
    head = stage.rotation @ Rotation.from_rotvec(rotation).as_matrix() @ face_turn()
    return person_solids(stage.see(positions), appearance, head=head, expression=expression)


@cache
def face_turn():
    """(3, 3) turn that lays the painter's face at rest over cospeech64's, of which the truth's rotation tells: where a
    face looks to is a convention, and the two differ by their slant."""
    model = embedded()
    drawn, reference = faces.NEUTRAL[: len(model.landmarks)], model.mean[model.landmarks]
    return Rotation.align_vectors(reference - reference.mean(axis=0), drawn - drawn.mean(axis=0))[0].as_matrix()


def _desk(positions, stage):
    """Solids (P, raster.COLUMNS) of a desk that hides the lap and whatever hangs below it."""
    solids, frame = Solids(1), stage.rotation[None]
    wrists = positions[:, UPPER55.joints("right_wrist", "left_wrist"), 1].min(axis=1)
    top = float(np.clip(np.median(wrists) - DESK_BELOW, -0.05, 0.10))
    wood = np.array([0.42, 0.33, 0.26])
    at = lambda x, y, z: stage.see(np.array([[x, y, z]]))
    solids.box(at(0.0, top - 0.02, 0.52), frame, np.array([0.9, 0.02, 0.3]), wood, THING)
    solids.box(at(0.0, top - 0.40, 0.80), frame, np.array([0.9, 0.36, 0.015]), 0.8 * wood, THING)
    return solids.rows()[0]


def _picture(solids, stage, rng):
    """One picture as a camera of the domain takes it; grain differs from frame to frame, `rng`."""
    canvas = Canvas(stage.background)
    c = stage.camera
    canvas.paint(solids, np.array([[c.fx, 0, c.cx], [0, c.fy, c.cy], [0, 0, 1]]), stage.light)
    painted = canvas.depth[canvas.depth < raster.FAR]
    scenes.contact_shadows(canvas.color, canvas.depth, painted.max(initial=0.0) + 0.15)
    seen = np.clip(canvas.color * stage.gain, 0, 1) ** stage.gamma
    seen = cv2.GaussianBlur(seen.astype(np.float32), (3, 3), 0.55) * 255
    grain = rng.integers(-stage.grain, stage.grain + 1, seen.shape[:2], dtype=np.int16)
    return np.clip(seen + grain[..., None], 0, 255).astype(np.uint8)
