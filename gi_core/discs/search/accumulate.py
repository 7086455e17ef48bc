"""Accepted candidates are added to the sums. They are listed first: memory accesses overlap in a separate loop."""

from __future__ import annotations

from gi_core.base.jit import inlined, kernel
from gi_core.base.vec import difference, dot
from gi_core.discs.search.predicate import accepts, receiver
from gi_core.photons.flux_sums import CHUNK_BITS

LISTED_AT_ONCE = 2048  # candidates listed before they are added


@inlined
def record(log, k, i, centre, normal, lines):
    """Write the intersection of line k with the disc of receiver i to the log, with the bits of t that decided it."""
    at = log.count[0]
    log.count[0] = at + 1
    if at < len(log.line):
        log.line[at], log.receiver[at] = k, i
        log.distance[at] = dot(difference(centre, lines.origin[k]), normal) / dot(lines.direction[k], normal)


@kernel
def add_accepted(n, candidates, blocks, discs, lines, sign, sums):
    """Add sign x flux of the accepted ones of n candidates (line, entry of blocks); return their number."""
    total, room = 0, len(sums.log.line)
    for f in range(n):
        k = candidates[f, 0]
        i, centre, normal = receiver(blocks, candidates[f, 1], lines.direction[k])
        if i >= 0 and accepts(discs, i, centre, normal, lines, k):
            total += 1
            for c in range(3):
                sums.flux[i, 3 * lines.lamp[k] + c] += sign * lines.flux[k, c]
            sums.touched[(sums.first + i) >> CHUNK_BITS] = True
            if room > 0:
                record(sums.log, k, i, centre, normal, lines)
    return total
