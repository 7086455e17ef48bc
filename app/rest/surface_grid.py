"""Grids of calculation surfaces: the floor of a room, points over it or on an object, and which of them count.

EN 12464-1 defines the grid. Cells are nearly square, of p = 0.2 * 5^log10(d) metres at a side of d metres, with points
at their centres. A border of 0.5 m along walls does not count. The text of the norm was not at hand; these formulas are
those of manuals of lighting software.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from gi_core.base.vectors import frame_of, unit
from gi_core.gather.reference import Gatherer
from gi_core.model import Model
from gi_core.rays.accelerator import LIFT, Transforms
from gi_core.rays.all_objects import nearest_in_world
from gi_core.scene import Pose
from gi_core.scene.pose import to_millionths
from gi_core.scene.types import CYLINDRICAL, MOST_GRID_POINTS, UGR, CalculationSurface
from gi_core.scene.validate import check_surface

BORDER = 0.5  # [m] along walls, EN 12464-1
LEVEL_COSINE = 0.999  # between normals of one flat part
LEAST_SLOPE = 0.1  # cosine of a face that a vertical line meets at a clear height
FLAT = 0.002  # of the longest side: a floor or a flat part is level within it


class Axes(NamedTuple):
    """Two horizontal axes of a scene and the vertical one, unit vectors (3,), and the names of the horizontal ones."""

    across: np.ndarray
    along: np.ndarray
    up: np.ndarray
    names: tuple[str, str]


class Level(NamedTuple):
    """The box that light reaches, seen along the axes of a scene [m]."""

    axes: Axes
    low: np.ndarray  # (3,) across, along, up; low[2] is the floor
    high: np.ndarray
    area: float  # [m2] of the floor


class Grid(NamedTuple):
    """Points of a surface."""

    positions: np.ndarray  # (n, 3) float64 [m], rows along the first side
    shape: tuple[int, int]  # points along the two sides
    corners: np.ndarray  # (4, 3) float64 [m] of the surface
    sides: np.ndarray  # (3, 3) float64 unit: the two sides, and the normal
    size: np.ndarray  # (2,) float64 [m]


def axes_of(up) -> Axes:
    """Return the axes of a scene: two coordinate axes where the third one is vertical."""
    east, north, upward = frame_of(up)
    vertical = int(np.argmax(np.abs(upward)))
    if np.abs(upward).max() < 1 - 1e-9:
        return Axes(east, north, upward, ("east", "north"))
    a, b = (k for k in range(3) if k != vertical)
    return Axes(np.eye(3)[a], np.eye(3)[b], upward, ("xyz"[a], "xyz"[b]))


def level_of(model: Model) -> Level:
    """Return the box of a scene that light reaches, from the floor up (`floor_of`), along its axes."""
    lit = model.lit_part
    level = box_along(lit.low + model.origins[0], lit.high + model.origins[0], model.scene.up)
    floor, share = floor_of(model, level)
    return level._replace(low=np.append(level.low[:2], floor), area=share * level.area)


def box_along(low, high, up) -> Level:
    """Return the box low .. high (3,) [m] along the axes of a scene."""
    axes = axes_of(up)
    ends = np.array([low, high], np.float64)
    corners = np.array([[ends[i, 0], ends[j, 1], ends[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    along = corners @ np.array(axes[:3]).T
    low, high = along.min(axis=0), along.max(axis=0)
    return Level(axes, low, high, float(np.prod((high - low)[:2])))


def floor_of(model: Model, level: Level) -> tuple[float, float]:
    """Return the height [m] of the floor of a scene whose light reaches the box `level`, and its share of the box.

    Vertical lines through the box pass all static surfaces that face up. The floor is level and lit. It is the
    lowest such surface of at least half the size of the largest: no desk, blind or ground below the house. Where
    nothing is level, it is the lowest point of the box.
    """
    floor_lines = 4096  # vertical lines that look for the floor, by Roberts' sequence R2: 0.1 % of its area
    axes, (low, high) = level.axes, (level.low, level.high)
    share = (np.arange(floor_lines)[:, None] + 0.5) * (0.7548776662466927, 0.5698402909980532) % 1.0
    at = (low[:2] + share * (high - low)[:2]) @ np.array(axes[:2])
    vertices = model.surfaces.vertices[0] + model.origins[0]
    at += (vertices @ axes.up).max(initial=high[2]) * axes.up - model.origins[0]
    at += model.world.size * LIFT * axes.up
    passed, every, line, normals = [], [], np.arange(len(at)), model.world.normals
    for _ in range(64):  # surfaces along each line
        distance, face = _below(model, model.static, at, axes.up, static=True)
        at, distance, face, line = (x[face >= 0] for x in (at, distance, face, line))
        if not len(at):
            break
        slope, over = normals[face] @ axes.up, (normals[face] * at).sum(axis=1) - model.world.height[face]
        exact = np.divide(over, slope, out=distance.astype(np.float64), where=np.abs(slope) > LEAST_SLOPE)
        at = at - exact[:, None] * axes.up
        above = (at + model.origins[0]) @ axes.up
        passed.append(above[_faces_up(model, model.static, face, axes.up)])
        every.append(np.stack([line, above]))
        at = at - LIFT * np.maximum(np.abs(at).max(axis=1), model.world.reach[face])[:, None] * axes.up
    heights = np.sort(np.concatenate([*passed, np.zeros(0)]))
    lit, flat = model.lit_part, FLAT * (high - low).max()  # of a dome's bottom, few lines hit so little
    arrived = np.sort(((lit.hits + model.origins[0]) @ axes.up)[lit.normals @ axes.up > LEAST_SLOPE])
    tops = heights + flat
    sizes = np.searchsorted(heights, tops, "right") - np.arange(len(heights))
    is_lit = np.searchsorted(arrived, tops, "right") > np.searchsorted(arrived, heights - flat)
    # the floor is the lowest level surface of 0.5 of the largest one's size
    large = np.flatnonzero(is_lit & (sizes >= 0.5 * np.max(sizes, where=is_lit, initial=1)))
    if not len(large):
        return float(low[2]), 1.0
    first = large[0]
    # the bottoms of bodies that stand on the floor hide it
    lines, above = np.concatenate(every, axis=1)
    on_floor = np.unique(lines[(above >= heights[first]) & (above <= tops[first])])
    return float(np.median(heights[first : first + sizes[first]])), len(on_floor) / floor_lines


def points_of(size: Sequence[float]) -> tuple[tuple[int, int], str]:
    """Return the points of EN 12464-1 along two sides [m], at most MOST_GRID_POINTS; a sentence if these are fewer.

    The rule holds for the longer side, or for the shorter one if the other has twice its length or more.
    """
    short, long = sorted(max(side, 1e-9) for side in size)
    side = long if long < 2 * short else short
    coarsest = min(0.2 * 5.0 ** math.log10(side), 10.0)
    # 3 cells along a side of less than a metre, EN 12464-1, table A.1
    cell = side / max(round(side / coarsest), 3)
    a, b = (max(round(x / cell), 1) for x in size)
    if max(a, b) <= MOST_GRID_POINTS:
        return (a, b), ""
    return (
        (min(a, MOST_GRID_POINTS), min(b, MOST_GRID_POINTS)),
        f"EN 12464-1 asks for {a} x {b} points; if the file is in millimetres, write scale = 0.001 in its table",
    )


def in_room(surface: CalculationSurface, level: Level) -> CalculationSurface:
    """Return a surface that lies on nothing with its height, position, size and margin filled in from the room."""
    low, high = level.low[:2], level.high[:2]
    top = float(level.high[2] - level.low[2])
    # 5 digits of the scene's size in numbers that come from the room
    decimals = 5 - math.floor(math.log10(max(*(high - low).tolist(), top, 1e-9)))
    middle, (width, depth) = ([round(float(x), decimals) for x in v] for v in ((low + high) / 2, high - low))
    size, margin = surface.size or (width, depth), surface.margin
    if surface.size is None and margin is None and min(size) > 4 * BORDER:  # a small room has no border
        margin = BORDER
    position = surface.position or (middle[0], middle[1])
    height = surface.height
    if height is None:
        # a plane above 0.9 of the scene's height lies at half the height
        usual = 1.2 if surface.quantity in (CYLINDRICAL, UGR) else 0.75  # m: eyes of seated people, desks
        height = usual if top * 0.9 >= usual else round(top / 2, decimals)
    return surface._replace(position=position, size=size, margin=margin or 0.0, height=height)


def grid_of(surface: CalculationSurface, model: Model, level: Level, poses: Mapping[str, Pose]) -> Grid:
    """Return the points of a surface at the poses of mobiles. Raises SceneError for one that lies on nothing."""
    check_surface(model.scene.name, surface, model.scene)
    if surface.on:
        middle, sides, size = _top_of(surface, model, level, poses)
        middle, margin = middle + (surface.height or 0.0) * sides[2], surface.margin or 0.0
    else:
        s, (a, b, up, _) = in_room(surface, level), level.axes
        middle, size, margin = np.array((*s.position, level.low[2] + s.height)) @ np.array((a, b, up)), s.size, s.margin
        turn, tilt = np.radians((s.turn, s.tilt))
        a, b = math.cos(turn) * a + math.sin(turn) * b, math.cos(turn) * b - math.sin(turn) * a
        sides = np.array([math.cos(tilt) * a - math.sin(tilt) * up, b, math.cos(tilt) * up + math.sin(tilt) * a])
    size = np.asarray(size)
    size = np.maximum(size - 2 * margin, 0.01 * size)  # 0.01 of a side is left by any margin
    shape = surface.points or points_of(size.tolist())[0]
    at = [((np.arange(n) + 0.5) / n - 0.5) * side for n, side in zip(shape, size, strict=True)]
    points = middle + at[0][:, None, None] * sides[0] + at[1][None, :, None] * sides[1]
    corners = middle + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2 * size @ sides[:2]
    return Grid(points.reshape(-1, 3), shape, corners, sides, size)


def on_part(name: str, model: Model, level: Level, face: int) -> CalculationSurface:
    """Return a surface on the level part of the static part around a face; elsewhere on the material of that face."""
    s, scene, axes = model.surfaces, model.scene, level.axes
    part = np.flatnonzero(s.patch[s.face_range(0)] == s.patch[face])
    if not (s.normals[part] @ axes.up > LEVEL_COSINE).all():
        return CalculationSurface(name, scene.materials[scene.static.face_material[face]].name)
    at = model.vertices_at(0, {})[s.faces[0][part]].reshape(-1, 3) @ np.array(axes[:3]).T
    low, high = at.min(axis=0), at.max(axis=0)
    size = float((high - low).max())
    (a, b, height), (width, depth, _) = (
        to_millionths(v, size) for v in ((low + high) / 2 - (0, 0, level.low[2]), high - low)
    )
    return CalculationSurface(name, position=(a, b), size=(width, depth), height=height)


def _top_of(surface: CalculationSurface, model: Model, level: Level, poses: Mapping[str, Pose]):
    """Return middle (3,) [m], sides (3, 3) unit and size (2,) [m] of the top of the part that a surface lies on.

    The top is the highest of its flat parts that face up, of those half as large as the largest; else its largest part.
    """
    scene, up, turned = model.scene, level.axes.up, np.eye(3)
    if surface.on in model.names:
        o = 1 + model.names.index(surface.on)
        chosen = np.arange(len(model.surfaces.faces[o]))
        turned = model.transforms(poses).rotation[o]
    else:
        o, named = 0, [m.name == surface.on for m in scene.materials]
        chosen = np.flatnonzero(np.array(named, bool)[scene.static.face_material])
    corners = model.vertices_at(o, poses)[model.surfaces.faces[o][chosen]]
    n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.sqrt((n * n).sum(axis=1))
    n = n / np.maximum(areas, 1e-300)[:, None]
    two_sided = model.surfaces.two_sided[model.surfaces.face_range(o)][chosen]
    inward = (level.low + level.high) / 2 @ np.array(level.axes[:3])
    away = np.where(np.abs(n @ up) > LEAST_SLOPE, n @ up, (n * (inward - corners[:, 0])).sum(axis=1)) < 0
    n[two_sided & away] *= -1.0
    parts = _flat_parts(corners, n, areas)
    upward = [part for part in parts if n[part[0]] @ up > LEVEL_COSINE]
    if upward:
        most = max(areas[part].sum() for part in upward)
        large = [part for part in upward if areas[part].sum() >= 0.5 * most]
        best = max(large, key=lambda part: float((corners[part].reshape(-1, 3) @ up).max()))
        a, b = turned @ level.axes.across, turned @ level.axes.along
    else:
        best = max(parts, key=lambda part: areas[part].sum())
        a, b = np.cross(up, n[best[0]]), up
    normal = n[best[0]]
    a = unit(a - (a @ normal) * normal)
    b = unit(b - (b @ normal) * normal - (b @ a) * a)
    at = corners[best].reshape(-1, 3)
    low, high = (np.array([f(at @ a), f(at @ b)]) for f in (np.min, np.max))
    middle = (low + high) / 2 @ np.array([a, b]) + (at @ normal).max() * normal
    return middle, np.array([a, b, normal]), high - low


def _flat_parts(corners: np.ndarray, normals: np.ndarray, areas: np.ndarray) -> list[np.ndarray]:
    """Return the faces of each flat part, the largest face first; corners (n, 3, 3) [m], at most 256 parts."""
    middle, left = corners.mean(axis=1), np.argsort(-areas, kind="stable")
    flat = FLAT * float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    parts: list[np.ndarray] = []
    while len(left) and len(parts) < 256:
        first = left[0]
        off = np.abs((middle[left] - middle[first]) @ normals[first])
        within = (off <= flat) & (normals[left] @ normals[first] > LEVEL_COSINE)
        within[0] = True
        parts.append(left[within])
        left = left[~within]
    return parts


def stands(model: Model, at: Transforms, points: np.ndarray, normals: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return whether the nearest surfaces below and above points (n, 3) [m], and one beside them, face them, (n,) bool.

    Points are lifted along their normals. Below or above a point inside a solid is a back, and below one outside a room
    is nothing. A pillar without ends has backs on all four sides.
    """
    o = points - model.origins[0]
    o = o + model.lifts_at(at, o, normals)[:, None] * normals
    (_, below), (_, above) = (_below(model, at, o, way) for way in (up, -up))
    faced = [_faces_up(model, at, np.maximum(face, 0), way) for face, way in ((below, up), (above, -up))]
    enclosed = np.ones(len(o), bool)
    for way in (sign * axis for axis in frame_of(up)[:2] for sign in (-1, 1)):
        _, beside = _below(model, at, o, way)
        enclosed &= (beside >= 0) & ~_faces_up(model, at, np.maximum(beside, 0), way)
    return (below >= 0) & faced[0] & ((above < 0) | faced[1]) & ~enclosed


