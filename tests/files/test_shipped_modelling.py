"""The generators' shapes: closed, facing outwards, of the given size; images decode to the painted pixels."""

import io

import numpy as np
import pytest
from PIL import Image as PillowImage

from scenes import furnishings, implicit, modelling, round_shapes, textures
from scenes.key_frames import loop, written
from scenes.modelling import Shape


def volume(shape: Shape) -> float:
    """Return the volume that the faces enclose: positive if they face outwards (divergence theorem)."""
    p = shape.vertices[shape.faces]
    return float((p[:, 0] * np.cross(p[:, 1], p[:, 2])).sum()) / 6


def unmatched_edges(shape: Shape) -> int:
    """Return the number of edges without a second face in the opposite direction."""
    place = np.unique(np.round(shape.vertices, 7), axis=0, return_inverse=True)[1].reshape(-1)[shape.faces]
    edges = np.concatenate([place[:, [0, 1]], place[:, [1, 2]], place[:, [2, 0]]])
    there = {tuple(e) for e in edges.tolist()}
    return sum((b, a) not in there for a, b in there)


SOLIDS = {
    "box": (modelling.box((0.3, 0.2, 0.5)), 0.3 * 0.2 * 0.5, 1e-9),
    "rounded_box": (modelling.rounded_box((0.3, 0.2, 0.5), 0.02, 2), 0.3 * 0.2 * 0.5, 0.02),
    "ball": (round_shapes.ball(0.2, 32), 4 / 3 * np.pi * 0.2**3, 0.02),
    "turned_body": (round_shapes.turned_body([(0, 0), (0.1, 0), (0.1, 0.4), (0, 0.4)], 48), np.pi * 0.01 * 0.4, 0.01),
    "tube": (round_shapes.rod((0, 0, 0), (0.3, 0.4, 0), 0.02, 32), np.pi * 0.0004 * 0.5, 0.01),
    "ring": (
        round_shapes.tube(
            np.array([[np.cos(a), 0, np.sin(a)] for a in np.arange(64) * np.pi / 32]), 0.1, 24, closed=True
        ),
        2 * np.pi**2 * 0.01,
        0.02,
    ),
    "blob": (
        implicit.polygonised(implicit.ellipsoid((0, 0, 0), (0.3, 0.3, 0.3)), (-0.4,) * 3, (0.4,) * 3, 0.05),
        4 / 3 * np.pi * 0.027,
        0.02,
    ),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_are_closed_face_outwards_and_have_their_volume(name):
    shape, expected, tolerance = SOLIDS[name]
    assert unmatched_edges(shape) == 0
    assert volume(shape) == pytest.approx(expected, rel=tolerance)
    if shape.normals is not None:
        p = shape.vertices[shape.faces]
        faces = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
        assert ((shape.normals[shape.faces] * faces[:, None]).sum(axis=2) > 0).all()
        np.testing.assert_allclose((shape.normals**2).sum(axis=1), 1, atol=1e-9)


def test_rounded_box_fills_its_size_and_keeps_its_flats_flat():
    shape = modelling.rounded_box((0.3, 0.2, 0.5), 0.02)
    np.testing.assert_allclose(shape.vertices.min(axis=0), [-0.15, 0, -0.25], atol=1e-12)
    np.testing.assert_allclose(shape.vertices.max(axis=0), [0.15, 0.2, 0.25], atol=1e-12)
    top = (shape.vertices[:, 1] > 0.2 - 1e-9) & (np.abs(shape.vertices[:, 0]) < 0.13 - 1e-9)
    assert (shape.normals[top & (np.abs(shape.vertices[:, 2]) < 0.2)] == [0, 1, 0]).all()


def test_wall_leaves_its_hole():
    shape = modelling.wall((0, 0, 0), (2, 0, 0), (0, 1, 0), 0.1, ((0.5, 0.2), (1.1, 0.7)))
    p = shape.vertices[shape.faces]
    area = np.sqrt((np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]) ** 2).sum(axis=1)).sum() / 2
    assert area == pytest.approx(2 - 0.6 * 0.5)
    np.testing.assert_allclose(shape.uv, shape.vertices[:, :2], atol=1e-12)
    middle = p.mean(axis=1)
    assert not ((np.abs(middle[:, 0] - 0.8) < 0.29) & (np.abs(middle[:, 1] - 0.45) < 0.24)).any()


def test_bodies_that_do_not_fit_are_refused():
    ball = implicit.ellipsoid((0, 0, 0), (0.3, 0.3, 0.3))
    with pytest.raises(ValueError, match="reaches out of its box"):
        implicit.polygonised(ball, (-0.2,) * 3, (0.4,) * 3, 0.05)
    with pytest.raises(ValueError, match="cannot have edges rounded by"):
        modelling.rounded_box((0.1, 0.01, 0.1), 0.02)


def test_joining_with_and_without_normals_is_refused():
    with pytest.raises(ValueError, match="cannot be joined"):
        modelling.joined(modelling.box((1, 1, 1)), round_shapes.ball(1.0))


def test_books_hide_no_cover_behind_another():
    """A book has no side next to a taller one; a row that touches the bookcase has no left end."""

    def sides(at_side):
        rng = np.random.default_rng(1)
        row = modelling.joined(*furnishings.books(rng, 0.5, 0.2, 0.3, lambda: (0.5, 0.5), at_side))
        p = row.vertices[row.faces]
        n = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]) / 2
        return row, n

    row, n = sides(False)
    # The view from the left, from the right: the outline of the row, no more.
    assert -n[n[:, 0] < 0][:, 0].sum() == pytest.approx(n[n[:, 0] > 0][:, 0].sum())
    _, fewer = sides(True)
    assert fewer[fewer[:, 0] < 0][:, 0].sum() > n[n[:, 0] < 0][:, 0].sum()
    assert row.vertices[:, 0].max() <= 0.5


def test_png_holds_the_pixels():
    image = textures.boards(64, 32, 4, "201008 f0e0d0", 1)
    read = np.asarray(PillowImage.open(io.BytesIO(textures.png(image))).convert("RGB"))
    np.testing.assert_array_equal(read, image.palette[image.index])
    assert len(np.unique(image.index)) > 10


def test_noise_repeats_without_a_seam():
    x = np.linspace(0, 1, 9)
    for seed in range(5):
        a, b = textures.cloud(x * 0, x * 4, (3, 4), seed), textures.cloud(x * 0 + 3, x * 4, (3, 4), seed)
        np.testing.assert_allclose(a, b, atol=1e-12)
        assert 0 <= a.min() and a.max() <= 1 and np.ptp(a) > 0.05


def test_loop_has_constant_speed_and_is_written_into_its_file():
    def ellipse(a):
        return np.stack([2 * np.cos(a), 0 * a, np.sin(a)], axis=1)

    path = loop(ellipse, keys=40, speed=0.5, turns=3)
    step = np.sqrt((np.diff(path.positions, axis=0) ** 2).sum(axis=1))
    np.testing.assert_allclose(step / np.diff(path.times), 0.5, rtol=2e-3)
    np.testing.assert_array_equal(path.positions[0], path.positions[-1])
    assert path.spin * path.times[-1] == pytest.approx(3 * 360, rel=1e-4)
    text = "[mobile.path]\nspin = 1.0  # why\ntimes = [\n]\npositions = [\n]\nafter = 1\n"
    new = written(text, path)
    assert written(new, path) == new and new.endswith("]\nafter = 1\n") and "  # why" in new
    with pytest.raises(ValueError, match="needs times, positions and spin"):
        written("[mobile.path]\ntimes = [\n]\n", path)
