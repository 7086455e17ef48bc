"""Generates classroom.glb, its blind, and its two photometric files: `python -m scenes.make_classroom`.

A classroom of 9 x 3 x 7 m: four windows of clear glass to a terrace with a hedge, twelve tables for two, a board. Two
rows of four luminaires and a washer of the board are placed in classroom.toml. y is up, pupils look along -x, windows
are on their left, in the plane z = FRONT. Metres, lumens and candelas.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scenes import furnishings
from scenes import office_furniture as office
from scenes import office_images as images
from scenes.furniture import SOLE, Piece, parts_of, placed, shelf, shelf_levels
from scenes.glb import glb_bytes, material, write
from scenes.luminaires import beam, ies
from scenes.modelling import Shape, X, Z, box, part, sheet, wall
from scenes.round_shapes import rod, tube, turned_body
from scenes.textures import Image, cloud, pixels, png, shades, swatch, wood

LEFT, RIGHT, BACK, FRONT, HEIGHT = -4.5, 4.5, -3.5, 3.5, 3.0
CELL = 0.3  # [m] of walls and floor: max_edge of the scene file halves it once
COARSE = 0.4  # [m] of small things
WINDOWS, WIDE, PILLAR, SILL, HEAD, REVEAL, BAR = 4, 1.8, 0.36, 0.9, 2.7, 0.2, 0.05
TERRACE, HEDGE = (2.0, 0.6), (7.0, 1.9)  # [m] depth and cells; half the length, and height
BOARD = (3.6, 1.2, 0.9)  # [m] width, height, lower edge
TABLE, TABLE_X, TABLE_Z = (1.3, 0.55), (-1.9, -0.65, 0.6, 1.85), (-2.1, 0.0, 2.1)
LUMINAIRE_X, LUMINAIRE_Z, LUMINAIRE_Y = (-3.0, -1.0, 1.0, 3.0), (-1.7, 1.7), 2.7
LUMINAIRE, WASHER = (1.5, 0.16), (2.8, 0.06)  # [m] openings along x and z; the washer's along z and x
WASHER_AT, AIM = (LEFT + 0.95, 2.8, 0.0), 34.0  # and degrees from straight down, towards the board
PEAK, WASHER_PEAK = 2300.0, 3700.0  # [cd]
WATTS, WASHER_WATTS = 40.0, 42.0
BLIND, SLATS = (1.9, 1.8), 22  # [m] width and height
SEED = 5


def window_x() -> list[float]:
    """Return the left edges of the windows."""
    return [LEFT + PILLAR + k * (WIDE + PILLAR) for k in range(WINDOWS)]


def classroom_parts():
    """Return the static part, a part a material."""
    rng = np.random.default_rng(SEED)
    return [*_shell(), *_windows(), *_outside(), *parts_of(_board(), _door(), *_luminaires(), *_furniture(rng))]


def _shell():
    w, h, d = RIGHT - LEFT, HEIGHT, FRONT - BACK
    floor = wall((LEFT, 0, FRONT), (w, 0, 0), (0, 0, -d), CELL).tiled(1.5, 1.5)
    ceiling = wall((LEFT, h, BACK), (w, 0, 0), (0, 0, d), CELL).tiled(0.6, 0.6)
    back = wall((LEFT, 0, BACK), (w, 0, 0), (0, h, 0), CELL)
    right = wall((RIGHT, 0, BACK), (0, 0, d), (0, h, 0), CELL)
    left = wall((LEFT, 0, FRONT), (0, 0, -d), (0, h, 0), CELL)
    front = [
        wall((RIGHT, 0, FRONT), (-w, 0, 0), (0, SILL, 0), CELL),
        wall((RIGHT, HEAD, FRONT), (-w, 0, 0), (0, h - HEAD, 0), CELL),
    ]
    for x in (*window_x(), RIGHT):
        front.append(wall((x, SILL, FRONT), (-PILLAR, 0, 0), (0, HEAD - SILL, 0), CELL))
    return [part("lino", floor), part("ceiling", ceiling), part("wall", back, left, *front), part("blue", right)]


def _windows():
    """Return glass and bars in one plane, as in the office, and the reveals."""
    glass, bars, reveals, z, tall = [], [], [], FRONT + REVEAL, HEAD - SILL
    leaf = (WIDE - 3 * BAR) / 2
    for x in window_x():
        for k in range(2):
            right = x + (k + 1) * (leaf + BAR)
            glass.append(wall((right, SILL + BAR, z), (-leaf, 0, 0), (0, tall - 2 * BAR, 0), CELL))
        for low in (SILL, HEAD - BAR):
            bars.append(wall((x + WIDE, low, z), (-WIDE, 0, 0), (0, BAR, 0), CELL))
        for right in (x + BAR, x + 2 * BAR + leaf, x + WIDE):
            bars.append(wall((right, SILL + BAR, z), (-BAR, 0, 0), (0, tall - 2 * BAR, 0), CELL))
        reveals += [
            wall((x, SILL, z), (WIDE, 0, 0), (0, 0, -REVEAL), CELL),
            wall((x, HEAD, FRONT), (WIDE, 0, 0), (0, 0, REVEAL), CELL),
            wall((x, SILL, FRONT), (0, tall, 0), (0, 0, REVEAL), CELL),
            wall((x + WIDE, SILL, FRONT), (0, 0, REVEAL), (0, tall, 0), CELL),
        ]
    return [part("glass", *glass), part("frame", *bars), part("white", *reveals)]


def _outside():
    """Return the terrace and the hedge. The terrace is smaller than half the floor, or it would count as the floor."""
    (deep, cell), (half, high), z = TERRACE, HEDGE, FRONT + REVEAL
    terrace = wall((LEFT, -0.1, z + deep), (RIGHT - LEFT, 0, 0), (0, 0, -deep), cell)
    hedge = wall((half, -0.1, z + deep), (-2 * half, 0, 0), (0, high, 0), cell).tiled(1.2, 1.2)
    return [part("paving", terrace), part("hedge", hedge)]


def _board() -> Piece:
    """Return the board on the left wall, in a frame, with a ledge for chalk."""
    w, h, low = BOARD
    face = wall((LEFT + 0.03, low, w / 2), (0, 0, -w), (0, h, 0), CELL)
    rails = [box((0.04, 0.04, w + 0.08), "-x", CELL).at(LEFT + 0.02, y, 0) for y in (low - 0.04, low + h)]
    rails += [box((0.04, h, 0.04), "-x-y+y", CELL).at(LEFT + 0.02, low, s * (w / 2 + 0.02)) for s in (-1, 1)]
    ledge = box((0.08, 0.02, w * 0.5), "-x", CELL).at(LEFT + 0.08, low - 0.06, 0)
    return {"board": [face], "steel": [*rails, ledge]}


def _door() -> Piece:
    leaf = box((0.95, 2.05, 0.04), "-z-y-x+x+y", CELL).at(-3.6, 0, BACK + 0.02)
    leaf = leaf._replace(uv=leaf.uv[:, ::-1]).tiled(0.9, 0.45)  # the grain runs upwards
    lever = rod((-3.99, 1.05, BACK + 0.03), (-3.99, 1.05, BACK + 0.09), 0.01, 8)
    grip = rod((-4.0, 1.05, BACK + 0.085), (-3.86, 1.05, BACK + 0.085), 0.009, 8)
    frame = [box((0.06, 2.11, 0.06), "-z-y", CELL).at(-3.6 + s * 0.505, 0, BACK + 0.03) for s in (-1, 1)]
    frame.append(box((0.95, 0.06, 0.06), "-z-x+x", CELL).at(-3.6, 2.05, BACK + 0.03))
    return {"birch": [leaf], "steel": [lever, grip], "white": frame}


def _luminaires() -> list[Piece]:
    """Return housings; light leaves openings 5 mm below them, which classroom.toml places."""
    long, wide = LUMINAIRE
    body = box((long + 0.02, 0.05, wide + 0.02), cell=COARSE)
    wires = [rod((s * 0.5, 0.05, 0), (s * 0.5, HEIGHT - LUMINAIRE_Y, 0), 0.004, 4) for s in (-1, 1)]
    pieces = [
        placed({"white": [body], "steel": wires}, x, LUMINAIRE_Y + 0.005, z) for x in LUMINAIRE_X for z in LUMINAIRE_Z
    ]
    x, y, z = WASHER_AT
    trough = box((0.09, 0.04, WASHER[0] + 0.02), cell=CELL).turned(-AIM, Z)
    lift = 0.005 * np.array([np.sin(np.radians(AIM)), np.cos(np.radians(AIM)), 0])
    stays = [rod((0, 0.03, s * 1.0), (0, HEIGHT - y, s * 1.0), 0.006, 4) for s in (-1, 1)]
    return [*pieces, placed({"white": [trough.at(*lift)], "steel": stays}, x, y, z)]


def pupil_chair(wood_of_seat: str, metal: str) -> Piece:
    """Return a chair of a seat and a back of plywood on four tubes."""
    seat = box((0.40, 0.018, 0.38), cell=COARSE).at(0, 0.432, 0.01)
    back = box((0.38, 0.17, 0.016), cell=COARSE).turned(-10, X).at(0, 0.65, -0.21)
    legs = [tube([(s * 0.17, -SOLE, 0.19), (s * 0.16, 0.435, 0.15)], 0.011, 4) for s in (-1, 1)]
    line = [(-SOLE, -0.17), (0.80, -0.225)]
    legs += [tube([(s * 0.165, y, z) for y, z in line], 0.011, 4) for s in (-1, 1)]
    return {wood_of_seat: [seat.tiled(0.9, 0.45), back.tiled(0.9, 0.45)], metal: legs}


def pupil_table(wood_of_top: str, metal: str) -> Piece:
    """Return a table for two on four square legs."""
    (w, d), high = TABLE, office.TOP - office.THICK
    top = box((w, office.THICK, d), cell=COARSE / 2).at(0, high, 0)
    leg = box((0.04, high + SOLE, 0.04), "-y+y", 1.0)
    legs = [leg.at(s * (w / 2 - 0.06), -SOLE, t * (d / 2 - 0.06)) for s in (-1, 1) for t in (-1, 1)]
    return {wood_of_top: [top.tiled(0.9, 0.45)], metal: legs}


def _furniture(rng) -> list[Piece]:
    low = office.TOP - 0.002
    pieces = []
    for x in TABLE_X:
        for z in TABLE_Z:
            pieces.append(placed(pupil_table("birch", "steel"), x, 0, z, 90))
            for s in (-1, 1):
                away, turn = 0.42 + 0.12 * rng.random(), 12 * (rng.random() - 0.5)
                pieces.append(placed(pupil_chair("birch", "steel"), x + away, 0, z + s * 0.32, turn - 90))
                if rng.random() < 0.6:
                    book = box((0.21, 0.014 + 0.012 * rng.random(), 0.297), "-y", COARSE).tinted(*_picker(rng)())
                    turn = 90 + 30 * (rng.random() - 0.5)
                    pieces.append(placed({"binders": [book]}, x - 0.02, low, z + s * 0.32, turn))
    desk = [
        placed(office.table(1.5, 0.75, "birch", "steel"), 0, 0, 0),
        placed(office.monitor("black", "monitor"), 0.35, low, -0.18, 0),
        placed(office.keyboard("black"), 0.30, low, 0.05, 0),
        placed(office.mug("ochre glaze"), -0.5, low, -0.1, 0),
    ]
    pieces += [placed(piece, -3.35, 0, 1.9, -90) for piece in desk]
    case = shelf(1.2, 1.5, 0.32, 4, "birch")
    books = []
    for level in shelf_levels(1.5, 4)[:-1]:
        row = furnishings.books(rng, 0.4 + 0.5 * rng.random(), 0.2, 0.3, _picker(rng), True)
        books += [s.at(-0.57, level, 0.1) for s in row]
    sill = box((RIGHT - LEFT - 0.1, 0.03, 0.2), "+z", CELL).at(0, SILL - 0.035, FRONT - 0.085)
    heaters = [box((WIDE - 0.1, 0.5, 0.08), "+z", CELL).at(x + WIDE / 2, 0.16, FRONT - 0.085) for x in window_x()]
    return [
        *pieces,
        placed(case, RIGHT - 0.165, 0, -0.6, -90),
        placed({"binders": books}, RIGHT - 0.165, 0, -0.6, -90),
        placed(furnishings.picture(1.9, 0.95, "steel", "chart", 0.02), RIGHT, 1.95, 1.9, -90),
        placed({"felt": [box((2.6, 1.0, 0.03), "-z", CELL).tiled(0.4, 0.4)]}, -0.6, 1.1, BACK + 0.018),
        placed(furnishings.rubber_plant(rng, 1.3, "white", "leaf", "stem", "soil"), RIGHT - 0.45, 0, FRONT - 0.6),
        {"white": [sill, *heaters, _globe()]},
    ]


def _globe() -> Shape:
    """Return a ball on the window sill."""
    a = np.linspace(-np.pi / 2, np.pi / 2, 13)
    profile = np.stack([0.11 * np.cos(a), 0.11 + 0.11 * np.sin(a)], axis=1)
    return turned_body(profile, 20).at(-4.3, SILL, FRONT - 0.1)


def blind() -> Piece:
    """Return a blind of slats, which stands on y = 0 about its own origin and slides before the windows."""
    width, height = BLIND
    step, deep, rise = (height - 0.05) / SLATS, 0.056, 0.047  # slats leave a fifth of the way open
    slats = [
        sheet((-width / 2, k * step, -deep / 2), (0, rise, deep), (width, 0, 0), (1, 8)).flipped() for k in range(SLATS)
    ]
    rail = box((width, 0.05, 0.06)).at(0, height - 0.05, 0)
    return {"slat": slats, "rail": [rail]}


def _picker(rng):
    """Return a function that picks a binder's colour at random."""
    return lambda: swatch(int(images.BINDER_COUNT * rng.random()), images.BINDER_COUNT)


