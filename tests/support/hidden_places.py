"""Rooms with places that little light reaches: under a table, between books, in a cupboard, behind a door."""

from dataclasses import replace

import numpy as np

from gi_core.files.completion.crossings import with_corners_at_crossings
from gi_core.scene.types import Mesh, Mobile, Pose, Scene
from tests.support.lit_from_outside import CEILING, DARK, MATERIALS, WALL, prism, sheet
from tests.support.scene_builders import lamp, merge

LAMP = len(MATERIALS)


def block(low, high, edge: float, material: int = WALL) -> Mesh:
    """Return a closed box of faces of about an edge [m]."""
    low, size = np.asarray(low, float), np.asarray(high, float) - low
    sides = []
    for axis in range(3):
        u, v, w = (np.eye(3)[(axis + k) % 3] * size for k in (1, 2, 0))
        sides += [sheet(low + w, u, v, edge, material), sheet(low, v, u, edge, material)]
    return merge(*sides)


def lit_room(width: float, depth: float, edge: float, *parts: Mesh, at=(0.5, 0.5)) -> Mesh:
    """Return a room 2.6 m high with a lamp of 0.5 x 0.5 m at its ceiling, at shares of its sides, and parts."""
    outline = ((0, 0, width, depth),), ((0, 0), (width, 0), (width, depth), (0, depth))
    corner = (at[0] * width - 0.25, at[1] * depth - 0.25, 2.58)
    return merge(prism(outline, 2.6, edge, -1, ()), sheet(corner, (0, 0.5, 0), (0.5, 0, 0), 0.25, LAMP), *parts)


def scene(name: str, static: Mesh, *mobiles: Mobile) -> Scene:
    """Return a scene of these materials and a lamp."""
    return Scene(static, (*MATERIALS, lamp(30.0)), mobiles, (), up=(0.0, 0.0, 1.0), name=name)


def table_room(edge: float = 0.5) -> Scene:
    """A room of 4 x 4 m with a table of 1.2 x 0.7 m, which stands beside the lamp."""
    legs = [block((x, y, 0), (x + 0.06, y + 0.06, 0.7), 0.2) for x in (-0.58, 0.52) for y in (-0.33, 0.27)]
    table = merge(block((-0.6, -0.35, 0.7), (0.6, 0.35, 0.74), 0.12), *legs)
    return scene("table", lit_room(4.0, 4.0, edge), Mobile("table", table, Pose((1.6, 2.2, 0.002))))


def books(edge: float = 0.04) -> Scene:
    """A room of 3 x 3 m with a board on a wall and nine books on it, 1 cm apart; the middle one is a mobile."""
    board = block((1.2, 2.7, 1.0), (1.8, 3.0, 1.02), 2 * edge)
    of = [block((0, 0, 0), (0.03, 0.18, 0.24), edge, DARK if k % 3 else CEILING) for k in range(9)]
    places = [np.array((1.31 + 0.04 * k, 2.8, 1.021)) for k in range(9)]
    still = [m._replace(vertices=m.vertices + x) for k, (m, x) in enumerate(zip(of, places, strict=True)) if k != 4]
    return scene("books", lit_room(3.0, 3.0, 0.3, board, *still), Mobile("book", of[4], Pose(tuple(places[4]))))


def cupboard(edge: float = 0.14) -> Scene:
    """A room of 3 x 3 m with a cupboard of 0.8 x 0.4 x 1.8 m, two shelves, and a door that stands ajar."""
    thick, high = 0.02, (0.8, 0.4, 1.8)
    boards = [block((0, 0.38, 0), high, edge), block((0, 0, 0), (0.02, 0.38, 1.8), edge)]
    boards += [block((0.78, 0, 0), (0.8, 0.38, 1.8), edge)]
    boards += [block((0.02, 0, z), (0.78, 0.38, z + thick), edge) for z in (0.0, 0.6, 1.2, 1.78)]
    still = [m._replace(vertices=m.vertices + np.array((1.1, 2.55, 0.003))) for m in boards]
    turned = Pose((1.1, 2.548, 0.003), (np.cos(np.pi / 12), 0.0, 0.0, -np.sin(np.pi / 12)))
    door = Mobile("door", block((0, -0.02, 0), (0.8, 0, 1.8), edge, CEILING), turned)
    return scene("cupboard", lit_room(3.0, 3.0, 0.3, *still), door)


def partition(edge: float = 0.25) -> Scene:
    """A room of 5 x 3 m with a lamp in its left part, and a partition 5 mm thick that leaves a gap beside a wall."""
    wall = Mobile("partition", block((0, 0, 0), (0.005, 2.5, 2.55), edge), Pose((2.5, 0.48, 0.02)))
    return scene("partition", lit_room(5.0, 3.0, edge, at=(0.2, 0.5)), wall)


def two_rooms(edge: float = 0.2) -> Scene:
    """Two rooms of 3 x 3 m under one ceiling, one with a lamp, and a door that leaves 1 cm at its sides."""
    walls = [block((2.95, y, 0), (3.05, z, 2.6), edge) for y, z in ((0, 1.0), (1.9, 3))]
    lintel = block((2.95, 1.0, 2.1), (3.05, 1.9, 2.6), edge)
    door = Mobile("door", block((0, 0, 0), (0.04, 0.88, 2.08), edge), Pose((3.0, 1.01, 0.01)))
    still = scene("two rooms", lit_room(6.0, 3.0, edge, *walls, lintel, at=(0.2, 0.5)), door)
    return replace(still, static=with_corners_at_crossings(still.static, still.materials))
