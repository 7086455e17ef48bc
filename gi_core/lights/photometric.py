"""Luminaires: intensity by tables over C-planes and gamma, bilinear in both angles (CIE 121, type C).

They radiate from a point, or evenly from a rectangle, whose halves are area lights that nothing hits.

Gamma is the angle from the luminaire's axis, C the angle about the axis, from C0 towards C90 = C0 x axis. Directions
are drawn in proportion to the interpolated intensity. Gamma follows its marginal density, a linear function times
sin(gamma) in each interval, then C its conditional density, which is piecewise linear. Both cumulative distributions
are inverted to rounding, so draws and `density` belong to the same function. Both maps are monotone, so stratified
numbers stay stratified.

A table in `tables` is a run of float64: T, P, gammas (T) [rad], planes (P) [rad], density (T, P) [1/sr], its integral
over C up to each plane (T, P), and the share of the light below each gamma (T).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.random_numbers import interval
from gi_core.base.vec import cross, dot, weighted
from gi_core.lights import point
from gi_core.scene.types import Light, PhotometricLight, Scene

RECORD = PhotometricLight
TABLE = 11  # place of the start in `tables` among the parameters


def parameters(light: PhotometricLight, _around, table: int) -> list:
    """Return position (3), axis (3), C0 (3), half the size along C0 and C90, start in `tables`."""
    axis, c0 = axes(light)
    return [light.position, axis, c0, np.array(light.size) / 2, [table]]


def flux(light: PhotometricLight, _around) -> np.ndarray:
    return np.array(light.flux, float)


def value(light: PhotometricLight) -> np.ndarray | None:
    """Return the flux (3,) [W]; None: it has a size."""
    return None if has_size(light) else np.array(light.flux, float)


def has_size(light: Light) -> bool:
    return isinstance(light, PhotometricLight) and min(light.size) > 0


@kernel
def emit(p, tables, u, v, s, t):
    gamma, plane = drawn(tables, int(p[TABLE]), s, t)
    c90 = cross(p[6:9], p[3:6])
    r = math.sin(gamma)
    way = weighted((r * math.cos(plane), r * math.sin(plane), math.cos(gamma)), p[6:9], c90, p[3:6])
    ax, ay, az = weighted(((2.0 * u - 1.0) * p[9], (2.0 * v - 1.0) * p[10], 0.0), p[6:9], c90, p[3:6])
    return (p[0] + ax, p[1] + ay, p[2] + az), way


@kernel
def arrive(p, tables, position, normal, far):
    strength, x, y, z, d = point.arrive(p, tables, position, normal, far)
    return strength * density(tables, int(p[TABLE]), p[3:6], p[6:9], -x, -y, -z), x, y, z, d


class Panels(NamedTuple):
    """Halves of the rectangles of luminaires that have a size."""

    corners: np.ndarray  # (n, 3, 3) float64 [m]
    normal: np.ndarray  # (n, 3) float64 unit
    radiance: np.ndarray  # (n, 3) float64 [W/m2/sr], of a diffuse face of the same flux
    area: np.ndarray  # (n,) float64 [m2]
    light: np.ndarray  # (n,) int64, into the scene's lights
    c0: np.ndarray  # (n, 3) float64 unit


def panels(scene: Scene | None) -> Panels:
    """Return the halves of the rectangles of a scene's luminaires."""
    rows = []
    for i, light in enumerate(scene.lights if scene is not None else ()):
        if not has_size(light) or max(light.flux) <= 0:
            continue
        axis, c0 = axes(light)
        a, b = 0.5 * light.size[0] * c0, 0.5 * light.size[1] * np.cross(c0, axis)
        p, area = np.array(light.position, float), 0.5 * light.size[0] * light.size[1]
        radiance = np.array(light.flux, float) / (math.pi * 2 * area)
        for triangle in ((p - a - b, p + a - b, p + a + b), (p - a - b, p + a + b, p - a + b)):
            rows.append((np.stack(triangle), axis, radiance, area, i, c0))
    shapes = (3, 3), (3,), (3,), (), (), (3,)
    columns = zip(*rows, strict=True) if rows else ((),) * 6
    kinds = (float, float, float, float, np.int64, float)
    return Panels(*(np.array(c, k).reshape(-1, *s) for c, k, s in zip(columns, kinds, shapes, strict=True)))


