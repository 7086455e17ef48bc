"""Scenes far from the origin of their coordinates, as surveys are: the same light, and the file's coordinates."""

from dataclasses import replace

import numpy as np
import pytest

from app.draw.picking import Picker
from app.draw.shot import Shot
from app.measure.scene_info import info
from app.session.picture import metadata_of
from app.settings import Settings
from gi_core.files.load import load_scene
from gi_core.frames.frame import probe_irradiance
from gi_core.gather.reference import reference_irradiance
from gi_core.scene.origin import origin_of, translated
from gi_core.scene.types import Camera, Mobile, PointLight, Pose, Probe, Scene, SpotLight
from gi_core.solver import Solver
from tests.support.scene_builders import box, coloured_room, grey, solve

AWAY = [(1024.0, 0.0, 0.0), (500_000.0, -4_649_984.0, 256.0)]
POSES = {"block": Pose((0.375, 0.625, 0.25), (0.8, 0.0, 0.0, 0.6))}


def room(away=(0.0, 0.0, 0.0)) -> Scene:
    """A room about the origin, or `away` from it: walls, lamp, point and spot light, camera, probe and a block."""
    block = Mobile("block", box((-0.125, -0.125, -0.125), (0.125, 0.125, 0.125), 2), Pose((0.0, 0.25, -0.25)))
    scene = replace(
        coloured_room((block,)),
        probes=(Probe("p", (0.25, 0.25, 0.0), (0, 0, 1)),),
        camera=Camera((0.5, 0.125, 0.5), (0.5, 0.75, 0.25)),
    )
    centred = translated(replace(scene, mobiles=()), np.full(3, -0.5))
    return translated(replace(centred, mobiles=(block,)), np.asarray(away))


def moved(poses, away) -> dict[str, Pose]:
    return {name: p._replace(position=tuple(np.add(p.position, away) - 0.5)) for name, p in poses.items()}


def solved(scene: Scene, **settings) -> Solver:
    return solve(scene, photons=20_000, radius=0.1, **settings)


@pytest.mark.parametrize("away", AWAY)
def test_light_of_a_far_room_is_that_of_the_room_at_the_origin(away):
    here, there = solved(room(), light="best"), solved(room(away), light="best")
    for where, solver in ((np.zeros(3), here), (away, there)):
        solver.move_all(moved(POSES, where))
        assert solver.frame.changes.photons_cut > 100
    assert np.allclose(here.irradiance, there.irradiance, rtol=1e-6)
    assert np.array_equal(there.irradiance, there.from_scratch())
    assert there.frame.probe_irradiance["p"] == pytest.approx(here.frame.probe_irradiance["p"], rel=1e-6)
    on_faces = [probe_irradiance(s.model, s.irradiance, True)["p"] for s in (here, there)]
    assert on_faces[0] == pytest.approx(on_faces[1], rel=1e-6) and on_faces[0].min() > 0
    for name, pose in moved(POSES, away).items():
        assert there.poses[name] == pose
    assert np.allclose(there.receivers.positions, here.receivers.positions + away, atol=1e-9)
    given = there.receivers.positions[:5], there.receivers.normals[:5], 16, 1
    truth, _ = reference_irradiance(there.scene, *given, poses=there.poses)
    given = here.receivers.positions[:5], here.receivers.normals[:5], 16, 1
    assert np.allclose(truth, reference_irradiance(here.scene, *given, poses=here.poses)[0], rtol=1e-6)
    assert (there.chosen.low + 1e-6 >= np.subtract(away, 0.5)).all()


def test_a_mobile_whose_mesh_lies_far_from_its_own_origin():
    near = room()
    turned = Pose((0.0, 0.0, 0.0), (0.8, 0.0, 0.0, 0.6))
    far = np.array([4096.0, -2048.0, 0.0])
    (block,) = near.mobiles
    mesh = block.mesh._replace(vertices=block.mesh.vertices + far)
    R = np.array([(0.28, -0.96, 0.0), (0.96, 0.28, 0.0), (0.0, 0.0, 1.0)])
    start = turned._replace(position=tuple(np.subtract((0.0, 0.25, -0.25), R @ far)))
    here = solved(replace(near, mobiles=(block._replace(pose=turned._replace(position=(0.0, 0.25, -0.25))),)))
    there = solved(replace(near, mobiles=(Mobile("block", mesh, start),)))
    assert here.frame.changes.photons_cut > 100
    assert np.allclose(here.irradiance, there.irradiance, rtol=1e-4, atol=1e-4 * here.irradiance.max())


