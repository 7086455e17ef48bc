"""Generates showroom.glb, its mobiles, and the path in showroom.toml: `python -m scenes.make_showroom`.

A showroom of 8.4 x 3.4 x 8.4 m for surfaces that shine: a lacquered streamliner on a turntable of black lacquer,
brushed steel, a satin floor, a mirror, velvet. y is up, the camera looks along -z through the front wall. Metres and
watts.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scenes.furniture import SOLE, Piece, parts_of, placed
from scenes.glb import glb_bytes, material, write
from scenes.implicit import blend, ellipsoid, polygonised, smooth_least
from scenes.key_frames import Loop, loop, write_paths
from scenes.modelling import Shape, box, part, radiance, rounded_box, wall
from scenes.round_shapes import rod, turned_body

LEFT, RIGHT, BACK, FRONT, HEIGHT = -4.2, 4.2, -3.6, 4.8, 3.4
CELL = 0.3  # [m] of walls and floor: max_edge of the scene file halves it once
STRIPS = (-2.1, -1.15, -0.2, 0.75)  # z of the ceiling's strips
STRIP = (4.8, 0.14)  # [m] of each, along x and z
SLOTS = (-3.4, -2.9, -2.4)  # x of the warm slots in the back wall
SLOT = (0.05, 2.5)  # [m] of each, along x and y
TABLE, TABLE_RADIUS, TABLE_HEIGHT = (-0.75, -0.75), 2.15, 0.12  # x and z of the turntable
CAR_TURN = -32.0  # degrees
CAR_CELL, BEAN_CELL = 0.075, 0.04
MIRROR_Z, MIRROR_Y = (-2.7, 0.3), (0.08, 2.5)  # on the right wall
PEDESTAL = (2.75, -1.5)
START, SPEED = np.pi / 2, 0.3  # of the vase on its ellipse, [m/s]

# Flux = pi x radiance x area.
STRIP_FLUX = np.array([64.0, 66.0, 68.0])  # [W] of all strips
SLOT_FLUX = np.array([9.0, 4.3, 1.3])  # [W] of all slots, warm


def room_parts():
    """Return the static part, a part a material."""
    return [*_shell(), *_lights(), *parts_of(*_things())]


def _shell():
    w, d = RIGHT - LEFT, FRONT - BACK
    floor = wall((LEFT, 0, FRONT), (w, 0, 0), (0, 0, -d), CELL)
    ceiling = wall((LEFT, HEIGHT, BACK), (w, 0, 0), (0, 0, d), CELL)
    back = wall((LEFT, 0, BACK), (w, 0, 0), (0, HEIGHT, 0), CELL)
    front = wall((RIGHT, 0, FRONT), (-w, 0, 0), (0, HEIGHT, 0), CELL)
    left = wall((LEFT, 0, FRONT), (0, 0, -d), (0, HEIGHT, 0), CELL)
    right = wall((RIGHT, 0, BACK), (0, 0, d), (0, HEIGHT, 0), CELL)
    return [
        part("floor", floor),
        part("ceiling", ceiling),
        part("slate", back),
        part("plaster", front, right),
        part("clay", left),
    ]


def _lights():
    """Return strips just below the ceiling, and warm slots just before the back wall."""
    (long, wide), (narrow, tall) = STRIP, SLOT
    strips = [
        wall((TABLE[0] + 0.2 - long / 2, HEIGHT - 0.01, z - wide / 2), (long, 0, 0), (0, 0, wide), CELL) for z in STRIPS
    ]
    slots = [wall((x - narrow / 2, 0.25, BACK + 0.01), (narrow, 0, 0), (0, tall, 0), CELL) for x in SLOTS]
    return [part("strips", *strips), part("slots", *slots)]


def car() -> Piece:
    """Return a streamliner of 3.5 m, its nose along +x."""
    wheels = [(s * 0.95, z) for s in (-1, 1) for z in (-0.44, 0.44)]
    long, high = ellipsoid((0.0, 0.44, 0), (1.90, 0.30, 0.80)), ellipsoid((-0.50, 0.66, 0), (1.30, 0.34, 0.52))
    hull = blend([long, high], 0.4)

    def body(p):
        return -smooth_least(-hull(p), p[..., 1] - 0.16, 0.08)

    canopy = ellipsoid((-0.42, 0.86, 0), (0.74, 0.30, 0.42))
    tyre = turned_body([(0, -0.09), (0.24, -0.09), (0.30, -0.06), (0.30, 0.06), (0.24, 0.09), (0, 0.09)], 24)
    return {
        "lacquer": [polygonised(body, (-2.0, 0.0, -1.0), (2.0, 1.3, 1.0), CAR_CELL)],
        "glass": [polygonised(canopy, (-1.3, 0.45, -0.6), (0.5, 1.3, 0.6), CAR_CELL)],
        "rubber": [tyre.turned(90, (1, 0, 0)).at(x, 0.30 - SOLE, z) for x, z in wheels],
    }


def _turntable() -> Piece:
    r, h = TABLE_RADIUS, TABLE_HEIGHT
    rings = np.linspace(r - 0.03, 0, int(np.ceil(r / 0.16)))
    rim = turned_body([(r, -SOLE), (r, h - 0.01), (r - 0.01, h), (r - 0.03, h)], 96)
    return {"rubber": [rim], "piano": [turned_body([(x, h) for x in rings], 96)]}


def _pedestal() -> Piece:
    r, h = 0.30, 0.80
    rows = [(r, y) for y in np.linspace(-SOLE, h - 0.01, 9)]
    return {"steel": [turned_body([*rows, (r - 0.01, h), (0.15, h), (0, h)], 48)]}


def _seat() -> Piece:
    """Return a velvet seat, upholstered, on short legs."""
    seat = rounded_box((1.25, 0.26, 0.62), 0.10, 3).at(0, 0.17, 0)
    back = rounded_box((1.25, 0.46, 0.20), 0.095, 3).turned(-10, (1, 0, 0)).at(0, 0.36, -0.27)
    legs = [rod((x, -SOLE, z), (x, 0.19, z), 0.016, 8) for x in (-0.5, 0.5) for z in (-0.22, 0.22)]
    return {"velvet": [seat, back], "brass": legs}


def _mirror() -> Piece:
    (z0, z1), (y0, y1), t = MIRROR_Z, MIRROR_Y, 0.035
    glass = wall((RIGHT - 0.02, y0, z0), (0, 0, z1 - z0), (0, y1 - y0, 0), CELL)
    bars = [box((t, y1 - y0 + 2 * t, t)).at(RIGHT - 0.02, y0 - t, z) for z in (z0 - t / 2, z1 + t / 2)]
    bars += [box((t, t, z1 - z0)).at(RIGHT - 0.02, y, (z0 + z1) / 2) for y in (y0 - t, y1)]
    return {"mirror": [glass], "brass": bars}


def _things():
    x, z = TABLE
    return [
        placed(_turntable(), x, 0, z),
        placed(car(), x, TABLE_HEIGHT, z, CAR_TURN),
        placed(_pedestal(), PEDESTAL[0], 0, PEDESTAL[1]),
        placed(_seat(), 2.75, 0, 0.75, -38),
        _mirror(),
    ]


def vase() -> Shape:
    """Return a tall vase standing on y = 0."""
    profile = [(0, 0), (0.10, 0), (0.13, 0.02), (0.21, 0.14), (0.245, 0.28), (0.235, 0.40), (0.18, 0.54), (0.105, 0.66),
               (0.075, 0.76), (0.085, 0.84), (0.12, 0.90), (0.11, 0.905), (0.06, 0.80), (0, 0.78)]  # fmt: skip
    h = np.linspace(0, 1, 40)
    t = np.linspace(0, 1, len(profile))
    fine = np.stack([np.interp(h, t, [p[k] for p in profile]) for k in (0, 1)], axis=1)
    for _ in range(2):  # evened out
        fine[1:-1] = (fine[:-2] + 2 * fine[1:-1] + fine[2:]) / 4
    return turned_body(fine, 40)


def bean() -> Shape:
    """Return a polished pebble standing on y = 0."""
    halves = ellipsoid((-0.13, 0.20, 0), (0.21, 0.20, 0.19)), ellipsoid((0.14, 0.23, 0), (0.20, 0.23, 0.18))
    field = blend(halves, 0.2)
    return polygonised(field, (-0.5, -0.1, -0.35), (0.5, 0.6, 0.35), BEAN_CELL)


def files() -> dict[str, bytes]:
    """Return the generated files by name."""
    parts = [p._replace(uv=None) for p in room_parts()]  # nothing has an image
    plain = {
        "floor": (0.30, 0.29, 0.28),
        "ceiling": (0.62, 0.61, 0.60),
        "slate": (0.20, 0.225, 0.26),
        "plaster": (0.62, 0.61, 0.59),
        "clay": (0.55, 0.30, 0.19),
        "lacquer": (0.50, 0.015, 0.02),
        "glass": (0.015, 0.017, 0.02),
        "rubber": (0.03, 0.03, 0.03),
        "steel": (0.55, 0.55, 0.55),
        "piano": (0.015, 0.015, 0.016),
        "velvet": (0.04, 0.12, 0.11),
        "brass": (0.55, 0.40, 0.18),
        "mirror": (0.8, 0.8, 0.8),
    }
    lights = {"strips": STRIP_FLUX, "slots": SLOT_FLUX}
    materials = [material(name, rho) for name, rho in plain.items()]
    materials += [material(name, (0.6, 0.6, 0.6), radiance(flux, parts, name)) for name, flux in lights.items()]
    return {
        "showroom.glb": glb_bytes(parts, materials),
        "showroom_vase.glb": glb_bytes(
            [part("teal", vase())._replace(uv=None)], [material("teal", (0.02, 0.20, 0.22))]
        ),
        "showroom_bean.glb": glb_bytes([part("gold", bean())._replace(uv=None)], [material("gold", (0.9, 0.6, 0.2))]),
    }


def paths() -> dict[str, Loop]:
    """Return the vase's path by scene file: an ellipse between the turntable and the camera."""

    def ellipse(a):
        return np.stack([0.5 + 1.5 * np.cos(a + START), 0 * a, 2.0 + 0.45 * np.sin(a + START)], axis=1)

    return {"showroom.toml": loop(ellipse, keys=32, speed=SPEED, turns=1)}


if __name__ == "__main__":
    write(Path(__file__).parent, files())
    write_paths(Path(__file__).parent, paths())
