"""Generates office.glb, its mobiles, office_desk_lamp.ldt, and the path in office.toml: `python -m scenes.make_office`.

An office of 9.6 x 3.0 x 7.2 m with twelve lamps by name: six ceiling panels, a pendant, a wall washer, three desk
lamps and the window. y is up, the camera looks along -z through the front wall. Metres, lumens and candelas.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gi_core.geometry.error import REC709
from scenes import furnishings
from scenes import office_furniture as office
from scenes import office_images as images
from scenes.furniture import parts_of, placed
from scenes.glb import glb_bytes, material, write
from scenes.key_frames import Loop, loop, write_paths
from scenes.luminaires import beam, ldt
from scenes.modelling import box, part, radiance, rounded_box, sheet, wall
from scenes.round_shapes import rod, turned_body
from scenes.textures import png, swatch

LEFT, RIGHT, BACK, FRONT, HEIGHT = -4.8, 4.8, -3.6, 3.6, 3.0
TILE = 0.6  # [m] of the ceiling's grid
CELL = 0.3  # [m] of walls and floor: max_edge of the scene file halves it once
WINDOW_Z, WINDOW_Y, REVEAL, BAR = (-2.7, 1.8), (0.9, 2.55), 0.05, 0.06  # along the left wall, up, into it
DOOR_X, DOOR_HEIGHT = (0.0, 0.9), 2.1  # in the back wall
DESK_X, ROW_Z = (-3.3, -1.9, -0.5), (-0.19, -1.01)  # middles of desks, from the window; front row, back row
MEETING = (2.85, -0.75)  # middle of the table
SEED = 11

# Lamps. Flux [lm]; colours of black bodies of 4000, 3000 and 7000 K in linear Rec. 709.
NEUTRAL, WARM, SKY = (1.414, 0.924, 0.533), (1.770, 0.845, 0.272), (1.005, 0.988, 1.109)
COLUMNS, ROWS = {"window": 2, "middle": 7, "door": 12}, {"back": 3, "front": 8}  # first tile of a panel, 2 x 1 tiles
PANEL_FLUX, PENDANT_FLUX, WASHER_FLUX, WINDOW_FLUX = 5500.0, 3000.0, 2500.0, 12000.0  # [lm]
GLOW_FLUX = 40.0  # [lm] of a desk lamp's diffuser; the luminaire below it has the rest
DESK_LAMP_PEAK, DESK_LAMP_FLUX = 150.0, 265.8  # [cd, lm] of that
DESK_LAMPS = dict(zip(("window", "middle", "aisle"), DESK_X, strict=True))  # on the front row
LAMP_FOOT = (-0.56, -0.24)  # from the middle of a desk, along x and z
PENDANT_SIZE, PENDANT_HEIGHT = (1.8, 0.09), 2.05
WASHER_Z, WASHER_X, WASHER_DROP = BACK + 0.75, (1.65, 4.05), 0.12

START, SPEED = -np.pi / 2, 0.5  # of the chair on its ellipse, [m/s]


def tinted(lumens: float, tint) -> np.ndarray:
    """Return RGB (3,) of a flux in lumens: its luminance is the flux."""
    tint = np.array(tint)
    return lumens * tint / float(REC709 @ tint)


def lamp_flux() -> dict[str, np.ndarray]:
    """Return flux RGB [lm] by material: of all lamps except the luminaires of the desk lamps."""
    flux = {f"panel {column} {row}": tinted(PANEL_FLUX, NEUTRAL) for column in COLUMNS for row in ROWS}
    flux |= {
        "pendant": tinted(PENDANT_FLUX, WARM),
        "wall washer": tinted(WASHER_FLUX, WARM),
        "window sky": tinted(WINDOW_FLUX, SKY),
    }
    return flux | {f"desk lamp {name}": tinted(GLOW_FLUX, WARM) for name in DESK_LAMPS}


def mouths() -> list[np.ndarray]:
    """Return where the light of the desk lamps leaves them, as in office.toml."""
    foot = [np.array([x + LAMP_FOOT[0], office.TOP, ROW_Z[0] + LAMP_FOOT[1]]) for x in DESK_LAMPS.values()]
    return [f + office.MOUTH for f in foot]


def office_parts():
    """Return the static part, a part a material."""
    rng = np.random.default_rng(SEED)
    return [*_shell(), *_ceiling(), *_window(), *_door(), *parts_of(*_luminaires(), *_workplaces(rng), *_rest(rng))]


def _shell():
    w, h, d = RIGHT - LEFT, HEIGHT, FRONT - BACK
    floor = wall((LEFT, 0, FRONT), (w, 0, 0), (0, 0, -d), CELL).tiled(1.2, 1.2)
    (x0, x1), y1 = DOOR_X, DOOR_HEIGHT
    back = [  # round the door, which reaches the floor
        wall((LEFT, 0, BACK), (x0 - LEFT, 0, 0), (0, y1, 0), CELL),
        wall((x1, 0, BACK), (RIGHT - x1, 0, 0), (0, y1, 0), CELL),
        wall((LEFT, y1, BACK), (w, 0, 0), (0, h - y1, 0), CELL),
    ]
    front = wall((RIGHT, 0, FRONT), (-w, 0, 0), (0, h, 0), CELL)
    (z0, z1), (y0, y1) = WINDOW_Z, WINDOW_Y
    left = wall((LEFT, 0, FRONT), (0, 0, -d), (0, h, 0), CELL, ((FRONT - z1, y0), (FRONT - z0, y1)))
    right = wall((RIGHT, 0, BACK), (0, 0, d), (0, h, 0), CELL)
    return [part("carpet", floor), part("wall", *back, front, left), part("green", right)]


def _ceiling():
    """Return the ceiling of tiles, and the panels flush with it."""
    columns, rows = [0, 5, 11, 16], [0, 6, 12]  # tiles, a panel in each field
    tiles, parts = [], []
    for i, (column, x) in enumerate(COLUMNS.items()):
        for j, (row, z) in enumerate(ROWS.items()):
            corner = np.array([LEFT + TILE * columns[i], HEIGHT, BACK + TILE * rows[j]])
            along, across = TILE * (columns[i + 1] - columns[i]), TILE * (rows[j + 1] - rows[j])
            low = TILE * np.array([x - columns[i], z - rows[j]])
            high = low + TILE * np.array([2, 1])
            field = wall(corner, (along, 0, 0), (0, 0, across), CELL, (tuple(low), tuple(high)))
            tiles.append(field.tiled(TILE, TILE))
            panel = wall(corner + [low[0], 0, low[1]], (2 * TILE, 0, 0), (0, 0, TILE), CELL)
            parts.append(part(f"panel {column} {row}", panel))
    return [part("ceiling", *tiles), *parts]


def _window():
    (z0, z1), (y0, y1) = WINDOW_Z, WINDOW_Y
    pane, wide, tall = LEFT - REVEAL, z1 - z0, y1 - y0
    width = (wide - 2 * BAR) / 3

    def flat(z, width):
        """Return a part of the window's plane from its end nearest the camera, seen from the room."""
        return wall((pane, y0, z), (0, 0, -width), (0, tall, 0), CELL / 2)

    # Glass and bars lie in one plane: a bar before the glass would have a gradient that no disc can follow.
    ends = [z1 - k * (width + BAR) for k in range(3)]
    panes = [flat(z, width) for z in ends]
    bars = [flat(z - width, BAR) for z in ends[:2]]
    reveal = [
        sheet((pane, y1, z0), (REVEAL, 0, 0), (0, 0, wide), (1, 30)),
        sheet((pane, y0, z0), (REVEAL, 0, 0), (0, tall, 0), (1, 11)),
        sheet((LEFT, y0, z1), (-REVEAL, 0, 0), (0, tall, 0), (1, 11)),
    ]
    sill = rounded_box((REVEAL + 0.20, 0.03, wide + 0.2), 0.01).at((pane + LEFT + 0.18) / 2, y0 - 0.03, (z0 + z1) / 2)
    heater = box((0.08, 0.5, wide - 0.4)).at(LEFT + 0.085, 0.16, (z0 + z1) / 2)
    return [part("window sky", *panes), part("steel", *bars), part("white", *reveal, sill, heater)]