def _below(model: Model, at: Transforms, origins: np.ndarray, up: np.ndarray, static=False):
    """Return distance [m] and face of the nearest surface below points (n, 3), relative to the model's origin."""
    far, down = np.full(len(origins), np.inf, np.float32), np.broadcast_to(-up, origins.shape)
    if static:
        return model.accelerator.nearest(0, origins.astype(np.float32), down.astype(np.float32), far)
    return nearest_in_world(model.accelerator, at, origins, down, far)


def _faces_up(model: Model, at: Transforms, face: np.ndarray, up: np.ndarray) -> np.ndarray:
    world = model.world
    normals = np.einsum("nij,nj->ni", at.rotation[world.face_object[face]], world.normals[face])
    return world.two_sided[face] | (normals @ up > 0)


def reached_steps(
    model: Model, points: np.ndarray, normals: np.ndarray, poses: Mapping[str, Pose]
) -> Iterator[np.ndarray]:
    """Yield in short steps which points (n, 3) [m] light can reach before their normals, (n,) bool; the last is final.

    Paths look for it in the scene painted white, at the levels of the scene file: the way counts, not the colour.
    """
    paths_per_step = 1024  # of these paths per step: 10 ms
    white = Gatherer(model.scene, points, normals, 0, poses, model=model.white())
    reached, first = np.zeros(len(points), bool), 0
    yield reached
    for paths in (16, 32, 64, 128, 256):  # paths from points that light has not reached yet
        left = np.flatnonzero(~reached)
        for k in range(0, len(left), paths_per_step // paths):
            rows = left[k : k + paths_per_step // paths]
            reached[rows] = white.paths(rows, first, paths).any(axis=(1, 2))
            yield reached
        first += paths
