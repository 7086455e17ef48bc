"""Picking agrees with drawing."""

import numpy as np
import pytest

from app.draw.camera import Bounds, from_camera
from app.draw.draw_mesh import draw_meshes
from app.draw.picking import Picker
from gi_core.display.edges import NO_EDGES
from gi_core.geometry.surfaces import flatten
from gi_core.model import Model
from gi_core.scene import Camera, Material, Mesh, Mobile, Pose, Scene
from gi_core.scene.pose import axis_angle, rotation
from tests.support.gl_drawing import IDENTITY, SIZE, background
from tests.support.scene_builders import box


def picking_scene(two_sided=False) -> Scene:
    """A closed one-sided box seen from outside, with a mobile ball-like box within."""
    walls = box((-1,) * 3, (1,) * 3, 12, inward=True)
    inner = box((-0.2,) * 3, (0.2,) * 3, 3, 1)
    pose = Pose((0.3, 0.1, -0.2), axis_angle((0.3, 1, 0.2), 35))
    materials = (Material("wall", two_sided=two_sided), Material("block"))
    return Scene(walls, materials, (Mobile("block", inner, pose),))


@pytest.mark.parametrize("cull", [True, False])
@pytest.mark.parametrize("two_sided", [True, False])
def test_picking_equals_a_loop_over_all_triangles(cull, two_sided):
    scene = picking_scene(two_sided)
    surfaces, _ = flatten(scene)
    poses = [m.pose for m in scene.mobiles]
    picker = Picker(Model(scene))
    rng = np.random.default_rng(1)
    met = set()
    for _ in range(25):
        origin = rng.normal(size=3)
        origin *= 3 / np.linalg.norm(origin)
        direction = rng.normal(size=3) * 0.25 - origin / 3
        direction /= np.linalg.norm(direction)
        hit = picker.pick(origin, direction, poses, cull)
        expected = pick_naively(surfaces, origin, direction, poses, cull)
        assert (hit is None) == (expected is None)
        if hit is not None:
            assert hit.object == expected[1] and hit.distance == pytest.approx(expected[0])
            assert np.allclose(hit.point, origin + hit.distance * direction)
            met.add(hit.object)
    assert met == ({0, 1} if cull and not two_sided else {0}), "through a culled wall the mobile can be grabbed"


def pick_naively(surfaces, origin, direction, poses, cull):
    best = None
    for o in range(surfaces.objects):
        vertices = surfaces.vertices[o]
        if o:
            vertices = vertices @ rotation(poses[o - 1]).T + poses[o - 1].position
        a, b, c = np.moveaxis(vertices[surfaces.faces[o]], 1, 0)
        A = np.stack([a - b, a - c, np.broadcast_to(direction, a.shape)], axis=2)
        met = np.abs(np.linalg.det(A)) >= 1e-12
        if cull:
            two_sided = surfaces.two_sided[surfaces.first_face[o] :][: len(a)]
            met &= two_sided | (np.cross(b - a, c - a) @ direction <= 0)
        beta, gamma, t = np.linalg.solve(A[met], (a - origin)[met, :, None])[..., 0].T
        inside = (beta >= 0) & (gamma >= 0) & (beta + gamma <= 1) & (t > 0)
        if inside.any() and (best is None or t[inside].min() < best[0]):
            best = (t[inside].min(), o)
    return best


def test_picking_along_axes_and_in_an_empty_scene():
    scene = picking_scene()
    picker = Picker(Model(scene))
    for axis in np.vstack([np.eye(3), -np.eye(3)]):
        assert picker.pick(-3 * axis + 0.013, axis, [scene.mobiles[0].pose], True).distance > 2
    nothing = Scene(Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32), np.zeros(0, np.int32)), ())
    assert Picker(Model(nothing)).pick(np.zeros(3), np.array([0, 0, 1.0]), [], True) is None


@pytest.mark.gl
def test_picking_respects_culling(draw):
    """At pixel centres away from edges, the picked object's colour is the colour on the screen."""
    scene = picking_scene()
    surfaces, receivers = flatten(scene)
    meshes = draw_meshes(surfaces)
    paint = [np.float32((0.9, 0, 0)), np.float32((0, 0, 0.9))]
    objects = [
        (m._replace(edges=NO_EDGES), np.tile(c, (len(m.positions), 1)), np.zeros((len(m.positions), 3)))
        for m, c in zip(meshes, paint, strict=True)
    ]
    model = IDENTITY.copy()
    pose = scene.mobiles[0].pose
    model[:3, :3], model[:3, 3] = rotation(pose), pose.position
    camera = from_camera(Camera((2.5, 1.5, 3.5), (0, 0, 0), 40.0), (0, 1, 0), Bounds((-1, -1, -1), (1, 1, 1)))
    picture = draw(objects, [IDENTITY, model], camera=camera, tone_map="clip")
    picker = Picker(Model(scene))
    wrong = 0
    for y in range(1, SIZE[1], 5):
        for x in range(1, SIZE[0], 5):
            ray = camera.ray((x + 0.5) / SIZE[0], (y + 0.5) / SIZE[1], SIZE[0] / SIZE[1])
            hit = picker.pick(*ray, [pose], True)
            seen = picture[y, x].astype(int)
            drawn = None if np.array_equal(seen, background()) else int(seen[2] > seen[0])
            wrong += drawn != (None if hit is None else hit.object)
    assert wrong <= 2, "only where an edge runs through the pixel's centre"
