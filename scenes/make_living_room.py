"""Generates living_room.glb, living_chair.glb and cat.glb: `python -m scenes.make_living_room`.

A room of 5.4 x 2.6 x 5.0 m at dusk: a cool window on the left, a floor lamp and a glass ball that are warm.
y is up, the camera looks along -z through the front wall, whose back is not drawn. Metres and watts.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scenes import furnishings, furniture
from scenes import living_room_images as images
from scenes.creatures import cat
from scenes.furniture import parts_of, placed
from scenes.glb import glb_bytes, material, write
from scenes.key_frames import Loop, loop, write_paths
from scenes.luminaires import beam, ies
from scenes.modelling import box, part, radiance, rounded_box, sheet, wall
from scenes.round_shapes import ball, rod, turned_body
from scenes.textures import png, swatch

LEFT, RIGHT, BACK, FRONT, HEIGHT = -2.7, 2.7, -2.2, 2.8, 2.6
BAR, CASING = 0.05, 0.06  # [m] width of the window's bar, and of the wood around it
CELL = 0.26  # [m] of walls and floor: max_edge of the scene file halves it once
WINDOW_Z, WINDOW_Y, REVEAL = (-1.25, 0.75), (0.65, 2.25), 0.04  # along the left wall, up, into it
RUG = (-0.35, -0.30, 2.7, 1.9)  # middle x, z; size
TABLE = (-0.35, -0.30)
RUG_THICKNESS = 0.012
CAT_CIRCLE, CAT_START, CAT_SPEED = 0.8, 60, 0.4  # radius [m], the angle in living_room.toml [degrees], [m/s]
SEED = 4

# Light. Flux = pi x radiance x area; a warm white gives some 300 lumen a watt of visible light.
WINDOW_FLUX = np.array([3.4, 4.6, 6.8])  # [W] dusk sky through 3 m2 of glass
DIFFUSER_FLUX = np.array([3.15, 2.2, 1.25])  # [W] up and down out of the floor lamp's shade, some 650 lumen;
# the luminaire of living_uplight.ies above it has as much
SHADE_FLUX = np.array([1.3, 0.76, 0.36])  # [W] through its cloth
BALL_FLUX = np.array([1.5, 1.0, 0.56])  # [W] the glass ball

WALL, CEILING, TERRACOTTA = (0.76, 0.73, 0.67), (0.82, 0.81, 0.78), (0.62, 0.27, 0.16)
PAINT, BRASS = (0.78, 0.77, 0.74), (0.52, 0.36, 0.16)


def room_parts():
    """Return the static part, a part a material."""
    rng = np.random.default_rng(SEED)
    pick = _picker(rng)
    return [*_shell(), *_window(), *parts_of(*_furnishing(rng, pick))]


def _shell():
    w, h, d = RIGHT - LEFT, HEIGHT, FRONT - BACK
    floor = wall((LEFT, 0, FRONT), (w, 0, 0), (0, 0, -d), CELL).tiled(2.4, 1.2)
    ceiling = wall((LEFT, h, BACK), (w, 0, 0), (0, 0, d), CELL)
    back = wall((LEFT, 0, BACK), (w, 0, 0), (0, h, 0), CELL)
    front = wall((RIGHT, 0, FRONT), (-w, 0, 0), (0, h, 0), CELL)
    right = wall((RIGHT, 0, BACK), (0, 0, d), (0, h, 0), CELL)
    (z0, z1), (y0, y1) = WINDOW_Z, WINDOW_Y
    hole = (FRONT - z1 - CASING, y0), (FRONT - z0 + CASING, y1 + CASING)
    left = wall((LEFT, 0, FRONT), (0, 0, -d), (0, h, 0), CELL, hole)
    board, thick = 0.09, 0.014
    skirting = [
        box((w, board, thick), "-x+x-y-z").at(0, 0, BACK + thick / 2),
        box((thick, board, d), "-y-z+z-x").at(LEFT + thick / 2, 0, (BACK + FRONT) / 2),
        box((thick, board, d), "-y-z+z+x").at(RIGHT - thick / 2, 0, (BACK + FRONT) / 2),
    ]
    return [
        part("floor", floor),
        part("ceiling", ceiling),
        part("wall", back, front, left),
        part("terracotta", right),
        part("paint", *skirting),
    ]


def _window():
    (z0, z1), (y0, y1) = WINDOW_Z, WINDOW_Y
    pane, wide, tall = LEFT - REVEAL, z1 - z0, y1 - y0

    def flat(z, y, width, height):
        """Return a rectangle in the plane of the glass from its corner nearest the camera, seen from the room."""
        return wall((pane, y, z), (0, 0, -width), (0, height, 0), CELL / 2)

    # The glass reaches the reveal: a dark bar in that corner would be a gradient that no disc can follow.
    half = (wide - BAR) / 2
    panes = [flat(z, y0, half, tall) for z in (z1, z0 + half)]
    bar = flat(z0 + half + BAR, y0, BAR, tall)
    # The casing lies flush in the wall: behind a board the wall would be dark, and darken its neighbours.
    casing = [wall((LEFT, y0, z + CASING), (0, 0, -CASING), (0, tall, 0), CELL / 2) for z in (z0 - CASING, z1)]
    casing.append(wall((LEFT, y1, z1 + CASING), (0, 0, -wide - 2 * CASING), (0, CASING, 0), CELL / 2))
    reveal = [
        sheet((pane, y1, z0), (REVEAL, 0, 0), (0, 0, wide), (1, 12)),
        sheet((pane, y0, z0), (REVEAL, 0, 0), (0, tall, 0), (1, 10)),
        sheet((LEFT, y0, z1), (-REVEAL, 0, 0), (0, tall, 0), (1, 10)),
    ]
    # The sill closes the opening below: from a little behind the glass to 15 cm into the room.
    sill = rounded_box((REVEAL + 0.16, 0.03, wide + 0.16), 0.01).at((pane + LEFT + 0.14) / 2, y0 - 0.03, (z0 + z1) / 2)
    rail = rod((LEFT + 0.10, y1 + 0.14, z0 - 0.55), (LEFT + 0.10, y1 + 0.14, z1 + 0.55), 0.012, 5)
    drapes = [
        placed(furnishings.curtain(0.50, y1 + 0.11, 3, "linen"), LEFT + 0.10, 0, z, 90) for z in (z0 - 0.24, z1 + 0.24)
    ]
    return [
        part("glass", *panes),
        part("paint", *reveal),
        part("oak", bar.tiled(0.7, 0.35), *(c.tiled(0.7, 0.35) for c in casing)),
        part("paint", sill),
        *parts_of({"brass": [rail]}, *drapes),
    ]


def _furnishing(rng, pick):
    rug_x, rug_z, rug_w, rug_d = RUG
    rug = [
        sheet((-rug_w / 2, RUG_THICKNESS, rug_d / 2), (rug_w, 0, 0), (0, 0, -rug_d), (14, 10)).painted(0, 1, 1, 0),
        box((rug_w, RUG_THICKNESS, rug_d), "-y+y").tinted(0.01, 0.5),
    ]
    shelf_w, shelf_h, shelf_d, boards = 1.05, 1.92, 0.32, 6
    case = furniture.shelf(shelf_w, shelf_h, shelf_d, boards, "oak")
    case_at = (RIGHT - 0.12 - shelf_w / 2, 0, BACK + shelf_d / 2 + 0.016)
    table_h = 0.42
    pieces = [
        placed({"rug": rug}, rug_x, 0, rug_z),
        placed(furniture.sofa(2.2, "sofa", "walnut"), -0.35, 0, BACK + 0.50),
        placed(furniture.pillow(0.44, "mustard"), -1.02, 0.45, BACK + 0.43, 10),
        placed(furniture.pillow(0.40, "rust"), 0.34, 0.45, BACK + 0.44, -12),
        placed(furniture.round_table(0.44, table_h, "walnut"), TABLE[0], 0, TABLE[1], 0),
        placed(furniture.round_table(0.22, 0.52, "walnut", 3), -1.82, 0, BACK + 0.40, 20),
        placed(furnishings.globe_lamp(0.10, "brass", "ball"), -1.82, 0.52, BACK + 0.40),
        placed(furnishings.floor_lamp(1.66, "brass", "shade", "diffuser"), 1.10, 0, BACK + 0.46),
        placed(furnishings.picture(1.30, 0.86, "frame", "painting"), -0.35, 1.53, BACK),
        placed(furnishings.rubber_plant(rng, 1.25, "pot", "leaf", "stem", "soil"), LEFT + 0.42, 0, 1.35),
        placed(case, *case_at),
        placed(_on_table(pick), TABLE[0], table_h, TABLE[1], 25),
        *(placed(p, *case_at) for p in _on_shelf(rng, pick, shelf_w, shelf_h, shelf_d, boards)),
    ]
    return pieces


def _on_table(pick):
    side = [
        (0, 0),
        (0.35, 0),
        (0.45, 0.06),
        (0.85, 0.35),
        (1.0, 0.62),
        (0.94, 0.63),
        (0.78, 0.38),
        (0.3, 0.12),
        (0, 0.1),
    ]
    bowl = turned_body(np.array(side) * 0.14, 24)
    fruit = [ball(0.037, 14).at(*at) for at in ((-0.045, 0.062, 0.02), (0.04, 0.06, 0.035), (0.005, 0.063, -0.05))]
    pile = furnishings.lying_books([(0.26, 0.024, 0.19, 0), (0.22, 0.030, 0.16, 14)], pick)
    return {
        "ceramic": [bowl.at(0.14, 0, 0.05)],
        "orange": [f.at(0.14, 0.0, 0.05) for f in fruit],
        "covers": [s.at(-0.17, 0, -0.03) for s in pile],
    }


def _on_shelf(rng, pick, width, height, depth, boards):
    """Return books and a few vessels on the boards, as pieces in the bookcase's own coordinates."""
    levels = furniture.shelf_levels(height, boards)
    headroom = levels[1] - levels[0] - 0.045
    inner = width - 0.056  # between the sides
    standing = []
    # Board, where the row begins and how long it is, as shares of the board.
    for level, start, length in ((0, 0.0, 0.62), (1, 0.30, 0.66), (2, 0.0, 0.55), (3, 0.36, 0.60), (4, 0.0, 0.34)):
        row = furnishings.books(rng, length * inner, depth - 0.08, headroom, pick, at_side=start == 0)
        standing += [s.at((start - 0.5) * inner, levels[level], 0.10) for s in row]
    pile = furnishings.lying_books([(0.24, 0.03, 0.18, 0), (0.22, 0.024, 0.17, -8), (0.19, 0.03, 0.15, 5)], pick)
    casket = rounded_box((0.26, 0.20, 0.22), 0.012).tinted(*swatch(3, images.COVER_COUNT))
    return [
        {"covers": [*standing, *(s.at(0.28, levels[2], 0.02) for s in pile), casket.at(0.32, levels[4], 0)]},
        placed(furnishings.vase(ROUND_VASE, 0.20, "ceramic"), -0.35, levels[1], 0.02),
        placed(furnishings.vase(TALL_VASE, 0.26, "glaze"), 0.33, levels[0], 0.02),
        placed(furnishings.vase(TALL_VASE, 0.24, "ceramic"), -0.38, levels[3], 0.02),
        placed(furnishings.vase(ROUND_VASE, 0.22, "glaze"), 0.02, levels[4], 0.02),
    ]