def lino() -> Image:
    x, y = pixels(160, 160)
    value = 0.5 * cloud(x * 6, y * 6, (6, 6), 3, 4) + 0.5 * cloud(x * 48, y * 48, (48, 48), 4, 2)
    return shades(value, "7d7466 938a7b a89f90", 32)


def birch() -> Image:
    return wood(256, 128, "c2a074 d8bb92 e6cfab", 3)


def hedge() -> Image:
    x, y = pixels(128, 128)
    value = 0.35 * cloud(x * 8, y * 8, (8, 8), 11, 3) + 0.65 * cloud(x * 40, y * 40, (40, 40), 12, 2)
    return shades(value, "16260f 2f4a1c 54722d 7d963f", 48)


def chart() -> Image:
    """Return a map of an island: contours of noise that falls towards its rim."""
    x, y = pixels(192, 96)
    land = cloud(x * 6, y * 3, (6, 3), 21, 4) + 0.55 - 1.1 * np.hypot(1.7 * (x - 0.5), 1.5 * (y - 0.5))
    step = np.clip(np.floor(8 * land), 0, 7) / 7
    return shades(np.where(land < 0.25, 0.02, 0.12 + 0.88 * step), "6fa3bd e9dfb3 b9c98a 8fae6b c9a86a a8794c", 24)


