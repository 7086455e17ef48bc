"""Calculation surfaces: grids of points, their irradiance, and the numbers that lighting norms ask for.

EN 12464-1 defines the grid: nearly square cells with points at their centres, of p = 0.2 * 5^log10(d) metres at a side
of d metres, and a border of 0.5 m along walls that does not count. EN 12665 defines illuminance uniformity as
U0 = E_min / E_mean. E_min / E_max is called diversity Ud here; EN 12665 lets it be stated beside U0. The texts of the
norms were not at hand; these formulas are those that manuals of lighting software give.

The points lie in space, on no surface, so photons on surfaces do not measure them. Unbiased paths do, with a standard
error.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gi_core.base.vectors import frame_of, unit
from gi_core.gather.glare import glare
from gi_core.gather.point_gather import Gatherer
from gi_core.gather.reference import ReferenceRounds
from gi_core.geometry.error import luminance, small_sample_bias
from gi_core.lights.power import Power, maintained, power_of
from gi_core.lights.sky import overcast
from gi_core.rays.accelerator import LIFT, Transforms
from gi_core.rays.all_objects import nearest_in_world
from gi_core.scene.types import DAYLIGHT_FACTOR, MOST_GRID_POINTS, UGR, CalculationSurface
from gi_core.scene.validate import check_surface

if TYPE_CHECKING:
    from collections.abc import Mapping

    from app.settings import Settings
    from gi_core.lights.light_sampling import Lights
    from gi_core.model import Model
    from gi_core.scene import Pose, Scene

HEIGHT = 0.75  # [m] above the floor: desks
BORDER = 0.5  # [m] along walls, EN 12464-1
LEVEL_COSINE = 0.999  # between normals of one flat part
MOST_PARTS = 256  # flat parts of an object that are looked at, from the largest face on
PASS, FAIL, UNCERTAIN = "pass", "fail", "not certain"
AT_MOST = ("maximum",)  # numbers whose target is an upper bound
LEAST_SLOPE = 0.1  # cosine of a face that a vertical line meets at a clear height
OF_POINT = 3.0  # times that: standard error of each point, relative to its value
FIRST_ROUNDS, LAST_ROUNDS = 3, 8  # rounds before values are shown, and before the end: a deviation of fewer says little


NOISE = 0.01  # relative, of the mean of a surface at the end
WORKING_PLANE = CalculationSurface("working plane")


def maintained_levels(model: Model, levels: np.ndarray, settings: Settings) -> np.ndarray:
    """Return levels (G, 3) of the lamps on surfaces, with the maintenance factor."""
    return maintained(model.emitters, levels, settings.maintenance_factor or model.scene.maintenance_factor)


def power(model: Model, levels: np.ndarray, settings: Settings, level: Level) -> Power:
    """Return the power of the lamps at levels (G, 3)."""
    stated = dict(model.scene.watts + settings.watts)
    return power_of(model.emitters, model.scene.lights, levels, stated, level.area)


def surfaces_of(settings: Settings, scene: Scene) -> tuple[CalculationSurface, ...]:
    """Return the surfaces to measure: those of the settings, else those of the scene file."""
    return scene.surfaces if settings.surfaces is None else settings.surfaces


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


class SurfaceLight(NamedTuple):
    """Irradiance at the points of a surface, as luminance of RGB [W/m2], or [lx] in a photometric scene; or factors.

    A daylight factor [%] is the share of the light that the CIE's overcast sky brings to open ground. UGR is that of
    eyes that look along the first side.
    """

    surface: CalculationSurface
    grid: Grid
    values: np.ndarray  # (n,) float64, nan where points do not count
    errors: np.ndarray  # (n,) float64, standard errors
    fraction: float  # of the paths needed, 0 .. 1
    is_current: bool = True  # False: the light has changed since

    @property
    def numbers(self) -> Uniformity:
        return uniformity(self.values, self.errors)

    def rows(self) -> tuple[tuple[str, float, float, bool], ...]:
        """Return those of the numbers that have a meaning: UGR has no uniformity."""
        return self.numbers.rows()[: 3 if self.surface.quantity == UGR else None]

    @property
    def verdicts(self) -> dict[str, str]:
        """PASS, FAIL or UNCERTAIN by the number that has a target."""
        of = {name: (value, error) for name, value, error, _ in self.rows()}
        return {
            name: verdict(*of[name], target, name in AT_MOST) for name, target in self.surface.targets if name in of
        }


class Uniformity(NamedTuple):
    """Mean, least and largest value of a grid, with standard errors; nan without values."""

    mean: float
    mean_error: float
    least: float
    least_error: float
    most: float
    most_error: float
    points: int  # that count
    left_out: int  # that lie inside objects or outside the room

    @property
    def U0(self) -> float:
        """E_min / E_mean, illuminance uniformity of EN 12665; nan in the dark."""
        return self.least / self.mean if self.mean > 0 else math.nan

    @property
    def U0_error(self) -> float:
        """Standard error of U0; least value and mean count as independent."""
        return self.U0 * math.hypot(_share(self.least_error, self.least), _share(self.mean_error, self.mean))

    @property
    def Ud(self) -> float:
        """E_min / E_max; nan in the dark."""
        return self.least / self.most if self.most > 0 else math.nan

    @property
    def Ud_error(self) -> float:
        """Standard error of Ud."""
        return self.Ud * math.hypot(_share(self.least_error, self.least), _share(self.most_error, self.most))

    def rows(self) -> tuple[tuple[str, float, float, bool], ...]:
        """Return name (as in targets), value, standard error, and whether it has the unit of the points, per number."""
        return (
            ("mean", self.mean, self.mean_error, True),
            ("minimum", self.least, self.least_error, True),
            ("maximum", self.most, self.most_error, True),
            ("U0", self.U0, self.U0_error, False),
            ("Ud", self.Ud, self.Ud_error, False),
        )


def _share(error: float, value: float) -> float:
    return error / value if value > 0 else 0.0


def verdict(value: float, error: float, target: float, at_most: bool = False) -> str:
    """Return PASS or FAIL where a value is certain by two standard errors, else UNCERTAIN; a target itself passes."""
    over = (target - value) if at_most else (value - target)
    slack = 2 * error + 1e-9 * abs(target)  # rounding of a value without noise
    if math.isnan(over):
        return UNCERTAIN
    if error == 0:
        return PASS if over >= -slack else FAIL
    return PASS if over >= slack else FAIL if over <= -slack else UNCERTAIN


def uniformity(values: np.ndarray, errors: np.ndarray) -> Uniformity:
    """Return the numbers of a grid from values (n,) and their standard errors (n,); nan values are left out."""
    rows = np.flatnonzero(np.isfinite(values))
    if not len(rows):
        nan = math.nan
        return Uniformity(nan, nan, nan, nan, nan, nan, 0, len(values))
    E, error = values[rows], errors[rows]
    low, high = int(E.argmin()), int(E.argmax())
    of_mean = math.sqrt(float((error * error).sum())) / len(E)
    least, most = (float(E[low]), float(error[low])), (float(E[high]), float(error[high]))
    return Uniformity(float(E.mean()), of_mean, *least, *most, len(E), len(values) - len(E))


# The grid -------------------------------------------------------------------------------------------


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

    Vertical lines through the box pass all static surfaces that face up. Of those that are level and that light
    reaches, the floor is the lowest one half as large as the largest, or larger: no desk,
    blind or ground below the house. The lowest point of the box, where nothing is level.
    """
    floor_lines = 32  # vertical lines per axis that look for the floor
    axes, (low, high) = level.axes, (level.low, level.high)
    a, b = ((np.arange(floor_lines) + 0.5) / floor_lines * (high[k] - low[k]) + low[k] for k in (0, 1))
    at = (a[:, None, None] * axes.across + b[None, :, None] * axes.along).reshape(-1, 3)
    vertices = model.surfaces.vertices[0] + model.origins[0]
    at += (vertices @ axes.up).max(initial=high[2]) * axes.up - model.origins[0]
    at += model.world.size * LIFT * axes.up
    passed, normals = [], model.world.normals
    for _ in range(64):  # surfaces along each line
        distance, face = _below(model, model.static, at, axes.up, static=True)
        at, distance, face = (x[face >= 0] for x in (at, distance, face))
        if not len(at):
            break
        slope, over = normals[face] @ axes.up, (normals[face] * at).sum(axis=1) - model.world.height[face]
        exact = np.divide(over, slope, out=distance.astype(np.float64), where=np.abs(slope) > LEAST_SLOPE)
        at = at - exact[:, None] * axes.up
        passed.append((at[_faces_up(model, model.static, face, axes.up)] + model.origins[0]) @ axes.up)
        at = at - LIFT * np.maximum(np.abs(at).max(axis=1), model.world.reach[face])[:, None] * axes.up
    heights = np.sort(np.concatenate([*passed, np.zeros(0)]))
    lit = model.lit_part
    arrived = np.sort(((lit.hits + model.origins[0]) @ axes.up)[lit.normals @ axes.up > LEAST_SLOPE])
    # a floor is level within 0.002 of the box's longest side; of a dome's bottom, few lines hit so little
    tops = heights + 0.002 * (high - low).max()
    sizes = np.searchsorted(heights, tops, "right") - np.arange(len(heights))
    is_lit = np.searchsorted(arrived, tops, "right") > np.searchsorted(arrived, 2 * heights - tops)
    # the floor is the lowest level surface of 0.5 of the largest one's size
    large = np.flatnonzero(is_lit & (sizes >= 0.5 * np.max(sizes, where=is_lit, initial=1)))
    if not len(large):
        return float(low[2]), 1.0
    size = sizes[large[0]]
    return float(np.median(heights[large[0] : large[0] + size])), min(size / floor_lines**2, 1.0)