ROUND_VASE = [(0.22, 0), (0.40, 0.25), (0.44, 0.45), (0.30, 0.72), (0.16, 0.85), (0.20, 1.0)]
TALL_VASE = [(0.14, 0), (0.20, 0.3), (0.17, 0.6), (0.09, 0.85), (0.12, 1.0)]


def _picker(rng):
    """Return a function that picks a book cover's colour at random."""
    return lambda: swatch(int(images.COVER_COUNT * rng.random()), images.COVER_COUNT)


TEXTURES = ("floor", "rug", "painting", "sofa", "mustard", "rust", "linen", "walnut", "oak", "covers")
WHITE = (1.0, 1.0, 1.0)


def files() -> dict[str, bytes]:
    """Return the generated files by name."""
    parts = room_parts()
    plain = {
        "wall": WALL,
        "ceiling": CEILING,
        "terracotta": TERRACOTTA,
        "paint": PAINT,
        "brass": BRASS,
        "frame": (0.30, 0.19, 0.11),
        "ceramic": (0.74, 0.71, 0.65),
        "glaze": (0.10, 0.22, 0.34),
        "orange": (0.78, 0.32, 0.05),
        "pot": (0.62, 0.60, 0.56),
        "soil": (0.10, 0.07, 0.05),
        "stem": (0.24, 0.26, 0.12),
    }
    lights = {"glass": WINDOW_FLUX, "diffuser": DIFFUSER_FLUX, "shade": SHADE_FLUX, "ball": BALL_FLUX}
    materials = [material(name, rho) for name, rho in plain.items()]
    materials.append(material("leaf", (0.13, 0.27, 0.09), two_sided=True))
    materials += [material(name, (0.6, 0.6, 0.6), radiance(flux, parts, name)) for name, flux in lights.items()]
    for i, name in enumerate(TEXTURES):
        materials.append(material(name, WHITE, two_sided=name == "linen", texture=i))
    chair = parts_of(furniture.chair("yellow", "rust"))
    return {
        "living_uplight.ies": ies("uplight", 100.0, beam(20.0, 80.0)),
        "living_room.glb": glb_bytes(parts, materials, [png(getattr(images, name)()) for name in TEXTURES]),
        "living_chair.glb": glb_bytes(
            chair, [material("yellow", (0.78, 0.52, 0.10)), material("rust", WHITE, texture=0)], [png(images.rust())]
        ),
        "cat.glb": glb_bytes([part("coat", cat())], [material("coat", WHITE, texture=0)], [png(images.coat())]),
    }


def paths() -> dict[str, Loop]:
    """Return the cat's path by scene file: round the table. It walks along +z where its angle is 0."""

    def round_the_table(a):
        turn = a + np.radians(CAT_START)
        x, z = TABLE[0] - CAT_CIRCLE * np.cos(turn), TABLE[1] + CAT_CIRCLE * np.sin(turn)
        return np.stack([x, np.full(len(a), RUG_THICKNESS), z], axis=1)

    return {"living_room.toml": loop(round_the_table, keys=24, speed=CAT_SPEED, turns=1)}


if __name__ == "__main__":
    write(Path(__file__).parent, files())
    write_paths(Path(__file__).parent, paths())
