"""Rooms lit by sky and sun through one window, with a box in their light, and one of bright tiles."""

import numpy as np

from gi_core.scene.types import DirectionalLight, Mesh, Mobile, Pose, Scene, SkyLight
from tests.support.scene_builders import box, grey, lamp, merge, quad

WALL, FLOOR, CEILING, DARK = range(4)
MATERIALS = (grey(0.6), grey(0.3), grey(0.8), grey(0.15))


def sheet(corner, u, v, edge: float, material: int = WALL) -> Mesh:
    """Return a parallelogram, see quad(), of faces of about an edge [m]."""
    sizes = (max(1, round(float(np.linalg.norm(w)) / edge)) for w in (u, v))
    return quad(corner, u, v, tuple(sizes), material)


def wall_with_window(corner, along, height: float, hole, edge: float) -> list[Mesh]:
    """Return a wall of two sides on a horizontal line, with a hole (first, last, sill, top) [m] in it."""
    corner, length = np.asarray(corner, float), float(np.linalg.norm(along))
    way, up = np.asarray(along, float) / length, np.array((0.0, 0.0, 1.0))
    first, last, sill, top = hole
    parts = ((0, first, 0, height), (last, length, 0, height), (first, last, 0, sill), (first, last, top, height))
    return [sheet(corner + a * way + low * up, (b - a) * way, (high - low) * up, edge) for a, b, low, high in parts]


def prism(outline, height: float, edge: float, window: int, hole) -> Mesh:
    """Return a room over rectangles (x, y, width, depth) of a floor; walls follow an outline to the left."""
    rectangles, corners = outline
    parts = []
    for x, y, w, d in rectangles:
        parts.append(sheet((x, y, 0), (w, 0, 0), (0, d, 0), edge, FLOOR))
        parts.append(sheet((x, y, height), (0, d, 0), (w, 0, 0), edge, CEILING))
    points = np.array(corners, float)
    for k, (a, b) in enumerate(zip(points, np.roll(points, -1, axis=0), strict=True)):
        start, along = (*b, 0.0), (*(a - b), 0.0)  # the front looks inside
        if k == window:
            parts += wall_with_window(start, along, height, hole, edge)
        else:
            parts.append(sheet(start, along, (0, 0, height), edge))
    return merge(*parts)


def l_room(edge: float = 0.4) -> Scene:
    """Two wings of 6 x 3 x 3 m, sun and sky by a window at the end of one, and a dark box in the sunbeam."""
    outline = ((0, 0, 6, 3), (0, 3, 3, 3)), ((0, 0), (6, 0), (6, 3), (3, 3), (3, 6), (0, 6))
    static = prism(outline, 3.0, edge, 1, (0.75, 2.25, 0.9, 2.4))
    sun = DirectionalLight("sun", (-1.0, 0.0, -0.75), (50.0, 48.0, 42.0))
    sky = SkyLight("sky", (3.0, 3.5, 4.5))
    thing = Mobile("box", box((-0.3, -0.4, 0.0), (0.3, 0.4, 0.8), 5, DARK), Pose((4.2, 1.5, 0.02)))
    return Scene(static, MATERIALS, (thing,), (sun, sky), up=(0.0, 0.0, 1.0), name="L-shaped room")


def sky_room(edge: float = 0.2) -> Scene:
    """A room of 4 x 4 x 3 m, sky by a window, and a box on the floor behind it."""
    outline = ((0, 0, 4, 4),), ((0, 0), (4, 0), (4, 4), (0, 4))
    static = prism(outline, 3.0, edge, 1, (1.4, 2.6, 0.9, 2.1))
    thing = Mobile("box", box((-0.3, -0.4, 0.0), (0.3, 0.4, 0.8), 5, WALL), Pose((2.6, 2.0, 0.01)))
    sky = SkyLight("sky", (3.0, 3.5, 4.5))
    return Scene(static, MATERIALS, (thing,), (sky,), up=(0.0, 0.0, 1.0), name="room under a sky")


def bathroom(edge: float = 0.1) -> Scene:
    """A room of 2.4 x 3 x 2.5 m, tiles of 0.85, with a bath, a lamp under its ceiling, one by a wall, a dark stool."""
    outline = ((0, 0, 2.4, 3),), ((0, 0), (2.4, 0), (2.4, 3), (0, 3))
    tiles = tuple(grey(0.85) for _ in range(3))
    bath = box((0.0, 2.2, 0.0), (1.7, 3.0, 0.6), 8, WALL)
    lamps = (
        sheet((1.0, 1.2, 2.45), (0, 0.5, 0), (0.5, 0, 0), edge, 4),
        sheet((0.05, 0.6, 1.9), (0, 0.6, 0), (0, 0, -0.1), edge, 4),
    )
    stool = Mobile("stool", box((-0.2, -0.2, 0.0), (0.2, 0.2, 0.45), 5, DARK), Pose((1.5, 1.0, 0.01)))
    static = merge(prism(outline, 2.5, edge, -1, ()), bath, *lamps)
    return Scene(static, (*tiles, grey(0.5), lamp(20.0)), (stool,), (), up=(0.0, 0.0, 1.0), name="bathroom")
