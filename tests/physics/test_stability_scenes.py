"""Stability of the program: odd numbers of photons, scales, places, meshes, lights, mobiles; many moves; thin gaps.

The first line of each test names the failure. Numbers predicted by theory are tested in test_stability_atlas.py.
"""

import numpy as np
import pytest

from gi_core.discs.region import EXTENSION
from gi_core.files.load import load_scene
from gi_core.scene.pose import axis_angle
from gi_core.scene.types import DirectionalLight, Mesh, Mobile, PointLight, Pose, Scene
from gi_core.solver import Solver
from tests.support.scene_builders import (
    box,
    box_mobile,
    floor,
    furnace_scene,
    grey,
    lamp,
    merge,
    plane_scene,
    quad,
    solve,
)

UP = (0.0, 0.0, 1.0)


def solved(scene: Scene, photons: int = 2000, poses=None, **setting) -> Solver:
    solver = solve(scene, photons=photons, **{"radius": 0.1, "neighbours": 20, **setting})
    if poses:
        solver.move_all(poses)
    return solver


def assert_sound(solver: Solver) -> None:
    """Finite, nothing negative, every photon accounted for."""
    assert np.isfinite(solver.irradiance).all()
    assert (solver.irradiance >= 0).all()
    fates = solver.frame.fates
    gone = fates["absorbed"] + fates["escaped"] + fates["truncated"]
    assert gone == pytest.approx(fates["emitted"], rel=1e-12)
    for part in fates.values():
        assert (part >= 0).all()


def room(*mobiles: Mobile, lights=(), more=()) -> Scene:
    """A closed white room of 1 m with a lamp below its ceiling."""
    walls = merge(box((0, 0, 0), (1, 1, 1), 6, 0, inward=True), quad((0.4, 0.4, 0.99), (0, 0.2, 0), (0.2, 0, 0)), *more)
    walls = walls._replace(face_material=np.where(np.arange(len(walls.faces)) // 2 == 6 * 36, 1, walls.face_material))
    return Scene(walls, (grey(0.7), lamp(10.0), grey(0.5, two_sided=True)), mobiles, lights, up=UP, name="room")


@pytest.mark.parametrize("photons", [0, 1])
def test_zero_photons_and_one_photon(photons, estimator):
    """Zeros, or one photon's light, without a warning."""
    solver = solved(room(box_mobile("a")), photons, estimator=estimator)
    solver.move("a", Pose((0.5, 0.5, 0.5)))
    assert_sound(solver)
    assert photons or not solver.irradiance.any()


def test_more_neighbours_than_photons():
    """All hits within the radius are taken, over its whole circle."""
    solver = solved(plane_scene(DirectionalLight("sun", (0, 0, -1), (1.0,) * 3)), 500, neighbours=1000,
                    radius=0.5, estimator="photon_map")  # fmt: skip
    assert_sound(solver)
    middle = np.abs(solver.receivers.positions).max(axis=1) < 0.4
    assert solver.irradiance[middle, 0].mean() == pytest.approx(1.0, rel=0.05)


@pytest.mark.parametrize("lights", [(), (PointLight("off", (0, 0, 1), (0.0, 0.0, 0.0)),)])
def test_zero_flux_and_no_lights(lights, estimator):
    scene = plane_scene(*lights, reflectance=0.5, mobiles=(box_mobile("a"),))
    solver = solved(scene, 100, {"a": Pose((0, 0, 0.5))}, estimator=estimator)
    assert_sound(solver)
    assert not solver.irradiance.any()


def test_light_of_one_channel_leaves_the_others_at_zero(estimator):
    solver = solved(plane_scene(PointLight("red", (0, 0, 1), (5.0, 0.0, 0.0)), reflectance=0.5), estimator=estimator)
    assert_sound(solver)
    assert solver.irradiance[:, 0].any() and not solver.irradiance[:, 1:].any()


def test_a_black_room(estimator):
    """All flux is absorbed at its first hit; nothing is reflected, and there is no warning."""
    scene = furnace_scene(1.0, 0.0, 4)
    solver = solved(scene, estimator=estimator)
    assert_sound(solver)
    assert solver.frame.fates["absorbed"] == pytest.approx(solver.frame.fates["emitted"], rel=1e-9)
    assert solver.frame.segments == solver.frame.photons


@pytest.mark.parametrize("factor", [2.0**-10, 2.0**10])
def test_scaled_by_a_power_of_two_the_picture_is_the_same(factor, estimator):
    """Lengths times s, flux times s^2: the same irradiance; powers of two keep float32's bits."""
    one = solved(furnace_scene(1.0, 0.5, 4), estimator=estimator)
    mesh = furnace_scene(1.0, 0.5, 4).static
    scene = Scene(mesh._replace(vertices=mesh.vertices * factor), (lamp(1.0, 0.5),), up=UP)
    scaled = solved(scene, estimator=estimator, radius=0.1 * factor)
    np.testing.assert_allclose(scaled.irradiance, one.irradiance, rtol=1e-5)


def written(folder, vertices, faces, name="a.obj", extra=()):
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
    (folder / name).write_text("\n".join([*lines, *extra]) + "\n")
    return folder / name


CUBE = box((0, 0, 0), (1, 1, 1), 1)


def soup(mesh: Mesh):
    return mesh.vertices[mesh.faces].reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3)


MESHES = {
    "one triangle": ([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)]),
    "an open mesh": (floor(2.0, 3).vertices, floor(2.0, 3).faces),
    "an unwelded soup": soup(CUBE),
    "an inverted body": (CUBE.vertices, CUBE.faces[:, ::-1]),
    "half its faces inverted": (CUBE.vertices, np.where(np.arange(12)[:, None] % 2, CUBE.faces, CUBE.faces[:, ::-1])),
    "three faces on an edge": (
        [(0, 0, 0), (0, 0, 1), (1, 0, 0), (-1, 1, 0), (-1, -1, 0)],
        [(0, 1, 2), (0, 1, 3), (0, 1, 4)],
    ),
    "two tetrahedra that share a vertex": (
        [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (-1, 0, 0), (0, -1, 0), (0, 0, -1)],
        [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3), (0, 4, 5), (0, 6, 4), (0, 5, 6), (4, 6, 5)],
    ),
    "a zero, a needle and a duplicate among good faces": (
        [*CUBE.vertices, (0.5, 0.5, 1), (0.5, 0.5 + 1e-12, 1)],
        [*CUBE.faces.tolist(), (0, 0, 1), (0, 24, 25), CUBE.faces[0].tolist(), CUBE.faces[1, ::-1].tolist()],
    ),
}


