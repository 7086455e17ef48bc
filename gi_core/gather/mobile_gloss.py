"""Directions of the light on mobiles: the paths that light a receiver in a frame, summed into its cells.

A receiver takes only its own shadow rays, as direct light has edges. A ray that reaches its lamp brings light from all
candidates of its stratum (`gather/candidates.py`), in proportion to their unoccluded light. Where shadow divides a
stratum, its highlight is dimmer, not cut. Bounces come in KINDS. A receiver takes those of
the nearest receiver of each kind, carried to its own frame: KINDS times as many directions as it traced.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import inlined, kernel
from gi_core.base.threads import run_ranges
from gi_core.base.vec import dot, rotate, row, weighted
from gi_core.gather.candidates import CANDIDATES, Candidates, thinned, unoccluded
from gi_core.gather.interleaved_mean import CHANCE, NearReceivers
from gi_core.gloss.hemisphere import CELLS, GRAZING, SUMS, add_ray, axes_of, cell_of, weight_of
from gi_core.lights.area import AreaLights
from gi_core.lights.next_event import Shadows

ROOM = 64  # rays that are added at a time: columns of SUMS lines of scratch memory, one after the other
# First columns of these lines: irradiance of three channels, weight times direction in the frame of the normal, weight.
# Unsigned, as LLVM vectorises no loop that checks for negative indices.
RED, GREEN, BLUE, X, Y, Z, WEIGHT = (np.uint64(line * ROOM) for line in range(SUMS))


class DirectLight(NamedTuple):
    """Shadow rays of a batch of receivers that reach their lamps."""

    start: int  # first receiver of the batch, among those of mobiles
    rotation: np.ndarray  # (3, 3) float64, of their mobile
    positions: np.ndarray  # (n, 3) float64 [m], in the world
    lights: AreaLights
    candidates: Candidates  # see for_cells()
    first: np.ndarray  # (n + 1,) int64 into `ray`
    ray: np.ndarray  # (k,) int32 into the next three, in the order of receivers
    stratum: np.ndarray  # (s,) int64 of the candidates, or -1
    direction: np.ndarray  # (s, 3) float32 unit, in the world
    value: np.ndarray  # (s, 3) float64, P times the irradiance [W/m2]


class BouncedLight(NamedTuple):
    """Bounced light of a frame at the receivers of mobiles, path by path."""

    normals: np.ndarray  # (m, 3) float64, in the object's space
    near: NearReceivers
    kinds: np.ndarray  # (m,) int64, of the bounces
    directions: np.ndarray  # (KINDS, 3, P) float32 unit, of bounces, in the frame of a normal
    close: np.ndarray  # (m,) float64, closeness() of the bounces [1/m]
    light: np.ndarray  # (m, 3, P) float32, P times the irradiance by each bounce [W/m2]; of glossy mobiles alone


class Scratch(NamedTuple):
    """Scratch memory of a thread for cells with strata and candidates of lamps."""

    ready: np.ndarray  # (SUMS ROOM,) float32
    cell: np.ndarray  # (ROOM,) int32
    sums: np.ndarray  # (CELLS, SUMS) float32
    reached: np.ndarray  # (strata,) bool, False before and after
    light: np.ndarray  # (candidates,) float64

    @classmethod
    def of(cls, candidates: Candidates) -> Scratch:
        """Return scratch memory for candidates."""
        ready, sums = np.empty(SUMS * ROOM, np.float32), np.empty((CELLS, SUMS), np.float32)
        strata, light = np.zeros(len(candidates.pick), bool), np.empty(len(candidates.face))
        return cls(ready, np.empty(ROOM, np.int32), sums, strata, light)


class PathLight(NamedTuple):
    """Light of a frame at the receivers of mobiles, path by path."""

    bounced: BouncedLight
    direct: list[DirectLight]  # of glossy mobiles

    def write_cells(
        self, rows: np.ndarray, place: np.ndarray, resting: np.ndarray, out: np.ndarray, threads: int
    ) -> None:
        """Write the cells (k, CELLS, 6) of receivers rows (k,), ascending, as those of a GlossLight.

        Rows place (k,) of `resting` have the directions of cells without light.
        """
        parts = [(d, *np.searchsorted(rows, (d.start, d.start + len(d.positions)))) for d in self.direct]

        def work(_, begin, end):
            for d, first, last in parts:
                a, b = max(first, begin), min(last, end)
                if a < b:
                    _write(rows[a:b], d, self.bounced, place[a:b], resting, Scratch.of(d.candidates), out[a:b])

        run_ranges(work, len(rows), threads, 64)  # 64 receivers per thread


def for_cells(of: Candidates) -> Candidates:
    """Return all candidates where they are few, at last one of each stratum: more in a cell add time alone."""
    halvings = (max(len(of.face) - 1, 0) // ROOM).bit_length()
    return thinned(of, min(1 << halvings, CANDIDATES))


def direct_light(
    rows: slice, rotation: np.ndarray, positions: np.ndarray, lights: AreaLights, candidates: Candidates, rays: Shadows,
    blocked: np.ndarray,
) -> DirectLight:  # fmt: skip
    """Return the rays that are not blocked, from receivers rows of a mobile at positions (n, 3) [m]."""
    first = np.zeros(rows.stop - rows.start + 1, np.int64)
    ray = np.empty(len(blocked), np.int32)
    _order(rays.row, blocked, first, ray)
    return DirectLight(
        rows.start, rotation, positions, lights, candidates, first, ray, rays.stratum, rays.direction, rays.value
    )


@kernel
def _order(rows, blocked, first, ray):
    """Write free rays in the order of receivers; first (n + 1,): zeros before, place of the first ray of each after."""
    for j in range(len(rows)):
        if not blocked[j]:
            first[rows[j]] += 1
    total = 0
    for i in range(len(first)):
        total += first[i]
        first[i] = total  # the end of each
    for j in range(len(rows) - 1, -1, -1):
        if not blocked[j]:
            first[rows[j]] -= 1
            ray[first[rows[j]]] = j


@kernel
def _write(rows, direct, bounced, place, resting, room, out):
    """Write the cells (k, CELLS, 6) of receivers rows (k,) of a batch: direct: DirectLight; bounced: BouncedLight;
    room: Scratch.
    """
    ready, cell, sums, reached, light = room
    near, paths = bounced.near, bounced.directions.shape[2]
    for r in range(len(rows)):
        i = rows[r]
        frame, seen, total = axes_of(bounced.normals[i]), 0, np.float32(0.0)
        sums[:] = np.float32(0.0)
        for k in range(near.first[i], near.first[i + 1]):
            j = near.of[k]
            kind = bounced.kinds[j]
            if (seen >> kind) & 1:
                continue
            seen |= 1 << kind
            c = max(bounced.close[i], bounced.close[j])
            share = np.float32(1.0 / (1.0 + CHANCE * paths * (near.apart[k] * c * c + near.turned[k])))
            total += share
            turn = _between(frame, axes_of(bounced.normals[j]))
            for p in range(0, paths, ROOM):
                n = min(ROOM, paths - p)
                _take_bounces(turn, bounced.directions[kind], share, bounced.light[j], p, n, ready)
                _add(ready, n, cell, sums)
        R, n, is_reached = direct.rotation, 0, False
        turned = rotate(R, frame[0]), rotate(R, frame[1]), rotate(R, frame[2])
        for k in range(direct.first[i - direct.start], direct.first[i - direct.start + 1]):
            e = direct.ray[k]
            if direct.stratum[e] >= 0:
                is_reached = reached[direct.stratum[e]] = True
                continue
            _put(turned, row(direct.direction, e), total, row(direct.value, e), n, ready)
            n += 1
            if n == ROOM:
                _add(ready, n, cell, sums)
                n = 0
        _add(ready, n, cell, sums)
        if is_reached:
            at, scale = row(direct.positions, i - direct.start), total * np.float32(paths / len(light))
            unoccluded(direct.candidates, np.uint64(0), at, turned[2], direct.lights, light)
            _forget_unreached(reached, light)
            for begin in range(0, len(light), ROOM):
                n = min(ROOM, len(light) - begin)
                _put_candidates(turned, at, direct.candidates, scale, light, begin, n, ready)
                _add(ready, n, cell, sums)
        _normalise(sums, frame, resting[place[r]], out[r])


@inlined
def _between(to, frame):
    """Return the rotation from one frame to another, as nine numbers."""
    a, b, c = to
    x, y, z = frame
    return (
        np.float32(dot(a, x)), np.float32(dot(a, y)), np.float32(dot(a, z)),
        np.float32(dot(b, x)), np.float32(dot(b, y)), np.float32(dot(b, z)),
        np.float32(dot(c, x)), np.float32(dot(c, y)), np.float32(dot(c, z)),
    )  # fmt: skip


@inlined
def _take_bounces(turn, directions, share, light, p, n, ready):
    """Write n bounces, times share: columns p and following of directions (3, P), turned, and of light (3, P)."""
    ax, ay, az, bx, by, bz, cx, cy, cz = turn
    for k in range(np.uint64(n)):
        j = np.uint64(p) + k
        x, y, z = directions[0, j], directions[1, j], directions[2, j]
        ready[X + k] = ax * x + ay * y + az * z
        ready[Y + k] = bx * x + by * y + bz * z
        ready[Z + k] = cx * x + cy * y + cz * z
        ready[RED + k], ready[GREEN + k], ready[BLUE + k] = (
            share * light[0, j],
            share * light[1, j],
            share * light[2, j],
        )


@inlined
def _put(frame, direction, share, light, n, ready):
    """Write ray n of a unit direction in the world, with share times its light; axes of the receiver in the world."""
    k, (a, b, c) = np.uint64(n), frame
    ready[RED + k], ready[GREEN + k], ready[BLUE + k] = share * light[0], share * light[1], share * light[2]
    ready[X + k], ready[Y + k], ready[Z + k] = dot(direction, a), dot(direction, b), dot(direction, c)


@inlined
def _put_candidates(frame, position, of, share, light, first, n, ready):
    """Write n candidates, from `first` on, with share times their light."""
    for k in range(np.uint64(n)):
        i = np.uint64(first) + k
        x, y, z = of.point[0, i] - position[0], of.point[1, i] - position[1], of.point[2, i] - position[2]
        scale, bright = 1.0 / math.sqrt(max(x * x + y * y + z * z, 1e-300)), share * light[i]
        colour = of.colour[0, i], of.colour[1, i], of.colour[2, i]
        _put(frame, (scale * x, scale * y, scale * z), bright, colour, k, ready)


@kernel
def _forget_unreached(reached, light):
    """Set the light of the candidates of strata that no ray reached to 0, and forget those that are."""
    size = len(light) // len(reached)
    for j in range(len(reached)):
        if not reached[j]:
            light[j * size : (j + 1) * size] = 0.0
        reached[j] = False


@inlined
def _add(ready, n, cell, sums):
    """Add n rays (red, green, blue, x, y, z) to their cells. Two loops: LLVM vectorises the first."""
    for k in range(np.uint64(n)):
        x, y, z = ready[X + k], ready[Y + k], ready[Z + k]
        cell[k] = cell_of(x, y, z)
        weight = weight_of(ready[RED + k] + ready[GREEN + k] + ready[BLUE + k], z, np.float32(GRAZING))
        ready[X + k], ready[Y + k], ready[Z + k], ready[WEIGHT + k] = weight * x, weight * y, weight * z, weight
    for k in range(np.uint64(n)):
        light, moment = (ready[RED + k], ready[GREEN + k], ready[BLUE + k]), (ready[X + k], ready[Y + k], ready[Z + k])
        add_ray(sums[cell[k]], light, moment, ready[WEIGHT + k])


@inlined
def _single(v):
    return np.float32(v[0]), np.float32(v[1]), np.float32(v[2])


@kernel
def _normalise(sums, frame, resting, out):
    """Write shares and mean directions, in the object's space, of sums (CELLS, SUMS) in the frame of a normal."""
    none, one = np.float32(0.0), np.float32(1.0)
    red = green = blue = none
    for c in range(CELLS):
        red, green, blue = red + sums[c, 0], green + sums[c, 1], blue + sums[c, 2]
    red, green, blue = (
        one / red if red > none else none,
        one / green if green > none else none,
        (one / blue if blue > none else none),
    )
    a, b, c = _single(frame[0]), _single(frame[1]), _single(frame[2])
    for k in range(CELLS):
        of, to = sums[k], out[k]
        x, y, z = of[3], of[4], of[5]
        size = max(math.sqrt(x * x + y * y + z * z), of[6])
        # Without a branch, which would be guessed wrong for every other cell.
        lit = size > none
        scale = one / (size if lit else one)
        x, y, z = weighted((scale * x, scale * y, scale * z), a, b, c)
        u, v, w = resting[k, 3], resting[k, 4], resting[k, 5]
        to[0], to[1], to[2] = red * of[0], green * of[1], blue * of[2]
        to[3], to[4], to[5] = x if lit else u, y if lit else v, z if lit else w
