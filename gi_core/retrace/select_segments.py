"""Culling of segments against boxes: those of mobiles, padded by the reach of a disc, and given ones.

Segments near a mobile are many, so tests and copies run on all threads.
"""

from __future__ import annotations

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.threads import run_ranges
from gi_core.base.vec import difference, rotate_back
from gi_core.model import Model
from gi_core.photons.paths import Segments, empty_segments
from gi_core.rays.accelerator import Transforms, passes_box
from gi_core.rays.two_level import CUT_PAD
from gi_core.retrace.broad_phase import PAD

GRAIN = 2048  # segments per thread


def select(model: Model, at: Transforms, segments: Segments, reach: float | None, boxes: np.ndarray) -> np.ndarray:
    """Return (1 + mobiles, n) bool: row 0, the lines that pass any of the boxes; row o, those that pass mobile o's box.

    reach: growth of the mobiles' boxes [m], None leaves their rows False. boxes: (b, 2, 3) float64 [m], corners low and
    high.
    """
    size = model.world.size
    out = np.zeros((len(at.position), segments.size), bool)
    seen = [(0, low, high, CUT_PAD * size) for low, high in boxes]
    if reach is not None:
        low, high, pad = model.world.box_low, model.world.box_high, reach + (PAD + CUT_PAD) * size
        seen += [(o, low[o], high[o], pad) for o in range(1, len(at.position))]

    def work(_, first, last):
        for o, low, high, pad in seen:
            _pass(segments.origin, segments.end, at.rotation[o], at.position[o], low, high, pad, first, last, out[o])

    run_ranges(work, segments.size, model.threads, GRAIN)
    return out


@kernel
def _pass(origin, end, R, p, low, high, pad, first, last, out):
    for k in range(first, last):
        ox, oy, oz = rotate_back(R, difference(origin[k], p))
        ex, ey, ez = rotate_back(R, difference(end[k], p))
        out[k] |= passes_box(ox, oy, oz, ex, ey, ez, low, high, pad)


def copy_selected(parts: list[tuple[Segments, np.ndarray]], threads: int) -> Segments:
    """Return the given rows (n,) int64 of the segments of each part, concatenated, copied on all threads."""
    out, at = empty_segments(sum(len(rows) for _, rows in parts)), 0
    for segments, rows in parts:

        def work(_, first, last, segments=segments, rows=rows, at=at):
            _copy(tuple(segments), rows, first, last, tuple(a[at:] for a in out))

        run_ranges(work, len(rows), threads, GRAIN)
        at += len(rows)
    return out


@kernel
def _copy(segments, rows, first, last, out):
    origin, end, low, high, flux, start_side, end_side, cut_side, hit, photon, bounce, lamp = segments
    origin_, end_, low_, high_, flux_, start_side_, end_side_, cut_side_, hit_, photon_, bounce_, lamp_ = out
    for j in range(first, last):
        k = rows[j]
        for c in range(3):
            origin_[j, c], end_[j, c], hit_[j, c], flux_[j, c] = origin[k, c], end[k, c], hit[k, c], flux[k, c]
        low_[j], high_[j], photon_[j], bounce_[j], lamp_[j] = low[k], high[k], photon[k], bounce[k], lamp[k]
        start_side_[j], end_side_[j], cut_side_[j] = start_side[k], end_side[k], cut_side[k]