OWN = {f.__name__: f for f in (lino, birch, hedge, chart)}
TEXTURES = ("lino", "ceiling", "birch", "felt", "binders", "monitor", "hedge", "chart")
PLAIN = {
    "wall": (0.76, 0.75, 0.71),
    "blue": (0.36, 0.50, 0.58),
    "white": (0.80, 0.80, 0.79),
    "frame": (0.55, 0.56, 0.56),
    "steel": (0.36, 0.37, 0.38),
    "black": (0.055, 0.056, 0.06),
    "board": (0.075, 0.135, 0.105),
    "ochre glaze": (0.62, 0.38, 0.13),
    "paving": (0.34, 0.33, 0.31),
    "stem": (0.24, 0.26, 0.12),
    "soil": (0.10, 0.07, 0.05),
    "glass": (0.0, 0.0, 0.0),
}
PAPER = (1.0, 1.0, 1.0)  # textures give all of the colour


def files() -> dict[str, bytes]:
    """Return the generated files by name."""
    materials = [material(name, rho) for name, rho in PLAIN.items()]
    materials.append(material("leaf", (0.14, 0.29, 0.10), two_sided=True))
    materials += [material(name, PAPER, texture=i) for i, name in enumerate(TEXTURES)]
    painted = [png(OWN[name]() if name in OWN else getattr(images, name)()) for name in TEXTURES]
    of_blind = [material("slat", (0.72, 0.71, 0.68), two_sided=True), material("rail", (0.6, 0.6, 0.6))]
    return {
        "classroom.glb": glb_bytes(classroom_parts(), materials, painted),
        "classroom_blind.glb": glb_bytes(parts_of(blind()), of_blind),
        "classroom_luminaire.ies": ies("row", PEAK, beam(32.0, 76.0), LUMINAIRE, WATTS),
        "classroom_washer.ies": ies("washer", WASHER_PEAK, beam(22.0, 60.0), WASHER, WASHER_WATTS),
    }


if __name__ == "__main__":
    write(Path(__file__).parent, files())
