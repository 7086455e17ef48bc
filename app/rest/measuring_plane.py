"""A measuring plane: a horizontal grid of points, their irradiance, and the numbers that lighting norms ask for.

EN 12464-1 defines the grid: nearly square cells with points at their centres, of p = 0.2 * 5^log10(d) metres at a side
of d metres, and a border of 0.5 m along walls that does not count. EN 12665 defines illuminance uniformity as
U0 = E_min / E_mean. E_min / E_max is called diversity Ud here; EN 12665 lets it be stated beside U0.

The points lie in space, on no surface, so photons on surfaces do not measure them. Unbiased paths do, with a standard
error.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from app.draw.camera import frame_of
from app.settings import MeasuringPlane
from gi_core.base.vectors import dot
from gi_core.gather.reference import ReferenceRounds
from gi_core.geometry.error import luminance, small_sample_bias
from gi_core.rays.accelerator import Transforms
from gi_core.rays.all_objects import nearest_in_world

if TYPE_CHECKING:
    from collections.abc import Mapping

    from gi_core.model import Model
    from gi_core.scene import Pose

HEIGHT = 0.75  # [m] above the floor: desks
BORDER = 0.5  # [m] along walls, EN 12464-1
COARSEST = 10.0  # [m], the largest cell of EN 12464-1
FEWEST = 3  # cells along a side of less than a metre, EN 12464-1, table A.1
LOW_SCENE = 0.9  # of the scene's height: a plane above that lies at half the height
RAYS = 64  # above a point that may lie inside an object
NOISE = 0.01  # relative l1 noise that is small enough
OF_POINT = 3.0  # times that: standard error of each point, relative to its value ...
DIM = 0.05  # ... or to this share of the mean, if larger
FIRST, ENOUGH = 3, 8  # rounds before values are shown, and before the end: a deviation of fewer says little
MOST_PATHS = 1 << 16  # per point


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


class Grid(NamedTuple):
    """Points of a measuring plane."""

    positions: np.ndarray  # (n, 3) float64 [m], rows along the first axis
    shape: tuple[int, int]  # points along the two axes
    corners: np.ndarray  # (4, 3) float64 [m] of the plane


class PlaneLight(NamedTuple):
    """Irradiance at the points of a measuring plane, as luminance of RGB [W/m2], or [lx] in a photometric scene."""

    plane: MeasuringPlane
    grid: Grid
    values: np.ndarray  # (n,) float64, nan inside objects
    errors: np.ndarray  # (n,) float64, standard errors
    fraction: float  # of the paths needed, 0 .. 1
    is_current: bool = True  # False: the light has changed since

    @property
    def numbers(self) -> Uniformity:
        return uniformity(self.values, self.errors)


class Uniformity(NamedTuple):
    """Mean, least and largest value of a grid, with standard errors; nan without values."""

    mean: float
    mean_error: float
    least: float
    least_error: float
    most: float
    most_error: float
    points: int  # that count
    left_out: int  # that lie inside objects

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


def _share(error: float, value: float) -> float:
    return error / value if value > 0 else 0.0


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


def level_of(low, high, up) -> Level:
    """Return the box low .. high (3,) [m] of a scene along its axes."""
    axes = axes_of(up)
    ends = np.array([low, high], np.float64)
    corners = np.array([[ends[i, 0], ends[j, 1], ends[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    along = corners @ np.array(axes[:3]).T
    return Level(axes, along.min(axis=0), along.max(axis=0))


def default_plane(level: Level) -> MeasuringPlane:
    """Return the plane at desk height without the border along walls; a small scene has neither."""
    low, high = level.low[:2].copy(), level.high[:2].copy()
    inside = high - low > 4 * BORDER
    low[inside] += BORDER
    high[inside] -= BORDER
    top = float(level.high[2] - level.low[2])
    height = HEIGHT if top * LOW_SCENE >= HEIGHT else top / 2
    a, b, c, d, h = (float(f"{x:.6g}") for x in (*low, *high, height))
    return MeasuringPlane((a, b), (c, d), h)


def coarsest_cell(side: float) -> float:
    """Return the largest cell [m] of EN 12464-1 for a side [m]."""
    return min(0.2 * 5.0 ** math.log10(side), COARSEST)


def standard_points(width: float, depth: float) -> tuple[int, int]:
    """Return the number of points along two sides [m] by EN 12464-1.

    The rule holds for the longer side, or for the shorter one if the other has twice its length or more.
    """
    short, long = sorted((max(width, 1e-9), max(depth, 1e-9)))
    side = long if long < 2 * short else short
    cell = side / max(round(side / coarsest_cell(side)), FEWEST)
    a, b = (max(round(x / cell), 1) for x in (width, depth))
    return a, b


def grid_of(plane: MeasuringPlane, level: Level) -> Grid:
    """Return the points of a plane: the centres of its cells."""
    low, high = np.minimum(plane.low, plane.high), np.maximum(plane.low, plane.high)
    size = high - low
    shape = plane.points or standard_points(*size.tolist())
    a, b = ((np.arange(n) + 0.5) / n * s + o for n, s, o in zip(shape, size, low, strict=True))
    axes, height = level.axes, level.low[2] + plane.height
    at = a[:, None, None] * axes.across + b[None, :, None] * axes.along + height * axes.up
    corners = [x * axes.across + y * axes.along + height * axes.up
               for x, y in ((low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1]))]  # fmt: skip
    return Grid(at.reshape(-1, 3), shape, np.array(corners))


def is_inside(model: Model, at: Transforms, positions: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return whether points (n, 3) [m] lie inside objects or outside a room, (n,) bool.

    There, most rays into the hemisphere about `up` (3,) that hit anything hit backs. Those of two-sided surfaces do
    not count.
    """
    k = np.arange(RAYS) + 0.5
    cosine, turn = 1 - k / RAYS, math.pi * (1 + math.sqrt(5)) * k  # a Fibonacci lattice
    sine = np.sqrt(1 - cosine * cosine)
    east, north, up = frame_of(up)
    directions = np.outer(sine * np.cos(turn), east) + np.outer(sine * np.sin(turn), north) + np.outer(cosine, up)
    d = np.tile(directions, (len(positions), 1))
    o = np.repeat(positions - model.origins[0], RAYS, axis=0)
    far = np.full(len(d), np.inf, np.float32)
    _, face = nearest_in_world(model.accelerator, at, o.astype(np.float32), d.astype(np.float32), far)
    hit = face >= 0
    f, world = np.maximum(face, 0), model.world
    normals = np.einsum("nij,nj->ni", at.rotation[world.face_object[f]], world.normals[f])
    back = hit & ~world.two_sided[f] & (dot(d, normals) > 0)
    hits, backs = (a.reshape(-1, RAYS).sum(axis=1) for a in (hit, back))
    return 2 * backs > hits


