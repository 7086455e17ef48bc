"""Culling of segments against boxes: those of mobiles, padded by the reach of a disc, and given ones.

Segments near a mobile are many, so tests run on all threads.
"""

from __future__ import annotations

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.threads import run_ranges
from gi_core.base.vec import difference, rotate_back
from gi_core.model import Model
from gi_core.rays.accelerator import CUT_PAD, Transforms, passes_box
from gi_core.retrace.broad_phase import PAD

GRAIN = 2048  # segments per thread


def select(
    model: Model, at: Transforms, origin: np.ndarray, end: np.ndarray, reach: float | None, boxes: np.ndarray
) -> np.ndarray:
    """Return (1 + mobiles, n) bool: row 0, the lines that pass any of the boxes; row o, those that pass mobile o's box.

    origin, end: (n, 3) float32 [m], of the lines.
    reach: growth of the mobiles' boxes [m], None leaves their rows False. boxes: (b, 2, 3) float64 [m], corners low and
    high.
    """
    size = model.world.size
    out = np.zeros((len(at.position), len(origin)), bool)
    seen = [(0, low, high, CUT_PAD * size) for low, high in boxes]
    if reach is not None:
        low, high, pad = model.world.box_low, model.world.box_high, reach + (PAD + CUT_PAD) * size
        seen += [(o, low[o], high[o], pad) for o in range(1, len(at.position))]

    def work(_, first, last):
        for o, low, high, pad in seen:
            _pass(origin, end, at.rotation[o], at.position[o], low, high, pad, first, last, out[o])

    run_ranges(work, len(origin), model.threads, GRAIN)
    return out


@kernel
def _pass(origin, end, R, p, low, high, pad, first, last, out):
    for k in range(first, last):
        ox, oy, oz = rotate_back(R, difference(origin[k], p))
        ex, ey, ez = rotate_back(R, difference(end[k], p))
        out[k] |= passes_box(ox, oy, oz, ex, ey, ez, low, high, pad)
