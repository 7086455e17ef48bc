"""Something far away in the file leaves the light of a room as it is: a stray triangle, a sky dome."""

from dataclasses import replace

import numpy as np
import pytest

from app.commands.measure import measure
from app.settings import Settings
from gi_core.files.load import load_scene
from gi_core.scene import CalculationSurface
from gi_core.scene.origin import translated
from gi_core.scene.types import Mesh, Mobile, PointLight, Pose
from gi_core.solver import Solver
from tests.support.scene_builders import box, coloured_room, merge, solve, sphere

AWAY = 448e3  # [m]
FAR = {
    "stray": Mesh(AWAY + np.array([(0.0, 0, 0), (1, 0, 0), (0, 1, 0)]), np.array([(0, 1, 2)]), np.zeros(1, np.int32)),
    "dome": sphere((0, 0, 0), 1e4, 2),
}
POSES = {"block": Pose((0.35, 0.6, 0.3), (0.8, 0.0, 0.0, 0.6))}


def room():
    block = Mobile("block", box((-0.125, -0.125, -0.125), (0.125, 0.125, 0.125), 2), Pose((0.5, 0.5, 0.25)))
    scene = coloured_room((block,))
    return replace(scene, lights=(*scene.lights, PointLight("bulb", (0.3, 0.3, 0.8), (5.0, 5.0, 5.0))))


def by_place(solver: Solver) -> dict[tuple, np.ndarray]:
    """Return the light of receivers by object, place and normal: numbers change with what else is in the file."""
    r, first = solver.model.object_receivers, solver.surfaces.first_receiver
    of = np.searchsorted(first[1:], np.arange(len(r.areas)), side="right")
    keys = zip(of.tolist(), np.round(r.positions, 6).tolist(), np.round(r.normals, 6).tolist(), strict=True)
    rows = [k for k in range(len(of)) if not solver.model.first_probe <= k < first[1]]
    keys = [(o, *p, *n) for o, p, n in keys]
    return {keys[k]: solver.irradiance[k] for k in rows}


@pytest.mark.parametrize("light", ["photons", "best"])
@pytest.mark.parametrize("estimator", ["tangent_plane", "impact_count", "photon_map"])
def test_light_stays_bit_for_bit(estimator, light):
    lit = []
    for scene in (room(), *(replace(room(), static=merge(room().static, mesh)) for mesh in FAR.values())):
        solver = solve(scene, photons=10_000, radius=0.1, estimator=estimator, light=light)
        solver.move_all(POSES)
        assert solver.frame.changes.photons_cut > 100
        assert np.array_equal(solver.irradiance, solver.from_scratch())
        lit.append(by_place(solver))
    alone, *others = lit
    assert len(alone) > 100 and sum(E.sum() for E in alone.values()) > 0
    for other in others:
        assert all(np.array_equal(E, other[key]) for key, E in alone.items())


LAMP = """
up = "y"
units = "photometric"
[static]
mesh = "floor.obj"
max_edge = 1
[[light]]
type = "point"
name = "bulb"
position = [0, 2, 0]
flux = [4000, 4000, 4000]
"""


def test_a_measured_point_under_a_lamp(tmp_path):
    """4,000 lm / 4 pi / 1.25^2 = 203.7 lx, whatever else the file holds."""
    corners = [(-5, 0, -5), (5, 0, -5), (5, 0, 5), (-5, 0, 5)]
    stray = [(AWAY, 0, 0), (AWAY + 1, 0, 0), (AWAY, 0, 1)]
    lines = [f"v {x} {y} {z}" for x, y, z in (*corners, *stray)]
    (tmp_path / "floor.obj").write_text("\n".join([*lines, "f 4 3 2 1", "f 5 7 6"]))
    (tmp_path / "scene.toml").write_text(LAMP)
    surface = CalculationSurface("a", "", (0.0, 0.0), (0.02, 0.02), 0.75, points=(1, 1))
    lines = measure(Settings(scene=str(tmp_path / "scene.toml"), surfaces=(surface,)), 0.01)
    assert any(line.split()[:2] == ["mean", "203.7"] for line in lines)


def test_a_surveyed_room_with_a_triangle_at_the_origin_of_the_file():
    """float32 keeps the room's digits near the shifted origin, which follows the room and not the box of all."""
    away = np.array((500_000.0, -4_649_984.0, 256.0))
    near, far = room(), translated(replace(room(), mobiles=()), away)
    stray = FAR["stray"]._replace(vertices=FAR["stray"].vertices - AWAY)
    lit = []
    for scene, shift in ((replace(near, mobiles=()), 0.0), (replace(far, static=merge(far.static, stray)), away)):
        solver = solve(scene, photons=10_000, radius=0.1, estimator="impact_count", light="photons")
        places = np.round(solver.receivers.positions - shift, 6).tolist()
        normals = np.round(solver.receivers.normals, 6).tolist()
        lit.append({(*p, *n): E for p, n, E in zip(places, normals, solver.irradiance, strict=True)})
    alone, there = lit
    total = sum(E.sum() for E in alone.values())
    assert sum(np.abs(E - there[key]).sum() for key, E in alone.items()) < 1e-3 * total


def test_a_room_without_light_gets_its_lamp_and_camera(tmp_path):
    """A stray triangle once put a lamp 358 km wide above the scene, and the camera 682 km away."""
    walls, desk = box((-2, -2, -1), (2, 2, 1.6), 1, inward=True), box((-0.6, -0.4, -1), (0.6, 0.4, -0.3), 1)
    scenes = []
    for name, mesh in (("room", merge(walls, desk)), ("stray", merge(walls, desk, FAR["stray"]))):
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
        lines += [f"f {a} {b} {c}" for a, b, c in (mesh.faces + 1).tolist()]
        (tmp_path / f"{name}.obj").write_text("\n".join(lines))
        scenes.append(load_scene(tmp_path / f"{name}.obj", up="z"))
    lamps = [[note for note in scene.notes if "lamp" in note] for scene in scenes]
    assert lamps[0] == lamps[1] and "below the ceiling" in lamps[0][0]
    for scene in scenes:
        assert np.abs(scene.camera.position).max() < 2
        assert len(scene.static.faces) > 600