@pytest.mark.parametrize("name", MESHES)
def test_odd_meshes_load_and_light(name, tmp_path, estimator):
    """A file without light gets a default light; then every remaining face gets sound light."""
    vertices, faces = MESHES[name]
    scene = load_scene(written(tmp_path, vertices, faces), max_edge=0.5)
    solver = solved(scene, 3000, estimator=estimator)
    assert_sound(solver)
    assert solver.irradiance.any()
    assert np.isfinite(solver.receivers.normals).all()


def test_zero_normals_in_a_file(tmp_path):
    normals = ["vn 0 0 0", "f 1//1 2//1 4//1"]
    scene = load_scene(written(tmp_path, CUBE.vertices, CUBE.faces, extra=normals), max_edge=0.5)
    solver = solved(scene, 1000)
    assert_sound(solver)
    assert np.linalg.norm(solver.receivers.normals, axis=1) == pytest.approx(1.0)


def test_tiny_bright_lamp_just_above_the_floor(estimator):
    """Its light all lands within a millimetre: one receiver's kernel holds it, and is finite."""
    for height in (1e-2, 1e-4, 1e-6):
        scene = plane_scene(PointLight("spark", (0.01, 0.02, height), (1e6,) * 3), reflectance=0.5)
        solver = solved(scene, estimator=estimator)
        assert_sound(solver)
        arrived = solver.irradiance[:, 0] @ solver.receivers.areas
        # Half of it goes down. A photon map and discs give it to those within reach, faces to their corners.
        assert arrived > 0 or estimator != "impact_count"
        if estimator == "impact_count":
            assert arrived == pytest.approx(0.5e6, rel=0.1)


def test_light_inside_a_mobile(estimator):
    """A closed black box over a bulb leaves the room exactly dark; without it the light returns, bit for bit."""
    cover = Mobile("cover", box((-0.1,) * 3, (0.1,) * 3, 2, 0), Pose((0.5, 0.5, 5.0)))
    walls = box((0, 0, 0), (1, 1, 1), 6, 0, inward=True)
    lights = (PointLight("bulb", (0.5, 0.5, 0.5), (10.0,) * 3),)
    scene = Scene(walls, (grey(0.7, two_sided=True),), (cover,), lights, up=UP, name="room")
    solver = solved(scene, estimator=estimator)
    static = solver.surfaces.receiver_range(0)
    begun = solver.irradiance.copy()
    assert begun[static].max() > 0
    solver.move("cover", Pose((0.5, 0.5, 0.5)))
    assert_sound(solver)
    assert not solver.irradiance[static].any()
    assert np.array_equal(solver.irradiance, solver.from_scratch())
    solver.move("cover", Pose((0.5, 0.5, 5.0)))
    assert np.array_equal(solver.irradiance, begun)


def test_a_mobile_laid_over_the_lamp(estimator):
    """It touches the lamp's own faces: light is reflected in the gap, and hardly any escapes or passes through."""
    plate = Mobile("plate", box((-0.15, -0.15, -0.01), (0.15, 0.15, 0.0), 2, 0), Pose((0.5, 0.5, 0.5)))
    solver = solved(room(plate), estimator=estimator)
    static = solver.surfaces.receiver_range(0)
    below = np.flatnonzero(solver.receivers.positions[static, 2] < 0.9)
    open_ = solver.irradiance[below].mean()
    for height in (0.9899, 0.99 - 1e-6, 0.99, 0.99 + 1e-6, 0.991):
        solver.move("plate", Pose((0.5, 0.5, height)))
        assert_sound(solver)
        assert np.array_equal(solver.irradiance, solver.from_scratch())
        # In a gap narrower than rays are lifted off faces (4 um here) reflected photons begin behind the lamp: 1 %.
        assert solver.irradiance[below].mean() < 0.02 * open_, height