def tables_of(lights: tuple[Light, ...]) -> tuple[np.ndarray, list[int]]:
    """Return the tables of all lights as one array (n,) float64, and the start of each light's, -1 without one.

    Lights that share their intensity share a table.
    """
    parts, start_of, starts, size = [np.zeros(0)], dict[int, int](), [], 0
    for light in lights:
        if not isinstance(light, PhotometricLight):
            starts.append(-1)
            continue
        if id(light.intensity) not in start_of:
            start_of[id(light.intensity)] = size
            parts.append(_table(light))
            size += len(parts[-1])
        starts.append(start_of[id(light.intensity)])
    return np.concatenate(parts), starts


def axes(light: PhotometricLight) -> tuple[np.ndarray, np.ndarray]:
    """Return the unit vectors (3,) of a luminaire's axis and of C0, made perpendicular to it."""
    axis, c0 = (np.array(v, np.float64) for v in (light.direction, light.c0))
    axis /= np.sqrt((axis * axis).sum())
    c0 = c0 / np.sqrt((c0 * c0).sum())
    c0 -= (c0 * axis).sum() * axis
    return axis, c0 / np.sqrt((c0 * c0).sum())


def flux_of(gammas: np.ndarray, planes: np.ndarray, intensity: np.ndarray) -> float:
    """Return the flux of intensity (P, T), bilinear in planes (P,) and gammas (T,) [degrees]: its integral [lm]."""
    gamma, plane = np.radians(gammas), np.radians(planes)
    return float(_shares(gamma, _across(plane, intensity.T)[:, -1])[-1])


def share_ahead(light: PhotometricLight) -> float:
    """Return the share of a luminaire's flux within 90 degrees of its axis."""
    gammas, planes, intensity = light.gammas_degrees, light.planes_degrees, light.intensity
    ahead = gammas[gammas < 90.0]
    if not len(ahead) or len(ahead) == len(gammas):
        return float(len(ahead) > 0)
    across = np.array([np.interp(90.0, gammas, row) for row in intensity])[:, None]
    part = flux_of(np.append(ahead, 90.0), planes, np.concatenate([intensity[:, : len(ahead)], across], axis=1))
    return part / flux_of(gammas, planes, intensity)


def _table(light: PhotometricLight) -> np.ndarray:
    gamma, plane = np.radians(light.gammas_degrees), np.radians(light.planes_degrees)
    flux = flux_of(light.gammas_degrees, light.planes_degrees, light.intensity)
    density = np.ascontiguousarray(light.intensity.T, np.float64) / flux
    across = _across(plane, density)
    below = _shares(gamma, across[:, -1])
    return np.concatenate([(len(gamma), len(plane)), gamma, plane, density.ravel(), across.ravel(), below / below[-1]])


