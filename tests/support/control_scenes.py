"""Small scenes with artifacts of discs, and their affected receivers.

Each is about a metre wide, has its faces finer than the discs where it matters, and is lit so that
irradiance hardly changes over a disc. Any error comes from the disc's shape.
"""

from typing import NamedTuple

import numpy as np

from gi_core.geometry.surfaces import Surfaces
from gi_core.scene.types import Material, Mesh, Mobile, PointLight, Pose, Scene
from tests.support.scene_builders import BLACK, box, grey, lamp, merge, quad, sphere

WHITE = Material("white", (0.99999,) * 3)  # 1 is not allowed
UP = (0.0, 0.0, 1.0)
RADIUS = 0.01  # 1 % of the scene's size


class ControlScene(NamedTuple):
    """A scene with points where control matters, and unobstructed points."""

    scene: Scene
    radius: float
    photons: int  # enough for a noise of some 10 % at one receiver in the open
    affected: object  # (positions, normals) in the world -> (R,) bool
    open: object


def fine_quad(corner, u, v, fine_u, fine_v, material: int = 0) -> Mesh:
    """Return the parallelogram corner + [0, 1] u + [0, 1] v with its grid lines at given shares of u and v."""
    grid = quad((0, 0, 0), (1, 0, 0), (0, 1, 0), (len(fine_u) - 1, len(fine_v) - 1), material)
    i = np.round(grid.vertices[:, 0] * (len(fine_u) - 1)).astype(int)
    j = np.round(grid.vertices[:, 1] * (len(fine_v) - 1)).astype(int)
    s, t = np.asarray(fine_u, float)[i], np.asarray(fine_v, float)[j]
    points = np.asarray(corner, float) + s[:, None] * np.asarray(u, float) + t[:, None] * np.asarray(v, float)
    return grid._replace(vertices=points)


def _lines(low: float, high: float, spacing: float) -> np.ndarray:
    """Return 0, 1 and grid lines between `low` and `high`, half a spacing off their ends."""
    inner = np.arange(low + spacing / 2, high, spacing)
    return np.concatenate([[0.0], inner, [1.0]])


def _sky_lamp(height: float = 1.0, width: float = 1.0) -> Mesh:
    """A wide lamp overhead, material 2: the floor below is lit evenly."""
    a = (1 - width) / 2
    return quad((a, a, height), (0, width, 0), (width, 0, 0), (1, 1), 2)


def corner() -> ControlScene:
    """A furnace: walls that emit and reflect, and meet at edges and corners; E is the same everywhere."""
    scene = Scene(_furnace(), (lamp(1.0, 0.5), WHITE), up=UP, name="corner")

    def walls(p):
        return ((p < 1e-6) | (p > 1 - 1e-6)).sum(axis=1)

    return ControlScene(scene, RADIUS, 400_000, lambda p, n: walls(p) >= 2, lambda p, n: walls(p) == 1)


def _furnace(*finer: Mesh) -> Mesh:
    """A closed unit room, material 0; `finer` replaces its floor."""
    room = box((0, 0, 0), (1, 1, 1), 16, 0, inward=True)
    if not finer:
        return room
    keep = (room.vertices[room.faces][:, :, 2] > 1e-9).any(axis=1)
    return merge(room._replace(faces=room.faces[keep], face_material=room.face_material[keep]), *finer)


LEG = 0.04  # side of a table's leg [m]


def _floor_round(low, high, spacing: float) -> Mesh:
    """A floor that is finer than a disc where something stands on [low, high] (2,)."""
    low, high = np.asarray(low), np.asarray(high)
    lines = [_lines(a - 3 * RADIUS, b + 3 * RADIUS, spacing) for a, b in zip(low, high, strict=True)]
    return fine_quad((0, 0, 0), (1, 0, 0), (0, 1, 0), *lines)


def _beside(p, n, low, high, reach) -> np.ndarray:
    """Receivers of the floor within reach of the rectangle [low, high] (2,) and not in it."""
    off = np.maximum(np.maximum(np.asarray(low) - p[:, :2], p[:, :2] - np.asarray(high)), 0)
    distance = np.sqrt((off * off).sum(axis=1))
    return (n[:, 2] > 0.9) & (np.abs(p[:, 2]) < 1e-9) & (distance > 0) & (distance < reach)


def standing(low, high, height: float, mobile: bool, name: str, black: bool = False) -> ControlScene:
    """A box that stands on the floor over the rectangle [low, high] (2,).

    In a furnace, and white: it reflects all light, so E is everywhere the same as without it. Or
    black, under a lamp as wide as the room: E falls towards it.
    """
    body = box((*low, 0), (*high, height), 8, 1)
    floor = _floor_round(low, high, RADIUS / 3)
    static = merge(floor, _sky_lamp()) if black else _furnace(floor)
    materials = (BLACK, BLACK, lamp(1.0)) if black else (lamp(1.0, 0.5), WHITE)
    mobiles = (Mobile("body", body, Pose()),) if mobile else ()
    scene = Scene(static if mobile else merge(static, body), materials, mobiles, up=UP, name=name)
    return ControlScene(
        scene,
        RADIUS,
        400_000,
        lambda p, n: _beside(p, n, low, high, 0.9 * RADIUS),
        lambda p, n: _beside(p, n, low, high, 3 * RADIUS) & ~_beside(p, n, low, high, 1.2 * RADIUS),
    )


