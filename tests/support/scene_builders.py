"""Tiny analytic scenes from numpy arrays: quads, boxes, spheres, and rooms with closed-form answers."""

from dataclasses import replace

import numpy as np

from gi_core.scene.types import (
    Camera,
    DirectionalLight,
    Material,
    Mesh,
    Mobile,
    PointLight,
    Pose,
    Scene,
    SkyLight,
    SpotLight,
)
from gi_core.solver import Solver

BLACK = Material("black", (0.0, 0.0, 0.0))


def grey(reflectance: float, two_sided: bool = False, emission: float = 0.0) -> Material:
    """Return a colourless material."""
    return Material(f"grey {reflectance}", (reflectance,) * 3, (emission,) * 3, two_sided)


def lamp(radiance: float, reflectance: float = 0.0) -> Material:
    """Return a material that emits from its front."""
    return Material("lamp", (reflectance,) * 3, (radiance,) * 3)


def quad(corner, u, v, divisions=(1, 1), material: int = 0) -> Mesh:
    """Return the parallelogram corner + [0, 1] u + [0, 1] v; its front is the side of u x v."""
    nu, nv = divisions
    s, t = np.meshgrid(np.linspace(0, 1, nu + 1), np.linspace(0, 1, nv + 1), indexing="ij")
    points = np.asarray(corner, float) + s[..., None] * np.asarray(u, float) + t[..., None] * np.asarray(v, float)
    i, j = np.meshgrid(np.arange(nu), np.arange(nv), indexing="ij")
    a = (i * (nv + 1) + j).reshape(-1)
    b, c, d = a + nv + 1, a + nv + 2, a + 1
    # Diagonals alternate, so that no direction is preferred.
    even = ((i + j) % 2 == 0).reshape(-1)[:, None, None]
    faces = np.where(
        even,
        np.stack([np.stack([a, b, c], 1), np.stack([a, c, d], 1)], 1),
        np.stack([np.stack([a, b, d], 1), np.stack([b, c, d], 1)], 1),
    ).reshape(-1, 3)
    return Mesh(points.reshape(-1, 3), faces.astype(np.int32), np.full(len(faces), material, np.int32))


def merge(*meshes: Mesh) -> Mesh:
    """Return one mesh of several; materials keep their numbers."""
    first = np.cumsum([0, *(len(m.vertices) for m in meshes[:-1])])
    return Mesh(
        np.concatenate([m.vertices for m in meshes]),
        np.concatenate([m.faces + np.int32(k) for m, k in zip(meshes, first, strict=True)]).astype(np.int32),
        np.concatenate([m.face_material for m in meshes]),
    )