# Light ----------------------------------------------------------------------------------------------


def plane_steps(
    model: Model, plane: MeasuringPlane, level: Level, poses: Mapping[str, Pose], levels: np.ndarray, seed: int,
    noise: float = NOISE,
) -> Iterator[PlaneLight]:  # fmt: skip
    """Trace paths from the points of a plane until their noise is small, in steps of some 10 ms; yield the light.

    levels (G, 3): of the lamps; noise: relative l1 noise at the end, that of each point is OF_POINT times it at most.
    Values are nan at first. Raises SceneError for bad poses.
    """
    grid = grid_of(plane, level)
    free = np.flatnonzero(~is_inside(model, model.transforms(poses), grid.positions, level.axes.up))
    points = grid.positions[free]
    up = np.broadcast_to(level.axes.up, points.shape)
    rounds = point_rounds(model, points, up, poses, levels, seed)
    values, errors = np.full(len(grid.positions), np.nan), np.full(len(grid.positions), np.nan)
    if not len(free):
        yield PlaneLight(plane, grid, values, errors, 1.0)
        return
    for E, error, fraction in light_steps(rounds, noise):
        values, errors = values.copy(), errors.copy()
        values[free], errors[free] = E, error
        yield PlaneLight(plane, grid, values, errors, fraction)


def point_rounds(
    model: Model, positions: np.ndarray, normals: np.ndarray, poses: Mapping[str, Pose], levels: np.ndarray, seed: int
) -> ReferenceRounds:
    """Return rounds of paths at points (n, 3) [m] with normals (n, 3); all points count alike."""
    weights = np.ones(len(positions))
    return ReferenceRounds(model.scene, positions, normals, seed, weights, poses, model=model, levels=levels)


def light_steps(rounds: ReferenceRounds, noise: float) -> Iterator[tuple[np.ndarray, np.ndarray, float]]:
    """Trace rounds until their noise is small; yield values (n,), standard errors (n,) and the fraction done.

    nan before round FIRST. The last standard errors are those of ENOUGH sets of paths or more.
    """
    state, weights, fraction = rounds.state, np.ones(len(rounds.state.sets)), 0.0
    E, error = np.full((2, len(weights)), np.nan)
    seen = FIRST - 1
    while fraction < 1:
        rounds.step()
        if state.rounds > seen:
            seen = state.rounds
            E, error = luminance(state.mean), luminance(state.standard_error) / small_sample_bias(state.sets)
            mean, left = float(E.mean()), 0.0
            if mean > 0:
                of_points = float((error / np.maximum(E, DIM * mean)).max())
                left = max(math.sqrt(2 / math.pi) * float(error.mean()) / mean, of_points / OF_POINT) / noise
            done = seen >= ENOUGH and (left <= 1 or state.paths.mean() >= MOST_PATHS)
            now = min(1 / max(left, 1e-9) ** 2, seen / ENOUGH, 0.99)
            fraction = 1.0 if done else max(fraction, now)  # the noise is measured, and may rise again
        yield E.copy(), error.copy(), fraction