@pytest.mark.parametrize("away", AWAY)
def test_pictures_and_picks_of_a_far_room(away):
    shots = [Shot(solved(room(a), estimator="impact_count"), Settings(size=(48, 32))) for a in ((0, 0, 0), away)]
    near, far = (s.take() for s in shots)
    assert near.std() > 10 and np.array_equal(near, far)
    there = shots[1].solver
    assert metadata_of(shots[1])["camera"].startswith(f"position {away[0]:.15g},{away[1] - 0.375:.15g},")
    hits = []
    for shot in shots:
        s = shot.solver
        picker = Picker(s.model)
        rays = [shot.camera.ray(u, v, 1.5) for u in np.linspace(0.01, 0.98, 9) for v in np.linspace(0.03, 0.97, 9)]
        hits.append([picker.pick(*ray, list(s.poses.values()), True) for ray in rays])
    assert {h.object for h in hits[0]} == {0, 1}
    for a, b in zip(*hits, strict=True):
        assert (a.object, a.face) == (b.object, b.face) and np.allclose(b.point - away, a.point, atol=1e-8)
    assert there.model.vertices_at(0, there.poses).min(axis=0) == pytest.approx(np.subtract(away, 0.5))


@pytest.mark.parametrize("away", AWAY[1:])
def test_a_far_file_is_completed_and_printed_in_its_coordinates(away, tmp_path):
    """A mesh file alone: camera, lamp and refinement are added; nothing is refused, and all lies in the box."""
    scenes = []
    for name, by in (("near", np.zeros(3)), ("far", np.asarray(away))):
        mesh = box((-2, -2, -2), (2, 2, 2), 4, inward=True)
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in (mesh.vertices + by).tolist()]
        lines += [f"f {a} {b} {c}" for a, b, c in (mesh.faces + 1).tolist()]
        (tmp_path / f"{name}.obj").write_text("\n".join(lines))
        scenes.append(load_scene(tmp_path / f"{name}.obj", up="z"))
    near, far = scenes
    assert np.array_equal(far.static.vertices, near.static.vertices + away)
    assert np.array_equal(far.static.faces, near.static.faces)
    assert np.allclose(far.camera.position, np.add(near.camera.position, away))
    assert [n for n in far.notes if not any(c.isdigit() for c in n)] == [
        n for n in near.notes if not any(c.isdigit() for c in n)
    ]
    E = [solved(s, estimator="impact_count").irradiance for s in scenes]
    assert np.allclose(*E, rtol=1e-6) and E[0].max() > 0
    (line,) = [x for x in info(Settings(scene=str(tmp_path / "far.obj"), up="z", photons=1000)) if "  box" in x]
    assert "({:.0f}, {:.0f}, {:.0f}) to".format(*np.subtract(away, 2)) in line


def test_origins_are_exact_and_only_of_far_meshes():
    rng = np.random.default_rng(0)
    mesh = box((0, 0, 0), (1, 1, 1), 3)
    for size, away in [(1e-3, 1e3), (3.0, 5e5), (3.0, -4.6e6), (100.0, 1e7), (1e-6, 1e300), (0.0, 7.0)]:
        vertices = size * rng.random(mesh.vertices.shape) + away
        there = mesh._replace(vertices=vertices)
        o = origin_of(there)
        assert np.array_equal((vertices - o) + o, vertices)
        assert np.abs(vertices - o).max() <= max(2 * size, np.spacing(abs(away)))
    assert not origin_of(mesh._replace(vertices=mesh.vertices + 6)).any()
    assert not origin_of(mesh._replace(faces=mesh.faces[:0])).any()


def test_lights_of_every_kind_move_with_the_scene():
    scene = replace(
        room(), lights=(PointLight("p", (1, 2, 3), (1, 1, 1)), SpotLight("s", (0, 0, 1), (0, 0, -1), (1, 1, 1), 10, 20))
    )
    away = np.array([1e6, 0.0, -5.0])
    point, spot = translated(scene, away).lights
    assert point.position == (1e6 + 1, 2.0, -2.0) and spot.position == (1e6, 0.0, -4.0)
    assert spot.direction == (0, 0, -1) and translated(scene, np.zeros(3)) is scene
    assert grey(0.5) in translated(replace(scene, materials=(grey(0.5),)), away).materials