def leg(mobile: bool, black: bool = False) -> ControlScene:
    """The leg of a table."""
    low, high = (0.5 - LEG / 2,) * 2, (0.5 + LEG / 2,) * 2
    return standing(low, high, 0.1, mobile, "leg", black)


def book(black: bool = False) -> ControlScene:
    """A book that lies flat against a wall, a mobile; the wall is the floor here."""
    return standing((0.43, 0.38), (0.57, 0.62), 0.03, True, "book", black)


def two_rooms(wall_mobile: bool = False, thickness: float = 0.002) -> ControlScene:
    """A lit and a dark room with a thin wall between them; `wall_mobile`: the wall is a mobile that fills the gap."""
    a, b = 0.5 - thickness / 2, 0.5 + thickness / 2
    # A fitting mobile ends where the walls do: it goes a little into them.
    e = 0.01 if wall_mobile else 0.0
    wall = box((a, -e, -e), (b, 1 + e, 1 + e), 24, 0)
    room = box((0, 0, 0), (1, 1, 1), 25, 0, inward=True)
    light = quad((0.05, 0.1, 0.99), (0, 0.8, 0), (0.35, 0, 0), (1, 1), 1)
    static = merge(room, light) if wall_mobile else merge(room, light, wall)
    mobiles = (Mobile("wall", wall, Pose()),) if wall_mobile else ()
    scene = Scene(static, (grey(0.7), lamp(10.0)), mobiles, up=UP, name="two rooms")
    return ControlScene(scene, 0.05, 50_000, lambda p, n: p[:, 0] > b - 1e-9, lambda p, n: p[:, 0] < 0.4)


def ball(inside: bool) -> ControlScene:
    """The inside of a sphere as a furnace, or its outside under an even sky of lamps: E is the same everywhere."""
    shell = sphere((0, 0, 0), 0.5, 4)
    if inside:
        shell = shell._replace(faces=np.ascontiguousarray(shell.faces[:, ::-1]))
        scene = Scene(shell, (lamp(1.0, 0.5),), up=UP, name="inside of a sphere")
    else:
        around = box((-2, -2, -2), (2, 2, 2), 1, 1, inward=True)
        scene = Scene(merge(shell, around), (BLACK, lamp(1.0)), up=UP, name="outside of a sphere")

    def on(p, n):
        return np.sqrt((p * p).sum(axis=1)) < 0.51

    return ControlScene(scene, 0.05, 200_000, on, lambda p, n: np.zeros(len(p), bool))


def bumpy_wall(two_sided: bool = False) -> ControlScene:
    """A wall of smooth bumps, 4 mm high and 100 mm apart, under a wide lamp; half of it rises through its discs."""
    n = 80
    wall = quad((0.2, 0.2, 0), (0.6, 0, 0), (0, 0.6, 0), (n, n), 0)
    x, y = wall.vertices[:, 0], wall.vertices[:, 1]
    height = 0.004 * np.cos(2 * np.pi * x / 0.1) * np.cos(2 * np.pi * y / 0.1)
    wall = wall._replace(vertices=np.stack([x, y, height], axis=1))
    material = Material("plaster", (0.0, 0.0, 0.0), two_sided=two_sided)
    light = quad((-1, -1, 1), (0, 3, 0), (3, 0, 0), (1, 1), 1)
    scene = Scene(merge(wall, light), (material, lamp(1.0)), up=UP, name="bumpy wall")

    def inner(p):
        return (np.abs(p[:, :2] - 0.5).max(axis=1) < 0.25) & (np.abs(p[:, 2]) < 0.01)

    return ControlScene(
        scene, 0.02, 800_000, lambda p, n: inner(p) & (p[:, 2] < -0.001), lambda p, n: inner(p) & (p[:, 2] > 0.001)
    )


def tent() -> ControlScene:
    """A dark dome in a lit room: curved, thin, and with light on its outside only."""
    shell = sphere((0.5, 0.5, 0.5), 0.2, 3)
    inner = sphere((0.5, 0.5, 0.5), 0.198, 3)
    inner = inner._replace(faces=np.ascontiguousarray(inner.faces[:, ::-1]))
    bulbs = (PointLight("bulb", (0.1, 0.1, 0.9), (10.0,) * 3), PointLight("other", (0.9, 0.9, 0.1), (10.0,) * 3))
    room = box((0, 0, 0), (1, 1, 1), 4, 0, inward=True)
    scene = Scene(merge(room, shell, inner), (grey(0.5),), (), bulbs, up=UP, name="tent")

    def centre(p):
        return np.sqrt(((p - 0.5) ** 2).sum(axis=1))

    return ControlScene(
        scene, 0.05, 50_000, lambda p, n: centre(p) < 0.199, lambda p, n: np.abs(centre(p) - 0.2) < 1e-6
    )


def classes(case: ControlScene, surfaces: Surfaces, receivers) -> tuple[np.ndarray, np.ndarray]:
    """Return the affected receivers and those in the open, (R,) bool each."""
    return tuple(f(receivers.positions, receivers.normals) for f in (case.affected, case.open))
