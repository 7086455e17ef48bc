"""Fine points: where they lie, their light, and the mesh that draws them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from app.draw.draw_mesh import meshes_of
from app.draw.fine_mesh import fine_light, fine_meshes, fine_points_of
from gi_core.display.dilation import Drawn
from gi_core.display.fine_points import SHORTEST_EDGE, FinePoints, fine_points
from gi_core.gather import static
from gi_core.gather.direct_light import Places
from gi_core.model import Model
from gi_core.scene.types import SUN_DEGREES, DirectionalLight, Mobile, Pose, Scene
from tests.support.lit_from_outside import l_room
from tests.support.scene_builders import box, grey, merge, quad, solve

SUN = np.array((0.0, -0.6, -0.8))
E_FLOOR = 50.0 * 0.8
EDGE = 0.4 * 0.6 / 0.8  # m from the rim of the plate, at y = 0.6 and z = 0.4, to that of its shadow on the floor


def scene() -> Scene:
    """A floor of 2 x 2 m under a plate that covers y > 0.6, a sun, and a small box that moves."""
    floor = quad((0, 0, 0), (2, 0, 0), (0, 2, 0), (5, 5), 0)
    plate = quad((-1, 0.6, 0.4), (4, 0, 0), (0, 3, 0), (1, 1), 0)
    thing = Mobile("thing", box((-0.1, -0.1, 0.0), (0.1, 0.1, 0.2), 1, 0), Pose((0.5, 5.0, 0.0)))
    sun = DirectionalLight("sun", tuple(SUN), (50.0, 50.0, 50.0))
    return Scene(merge(floor, plate), (grey(0.5, two_sided=True),), (thing,), (sun,), up=(0.0, 0.0, 1.0), name="plate")


@pytest.fixture(scope="module")
def model() -> Model:
    return Model(scene(), threads=2)


def found(model: Model, y: float = 5.0) -> tuple[FinePoints, tuple]:
    """Return fine points with the mobile at y, and transforms there."""
    at = model.transforms({"thing": Pose((0.5, y, 0.0))})
    meshes = meshes_of(model)
    first = np.cumsum([0, *(len(mesh.positions) for mesh in meshes)])
    corners = np.concatenate([mesh.triangles + k for mesh, k in zip(meshes, first, strict=False)])
    *_, points = fine_points(model, 3, at, corners[:, :, None])
    return points, at


def no_ids(model: Model) -> np.ndarray:
    """Return corners without further ids."""
    return np.zeros((len(model.surfaces.corner_front), 3, 0), int)


def places(model: Model, points: FinePoints) -> np.ndarray:
    """Return the positions (R + n, 3) of receivers and points."""
    p = np.concatenate([model.object_receivers.positions, np.zeros((len(points.parents.shares), 3))])
    points.parents.fill(len(model.object_receivers.areas), p)
    return p


def test_a_half_plane_before_parallel_light_has_a_sharp_shadow():
    parallel = tuple(light._replace(disc_degrees=0.0) for light in scene().lights)
    model = Model(replace(scene(), lights=parallel), threads=2)
    points, at = found(model)
    light, first = points.at(at, model.emitters.lamps.full()), len(model.object_receivers.areas)
    p, size = places(model, points)[first:], model.world.size
    fronts = np.isin(np.arange(first, first + len(p)), points.ids[..., 0])
    floor = fronts & (np.abs(p[:, 2]) < 1e-6)
    lit = light.own[floor, 0] > 0
    assert np.allclose(light.own[floor][lit], E_FLOOR)
    border = 0.6 - EDGE
    sure = np.abs(p[floor, 1] - border) > 1e-3
    assert np.array_equal(lit[sure], p[floor, 1][sure] < border)
    y = p[floor, 1]
    nearest = y[lit].max(), y[~lit].min()
    assert nearest[1] - nearest[0] < 2 * SHORTEST_EDGE * size < 0.02, "points lie on both sides of the border"


def test_a_half_plane_before_the_sun_has_a_penumbra_of_the_disc(model):
    """Its width is 9.25 mm per metre from the rim; across it light is the area of the disc beside a chord."""
    points, at = found(model)
    light, first = points.at(at, model.emitters.lamps.full()), len(model.object_receivers.areas)
    p = points.direct[1]._places.positions
    floor = np.isin(np.arange(first, first + len(p)), points.ids[..., 0]) & (np.abs(p[:, 2]) < 1e-2)
    y, E = p[floor, 1] - 0.75 * p[floor, 2], light.own[floor, 0]
    distance = 0.4 / 0.8  # m from the rim to its shadow
    width = 2 * math.tan(math.radians(SUN_DEGREES / 2)) * distance / 0.8  # m along the floor
    assert width == pytest.approx(0.00925 * distance / 0.8, rel=1e-3)
    x = np.clip((y - (0.6 - EDGE)) / (width / 2), -1.0, 1.0)
    share = np.arccos(x) / np.pi - x * np.sqrt(1 - x * x) / np.pi
    assert (np.abs(x) < 1).sum() > 100
    assert np.abs(E / E_FLOOR - share).max() < 0.06, "64 points on the disc"
    assert abs((E / E_FLOOR - share)[np.abs(x) < 1].mean()) < 0.01


def test_a_thin_shadow_stays_whole_on_coarse_faces():
    """A post of 6 cm on squares of 0.2 m: its shadow passes edges beside their middles."""
    floor, post = quad((0, 0, 0), (2, 0, 0), (0, 2, 0), (10, 10), 0), box((0.43, 1.75, 0.0), (0.49, 1.81, 1.2), 1, 0)
    sun = DirectionalLight("sun", (0.15, -0.6, -0.8), (50.0, 50.0, 50.0))
    model = Model(replace(scene(), static=merge(floor, post), mobiles=(), lights=(sun,)), threads=2)
    *_, points = fine_points(model, 3, model.transforms({}), no_ids(model))
    first, light = len(model.object_receivers.areas), points.at(model.transforms({}), model.emitters.lamps.full())
    p, E = points.direct[1]._places.positions, light.own[:, 0]
    p, E = np.concatenate([model.object_receivers.positions, p]), np.concatenate([light.receivers[:, 0], E])
    assert len(p) == first + len(points.parents.shares)
    on_floor = (np.abs(p[points.ids[..., 0]][..., 2]) < 1e-2).all(axis=1)
    corners, shades = points.ids[on_floor, :, 0], []
    for y in np.linspace(0.9, 1.7, 41):
        a, b, c = (p[corners[:, k], :2] for k in range(3))
        at = np.array((0.46 + 0.25 * (1.75 - y), y))
        sides = [
            np.linalg.det(np.stack([v - u, np.broadcast_to(at, u.shape) - u], axis=1))
            for u, v in ((b, c), (c, a), (a, b))
        ]
        inside = np.argmax(np.min(sides, axis=0))
        shares = np.array([side[inside] for side in sides]).clip(0)
        shades.append(shares @ E[corners[inside]] / shares.sum() / E.max())
    assert max(shades) < 0.5 and len(points.parents.shares) < 2500  # 1,964


@pytest.mark.parametrize("direction", [(-1.0, 0.0, -0.75), (-1.0, 0.17, -0.7), (-0.9, -0.31, -0.77)])
def test_sunlight_by_a_window_takes_few_points(direction):
    """Where its border passes a corner of a face, each round cut slivers from slivers, up to 50,000 points."""
    room = replace(l_room(), mobiles=(), lights=(DirectionalLight("sun", direction, (1.0, 1.0, 1.0)),))
    model = Model(room)
    *_, points = fine_points(model, 0, model.transforms({}), no_ids(model))
    assert 500 < len(points.parents.shares) < 3000  # 1,125, 2,117, 2,219; parallel light takes 129 to 632


def test_each_round_adds_points(model):
    at = found(model)[1]
    rounds, full = list(fine_points(model, 3, at, no_ids(model))), model.emitters.lamps.full()
    counts = [len(points.parents.shares) for points in rounds]
    assert len(rounds) > 2 and counts == sorted(counts) and counts[0] < counts[-1]
    last = rounds[-1].at(at, full).own
    for points, count in zip(rounds, counts, strict=True):
        assert points.ids[..., :2].max() < len(model.object_receivers.areas) + count
        assert np.array_equal(points.at(at, full).own, last[:count])


def test_light_of_receivers_stays_bit_for_bit(model):
    points, at = found(model)
    E = np.random.default_rng(1).uniform(0, 60, (len(model.object_receivers.areas), 3))
    drawn = points.at(at, model.emitters.lamps.full()).of(Drawn(E, None))
    assert np.array_equal(drawn.irradiance[: len(E)], E) and (drawn.irradiance >= 0).all()
    assert len(drawn.irradiance) == len(E) + len(points.parents.shares) == len(drawn.weights)


def test_bounced_light_is_interpolated_under_direct_light(model):
    """Light that is the direct light and a slope is the slope between receivers."""
    points, at = found(model)
    light = points.at(at, model.emitters.lamps.full())
    E, slope = light.receivers, places(model, points) @ (1.0, 2.0, 0.5) + 2.0
    drawn = light.of(Drawn(E + slope[: len(E), None], None)).irradiance
    assert np.allclose(drawn[len(E) :], light.own + slope[len(E) :, None], rtol=1e-12, atol=1e-9)


def test_an_unreached_receiver_gives_no_light(model):
    points, at = found(model)
    light, n = points.at(at, model.emitters.lamps.full()), len(model.object_receivers.areas)
    weights, E = np.ones(n, np.float32), np.full((n, 3), 90.0)
    p, q = points.parents.ends[0]
    weights[p], E[p] = 1e-6, 0.0
    drawn = light.of(Drawn(E, weights))
    expected = 90.0 - light.receivers[q] + light.own[0]
    assert np.allclose(drawn.irradiance[n], expected, rtol=1e-4) and drawn.weights[n] == 1.0


def test_light_at_the_poses_of_points_equals_that_measured_anew(model):
    full = model.emitters.lamps.full()
    for y in (5.0, 0.05):
        points, at = found(model, y)
        fresh = points.direct[1].measured_at(Places(*points.direct[1]._places))
        assert np.array_equal(points.at(at, full).own, fresh.at(at, full))


def test_shadows_of_mobiles_are_interpolated_at_other_poses(model):
    """Whatever the poses: where no mobile stands in the light, light is that of no mobile."""
    points, at = found(model)
    elsewhere, full = model.transforms({"thing": Pose((0.5, 9.0, 0.0))}), model.emitters.lamps.full()
    light, n = points.at(elsewhere, full), len(model.object_receivers.areas)
    static = points.objects[n:] == 0
    assert np.array_equal(light.own[static], points.at(at, full).own[static])

    def drawn(share: float) -> np.ndarray:
        """Return the light of points where receivers have a share of their direct light."""
        return light.of(Drawn(share * light.receivers, None)).irradiance[n:]

    of_receivers = drawn(2.0) - light.own
    assert of_receivers.any() and np.allclose(drawn(0.25), np.maximum(light.own - 0.75 * of_receivers, 0.0))


def test_a_shadow_at_other_poses_takes_no_bounced_light(model):
    """Beside the border of sunlight, points were black where the shadow of a mobile touched their parents."""
    points, at = found(model)
    there, full = model.transforms({"thing": Pose((0.5, 0.2, 0.0))}), model.emitters.lamps.full()
    light, n = points.at(there, full), len(model.object_receivers.areas)
    assert (light.of(Drawn(light.receivers + 5.0, None)).irradiance > 5.0 - 1e-9)[n:].all()
    shaded = light.own < points.at(at, full).own - 1.0
    assert shaded.any() and (light.own >= 0).all()


def test_a_mobiles_shadow_has_points_along_it(model):
    shade = [len(found(model, y)[0].parents.shares) for y in (5.0, 0.05)]
    assert shade[1] > shade[0] + 50


def test_a_shadow_on_a_mobile_is_sharp_until_it_moves(model):
    points, at = found(model, 0.45)
    full, n = model.emitters.lamps.full(), len(model.object_receivers.areas)
    light, on_box = points.at(at, full), points.objects[n:] == 1
    p, normals, _ = points.direct[1]._places
    top = on_box & (np.abs(p[:, 2] - 0.2) < 1e-3) & (normals[:, 2] > 0.5)
    y, lit = p[top, 1], light.own[top, 0] > 0.5 * E_FLOOR
    border = 0.6 - 0.2 * 0.6 / 0.8
    assert np.array_equal(lit[np.abs(y - border) > 3e-3], y[np.abs(y - border) > 3e-3] < border)
    assert y[~lit].min() - y[lit].max() < 2 * SHORTEST_EDGE * model.world.size
    moved = points.at(model.transforms({"thing": Pose((0.5, 0.5, 0.0))}), full)
    assert not moved.own[on_box].any() and moved.own[~on_box].any()
    E = np.random.default_rng(1).uniform(20, 60, (n, 3))
    between = points.between(Drawn(E, None)).irradiance[n:]
    for interpolated in moved, points.at(at, full, {1}):
        assert np.allclose(interpolated.of(Drawn(E, None)).irradiance[n:][on_box], between[on_box])
    assert np.array_equal(points.at(at, full, {1}).own[~on_box], light.own[~on_box])


def test_points_on_a_mobile_have_direct_light_once_paths_light_it(monkeypatch):
    """Frames light it by other points on lamps: borders of both differ by black teeth."""
    monkeypatch.setattr(static, "ENOUGH", 0.05)
    solver = solve(scene(), photons=20_000, radius=0.2, light="best")
    list(solver.gather_steps())
    solver.move("thing", Pose((0.5, 0.45, 0.0)))
    *_, points = fine_points_of(solver, meshes_of(solver.model))
    on_box = points.objects[len(solver.irradiance) :] == 1
    assert not fine_light(solver, points).own[on_box].any()
    list(solver.gather_pose_steps())
    assert fine_light(solver, points).own[on_box].any()


@pytest.mark.parametrize("y", [5.0, 0.05, 0.45])
def test_pieces_cover_faces_without_gaps(model, y):
    points, _ = found(model, y)
    meshes, pieces = meshes_of(model), fine_meshes(meshes_of(model), points)
    for before, mesh in zip(meshes, pieces, strict=True):
        area = [np.linalg.norm(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), axis=1)
                for c in (m.positions[m.triangles].astype(float) for m in (before, mesh))]  # fmt: skip
        source = np.arange(len(area[1])) if mesh is before else mesh.source
        assert np.allclose(np.bincount(source, area[1]), area[0], rtol=1e-4)
    assert (pieces[1] is meshes[1]) == (y != 0.45), "the shadow of the plate lies on the box"
    before, mesh = meshes[0], pieces[0]
    static = points.ids[points.source < len(before.triangles)]
    corners, p = static[..., 0], places(model, points)
    edges = np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]), axis=1)
    edges, count = np.unique(edges, axis=0, return_counts=True)
    rims = (0, 0), (0, 2), (1, 0), (1, 2), (0, -1), (0, 3), (1, 0.6), (1, 3.6)
    within = ~np.any([np.isclose(p[edges][..., k], at).all(axis=1) for k, at in rims], axis=0)
    assert (count[within] == 2).all(), "an edge within the floor has faces on both sides"
    assert (mesh.front[mesh.triangles] == static[..., 0]).all()