def _door():
    """Return the leaf in the plane of a reveal, and its handle."""
    (x0, x1), h, deep = DOOR_X, DOOR_HEIGHT, BACK - REVEAL
    leaf = wall((x0, 0, deep), (x1 - x0, 0, 0), (0, h, 0), CELL / 2)
    leaf = leaf._replace(uv=leaf.uv[:, ::-1]).tiled(0.9, 0.45)  # the grain runs upwards
    reveal = [
        sheet((x0, h, deep), (x1 - x0, 0, 0), (0, 0, REVEAL), (6, 1)),
        sheet((x0, 0, BACK), (0, 0, -REVEAL), (0, h, 0), (1, 14)),
        sheet((x1, 0, deep), (0, 0, REVEAL), (0, h, 0), (1, 14)),
        sheet((x0, 0, BACK), (x1 - x0, 0, 0), (0, 0, -REVEAL), (6, 1)),
    ]
    near = deep + 0.05
    lever = [rod((x0 + 0.09, 1.05, deep), (x0 + 0.09, 1.05, near), 0.01, 10)]
    lever.append(rod((x0 + 0.08, 1.05, near), (x0 + 0.21, 1.05, near), 0.009, 10))
    return [part("oak", leaf), part("white", *reveal), part("metal", *lever)]


