"""Generates gallery.glb, stone.glb, gallery_spot.ies, and the path in gallery.toml: `python -m scenes.make_gallery`.

A hall of 9 x 3.8 x 7.9 m with luminaires of every kind: a luminous ceiling and a glowing tube (faces that
emit), three spots by their photometric file, and a bare bulb (a point). y is up, the camera looks along -z
through the front wall.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scenes import furnishings, furniture
from scenes import gallery_images as images
from scenes.creatures import pierced_stone
from scenes.furniture import parts_of, placed
from scenes.glb import glb_bytes, material, write
from scenes.key_frames import Loop, loop, write_paths
from scenes.luminaires import beam, ies
from scenes.modelling import box, part, radiance, rounded_box, sheet, wall
from scenes.round_shapes import ball, rod, tube, turned_body
from scenes.textures import png

LEFT, RIGHT, BACK, FRONT, HEIGHT = -4.5, 4.5, -3.4, 4.5, 3.8
CELL = 0.3  # [m] of walls and floor: max_edge of the scene file halves it once
CEILING_LIGHT = (5.4, 2.1)  # [m] along x and z, over the middle of the hall, in a frame let down by DROP
DROP = 0.12
RING_CENTRE, RING_RADIUS, RING_TUBE = np.array([RIGHT - 0.16, 1.85, -0.9]), 0.62, 0.022
STONE_HEIGHT = 1.35
PICTURES = [(-2.75, 1.10, 1.35, "fields"), (-0.35, 1.80, 1.29, "circles"), (2.30, 1.10, 1.35, "waves")]  # x, size, name
PICTURE_HEIGHT = 1.62  # of their middles
SPOTS = [(x, HEIGHT - 0.42, BACK + 2.1) for x, *_ in PICTURES]  # where the light leaves them, as in gallery.toml
BULB = (-3.55, 2.05, -1.45)  # likewise

# Light. Flux = pi x radiance x area; a white as here gives some 300 lumen a watt.
CEILING_FLUX = np.array([26.5, 28.0, 29.5])  # [W]
RING_FLUX = np.array([5.0, 0.55, 1.7])  # [W] a magenta tube
BULB_FLUX = np.array([0.30, 0.20, 0.10])  # [W] the bulb's glass; the point below it has ten times as much

WHITE_WALL, BLUE_WALL = (0.80, 0.79, 0.77), (0.10, 0.20, 0.46)
START = np.pi / 3  # where on its ellipse the stone stands first: in front, to the right
SPEED = 0.3  # of the stone [m/s]


def hall_parts():
    """Return the static part, a part a material."""
    return [*_shell(), *_ceiling_light(), *parts_of(*_pictures(), *_luminaires(), *_things())]


def _shell():
    w, d = RIGHT - LEFT, FRONT - BACK
    floor = wall((LEFT, 0, FRONT), (w, 0, 0), (0, 0, -d), CELL).tiled(3.0, 3.0)
    ceiling = wall((LEFT, HEIGHT, BACK), (w, 0, 0), (0, 0, d), CELL)
    back = wall((LEFT, 0, BACK), (w, 0, 0), (0, HEIGHT, 0), CELL)
    front = wall((RIGHT, 0, FRONT), (-w, 0, 0), (0, HEIGHT, 0), CELL)
    left = wall((LEFT, 0, FRONT), (0, 0, -d), (0, HEIGHT, 0), CELL)
    right = wall((RIGHT, 0, BACK), (0, 0, d), (0, HEIGHT, 0), CELL)
    return [part("floor", floor), part("white", ceiling, back, front, left), part("blue", right)]


def _ceiling_light():
    """Return a luminous field let down from the ceiling, flush with its white frame."""
    (w, d), y, rim = CEILING_LIGHT, HEIGHT - DROP, 0.06
    field = wall((-w / 2, y, -d / 2), (w, 0, 0), (0, 0, d), CELL)
    low = [sheet((-w / 2 - rim, y, z), (w + 2 * rim, 0, 0), (0, 0, rim)) for z in (-d / 2 - rim, d / 2)]
    low += [sheet((x, y, -d / 2), (rim, 0, 0), (0, 0, d)) for x in (-w / 2 - rim, w / 2)]
    sides = box((w + 2 * rim, DROP + 0.001, d + 2 * rim), "-y+y").at(0, y, 0)
    return [part("ceiling light", field), part("white", sides, *low)]


def _pictures():
    frames = [
        placed(furnishings.picture(w, h, "frame", name, 0.025), x, PICTURE_HEIGHT, BACK) for x, w, h, name in PICTURES
    ]
    return frames


def _luminaires():
    """Return the bodies of the spots on their rail, of the bulb, and the glowing ring."""
    pieces = []
    y = SPOTS[0][1] + 0.34
    rail = box((6.4, 0.04, 0.05)).at(-0.22, y, SPOTS[0][2] + 0.10)
    hangers = [
        tube([(x, y + 0.03, SPOTS[0][2] + 0.10), (x, HEIGHT + 0.01, SPOTS[0][2] + 0.10)], 0.008, 6) for x in (-3.1, 2.7)
    ]
    pieces.append({"black": [rail]})
    pieces.append({"black": hangers})
    for x, h, z in SPOTS:
        aim = np.array([0, PICTURE_HEIGHT - h, BACK - z])
        aim /= np.sqrt(aim @ aim)
        back = np.array([x, h, z]) - aim * 0.02
        can = tube([back - 0.17 * aim, back], 0.045, 14)
        stalk = tube([back - 0.10 * aim, (x, y + 0.01, z + 0.10)], 0.009, 6)
        pieces.append({"black": [can, stalk]})
    x, y, z = BULB
    socket = turned_body([(0, 0.0), (0.020, 0.0), (0.024, 0.02), (0.024, 0.07), (0.006, 0.09), (0, 0.09)], 14)
    glass = ball(0.036, 10).at(x, y + 0.10, z)  # glows so that the eye finds it; the light comes from the point below
    cord = rod((x, y + 0.21, z), (x, HEIGHT + 0.01, z), 0.005, 6)
    a = 2 * np.pi * np.arange(48) / 48
    circle = RING_CENTRE + RING_RADIUS * np.stack([0 * a, np.cos(a), np.sin(a)], axis=1)
    ring = tube(circle, RING_TUBE, 10, closed=True)
    pieces.append({"brass": [socket.at(x, y + 0.132, z)], "black": [cord], "ring": [ring], "bulb": [glass]})
    return pieces


def _things():
    bench = {
        "oak": [rounded_box((1.9, 0.07, 0.46), 0.012, 1).at(0, 0.385, 0).tiled(1.2, 0.46)],
        "black": [box((0.05, 0.39, 0.40), "+y").at(s * 0.75, -furniture.SOLE, 0) for s in (-1, 1)],
    }
    plinths = [
        placed({"white": [rounded_box((w, h, w), 0.008).at(0, -furniture.SOLE, 0)]}, x, 0, z, turn)
        for x, z, w, h, turn in ((-3.55, -1.45, 0.42, 0.98, 8), (3.35, -2.35, 0.50, 0.62, -12))
    ]
    tall = [(0.15, 0), (0.24, 0.28), (0.27, 0.5), (0.20, 0.78), (0.07, 0.9), (0.10, 1.0)]
    wide = [(0.25, 0), (0.48, 0.3), (0.52, 0.5), (0.42, 0.75), (0.24, 0.9), (0.28, 1.0)]
    return [
        placed(bench, -1.6, 0, 0.85, 6),
        *plinths,
        placed(furnishings.vase(tall, 0.46, "celadon", 28), -3.60, 0.976, -1.50),
        placed(furnishings.vase(wide, 0.17, "ochre", 24), -3.42, 0.976, -1.38),
        {"gold": [ball(0.20, 28).at(3.35, 0.62 - furniture.SOLE + 0.197, -2.35)]},
    ]


TEXTURES = ("floor", "oak", "fields", "circles", "waves")
PAINTERS = (images.concrete, images.oak, images.fields, images.circles, images.waves)


def files() -> dict[str, bytes]:
    """Return the generated files by name."""
    parts = hall_parts()
    plain = {
        "white": WHITE_WALL,
        "blue": BLUE_WALL,
        "black": (0.045, 0.045, 0.05),
        "frame": (0.20, 0.15, 0.11),
        "brass": (0.52, 0.36, 0.16),
        "celadon": (0.36, 0.55, 0.45),
        "ochre": (0.66, 0.38, 0.10),
        "gold": (0.80, 0.57, 0.16),
    }
    lights = {"ceiling light": CEILING_FLUX, "ring": RING_FLUX, "bulb": BULB_FLUX}
    materials = [material(name, rho) for name, rho in plain.items()]
    materials += [material(name, (0.6, 0.6, 0.6), radiance(flux, parts, name)) for name, flux in lights.items()]
    materials += [material(name, (1.0, 1.0, 1.0), texture=i) for i, name in enumerate(TEXTURES)]
    base = turned_body([(0, 0), (0.24, 0), (0.24, 0.05), (0.23, 0.06), (0, 0.06)], 32)
    stone = [part("stone", pierced_stone(STONE_HEIGHT).at(0, 0.07, 0)), part("slate", base)]
    return {
        "gallery_spot.ies": ies("spot with spill", 1000.0, beam(6.0, 26.0, 0.03)),
        "gallery.glb": glb_bytes(parts, materials, [png(paint()) for paint in PAINTERS]),
        "stone.glb": glb_bytes(
            stone,
            [material("stone", (1.0, 1.0, 1.0), texture=0), material("slate", (0.12, 0.12, 0.13))],
            [png(images.stone())],
        ),
    }


def paths() -> dict[str, Loop]:
    """Return the stone's path by scene file: an ellipse through the middle of the hall, past the blue wall."""

    def ellipse(a):
        return np.stack([1.3 + 1.8 * np.cos(a + START), 0 * a, -0.6 + 1.1 * np.sin(a + START)], axis=1)

    return {"gallery.toml": loop(ellipse, keys=32, speed=SPEED, turns=1)}


if __name__ == "__main__":
    write(Path(__file__).parent, files())
    write_paths(Path(__file__).parent, paths())