def coarsest_cell(side: float) -> float:
    """Return the largest cell [m] of EN 12464-1 for a side [m]."""
    return min(0.2 * 5.0 ** math.log10(side), 10.0)  # 10.0 m: the largest cell of EN 12464-1


def standard_points(width: float, depth: float) -> tuple[int, int]:
    """Return the number of points along two sides [m] by EN 12464-1.

    The rule holds for the longer side, or for the shorter one if the other has twice its length or more.
    """
    short, long = sorted((max(width, 1e-9), max(depth, 1e-9)))
    side = long if long < 2 * short else short
    # 3 cells along a side of less than a metre, EN 12464-1, table A.1
    cell = side / max(round(side / coarsest_cell(side)), 3)
    a, b = (max(round(x / cell), 1) for x in (width, depth))
    return a, b


def points_of(size: Sequence[float]) -> tuple[tuple[int, int], str]:
    """Return the points of EN 12464-1 along two sides [m], at most MOST_GRID_POINTS; a sentence if these are fewer."""
    a, b = standard_points(*size)
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
        usual = 1.2 if surface.quantity == UGR else HEIGHT  # m: eyes of people who sit
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


def _top_of(surface: CalculationSurface, model: Model, level: Level, poses: Mapping[str, Pose]):
    """Return middle (3,) [m], sides (3, 3) unit and size (2,) [m] of the top of what a surface lies on.

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
    """Return the faces of each flat part, the largest face first; corners (n, 3, 3) [m], at most MOST_PARTS parts."""
    middle, left = corners.mean(axis=1), np.argsort(-areas, kind="stable")
    flat = 0.002 * float(np.ptp(corners.reshape(-1, 3), axis=0).max())  # as of a floor
    parts: list[np.ndarray] = []
    while len(left) and len(parts) < MOST_PARTS:
        first = left[0]
        off = np.abs((middle[left] - middle[first]) @ normals[first])
        within = (off <= flat) & (normals[left] @ normals[first] > LEVEL_COSINE)
        within[0] = True
        parts.append(left[within])
        left = left[~within]
    return parts


def stands(model: Model, at: Transforms, points: np.ndarray, normals: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return whether the nearest surface below points (n, 3) [m], lifted along their normals, faces up, (n,) bool.

    Below a point inside a solid is a back, and below one outside a room is nothing.
    """
    o = points - model.origins[0]
    o = o + model.lifts_at(at, o, normals)[:, None] * normals
    _, face = _below(model, at, o, up)
    return (face >= 0) & _faces_up(model, at, np.maximum(face, 0), up)


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


