"""Light maps: what bilinear filters and smaller copies read is the light of the surface, nothing of other charts."""

import numpy as np
import pytest

from app.draw.baking import PADDING, Unwrapped, light_map, unwrap
from tests.support.scene_builders import box

SIZE = 96


def boxes() -> list[tuple[np.ndarray, np.ndarray]]:
    """Return positions and triangles of two boxes whose sides are split into cells."""
    meshes = box((0, 0, 0), (1, 0.7, 0.4), 3), box((2, 0, 0), (2.3, 1.0, 0.9), 3)
    return [(mesh.vertices, mesh.faces) for mesh in meshes]


def bilinear(image: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Return an image (h, w, 3) at texture coordinates (n, 2), filtered as graphics hardware does."""
    h, w = image.shape[:2]
    x, y = uv[:, 0] * w - 0.5, uv[:, 1] * h - 0.5
    i, j = np.floor(x).astype(int), np.floor(y).astype(int)
    a, b = (x - i)[:, None], (y - j)[:, None]
    at = lambda di, dj: image[np.clip(j + dj, 0, h - 1), np.clip(i + di, 0, w - 1)]  # noqa: E731
    return (at(0, 0) * (1 - a) + at(1, 0) * a) * (1 - b) + (at(0, 1) * (1 - a) + at(1, 1) * a) * b


def on_surface(part: Unwrapped, values: np.ndarray, n: int, rng) -> tuple[np.ndarray, np.ndarray]:
    """Return texture coordinates (n, 2) of points of triangles, edges and corners too, and values (n, 3) there."""
    rows = part.corners[rng.integers(len(part.corners), size=n)]
    shares = rng.dirichlet((0.4,) * 3, n)
    shares[: n // 4] = np.eye(3)[rng.integers(3, size=n // 4)]
    return tuple((shares[:, :, None] * a[rows]).sum(axis=1) for a in (part.uv.astype(float), values))


def test_a_smooth_light_is_read_back_all_over_the_surface():
    """Light linear along the surface: bilinear reads are exact within a chart, and nearly so at its edge."""
    meshes, rng = boxes(), np.random.default_rng(1)
    parts, size = unwrap(meshes, SIZE)
    slope = np.array([[3.0, 1.0, 0.0], [0.0, 2.0, 1.0], [1.0, 0.0, 4.0]])
    light = [5 + p[0][u.vertices] @ slope.T for p, u in zip(meshes, parts, strict=True)]
    for part, (_, triangles) in zip(parts, meshes, strict=True):
        assert np.array_equal(part.vertices[part.corners], triangles), "the same triangles, cut along charts"
    made = light_map(size, [(u, E, np.ones(len(E))) for u, E in zip(parts, light, strict=True)])
    texel = 1 / np.sqrt((made.coverage.sum()) / sum(area(*m) for m in meshes))  # [m]
    for part, E in zip(parts, light, strict=True):
        uv, expected = on_surface(part, E, 4000, rng)
        off = np.abs(bilinear(made.irradiance, uv) - expected)
        steepest = np.linalg.norm(slope, axis=1)
        assert (off < 1e-4).all(axis=1).mean() > 0.5 and (off < 1.5 * texel * steepest).all()
        middle = part.uv[part.corners].astype(float).mean(axis=1)
        exact = np.abs(bilinear(made.irradiance, middle) - E[part.corners].mean(axis=1)).max(axis=1)
        assert np.median(exact) < 1e-4


def area(positions: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def test_no_light_bleeds_from_chart_to_chart():
    """Every chart has a light of its own: reads at any point of it, and in the half-size copy, give exactly that."""
    meshes, rng = boxes(), np.random.default_rng(2)
    parts, size = unwrap(meshes, SIZE)
    lit = []
    for part in parts:
        flat = flat_normals(part, meshes[len(lit)][0])
        value = 10.0 ** (flat @ (1, 2, 4)) + 100 * len(lit)  # of six sides
        lit.append(np.repeat(value[:, None], 3, axis=1))
    made = light_map(size, [(u, E, np.ones(len(E))) for u, E in zip(parts, lit, strict=True)])
    padded = [(0, n % 2) for n in made.irradiance.shape[:2]] + [(0, 0)]
    half = np.pad(made.irradiance, padded, mode="edge")
    half = (half[::2, ::2] + half[1::2, ::2] + half[::2, 1::2] + half[1::2, 1::2]) / 4
    scale = np.array(made.irradiance.shape[1::-1]) / (2 * np.array(half.shape[1::-1]))
    for part, E in zip(parts, lit, strict=True):
        uv, expected = on_surface(part, E, 4000, rng)
        np.testing.assert_allclose(bilinear(made.irradiance, uv), expected, rtol=1e-5)
        np.testing.assert_allclose(bilinear(half, uv * scale), expected, rtol=1e-5)
    assert PADDING >= 4 and set(np.unique(made.coverage)) == {0.0, 1.0}


def flat_normals(part: Unwrapped, positions: np.ndarray) -> np.ndarray:
    """Return per vertex of an unwrapped box the outward normal of its side: -1, 0, 1 along each axis."""
    p = positions[part.vertices]
    out = np.zeros((len(p), 3))
    a, b, c = (p[part.corners[:, k]] for k in range(3))
    n = np.cross(b - a, c - a)
    n /= np.linalg.norm(n, axis=1)[:, None]
    for k in range(3):
        out[part.corners[:, k]] = n
    return np.round(out)


def test_weights_are_those_of_the_picture():
    """A vertex of small weight hardly counts."""
    part = Unwrapped(np.arange(3), np.array([[0, 1, 2]]), np.array([[0.1, 0.1], [0.9, 0.1], [0.1, 0.9]], np.float32))
    E = np.array([[0.0] * 3, [1.0] * 3, [1.0] * 3])
    light = [light_map((32, 32), [(part, E, np.array([w, 1.0, 1.0]))]).irradiance[8, 8, 0] for w in (1.0, 1e-3)]
    assert light[0] == pytest.approx(1 - (1 - 2 * (8.5 / 32 - 0.1) / 0.8), abs=1e-6) and light[1] > 0.99
