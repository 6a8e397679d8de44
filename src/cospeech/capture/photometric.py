"""What a fitted face looks like: its albedo and the light on it, 27 spherical-harmonic coefficients (thesis 4.3.1).

Skin is Lambertian under light of nine coefficients a colour: a vertex of albedo a and unit normal n shows
a * sum_k Y_k(n) l_k. Colours are RGB, 0 to 1. The terms are differentiable torch functions; `explain` solves light and
albedo of one picture for the pose and expression that the landmark fit found, which it leaves as they are.
"""

from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from cospeech.face.solver import AXES

BANDS = 9  # real spherical harmonics of degree 0, 1 and 2
# RGB of the embedded model's regions; skin where a model names none
WHITE = (0.9, 0.9, 0.9)
COLORS = {"skin": (0.78, 0.60, 0.50), "left_eye": WHITE, "right_eye": WHITE, "lips": (0.72, 0.38, 0.38)}
HIDDEN = ("upper_teeth", "lower_teeth", "tongue")  # regions that lips cover in most pictures
FACING = 0.15  # cosine towards the camera from which a vertex is compared
ALBEDO, COLOR = 0.1, 0.03  # standard deviations: of albedo about the region's, and of a picture's colour


def harmonics(normals):
    """The real spherical harmonics up to degree 2, orthonormal on the sphere: unit normals (..., 3) -> (..., 9)."""
    x, y, z = normals.unbind(-1)
    one = torch.ones_like(x)
    a, b, c = 0.5 * np.sqrt(1 / np.pi), np.sqrt(3 / (4 * np.pi)), 0.5 * np.sqrt(15 / np.pi)
    terms = [
        a * one,
        b * y,
        b * z,
        b * x,
        c * x * y,
        c * y * z,
        0.25 * np.sqrt(5 / np.pi) * (3 * z**2 - 1),
        c * x * z,
        0.5 * c * (x**2 - y**2),
    ]
    return torch.stack(terms, dim=-1)


def shade(albedo, normals, light):
    """Colours (V, 3) of Lambertian skin: albedo (V, 3), unit normals (V, 3), light (27,), nine a colour."""
    return albedo * (harmonics(normals) @ light.reshape(3, BANDS).T)


def vertex_normals(points, triangles):
    """Unit normals (V, 3) of a mesh, outwards: each vertex's mean of its triangles, weighted by their areas."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    faces = torch.linalg.cross(b - a, c - a)
    total = torch.zeros_like(points)
    for i in range(3):
        total = total.index_add(0, triangles[:, i], faces)
    return torch.nn.functional.normalize(total, dim=-1, eps=1e-12)


def sample(image, pixels):
    """Colours (V, 3) of image (H, W, 3) at pixels (V, 2), bilinear; (0, 0) is the middle of the first pixel."""
    height, width = image.shape[:2]
    size = torch.tensor([width - 1, height - 1], dtype=pixels.dtype)
    grid = (2 * pixels / size - 1)[None, None]
    planes = image.permute(2, 0, 1)[None].to(pixels.dtype)
    return torch.nn.functional.grid_sample(planes, grid, align_corners=True, padding_mode="border")[0, :, 0].T


def fit_light(colors, albedo, normals, ridge=1e-4):
    """The light (27,) that explains colours (V, 3) best, by linear least squares; numpy arrays in and out."""
    terms = harmonics(torch.as_tensor(normals)).numpy()
    light = []
    for channel in range(3):
        matrix = albedo[:, channel : channel + 1] * terms
        normal = matrix.T @ matrix
        light.append(
            np.linalg.solve(normal + ridge * np.trace(normal) / BANDS * np.eye(BANDS), matrix.T @ colors[:, channel])
        )
    return np.concatenate(light)


def mean_albedo(model):
    """(V, 3) the colours that a `FaceModel`'s regions have before any picture is seen."""
    albedo = np.tile(COLORS["skin"], (len(model.mean), 1))
    for region, color in COLORS.items():
        albedo[model.regions.get(region, [])] = color
    return albedo


@dataclass
class Appearance:
    """albedo (V, 3), light (27,), and the root mean square difference of colours between shaded face and picture at the
    `seen` (V,) vertices: under daylight with the mean albedo, and as found."""

    albedo: np.ndarray
    light: np.ndarray
    seen: np.ndarray
    before: float
    after: float


def explain(model, image, camera, expression, rotation, translation, identity=None):
    """`Appearance` of one picture (H, W, 3, 0 to 1) for a face as a `FaceFit` in pixels gives it.

    camera (fx, fy, cx, cy); expression (E,); rotation (3,) axis-angle; translation (3,). Light is found first, for the
    regions' mean albedo, by linear least squares over the vertices that face the camera; then each vertex's albedo is
    the most probable one between its region's and what the picture shows.
    """
    points = torch.tensor(model.vertices(expression, identity) @ Rotation.from_rotvec(rotation).as_matrix().T)
    normals = vertex_normals(points, torch.tensor(model.triangles.astype(np.int64)))
    placed = points * torch.tensor(AXES) + torch.tensor(np.asarray(translation, float))
    towards = torch.nn.functional.normalize(-placed, dim=-1)
    seen = ((normals * torch.tensor(AXES) * towards).sum(-1) > FACING).numpy()
    for region in HIDDEN:
        seen[model.regions.get(region, [])] = False
    (fx, fy, cx, cy), mean = camera, mean_albedo(model)
    pixels = placed[:, :2] / placed[:, 2:] * torch.tensor([fx, fy]) + torch.tensor([cx, cy])
    colors = sample(torch.as_tensor(np.asarray(image, float)), pixels).numpy()
    light = fit_light(colors[seen], mean[seen], normals.numpy()[seen])
    shading = shade(torch.ones_like(points), normals, torch.tensor(light)).numpy()
    trust = (shading / COLOR) ** 2 * seen[:, None]
    albedo = (mean / ALBEDO**2 + trust * colors / np.maximum(shading, 0.05)) / (ALBEDO**-2 + trust)
    daylight = np.zeros(3 * BANDS)
    daylight[::BANDS] = 2 * np.sqrt(np.pi)
    shown = lambda skin, lamp: shade(torch.tensor(skin), normals, torch.tensor(lamp)).numpy()
    differ = lambda skin, lamp: float(np.sqrt(((shown(skin, lamp) - colors)[seen] ** 2).mean()))
    return Appearance(albedo, light, seen, differ(mean, daylight), differ(albedo, light))