def _across(plane: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the integral over C of values (T, P), up to each plane, (T, P)."""
    steps = 0.5 * np.diff(plane) * (values[:, 1:] + values[:, :-1])
    return np.concatenate([np.zeros((len(values), 1)), np.cumsum(steps, axis=1)], axis=1)


def _shares(gamma: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Return the integral of row (T,), linear in gamma, times sin(gamma), up to each gamma, (T,)."""
    slope = np.diff(row) / np.diff(gamma)
    sine, cosine = np.sin(gamma), np.cos(gamma)
    steps = row[:-1] * (cosine[:-1] - cosine[1:]) + slope * (np.diff(sine) - np.diff(gamma) * cosine[1:])
    return np.concatenate([[0.0], np.cumsum(np.maximum(steps, 0.0))])


@kernel
def drawn(tables, start, u, v):
    """Return gamma and C [rad] of a direction drawn from a table by u, v in [0, 1)."""
    rows, columns = int(tables[start]), int(tables[start + 1])
    gammas = start + 2
    planes = gammas + rows
    density, across = planes + columns, planes + columns + rows * columns
    below = across + rows * columns
    k = interval(tables, below, below, 0.0, rows, u)
    low, high = tables[gammas + k], tables[gammas + k + 1]
    full = across + columns - 1  # of row k, the integral over all C
    first, last = tables[full + k * columns], tables[full + (k + 1) * columns]
    share = tables[below + k + 1] - tables[below + k]
    part = min(max((u - tables[below + k]) / share, 0.0), 1.0) if share > 0.0 else 0.0
    gamma = _gamma(low, high, first, last, part)
    w = min(max((gamma - low) / (high - low), 0.0), 1.0)
    # The same interpolation of the running integral over C.
    a, b = across + k * columns, across + (k + 1) * columns
    right = columns - 1
    target = v * ((1.0 - w) * tables[a + right] + w * tables[b + right])
    left = interval(tables, a, b, w, columns, target)
    rest = target - ((1.0 - w) * tables[a + left] + w * tables[b + left])
    a, b = density + k * columns + left, density + (k + 1) * columns + left
    value = (1.0 - w) * tables[a] + w * tables[b]
    step = tables[planes + left + 1] - tables[planes + left]
    slope = ((1.0 - w) * tables[a + 1] + w * tables[b + 1] - value) / step
    root = value + math.sqrt(max(value * value + 2.0 * slope * rest, 0.0))
    return gamma, tables[planes + left] + (min(2.0 * rest / root, step) if root > 0.0 else 0.0)


@kernel
def _gamma(low, high, first, last, part):
    """Return gamma below which the interval from low to high has a part of its light.

    Its density is sin(gamma) times a linear function, `first` at low and `last` at high.
    """
    slope, start, sine = (last - first) / (high - low), math.cos(low), math.sin(low)
    all_of_it = first * (start - math.cos(high)) + slope * (math.sin(high) - sine - (high - low) * math.cos(high))
    target = part * all_of_it
    a, b = low, high
    x = low + part * (high - low)
    for _ in range(60):  # at most 60 steps of Newton's method with bisection; some 5 suffice
        cosine, sin = math.cos(x), math.sin(x)
        over = first * (start - cosine) + slope * (sin - sine - (x - low) * cosine) - target
        if over > 0.0:
            b = x
        else:
            a = x
        rate = (first + slope * (x - low)) * sin
        new = x - over / rate if rate > 0.0 else 0.5 * (a + b)
        if not a < new < b:
            new = 0.5 * (a + b)
        if abs(new - x) <= 1e-15 * high:
            break
        x = new
    return x


@kernel
def density(tables, start, axis, c0, x, y, z):
    """Return intensity / flux [1/sr] in a unit direction (x, y, z), for unit vectors of the axis and of C0."""
    rows, columns = int(tables[start]), int(tables[start + 1])
    gammas = start + 2
    planes = gammas + rows
    values = planes + columns
    a, b = dot((x, y, z), c0), dot((x, y, z), cross(c0, axis))
    gamma, plane = math.atan2(math.sqrt(a * a + b * b), dot((x, y, z), axis)), math.atan2(b, a)
    if plane < 0.0:
        plane += 2.0 * math.pi
    if not tables[gammas] <= gamma <= tables[gammas + rows - 1]:
        return 0.0
    k = interval(tables, gammas, gammas, 0.0, rows, gamma)
    j = interval(tables, planes, planes, 0.0, columns, plane)
    w = (gamma - tables[gammas + k]) / (tables[gammas + k + 1] - tables[gammas + k])
    s = min((plane - tables[planes + j]) / (tables[planes + j + 1] - tables[planes + j]), 1.0)
    one, two = values + k * columns + j, values + (k + 1) * columns + j
    return (1.0 - w) * ((1.0 - s) * tables[one] + s * tables[one + 1]) + w * (
        (1.0 - s) * tables[two] + s * tables[two + 1]
    )