# Light ----------------------------------------------------------------------------------------------


def surface_steps(
    model: Model, surface: CalculationSurface, level: Level, poses: Mapping[str, Pose], levels: np.ndarray, seed: int,
    noise: float = NOISE,
) -> Iterator[SurfaceLight]:  # fmt: skip
    """Trace paths from the points of a surface until their noise is small, in steps of some 10 ms; yield the light.

    levels (G, 3): of the lamps; noise: relative l1 noise at the end, that of each point is OF_POINT times it at most.
    Values are nan at first. Raises SceneError for bad poses, and for an object that is not there.
    """
    grid = grid_of(surface, model, level, poses)
    normals = np.broadcast_to(grid.sides[2], grid.positions.shape)
    values, errors = np.full(len(grid.positions), np.nan), np.full(len(grid.positions), np.nan)
    free, view = np.arange(len(grid.positions)), normals
    if surface.quantity == UGR:
        view = np.broadcast_to(grid.sides[0], grid.positions.shape)
    standing = stands(model, model.transforms(poses), grid.positions, normals, level.axes.up)
    free = free[standing] if standing.any() else free
    lit = free
    for reached in reached_steps(model, grid.positions[free], view[free], poses):
        lit = free[reached]
        yield SurfaceLight(surface, grid, values, errors, 0.0)
    free = lit if len(lit) else free
    lights, factor, of_eyes = None, 1.0, None
    if surface.quantity == DAYLIGHT_FACTOR:  # alone, a sky that brings 1 to a horizontal plane in the open
        lights = model.lights_at(np.zeros_like(levels))._replace(sky=overcast(level.axes.up))
        factor = 100.0  # percent
    if surface.quantity == UGR:
        of_eyes = glare(model, levels, grid.positions[free], grid.sides[0], level.axes.up, poses, seed)
    rounds = point_rounds(model, grid.positions[free], view[free], poses, levels, seed, lights)
    for E, error, fraction in light_steps(rounds, noise):
        values, errors = values.copy(), errors.copy()
        values[free], errors[free] = factor * E, factor * error
        if of_eyes is not None:
            values[free], errors[free] = of_eyes.rating(E), of_eyes.deviation(E, error)
        yield SurfaceLight(surface, grid, values, errors, fraction)


