"""Bodies with blended limbs: the cat of the living room, the pierced stone of the gallery."""

from __future__ import annotations

import numpy as np

from scenes.implicit import blend, ellipsoid, limb, polygonised, smooth_least
from scenes.modelling import Shape

CAT_CELL = 0.0205  # [m]: 1,300 vertices; every one of them is estimated in every frame
STONE_CELL = 0.048  # likewise, 1,700


def cat() -> Shape:
    """Return a cat that walks along +z, 0.5 m from nose to rump, its paws on y = 0.

    uv: u along the body (stripes), v from belly (0) to back (1).
    """
    body = [
        limb((0, 0.215, -0.13), (0, 0.225, 0.10), 0.070, 0.066),
        limb((0, 0.225, 0.10), (0, 0.290, 0.185), 0.056, 0.046),  # neck
        ellipsoid((0, 0.322, 0.215), (0.062, 0.054, 0.058)),
        ellipsoid((0, 0.300, 0.262), (0.029, 0.023, 0.026)),  # muzzle
    ]
    legs = []
    for side in (-1, 1):
        stride = 0.030 * side
        fore, hind = (side * 0.043, 0.020, 0.125 + stride), (side * 0.044, 0.020, -0.150 - stride)
        hock = (side * 0.048, 0.105, -0.165 - stride)
        legs += [
            limb((side * 0.040, 0.20, 0.115), fore, 0.034, 0.020),
            limb(fore, np.add(fore, (0, -0.003, 0.026)), 0.020, 0.017),
            limb((side * 0.042, 0.20, -0.135), hock, 0.050, 0.027),
            limb(hock, hind, 0.025, 0.020),
            limb(hind, np.add(hind, (0, -0.003, 0.028)), 0.020, 0.017),
        ]
    tail = [
        limb((0, 0.245, -0.185), (0, 0.325, -0.255), 0.026, 0.021),
        limb((0, 0.325, -0.255), (0, 0.425, -0.262), 0.021, 0.019),
        limb((0, 0.425, -0.262), (0, 0.490, -0.225), 0.020, 0.019),
    ]
    ears = [limb((s * 0.033, 0.345, 0.208), (s * 0.050, 0.394, 0.200), 0.027, 0.015) for s in (-1, 1)]
    trunk, legs, tail, ears = blend(body, 0.045), blend(legs, 0.006), blend(tail, 0.02), blend(ears, 0.004)

    def field(p):
        standing = smooth_least(trunk(p), legs(p), 0.035)  # legs blend with the trunk, hardly with each other
        return smooth_least(smooth_least(standing, tail(p), 0.03), ears(p), 0.016)

    shape = polygonised(field, (-0.13, -0.03, -0.33), (0.13, 0.55, 0.33), CAT_CELL)
    v = shape.vertices - [0, shape.vertices[:, 1].min(), 0]
    along = v[:, 2] - 0.35 * np.maximum(v[:, 1] - 0.28, 0)
    up = np.clip((v[:, 1] - 0.02) / 0.34, 0, 1)
    return shape._replace(vertices=v, uv=np.stack([0.5 + along / 0.7, 1 - up], axis=1))


def pierced_stone(height: float) -> Shape:
    """Return an upright rounded form with two holes, twisted about its axis; its foot is round, at y = -0.02 height.

    uv: u runs from the outside (0) into the holes (1), v is 0.5.
    """
    h = height
    outer = ellipsoid((0, 0.5 * h, 0), (0.27 * h, 0.52 * h, 0.17 * h))
    shoulder = ellipsoid((0.09 * h, 0.70 * h, 0.01), (0.20 * h, 0.25 * h, 0.15 * h))
    holes = [
        limb((-0.02 * h, 0.63 * h, -0.5 * h), (0.05 * h, 0.66 * h, 0.5 * h), 0.11 * h, 0.125 * h),
        limb((0.04 * h, 0.27 * h, -0.5 * h), (-0.03 * h, 0.31 * h, 0.5 * h), 0.075 * h, 0.065 * h),
    ]
    bored = blend(holes, 0.02 * h)

    def twisted(p):
        a = 0.9 * (p[..., 1] / h - 0.5)
        c, s = np.cos(a), np.sin(a)
        return np.stack([c * p[..., 0] + s * p[..., 2], p[..., 1], -s * p[..., 0] + c * p[..., 2]], axis=-1)

    def field(p):
        q = twisted(p)
        body = smooth_least(outer(q), shoulder(q), 0.12 * h)
        return -smooth_least(-body, bored(q), 0.10 * h)

    shape = polygonised(field, (-0.45 * h, -0.1 * h, -0.4 * h), (0.45 * h, 1.1 * h, 0.4 * h), STONE_CELL)
    # A slope that every triangle interpolates well; the image has the edge, at u = 0.5, a little outside the holes.
    into = np.clip(0.5 + (0.035 * h - bored(twisted(shape.vertices))) / (0.8 * h), 0.02, 0.98)
    return shape._replace(uv=np.stack([into, np.full(len(into), 0.5)], axis=1))