def _luminaires():
    """Return the pendant over the meeting table, the wall washer on the ceiling and the desk lamps."""
    (w, d), y, (x, z) = PENDANT_SIZE, PENDANT_HEIGHT, MEETING
    profile = box((w, 0.045, d), "+y").at(x, y, z)  # glows below and on its sides
    body = box((w, 0.03, d), "-y").at(x, y + 0.045, z)
    wires = [rod((x + s * 0.7, y + 0.07, z), (x + s * 0.7, HEIGHT + 0.01, z), 0.004, 10) for s in (-1, 1)]
    x0, x1 = WASHER_X
    # A trough whose opening looks to the wall and down, 30 degrees below the horizontal.
    high, near, far = HEIGHT - 0.02, WASHER_Z + 0.035, WASHER_Z - 0.025
    low = HEIGHT - WASHER_DROP
    opening = wall((x0, low, near), (x1 - x0, 0, 0), (0, high - low, far - near), CELL / 2).flipped()
    back = wall((x0, low, near), (x1 - x0, 0, 0), (0, HEIGHT - low, 0), CELL / 2)
    lid = sheet((x0, high, far), (x1 - x0, 0, 0), (0, HEIGHT - high, 0), (12, 1)).flipped()
    ends = []
    for s, x in ((1, x1), (-1, x0)):
        outline = np.array([[x, low, near], [x, HEIGHT, near], [x, HEIGHT, far], [x, high, far]])
        end = sheet(outline[0], (0, 0, 1), (0, 1, 0))  # its normals and texture coordinates; corners follow
        corners = outline if s < 0 else outline[::-1]
        normals = np.tile([float(s), 0, 0], (4, 1))
        ends.append(end._replace(vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]]), normals=normals))
    lamps = []
    for name, x in DESK_LAMPS.items():
        lamp = office.desk_lamp("metal", f"desk lamp {name}")
        lamps.append(placed(lamp, x + LAMP_FOOT[0], office.TOP, ROW_Z[0] + LAMP_FOOT[1]))
    return [
        {"pendant": [profile], "metal": [body, *wires]},
        {"wall washer": [opening], "metal": [back, lid, *ends]},
        *lamps,
    ]


def _workplaces(rng):
    """Return six desks face to face, dividers between the rows, and the things on them."""
    pieces = []
    low = office.TOP - 0.002
    for row, z in enumerate(ROW_Z):
        for k, x in enumerate(DESK_X):
            turn = 0 if row == 0 else 180
            things = [
                placed(office.table(office.DESK[0] - 0.01, office.DESK[1], "oak", "steel"), 0, 0, 0),
                placed(office.monitor("black", "monitor"), 0.06, low, -0.22, 0),
                placed(office.keyboard("black"), 0.06, low, -0.01, 0),
            ]
            if (row + k) % 2 == 0:
                things.append(placed(office.mug("ochre glaze"), 0.46, low, -0.06, 0))
            else:
                pile = furnishings.lying_books([(0.22, 0.03, 0.30, 4), (0.20, 0.024, 0.28, -9)], _picker(rng))
                things.append(placed({"binders": pile}, 0.52, low, -0.12, 0))
            pieces += [placed(p, x, 0, z, turn) for p in things]
            if (row, k) not in ((0, 2), (1, 1)):  # the chair of the first moves; nobody sits at the second
                away = 0.68 + 0.1 * rng.random()
                chair = office.swivel_chair("charcoal", "black")
                pieces.append(
                    placed(
                        chair,
                        x + 0.08 * rng.random(),
                        0,
                        z + away * (1 - 2 * row),
                        180 - turn + 25 * (rng.random() - 0.5),
                    )
                )
    width = DESK_X[2] - DESK_X[0] + office.DESK[0] - 0.02
    middle = (ROW_Z[0] + ROW_Z[1]) / 2
    third = width / 3
    for k in (-1, 0, 1):
        pieces.append(placed(office.divider(third - 0.02, 0.44, "felt"), DESK_X[1] + k * third, low - 0.1, middle))
    return pieces