def all_steps(
    model: Model, surfaces: Sequence[CalculationSurface], level: Level, poses: Mapping[str, Pose], levels: np.ndarray,
    seed: int, noise: float = NOISE,
) -> Iterator[tuple[SurfaceLight, ...]]:  # fmt: skip
    """Measure several surfaces side by side; yield the light of each, in their order, see surface_steps()."""
    steps = [surface_steps(model, s, level, poses, levels, seed, noise) for s in surfaces]
    lights = [next(of) for of in steps]
    while True:
        yield tuple(lights)
        left = [k for k, light in enumerate(lights) if light.fraction < 1]
        if not left:
            return
        for k in left:
            lights[k] = next(steps[k])
            yield tuple(lights)


def point_rounds(
    model: Model, positions: np.ndarray, normals: np.ndarray, poses: Mapping[str, Pose], levels: np.ndarray, seed: int,
    lights: Lights | None = None,
) -> ReferenceRounds:  # fmt: skip
    """Return rounds of paths at points (n, 3) [m] with normals (n, 3), which count alike; lights: see there."""
    weights = np.ones(len(positions))
    return ReferenceRounds(
        model.scene, positions, normals, seed, weights, poses, model=model, levels=levels, lights=lights
    )


def light_steps(rounds: ReferenceRounds, noise: float) -> Iterator[tuple[np.ndarray, np.ndarray, float]]:
    """Trace rounds until their noise is small; yield values (n,), standard errors (n,) and the fraction done.

    nan before round FIRST_ROUNDS. The last standard errors are those of LAST_ROUNDS sets of paths or more.
    """
    state, weights, fraction = rounds.state, np.ones(len(rounds.state.sets)), 0.0
    E, error = np.full((2, len(weights)), np.nan)
    seen = FIRST_ROUNDS - 1
    while fraction < 1:
        rounds.step()
        if state.rounds > seen:
            seen = state.rounds
            E, error = luminance(state.mean), luminance(state.standard_error) / small_sample_bias(state.sets)
            mean, left = float(E.mean()), 0.0
            if mean > 0:
                # relative to 0.05 of the mean where a point is dimmer
                of_points = float((error / np.maximum(E, 0.05 * mean)).max())
                left = max(math.sqrt(2 / math.pi) * float(error.mean()) / mean, of_points / OF_POINT) / noise
            done = seen >= LAST_ROUNDS and (left <= 1 or state.paths.mean() >= 1 << 16)
            now = min(1 / max(left, 1e-9) ** 2, seen / LAST_ROUNDS, 0.99)
            fraction = 1.0 if done else max(fraction, now)  # the noise is measured, and may rise again
        yield E.copy(), error.copy(), fraction