ODD = {
    "standing exactly on the floor": Pose((0.5, 0.5, 0.1)),
    "a hair above it": Pose((0.5, 0.5, 0.1 + 1e-7)),
    "flush with two walls": Pose((0.1, 0.1, 0.1)),
    "half in the wall": Pose((0.0, 0.5, 0.5)),
    "half in a corner, turned": Pose((1.0, 1.0, 1.0), axis_angle((1, 2, 3), 40)),
    "on the lamp's plane": Pose((0.5, 0.5, 0.89)),
    "outside": Pose((3.0, 0.5, 0.5)),
    "far away": Pose((1e7, -1e7, 1e7)),
}


@pytest.mark.parametrize("where", ODD)
def test_mobile_touching_crossing_or_leaving_the_room(where, estimator):
    """No NaN, no lost flux, the same bits as from scratch."""
    solver = solved(room(box_mobile("a"), box_mobile("b", 0.1)), estimator=estimator)
    solver.move_all({"a": ODD[where], "b": ODD[where]})  # and the smaller is swallowed by the larger
    assert_sound(solver)
    assert np.array_equal(solver.irradiance, solver.from_scratch())
    if where in ("outside", "far away"):
        on_mobiles = solver.irradiance[solver.surfaces.receiver_range(0).stop :]
        assert not on_mobiles.any()
        assert solver.frame.changes.photons_cut == 0


def test_no_light_under_a_box_on_the_floor(estimator):
    """Neither leak nor acne: well inside the footprint it is exactly dark; around it no receiver is black."""
    block = Mobile("block", box((-0.25, -0.25, 0), (0.25, 0.25, 0.4), 4, 0), Pose((0.5, 0.5, 0.0)))
    solver = solved(room(block), 40_000, estimator=estimator, radius=0.08)
    p, n = solver.receivers.positions, solver.receivers.normals
    static = np.arange(len(p)) < solver.surfaces.receiver_range(0).stop
    ground = static & (p[:, 2] == 0) & (n[:, 2] > 0.9)
    off = np.abs(p[:, :2] - 0.5).max(axis=1)
    assert (ground & (off < 0.16)).any() and not solver.irradiance[ground & (off < 0.16)].any()
    beside = solver.irradiance[ground & (off > 0.26), 0]
    assert len(beside) > 20 and beside.min() > 0.1 * beside.mean()
    # Its sides do not darken towards the floor that they touch by more than the floor's own share of their view.
    side = ~static & (np.abs(n[:, 2]) < 0.1)
    low, high = side & (p[:, 2] < 1e-9), side & (np.abs(p[:, 2] - 0.2) < 1e-9)
    assert solver.irradiance[low, 0].mean() > 0.2 * solver.irradiance[high, 0].mean() > 0


def test_tiny_move_changes_at_most_the_flux_of_cut_photons():
    """Photons with uncut paths before and after add the same light; only cut photons can change it.

    Each adds at most its flux per segment.
    """
    solver = solved(room(box_mobile("a")), 20_000, estimator="impact_count")
    a_photon = float(solver.frame.fates["emitted"][0]) / solver.frame.photons
    solver.move("a", Pose((0.5, 0.5, 0.4)))
    for step in (1e-7, 1e-5, 1e-3):
        before, old = solver.irradiance.copy(), solver.frame.changes
        solver.move("a", Pose((0.5 + step, 0.5, 0.4)))
        static = solver.surfaces.receiver_range(0)
        areas = solver.receivers.areas[static]
        moved = np.abs(solver.irradiance[static, 0] - before[static, 0]) @ areas
        new = solver.frame.changes
        bound = a_photon * (old.old_segments + old.new_segments + new.old_segments + new.new_segments)
        assert moved <= bound
        if step == 1e-7:
            assert moved < 1e-3 * solver.frame.fates["emitted"][0]  # none or a photon or two


@pytest.mark.parametrize("gap", [0.0005, 0.002, 0.02])
def test_a_floor_close_under_a_lamp_has_all_of_its_light(gap):
    above = quad((-2, -2, gap), (0, 4, 0), (4, 0, 0), (1, 1), 1)
    scene = Scene(merge(floor(20.0, 40), above), (grey(0.0), lamp(5.0)), up=(0.0, 0.0, 1.0), name="gap")
    solver = Solver(scene, photons=100_000, radius=0.3)
    assert EXTENSION * 0.3 > 0.002
    solver.solve()
    p = solver.receivers.positions
    under = (np.abs(p[:, :2]).max(axis=1) < 1.2) & (solver.receivers.normals[:, 2] > 0.5) & (p[:, 2] == 0)
    assert under.sum() >= 9
    assert solver.irradiance[under].mean() == pytest.approx(np.pi * 5.0, rel=0.03)