def _rest(rng):
    """Return the meeting table with its chairs, cupboards, whiteboard and plants."""
    x, z = MEETING
    around = [(-0.5, 0.72, 180), (0.5, 0.74, 172), (-0.5, -0.74, 6), (0.5, -0.72, 0)]
    chairs = [placed(office.visitor_chair("ochre", "steel"), x + dx, 0, z + dz, a) for dx, dz, a in around]
    side = office.sideboard(1.6, "oak", "white")
    row = furnishings.books(rng, 0.8, 0.25, 0.33, _picker(rng))
    bowl = [(0, 0), (0.35, 0), (0.9, 0.35), (1.0, 0.6), (0.94, 0.61), (0.8, 0.38), (0, 0.1)]
    return [
        placed(office.table(2.1, 1.0, "oak", "steel", 0.1), x, 0, z),
        *chairs,
        placed({"ochre glaze": [turned_body(np.array(bowl) * 0.15, 20)]}, x + 0.2, office.TOP - 0.002, z),
        placed(side, -3.2, 0, BACK + 0.225),
        placed(side, -1.4, 0, BACK + 0.225),
        placed({"binders": row}, -3.9, office.TOP - 0.001, BACK + 0.34),
        placed(furnishings.vase(VASE, 0.30, "ochre glaze", 20), -2.7, office.TOP - 0.001, BACK + 0.22),
        placed(furnishings.picture(1.5, 0.95, "steel", "board", 0.02), x, 1.55, BACK),
        *(
            placed({cloth: [rounded_box((w, h, 0.05), 0.012).tiled(0.4, 0.4)]}, x, y, BACK + 0.028)
            for cloth, w, h, x, y in ABSORBERS
        ),
        placed(furnishings.rubber_plant(rng, 1.35, "white", "leaf", "stem", "soil"), 1.45, 0, BACK + 0.42),
    ]


ABSORBERS = [  # cloth on the back wall: material, width, height, x of the middle, lower edge [m]
    ("felt", 1.1, 0.8, -3.35, 1.35),
    ("ochre", 0.5, 0.8, -2.45, 1.35),
    ("charcoal", 0.8, 0.8, -1.70, 1.35),
]
VASE = [(0.16, 0), (0.24, 0.3), (0.22, 0.55), (0.09, 0.82), (0.12, 1.0)]


def _picker(rng):
    """Return a function that picks a binder's colour at random."""
    return lambda: swatch(int(images.BINDER_COUNT * rng.random()), images.BINDER_COUNT)


TEXTURES = ("carpet", "ceiling", "oak", "felt", "ochre", "charcoal", "binders", "monitor", "board")
PLAIN = {
    "wall": (0.74, 0.73, 0.71),
    "green": (0.30, 0.42, 0.34),
    "white": (0.78, 0.78, 0.77),
    "steel": (0.36, 0.37, 0.38),
    "metal": (0.16, 0.17, 0.18),
    "black": (0.055, 0.056, 0.06),
    "ochre glaze": (0.62, 0.38, 0.13),
    "stem": (0.24, 0.26, 0.12),
    "soil": (0.10, 0.07, 0.05),
}
PAPER = (1.0, 1.0, 1.0)  # textures give all of the colour


def files() -> dict[str, bytes]:
    """Return the generated files by name."""
    parts = office_parts()
    materials = [material(name, rho) for name, rho in PLAIN.items()]
    materials.append(material("leaf", (0.14, 0.29, 0.10), two_sided=True))
    for name, flux in lamp_flux().items():
        materials.append(material(name, (0.6, 0.6, 0.6), radiance(flux, parts, name)))
    materials += [material(name, PAPER, texture=i) for i, name in enumerate(TEXTURES)]
    plastic, metal = material("black", PLAIN["black"]), material("metal", PLAIN["metal"])

    def mobile(piece, textures, *others) -> bytes:
        painted = [material(name, PAPER, texture=i) for i, name in enumerate(textures)]
        return glb_bytes(parts_of(piece), [*others, *painted], [png(getattr(images, name)()) for name in textures])

    return {
        "office_desk_lamp.ldt": ldt("desk lamp", DESK_LAMP_PEAK, beam(25.0, 70.0), DESK_LAMP_FLUX),
        "office.glb": glb_bytes(parts, materials, [png(getattr(images, name)()) for name in TEXTURES]),
        "office_chair.glb": mobile(office.swivel_chair("charcoal", "black"), ["charcoal"], plastic),
        "office_screen.glb": mobile(office.screen("ochre", "metal"), ["ochre"], metal),
        "office_cabinet.glb": mobile(
            office.cabinet("locker", "paint"), ["locker"], material("paint", (0.49, 0.55, 0.47))
        ),
    }


def paths() -> dict[str, Loop]:
    """Return the chair's path by scene file: an ellipse over the free floor before the desks."""

    def ellipse(a):
        return np.stack([0.2 + 2.1 * np.cos(a + START), 0 * a, 2.1 + 0.62 * np.sin(a + START)], axis=1)

    return {"office.toml": loop(ellipse, keys=24, speed=SPEED, turns=1)}


if __name__ == "__main__":
    write(Path(__file__).parent, files())
    write_paths(Path(__file__).parent, paths())