def box(low, high, divisions: int = 1, material: int = 0, inward: bool = False) -> Mesh:
    """Return a closed box with its front outside, or inside (a room)."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    sides = []
    for axis in range(3):
        u, v = np.zeros(3), np.zeros(3)
        u[(axis + 1) % 3] = high[(axis + 1) % 3] - low[(axis + 1) % 3]
        v[(axis + 2) % 3] = high[(axis + 2) % 3] - low[(axis + 2) % 3]
        top = low.copy()
        top[axis] = high[axis]
        for corner, outward in ((top, True), (low, False)):
            a, b = (u, v) if outward != inward else (v, u)
            sides.append(quad(corner, a, b, (divisions, divisions), material))
    return merge(*sides)


def sphere(centre, radius: float, subdivisions: int = 3, material: int = 0) -> Mesh:
    """Return an icosphere: 20 * 4^subdivisions nearly equal faces, vertices on the sphere, front outside."""
    g = (1 + 5**0.5) / 2
    v = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g)]
    v += [(0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]
    f = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6)]
    f += [(7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10)]
    f += [(8, 6, 7), (9, 8, 1)]
    points, faces = np.array(v, float), np.array(f)
    for _ in range(subdivisions):
        ends = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        edges, which = np.unique(ends, axis=0, return_inverse=True)
        m = len(points) + which.reshape(-1, 3)
        points = np.concatenate([points, points[edges].mean(axis=1)])
        a, b, c = faces.T
        faces = np.concatenate(
            [np.stack(t, 1) for t in ((a, m[:, 0], m[:, 2]), (b, m[:, 1], m[:, 0]), (c, m[:, 2], m[:, 1]), tuple(m.T))]
        )
    points = points / np.linalg.norm(points, axis=1)[:, None]
    return Mesh(
        points * radius + np.asarray(centre, float), faces.astype(np.int32), np.full(len(faces), material, np.int32)
    )


def floor(size: float = 2.0, divisions: int = 8, material: int = 0, centre=(0.0, 0.0, 0.0)) -> Mesh:
    """Return a square in the plane z = centre z, facing up."""
    corner = np.asarray(centre, float) - (size / 2, size / 2, 0)
    return quad(corner, (size, 0, 0), (0, size, 0), (divisions, divisions), material)


def plane_scene(*lights, reflectance: float = 0.0, size: float = 2.0, divisions: int = 8, mobiles=()) -> Scene:
    """A square floor at z = 0, facing up, under given lights; +z is up. Nothing bounces back to it."""
    return Scene(floor(size, divisions), (grey(reflectance),), mobiles, lights, up=(0.0, 0.0, 1.0), name="plane")


def lamp_over_floor(radiance: float = 10.0, width: float = 1.0, height: float = 1.0, divisions: int = 8) -> Scene:
    """A black floor [-1, 1]^2 under a parallel square lamp that faces down: parallel rectangles."""
    w = width
    light = quad((-w / 2, -w / 2, height), (0, w, 0), (w, 0, 0), (1, 1), 1)
    return Scene(
        merge(floor(2.0, divisions), light), (BLACK, lamp(radiance)), up=(0.0, 0.0, 1.0), name="parallel rectangles"
    )


def furnace_scene(radiance: float = 1.0, reflectance: float = 0.5, divisions: int = 8, mobiles=()) -> Scene:
    """A closed unit room with walls that emit and reflect: E = pi Le / (1 - rho) everywhere."""
    walls = box((0, 0, 0), (1, 1, 1), divisions, inward=True)
    return Scene(walls, (lamp(radiance, reflectance),), mobiles, up=(0.0, 0.0, 1.0), name="furnace")


def corner_scene(radiance: float = 1.0, extent: float = 1.0, divisions: int = 4, reflectance: float = 0.0) -> Scene:
    """A black floor z = 0 that meets an emitting wall x = 0 in an edge; the wall faces +x."""
    ground = quad((0, -extent / 2, 0), (extent, 0, 0), (0, extent, 0), (divisions, divisions), 0)
    wall = quad((0, -extent / 2, 0), (0, extent, 0), (0, 0, extent), (divisions, divisions), 1)
    return Scene(
        merge(ground, wall),
        (grey(reflectance), lamp(radiance, reflectance)),
        up=(0.0, 0.0, 1.0),
        name="two-wall corner",
    )


def sphere_scene(*lights, reflectance: float = 0.5, radius: float = 1.0, subdivisions: int = 3) -> Scene:
    """A two-sided sphere about the origin in the open."""
    return Scene(
        sphere((0, 0, 0), radius, subdivisions),
        (grey(reflectance, two_sided=True),),
        (),
        lights,
        up=(0.0, 0.0, 1.0),
        name="sphere",
    )


def box_mobile(name: str = "box", size: float = 0.2, material: int = 0) -> Mobile:
    """A small box about its own origin."""
    h = size / 2
    return Mobile(name, box((-h, -h, -h), (h, h, h), 2, material))


def coloured_room(mobiles=(), grid=2):
    """A room of coloured walls of grid x grid squares, small lamp, point light inside, two-sided shelf."""
    room = box((0, 0, 0), (1, 1, 1), grid, 0, inward=True)
    panel = quad((0.4, 0.4, 0.95), (0, 0.3, 0), (0.2, 0, 0), (1, 1), 1)
    shelf = quad((0.6, 0.1, 0.5), (0.3, 0, 0.1), (0, 0.6, 0), (1, 1), 2)
    wall = grey(0.6)._replace(reflectance=(0.8, 0.5, 0.2))
    materials = (wall, lamp(8.0, 0.5), grey(0.7, two_sided=True))
    lights = (
        PointLight("p", (0.2, 0.8, 0.4), (1.0, 2.0, 0.5)),
        SpotLight("s", (0.5, 0.5, 0.9), (1, 0, -1), (1.0,) * 3, 10.0, 40.0),
    )
    return Scene(merge(room, panel, shelf), materials, mobiles, lights, up=(0.0, 0.0, 1.0), name="room")


def fine_room(mobiles=()) -> Scene:
    """A room with a lamp, a bulb, and many receivers on the walls."""
    lit = quad((0.4, 0.4, 0.95), (0, 0.3, 0), (0.2, 0, 0), (2, 2), 1)
    materials = grey(0.6)._replace(reflectance=(0.8, 0.5, 0.2)), lamp(8.0, 0.5)
    lights = (PointLight("p", (0.2, 0.8, 0.4), (1.0, 2.0, 0.5)),)
    walls = box((0, 0, 0), (1, 1, 1), 12, 0, inward=True)
    return Scene(merge(walls, lit), materials, mobiles, lights, up=(0, 0, 1))


ROOM_POINTS = (
    np.array([(0.5, 0.5, 0), (0.02, 0.5, 0), (0, 0.3, 0.6), (0.75, 0.4, 0.55 + 1e-6), (0.75, 0.4, 0.55 - 1e-6)]),
    np.array([(0, 0, 1), (0, 0, 1), (1, 0, 0), (-0.316227766, 0, 0.948683298), (0.316227766, 0, -0.948683298)]),
)


def classroom(spacing: float = 0.25) -> Scene:
    """Return a closed room of 8 x 3 x 6 m, lit through one window of 2 x 1.2 m in a frame 0.4 m deep, with desks.

    The window's light is an emissive portal at the outer end of the frame. spacing [m]: of the receivers.
    """

    def side(corner, u, v, material=0, fine=spacing):
        divisions = tuple(max(1, round(float(np.linalg.norm(w)) / fine)) for w in (u, v))
        return quad(corner, u, v, divisions, material)

    x, y, z, low, high, left, right, deep = 8.0, 3.0, 6.0, 0.9, 2.1, 3.0, 5.0, 0.4
    parts = [
        side((0, 0, 0), (0, 0, z), (x, 0, 0), 1),  # floor
        side((0, y, 0), (x, 0, 0), (0, 0, z)),  # ceiling
        side((0, 0, 0), (0, y, 0), (0, 0, z)),
        side((x, 0, 0), (0, 0, z), (0, y, 0)),
        side((0, 0, z), (0, y, 0), (x, 0, 0)),
        side((0, 0, 0), (x, 0, 0), (0, low, 0)),  # the window's wall, in four parts
        side((0, high, 0), (x, 0, 0), (0, y - high, 0)),
        side((0, low, 0), (left, 0, 0), (0, high - low, 0)),
        side((right, low, 0), (x - right, 0, 0), (0, high - low, 0)),
        side((left, low, -deep), (0, 0, deep), (right - left, 0, 0), 0, 0.1),  # its frame
        side((left, high, -deep), (right - left, 0, 0), (0, 0, deep), 0, 0.1),
        side((left, low, -deep), (0, high - low, 0), (0, 0, deep), 0, 0.1),
        side((right, low, -deep), (0, 0, deep), (0, high - low, 0), 0, 0.1),
        side((left, low, -deep), (right - left, 0, 0), (0, high - low, 0), 2),
    ]
    for row in range(2):
        for column in range(3):
            at = np.array((1.2 + 2.2 * column, 0.0, 2.0 + 2.0 * row))
            parts.append(box(at + (0, 0.68, 0), at + (1.2, 0.72, 0.6), 4, 1))
            parts += [box(at + (dx, 0, 0.1), at + (dx + 0.06, 0.68, 0.5), 3, 1) for dx in (0.05, 1.09)]
    return Scene(merge(*parts), (grey(0.75), grey(0.35), lamp(20.0)), name="classroom")


def sunny_room(spacing: float = 0.15, glow: float = 2.5) -> Scene:
    """Return a room of 6 x 2.7 x 4 m with an open window, sun through it on the floor, a sky, and a box to move.

    spacing [m]: of the receivers; glow [W/m2/sr]: of the sky.
    """
    x, y, z, low, high, left, right = 6.0, 2.7, 4.0, 0.8, 2.2, 1.2, 2.8

    def side(corner, u, v, material=0):
        return quad(corner, u, v, tuple(max(1, round(float(np.linalg.norm(w)) / spacing)) for w in (u, v)), material)

    walls = merge(
        side((0, 0, 0), (0, 0, z), (x, 0, 0), 1),  # floor
        side((0, y, 0), (x, 0, 0), (0, 0, z)),  # ceiling
        side((0, 0, 0), (0, y, 0), (0, 0, z)),
        side((0, 0, 0), (x, 0, 0), (0, y, 0)),
        side((0, 0, z), (0, y, 0), (x, 0, 0)),
        side((x, 0, 0), (0, 0, z), (0, low, 0)),  # the window's wall, in four parts
        side((x, high, 0), (0, 0, z), (0, y - high, 0)),
        side((x, low, 0), (0, 0, left), (0, high - low, 0)),
        side((x, low, right), (0, 0, z - right), (0, high - low, 0)),
    )
    sun = DirectionalLight("sun", (-0.75, -0.6, -0.15), (60.0, 56.0, 48.0))
    materials = Material("wall", (0.6, 0.58, 0.55)), Material("floor", (0.25, 0.15, 0.08))
    thing = Mobile("box", box((-0.25, 0, -0.25), (0.25, 0.5, 0.25), 10, 0), Pose((2.2, 0.3, 2.0)))
    sky = SkyLight("sky", (0.8 * glow, glow, 1.3 * glow))
    return Scene(walls, materials, (thing,), (sun, sky), name="sunny room")


def sunny_house(spacing: float = 0.8) -> Scene:
    """Return the sunny room with sunlit ground outside, five times its area, and the camera inside."""
    scene = sunny_room(spacing)
    ground = quad((7.0, 0, -5.0), (0, 0, 14.0), (14.0, 0, 0), (10, 10), 1)
    camera = Camera((0.5, 1.6, 3.7), (3.6, 0.7, 1.0), 65.0)
    return replace(scene, static=merge(scene.static, ground), camera=camera)


def complete(solver: Solver) -> Solver:
    """Complete a solver's light and return it."""
    solver.solve()
    return solver


def gathered(solver: Solver) -> Solver:
    """Return a solver, once its frames take gathered light of the static part."""
    for _ in solver.gather_steps():
        if solver.frame_light.is_gathered:
            solver.move_all({})
            return solver
    raise AssertionError("photons have less error")


def solve(scene: Scene, *arguments, **settings) -> Solver:
    """Return a solver whose light is complete."""
    return complete(Solver(scene, *arguments, **settings))
