"""Broad phase: background segments near a mobile, by a conservative test of all of them at 6 bytes per vertex.

Path vertices are rounded to 65,536 levels per axis over the reach of light. Vector instructions test segments against
the mobiles' bounding spheres, grown by the rounding. At a million photons memory bounds the time: half the bytes take
half the time. A hierarchy over bundled segments was tried: sorting takes a second per million photons, and a third of
the blocks of cornell lie near the pawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import inlined, kernel, lowest_bit
from gi_core.base.threads import run_ranges
from gi_core.photons.paths import PathVertices, grown
from gi_core.rays.accelerator import FAR, Transforms
from gi_core.rays.all_objects import World

LANES = 16  # segments per vector test
PAD = 1e-3  # of the world's size: covers the rounding of the test; the grid's is one level
QUANTISATION = 65_535


class Grid(NamedTuple):
    """Quantisation of positions: level = (x - low) * per_metre."""

    low: np.ndarray  # (3,) float64 [m]
    per_metre: float


class Coarse(NamedTuple):
    """Quantised path vertices, photon-major, padded by LANES vertices of later photons or of none."""

    x: np.ndarray  # (n + LANES,) uint16
    y: np.ndarray
    z: np.ndarray
    photon: np.ndarray  # (n + LANES,) int32, -1: none
    grid: Grid


def grid_for(world: World, centre: np.ndarray, radius: float) -> Grid:
    """Return the grid that covers all path vertices of a scene.

    Paths start on the static part or within 1.5 `radius` [m] of `centre` (3,), and end at most FAR world sizes away.
    """
    reach = 1.5 * max(radius, 0.5 * world.size) + 1.01 * FAR * world.size
    return Grid(np.asarray(centre, np.float64) - reach, QUANTISATION / (2 * reach))


def same_grid(a: Grid, b: Grid) -> bool:
    return np.array_equal(a.low, b.low) and a.per_metre == b.per_metre


class CoarseStore:
    """Append-only store of the quantised vertices of photons 0 .. N - 1."""

    def __init__(self, grid: Grid):
        self.grid = grid
        self._levels = [np.zeros(LANES, np.uint16) for _ in range(3)]
        self._photon = np.full(LANES, -1, np.int32)
        self._count = 0

    def copied(self) -> CoarseStore:
        """Return a copy."""
        other, n = CoarseStore(self.grid), self._count
        other._levels, other._photon = [a[: n + LANES].copy() for a in self._levels], self._photon[: n + LANES].copy()
        other._photon[n:], other._count = -1, n
        return other

    def append(self, parts: Sequence[PathVertices], first: int, room: int, threads: int) -> None:
        """Append the paths of photons from `first` on, part by part; `room`: number of vertices to reserve."""
        photons = np.cumsum([first, *(len(p.offsets) - 1 for p in parts)])
        starts = np.cumsum([self._count, *(len(p.side) for p in parts)])
        n = int(starts[-1])
        room = max(room, n) + LANES
        self._levels, self._photon = [grown(a, room) for a in self._levels], grown(self._photon, room)

        def work(_, a, b):
            for p, photon, start in zip(parts[a:b], photons[a:b], starts[a:b], strict=True):
                _round(p.offsets, p.position, *self.grid, photon, start, *self._levels, self._photon)

        run_ranges(work, len(parts), threads, 1)
        self._photon[n : n + LANES] = -1
        self._count = n

    def subset(self, vertices: int) -> Coarse:
        """Return views of the first `vertices` vertices."""
        n = vertices + LANES
        return Coarse(*(a[:n] for a in self._levels), self._photon[:n], self.grid)


@kernel
def _round(offsets, position, low, per_metre, first, row, x, y, z, photon):
    for i in range(len(offsets) - 1):
        for k in range(offsets[i], offsets[i + 1]):
            x[row] = np.uint16(min(max((position[k, 0] - low[0]) * per_metre + 0.5, 0.0), float(QUANTISATION)))
            y[row] = np.uint16(min(max((position[k, 1] - low[1]) * per_metre + 0.5, 0.0), float(QUANTISATION)))
            z[row] = np.uint16(min(max((position[k, 2] - low[2]) * per_metre + 0.5, 0.0), float(QUANTISATION)))
            photon[row] = first + i
            row += 1


@inlined
def _near(x, y, z, first, cx, cy, cz, r2):
    """Return a bit mask of the LANES segments from vertex `first` on that pass within a sphere.

    The nearest point of each is computed without branches or divisions in a loop of fixed length: LLVM vectorises it.
    """
    bits = np.uint32(0)
    for lane in range(np.uint64(LANES)):
        k = np.uint64(first) + lane
        ox, oy, oz = np.float32(x[k]), np.float32(y[k]), np.float32(z[k])
        dx, dy, dz = (
            np.float32(x[k + np.uint64(1)]) - ox,
            np.float32(y[k + np.uint64(1)]) - oy,
            np.float32(z[k + np.uint64(1)]) - oz,
        )
        ax, ay, az = cx - ox, cy - oy, cz - oz
        length2 = dx * dx + dy * dy + dz * dz
        along = min(max(ax * dx + ay * dy + az * dz, np.float32(0.0)), length2)
        # Both sides are multiplied by length2, which saves a division.
        px, py, pz = along * dx - length2 * ax, along * dy - length2 * ay, along * dz - length2 * az
        yes = px * px + py * py + pz * pz <= r2 * length2 * length2
        bits = np.uint32(bits | np.uint32(np.uint32(yes) << np.uint32(lane)))
    return bits


@kernel
def _scan(x, y, z, first, last, centres, radii, out):
    """List the vertices first .. last - 1 whose segment to the next vertex passes near any mobile; return their number.

    out (last - first,).
    """
    n = 0
    for block in range(first, last, LANES):
        bits = np.uint32(0)
        for m in range(len(radii)):
            bits = np.uint32(
                bits | _near(x, y, z, block, centres[m, 0], centres[m, 1], centres[m, 2], radii[m] * radii[m])
            )
        while bits != 0:
            k = block + lowest_bit(bits)
            bits &= bits - np.uint32(1)
            if k < last:
                out[n] = k
                n += 1
    return n


@kernel
def _segments_only(photon, rows, photons):
    """Drop the last vertices of paths, which start no segment, and write photons; return the number of rows left.

    A separate loop, so that its memory accesses are independent and overlap.
    """
    n = 0
    for j in range(len(rows)):
        k = rows[j]
        rows[n], photons[n] = k, photon[k]
        n += photon[k] == photon[k + 1]
    return n


def find_near(world: World, coarse: Coarse, at: Transforms, margin, threads: int) -> tuple[np.ndarray, np.ndarray]:
    """Return photon and vertex (n,) int64 of background segments within a margin of a mobile's sphere, in order.

    margin: [m], one number or (mobiles,).
    """
    grid = coarse.grid
    centres = np.empty((len(at.position) - 1, 3), np.float32)
    for o in range(1, len(at.position)):
        c, R = world.sphere_centre[o], at.rotation[o]
        for i in range(3):
            x = R[i, 0] * c[0] + R[i, 1] * c[1] + R[i, 2] * c[2] + at.position[o, i]
            centres[o - 1, i] = (x - grid.low[i]) * grid.per_metre
    radii = ((world.sphere_radius[1:] + margin + PAD * world.size) * grid.per_metre + 2).astype(np.float32)
    vertices, levels = len(coarse.photon) - LANES, (coarse.x, coarse.y, coarse.z)

    def work(_, first, last):
        rows = np.empty(last - first, np.int64)  # untouched memory costs nothing
        n = _scan(*levels, first, last, centres, radii, rows)
        photons = np.empty(n, np.int64)
        n = _segments_only(coarse.photon, rows[:n], photons)
        return photons[:n], rows[:n]

    photons, rows = zip(*run_ranges(work, vertices, threads, 1 << 16), strict=True)  # 1 << 16 vertices per thread
    return np.concatenate(photons), np.concatenate(rows)
