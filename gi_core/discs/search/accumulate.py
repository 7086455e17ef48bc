"""What crossings found add to the sums: listed first, because the accesses of a loop of its own overlap."""

from __future__ import annotations

from gi_core.base.jit import inlined, kernel
from gi_core.discs.search.predicate import counts, receiver
from gi_core.photons.flux_sums import CHUNK_BITS

ROOM = 2048  # crossings that are listed before they are added


@inlined
def note(log, k, i, x, y, z, nx, ny, nz, ox, oy, oz, dx, dy, dz):
    """Write down that line k crosses the disc of receiver i, and where: the bits of t that decided it."""
    at = log.count[0]
    log.count[0] = at + 1
    if at < len(log.line):
        ax, ay, az = x - ox, y - oy, z - oz
        log.line[at], log.receiver[at] = k, i
        log.distance[at] = (ax * nx + ay * ny + az * nz) / (dx * nx + dy * ny + dz * nz)


@kernel
def add_found(
    n, found, data, front, behind, own, row, reach, r2, origin, direction, stop, flux, patches, touches, sign, sums,
    touched, base, log,
):  # fmt: skip
    """Add sign x flux of the first n pairs (line, entry of blocks) that count to the sums; returns how many do."""
    total, room = 0, len(log.line)
    for f in range(n):
        k = found[f, 0]
        ox, oy, oz = origin[k, 0], origin[k, 1], origin[k, 2]
        dx, dy, dz = direction[k, 0], direction[k, 1], direction[k, 2]
        i, x, y, z, mx, my, mz = receiver(data, front, behind, found[f, 1], dx, dy, dz)
        if i >= 0 and counts(
            i, x, y, z, mx, my, mz, k, ox, oy, oz, dx, dy, dz, stop[k], r2, own, row, reach, patches, touches
        ):
            total += 1
            for c in range(3):
                sums[i, c] += sign * flux[k, c]
            touched[(base + i) >> CHUNK_BITS] = True
            if room > 0:
                note(log, k, i, x, y, z, mx, my, mz, ox, oy, oz, dx, dy, dz)
    return total
