"""Appearance: harmonics, shading, sampling and light against closed forms; a made-up picture is explained."""

import cv2
import numpy as np
import torch
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from cospeech.capture.photometric import explain, fit_light, harmonics, mean_albedo, sample, shade, vertex_normals
from cospeech.face.model import embedded
from cospeech.face.solver import AXES

CAMERA = (700.0, 700.0, 160.0, 160.0)


def sphere(count=40):
    """Unit directions (n, 3) and weights (n,) of an exact quadrature on the sphere (Gauss-Legendre in z)."""
    z, w = np.polynomial.legendre.leggauss(count)
    angle = np.arange(2 * count) * np.pi / count
    ring = np.sqrt(1 - z**2)[:, None]
    points = np.stack(np.broadcast_arrays(ring * np.cos(angle), ring * np.sin(angle), z[:, None]), -1).reshape(-1, 3)
    return points, np.repeat(w, 2 * count) * np.pi / count


def test_harmonics_are_orthonormal_on_the_sphere():
    points, weights = sphere()
    values = harmonics(torch.tensor(points)).numpy()
    assert_allclose((values * weights[:, None]).T @ values, np.eye(9), atol=1e-12)


def test_white_light_from_everywhere_shows_the_albedo_and_a_lamp_its_side():
    normals = torch.nn.functional.normalize(torch.randn(50, 3, dtype=torch.float64), dim=1)
    albedo = torch.rand(50, 3, dtype=torch.float64)
    ambient = torch.zeros(27, dtype=torch.float64)
    ambient[::9] = 2 * np.sqrt(np.pi)
    assert_allclose(shade(albedo, normals, ambient), albedo, atol=1e-12)
    lamp = torch.zeros(27, dtype=torch.float64)
    lamp[3::9] = np.sqrt(4 * np.pi / 3)  # degree 1 along x: brightness is the normal's x
    assert_allclose(shade(albedo, normals, lamp), albedo * normals[:, :1], atol=1e-12)


def test_normals_of_a_sphere_are_its_directions():
    angle, height = np.meshgrid(np.arange(40) * np.pi / 20, np.linspace(-1.4, 1.4, 30))
    points = np.stack([np.cos(height) * np.cos(angle), np.cos(height) * np.sin(angle), np.sin(height)], -1).reshape(
        -1, 3
    )
    row, column = np.mgrid[:29, :40]
    a, b = row * 40 + column, row * 40 + (column + 1) % 40
    triangles = np.concatenate(
        [np.stack([a, b, a + 40], -1).reshape(-1, 3), np.stack([b, b + 40, a + 40], -1).reshape(-1, 3)]
    )
    normals = vertex_normals(torch.tensor(points), torch.tensor(triangles)).numpy()
    inner = slice(40, -40)
    assert (np.sum(normals[inner] * points[inner], axis=1) > 0.999).all()


def test_sampling_reads_a_linear_picture_exactly():
    y, x = np.mgrid[:20, :30]
    image = torch.tensor(np.stack([x, y, 2 * x - y], -1).astype(float))
    pixels = torch.rand(100, 2, dtype=torch.float64) * torch.tensor([29.0, 19.0])
    expected = torch.stack([pixels[:, 0], pixels[:, 1], 2 * pixels[:, 0] - pixels[:, 1]], 1)
    assert_allclose(sample(image, pixels), expected, atol=1e-9)


def test_light_is_found_again():
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(400, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    albedo, light = rng.random((400, 3)) + 0.2, rng.normal(size=27)
    colors = shade(torch.tensor(albedo), torch.tensor(normals), torch.tensor(light)).numpy()
    assert_allclose(fit_light(colors, albedo, normals, ridge=0), light, atol=1e-9)


def picture(expression, rotation, translation, light):
    """(320, 320, 3) the embedded face drawn triangle by triangle, from far to near, by OpenCV."""
    model = embedded()
    points = model.vertices(expression) @ Rotation.from_rotvec(rotation).as_matrix().T
    normals = vertex_normals(torch.tensor(points), torch.tensor(model.triangles.astype(np.int64)))
    colors = shade(torch.tensor(mean_albedo(model)), normals, torch.tensor(light)).numpy()
    placed = points * AXES + translation
    pixels = placed[:, :2] / placed[:, 2:] * CAMERA[:2] + CAMERA[2:]
    image = np.full((320, 320, 3), 0.3)
    for triangle in model.triangles[np.argsort(-placed[model.triangles, 2].mean(axis=1))]:
        corner = np.round(pixels[triangle] * 16).astype(np.int32)
        cv2.fillConvexPoly(image, corner, colors[triangle].mean(axis=0).tolist(), cv2.LINE_8, 4)
    return image


def test_light_and_albedo_of_a_picture_are_found_again():
    model, expression = embedded(), np.zeros(64)
    expression[model.expression_names.index("jaw_open")] = 0.3
    rotation, translation = np.array([0.05, 0.15, 0.0]), np.array([0.0, -0.02, 0.75])
    light = np.zeros(27)
    light[::9], light[3::9], light[1::9] = 3.2, 0.8, 0.5
    image = picture(expression, rotation, translation, light)
    found = explain(model, image, CAMERA, expression, rotation, translation)
    assert 500 < found.seen.sum() < len(model.mean) and not found.seen[model.regions["tongue"]].any()
    assert found.after < 0.03 and found.after < 0.4 * found.before
    skin = np.intersect1d(np.flatnonzero(found.seen), model.regions["skin"])
    away = np.abs(found.albedo - mean_albedo(model))[skin]
    assert np.median(away) < 0.03  # the picture was drawn with the mean albedo
    white = torch.ones(len(model.mean), 3, dtype=torch.float64)
    points = torch.tensor(model.vertices(expression) @ Rotation.from_rotvec(rotation).as_matrix().T)
    normals = vertex_normals(points, torch.tensor(model.triangles.astype(np.int64)))
    true, ours = (shade(white, normals, torch.tensor(lamp)).numpy()[skin] for lamp in (light, found.light))
    assert np.median(np.abs(ours - true)) < 0.03 * true.mean() and np.corrcoef(ours[:, 0], true[:, 0])[0, 1] > 0.97
