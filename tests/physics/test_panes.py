"""Panes: transmittance against closed forms and Mitsuba, light of frames, histories, pictures."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gi_core.base.jit import allocating
from gi_core.estimators import ESTIMATORS
from gi_core.gather.reference import reference_irradiance
from gi_core.model import Model
from gi_core.rays.panes import shares_of, transmitted
from gi_core.rays.structures import DEFAULT, new_ray
from gi_core.scene.pose import axis_angle
from gi_core.scene.types import DirectionalLight, Material, Mobile, Pane, PointLight, Pose, Probe, Scene, SkyLight
from gi_core.solver import Solver
from tests.support.lit_from_outside import MATERIALS, prism
from tests.support.scene_builders import box, grey, merge, quad, solve, sphere

UP = (0.0, 0.0, 1.0)
TINT = (1.0, 0.7, 0.4)


def glass(transmittance=(1.0, 1.0, 1.0), ior=1.5) -> Material:
    return Material("glass").as_pane(Pane(transmittance, ior))


def stack(count: int, light) -> Scene:
    """Return a black floor below so many tinted panes, one above the other."""
    panes = [quad((-6, -6, 1 + 0.3 * k), (12, 0, 0), (0, 12, 0), (2, 2), 1) for k in range(count)]
    floor = quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), (8, 8), 0)
    return Scene(merge(floor, *panes), (grey(0.0), glass(TINT)), (), (light,), up=UP, name="panes")


def slab(cosine):
    """Return reflectance and transmittance (n, 3) of a tinted pane by an explicit sum of the reflections inside."""
    c = np.asarray(cosine)[:, None]
    inside = np.sqrt(1 - (1 - c**2) / 1.5**2)
    s, p = (c - 1.5 * inside) / (c + 1.5 * inside), (1.5 * c - inside) / (1.5 * c + inside)
    F, t = (s**2 + p**2) / 2, np.array(TINT) ** (1 / inside)
    passes = sum((1 - F) ** 2 * t * (F * t) ** (2 * k) for k in range(200))
    back = F + sum((1 - F) ** 2 * F * t**2 * (F * t) ** (2 * k) for k in range(200))
    return back, passes


def test_shares_are_the_sum_of_all_reflections_inside():
    cosine = np.linspace(0.02, 1.0, 50)
    kinds = np.tile((*TINT, 1.5), (50, 1))
    back, passes = slab(cosine)
    mirrored, passed = shares_of(kinds, cosine)
    np.testing.assert_allclose(mirrored, back, rtol=1e-9)
    np.testing.assert_allclose(passed, passes, rtol=1e-9)
    assert (mirrored + passed <= 1 + 1e-12).all()
    clear = shares_of(np.tile((1.0, 1.0, 1.0, 1.5), (50, 1)), cosine)
    np.testing.assert_allclose(clear[0] + clear[1], 1.0, rtol=1e-9)
    assert clear[1][-1, 0] == pytest.approx(0.923, abs=5e-4)  # of a window, along the normal


def test_an_index_of_one_reflects_nothing_at_any_angle():
    """Exporters write it for every material; along the pane its formula divides 0 by 0."""
    cosine = np.array([0.0, 1e-12, 1e-3, 0.5, 1.0])
    mirrored, passed = shares_of(np.tile((*TINT, 1.0), (5, 1)), cosine)
    assert np.isfinite(mirrored).all() and np.isfinite(passed).all()
    np.testing.assert_allclose(mirrored[2:], 0.0, atol=1e-12)
    np.testing.assert_allclose(passed[2:], np.array(TINT) ** (1 / cosine[2:, None]), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_parallel_light_through_panes(count):
    """Shadow rays see the product of the panes; photons also what goes to and fro between panes."""
    cosine = 1 / np.sqrt(1.25)
    scene = stack(count, DirectionalLight("sun", (0.5, 0.0, -1.0), (10.0, 10.0, 10.0), 0.0))
    back, passes = (a[0] for a in slab([cosine]))
    solver = solve(scene, photons=400_000, radius=0.3, light="photons")
    E, _ = reference_irradiance(scene, [(0.1, 0.1, 0.0)], [UP], 4, 1, model=solver.model)
    np.testing.assert_allclose(E[0], 10 * cosine * passes**count, rtol=1e-6)
    R, T = back, passes
    for _ in range(count - 1):
        R, T = R + T * T * back / (1 - R * back), T * passes / (1 - R * back)
    r = solver.model.object_receivers
    floor = (np.abs(r.positions[:, :2]).max(axis=1) < 0.8) & (r.positions[:, 2] < 0.5)
    np.testing.assert_allclose(solver.irradiance[floor].mean(axis=0), 10 * cosine * T, rtol=0.02)


@pytest.mark.parametrize("count", [1, 2])
def test_diffuse_light_through_panes(count):
    """Under a whole sky, by whole paths, which see what goes to and fro between panes too."""
    scene = stack(count, SkyLight("sky", (1.0, 1.0, 1.0)))
    scene = replace(scene, static=scene.static._replace(vertices=scene.static.vertices * (1e3, 1e3, 1.0)))
    cosine = np.sqrt((np.arange(400) + 0.5) / 400)
    back, passes = slab(cosine)
    T = passes if count == 1 else passes**2 / (1 - back**2)
    E, error = reference_irradiance(scene, [(0.0, 0.0, 0.0)], [UP], 100_000, 3)
    np.testing.assert_allclose(E[0] / np.pi, T.mean(axis=0), atol=3 * error.max() / np.pi)
    assert (error < 0.007 * E).all()


def glazed_room() -> tuple[Scene, np.ndarray, np.ndarray]:
    """Return a room under a sky behind one large pane, and points with normals."""
    outline = ((0, 0, 4, 4),), ((0, 0), (4, 0), (4, 4), (0, 4))
    room = prism(outline, 3.0, 1.0, 1, (0.4, 3.6, 0.2, 2.8))
    pane = quad((4.0, 0.4, 0.2), (0, 3.2, 0), (0, 0, 2.6), (2, 2), 4)
    scene = Scene(merge(room, pane), (*MATERIALS, glass()), (), (SkyLight("sky", (3.0, 3.5, 4.5)),), up=UP, name="r")
    return scene, np.array([(3, 2, 0), (1, 2, 0), (2, 2, 3), (0, 2, 1.5)]), np.array([UP, UP, (0, 0, -1), (1, 0, 0)])


# Mitsuba 3.9, `thindielectric` and `path`: irradiance [W/m2] of red and its standard error, by studies of this commit.
MITSUBA = np.array([(2.43282, 0.0041), (1.01314, 0.0022), (0.42936, 0.0007), (0.96468, 0.0010)])


def test_a_glazed_room_has_the_light_of_mitsuba():
    scene, points, normals = glazed_room()
    E, error = reference_irradiance(scene, points, normals, 100_000, 3)
    off = (E[:, 0] - MITSUBA[:, 0]) / np.hypot(error[:, 0], MITSUBA[:, 1])
    assert np.abs(off).max() < 3.5
    assert (error[:, 0] < 0.01 * E[:, 0]).all()


def test_photons_and_paths_agree_behind_a_pane():
    scene, points, normals = glazed_room()
    probes = tuple(Probe(f"p{k}", tuple(p), tuple(n)) for k, (p, n) in enumerate(zip(points, normals, strict=True)))
    solver = solve(replace(scene, probes=probes), photons=1_000_000, radius=0.25, light="photons")
    by_photons = [solver.frame.probe_irradiance[p.name][0] for p in probes]
    np.testing.assert_allclose(by_photons, MITSUBA[:, 0], rtol=0.05)


def histories() -> Scene:
    """A room with a tinted pane, a box of glass and a ball; a lamp, a bulb, sun and sky."""
    materials = (
        Material("wall", (0.8, 0.6, 0.4)),
        Material("lamp", (0.5, 0.5, 0.5), (3.0, 2.0, 1.0)),
        glass((0.9, 0.7, 0.5)),
        glass(),
    )
    static = merge(
        box((0, 0, 0), (1, 1, 1), 3, 0, inward=True),
        quad((0.3, 0.3, 0.99), (0, 0.4, 0), (0.4, 0, 0), (1, 1), 1),
        quad((0.1, 0.5, 0.1), (0, 0, 0.6), (0.6, 0, 0), (2, 2), 2),
    )
    mobiles = (
        Mobile("box", box((-0.12, -0.12, 0), (0.12, 0.12, 0.24), 1, 3), Pose((0.6, 0.4, 0.0))),
        Mobile("ball", sphere((0, 0, 0), 0.15, 1, 0), Pose((0.3, 0.7, 0.4))),
    )
    lights = (
        PointLight("bulb", (0.8, 0.8, 0.7), (0.5, 0.5, 2.0)),
        DirectionalLight("sun", (0.3, 0.2, -1.0), (1.0, 1.0, 1.0)),
        SkyLight("sky", (0.1, 0.2, 0.3)),
    )
    return Scene(static, materials, mobiles, lights, up=UP, name="glazed")


SCENE = histories()
places = st.tuples(st.floats(-0.1, 1.1), st.floats(-0.1, 1.1), st.one_of(st.just(0.0), st.floats(-0.1, 1.0)))
poses = st.builds(lambda p, turn: Pose(p, axis_angle((1.0, 0.5, 0.0), turn)), places, st.sampled_from([0.0, 40.0]))
moves = st.lists(st.tuples(st.sampled_from(["box", "ball"]), poses), min_size=1, max_size=4)


@pytest.mark.parametrize("light", ["photons", "best"])
@settings(max_examples=8)
@given(history=moves, estimator=st.sampled_from(list(ESTIMATORS)))
def test_any_history_with_panes_equals_from_scratch(light, history, estimator):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gi_core.frames.static_light.UNRESOLVED", np.inf)
        solver = solve(SCENE, photons=3000, radius=0.2, neighbours=6, seed=11, light=light, estimator=estimator)
        for name, pose in history:
            solver.move(name, pose)
        assert np.array_equal(solver.irradiance, solver.from_scratch())
        assert (solver.irradiance >= 0).all() and np.isfinite(solver.irradiance).all()
        photons, change = solver.frame.store, solver.frame.change
        emitted, absorbed, escaped, truncated = (
            getattr(photons.fates, k) + getattr(change.fates, k) for k in change.fates._fields
        )
        assert np.array_equal(emitted, absorbed + escaped + truncated)


def test_threads_do_not_change_bits_with_panes():
    solvers = [Solver(SCENE, photons=3000, radius=0.2, seed=11, light="best", threads=n) for n in (1, 2, 3)]
    for solver in solvers:
        solver.solve()
        solver.move("box", Pose((0.5, 0.5, 0.2)))
    assert all(np.array_equal(solvers[0].irradiance, other.irradiance) for other in solvers[1:])


@allocating
def shares_along(scenes, ray, origins, directions, limits):
    """Return the shares (n, 3) of light that object 0 lets pass along rays (n, 3)."""
    out = np.empty((len(origins), 3))
    for k in range(len(origins)):
        (x, y, z), (u, v, w) = origins[k], directions[k]
        out[k] = transmitted(scenes, 0, ray, x, y, z, u, v, w, limits[k])
    return out


@pytest.mark.parametrize("rays", sorted({DEFAULT, "bvh"}))
def test_rays_of_each_structure_pass_panes(rays):
    """Two tinted panes above a floor of 2 x 2 m; kernels of whole frames for another structure compile for 17 s."""
    model = Model(stack(2, SkyLight("sky", (1.0, 1.0, 1.0))), rays=rays)
    xy = np.random.default_rng(4).uniform(-3, 3, (500, 2))
    origins = np.concatenate([xy, np.full((500, 1), 2.0)], axis=1).astype(np.float32)
    down = np.array((0.6, 0.0, -0.8), np.float32)
    rays_down = origins, np.tile(down, (500, 1))
    on_floor = np.abs(xy + (1.5, 0.0)).max(axis=1) < 1
    _, passes = slab([0.8])
    for reach, blocked in ((1.7, False), (4.0, on_floor)):
        expected = np.where(np.broadcast_to(blocked, 500)[:, None], 0.0, passes**2)
        found = shares_along(model.accelerator.scenes, new_ray(), *rays_down, np.full(500, reach, np.float32))
        np.testing.assert_allclose(found, expected, rtol=1e-5)
    distance, face = model.accelerator.nearest(0, *rays_down, np.full(500, 4.0, np.float32))
    assert (model.surfaces.pane[face] >= 0).all()
    np.testing.assert_allclose(distance, 0.7 / 0.8, rtol=1e-5)
    opaque = model.accelerator.opaque.nearest(0, *rays_down, np.full(500, 4.0, np.float32))[1]
    assert on_floor.sum() > 20 and np.array_equal(opaque >= 0, on_floor)


def test_a_moved_pane_dims_what_stands_behind_it():
    """A floor under the sun has T of the light below a pane, by direct light that is measured and by whole paths."""
    floor = quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), (10, 10), 0)
    pane = Mobile("pane", quad((-0.5, -0.5, 0), (1, 0, 0), (0, 1, 0), (1, 1), 1), Pose((0.0, 0.0, 0.4)))
    sun = DirectionalLight("sun", (0.0, 0.0, -1.0), (10.0, 10.0, 10.0), 0.0)
    scene = Scene(floor, (grey(0.2), glass(TINT)), (pane,), (sun,), up=UP, name="shade")
    solver = solve(scene, photons=20_000, radius=0.2, light="best")
    solver.move("pane", Pose((0.1, 0.0, 0.4)))
    _, passes = slab([1.0])
    direct, levels = solver.frame_light.direct, solver.levels
    assert direct.is_known
    at = solver.model.transforms(solver.poses)
    p = solver.model.object_receivers.positions[: len(direct.per_lamp)]
    inside = (np.abs(p[:, 0] - 0.1) < 0.45) & (np.abs(p[:, 1]) < 0.45)
    outside = (np.abs(p[:, 0] - 0.1) > 0.55) | (np.abs(p[:, 1]) > 0.55)
    light = direct.at(at, levels)
    np.testing.assert_allclose(light[inside], np.tile(10 * passes[0], (inside.sum(), 1)), rtol=1e-5)
    np.testing.assert_allclose(light[outside], 10.0, rtol=1e-6)


@pytest.mark.parametrize("height", [0.5, 0.4999999])
def test_no_light_passes_a_pane_in_the_plane_of_a_wall(height):
    """By photons all light passed."""
    wall, pane = quad((-1, -1, 0.5), (2, 0, 0), (0, 2, 0)), quad((-0.5, -0.5, height), (1, 0, 0), (0, 1, 0), (1, 1), 1)
    floor = quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), (10, 10))
    sun = DirectionalLight("sun", (0.0, 0.0, -1.0), (10.0, 10.0, 10.0))
    scene = Scene(merge(floor, wall, pane), (grey(0.0, two_sided=True), glass()), (), (sun,), up=UP, name="plane")
    solver = solve(scene, photons=20_000, radius=0.1, light="photons")
    p = solver.receivers.positions
    below = (p[:, 2] < 0.1) & (np.abs(p[:, :2]).max(axis=1) < 0.9)
    assert below.any() and not solver.irradiance[below].any()
    above = (p[:, 2] > 0.4) & (solver.receivers.normals[:, 2] > 0)
    assert solver.irradiance[above].max() > 5.0


def test_opaque_faces_keep_their_rays_beside_panes():
    """Regions and contact see the scene without its panes; paths and pictures with them."""
    scene, *_ = glazed_room()
    mesh, keep = scene.static, scene.static.face_material != 4
    without = mesh._replace(faces=mesh.faces[keep], face_material=mesh.face_material[keep])
    model, bare = Model(scene), Model(replace(scene, static=without))
    rng = np.random.default_rng(1)
    d = rng.normal(size=(2000, 3)).astype(np.float32)
    d /= np.linalg.norm(d, axis=1)[:, None]
    rays = np.full((2000, 3), (2.0, 2.0, 1.5), np.float32), d, np.full(2000, 1e3, np.float32)
    t, face = model.accelerator.opaque.nearest(0, *rays)
    t_bare, face_bare = bare.accelerator.nearest(0, *rays)
    np.testing.assert_array_equal(t, t_bare)
    np.testing.assert_array_equal(face, face_bare)
    seen = model.accelerator.nearest(0, *rays)[1]
    assert (model.surfaces.pane[seen[seen >= 0]] >= 0).sum() > 100
