"""Furniture of the living room and the gallery, each piece standing on y = 0 about its own origin, facing +z.

A piece is a dict from material to shapes, so that pieces are put into a room by `placed` and sorted by `parts_of`.
"""

from __future__ import annotations

import numpy as np

from scenes.glb import Part
from scenes.modelling import (
    FINE,
    Shape,
    X,
    ball,
    box,
    cushion,
    grid_faces,
    joined,
    part,
    rod,
    rounded_box,
    sheet,
    tube,
    turned_body,
    wall,
)

Piece = dict[str, list[Shape]]
SOLE = 0.004  # [m] how far feet reach into the floor: a sole in its plane would be the same place twice


def placed(piece: Piece, x: float, y: float, z: float, degrees: float = 0.0) -> Piece:
    """Return the piece turned about the vertical, then moved."""
    return {m: [s.turned(degrees).at(x, y, z) for s in shapes] for m, shapes in piece.items()}


def parts_of(*pieces: Piece) -> list[Part]:
    """Return the parts of a mesh file, one a material and kind of normals."""
    sorted_shapes: dict[tuple[str, bool], list[Shape]] = {}
    for piece in pieces:
        for material, shapes in piece.items():
            for s in shapes:
                sorted_shapes.setdefault((material, s.normals is None), []).append(s)
    return [part(material, *shapes) for (material, _), shapes in sorted_shapes.items()]


def sofa(width: float, cloth: str, wood: str) -> Piece:
    """Return a sofa of two seats, 0.92 m deep, its back 0.80 m high."""
    arm, depth = 0.17, 0.92
    seat = (width - 2 * arm) / 2
    shapes = [box((width - 0.06, 0.16, depth - 0.08), "+y").at(0, 0.14, 0)]
    shapes += [rounded_box((arm, 0.46, depth), 0.06, 2).at(s * (width - arm) / 2, 0.13, 0) for s in (-1, 1)]
    shapes += [rounded_box((width - 2 * arm, 0.58, 0.20), 0.06, 2).at(0, 0.2, -depth / 2 + 0.10)]
    for s in (-1, 1):
        shapes += [rounded_box((seat - 0.01, 0.17, 0.72), 0.055, 2).at(s * seat / 2, 0.28, 0.085)]
        back = rounded_box((seat - 0.02, 0.42, 0.17), 0.065, 2).turned(-13, X)
        shapes += [back.at(s * seat / 2, 0.43, -depth / 2 + 0.26)]
    feet = [
        turned_body([(0, -SOLE), (0.018, -SOLE), (0.026, 0.15), (0, 0.15)], 8).at(x, 0, z)
        for x in (-width / 2 + 0.1, width / 2 - 0.1)
        for z in (-depth / 2 + 0.1, depth / 2 - 0.1)
    ]
    return {cloth: [s.tiled(0.3, 0.3) for s in shapes], wood: feet}


def pillow(size: float, material: str) -> Piece:
    """Return a square pillow that leans backwards."""
    standing = cushion((size, 0.16, size), 0.55).turned(90, X).at(0, size / 2, 0)
    return {material: [standing.turned(-24, X).tiled(0.3, 0.3)]}


def round_table(radius: float, height: float, wood: str, legs: int = 4) -> Piece:
    """Return a round table on splayed legs."""
    edge = 0.03
    top = [
        (0, -edge),
        (radius - 0.02, -edge),
        (radius, -0.6 * edge),
        (radius, -0.25 * edge),
        (radius - 0.008, 0),
        (0, 0),
    ]
    top = turned_body(top, 40).at(0, height, 0)
    flat = top.vertices[:, [0, 2]]  # grain straight across, not round and round
    shapes = [top._replace(uv=flat).tiled(0.7, 0.35)]
    for k in range(legs):
        a = 2 * np.pi * (k + 0.5) / legs
        out = np.array([np.cos(a), 0, np.sin(a)])
        foot, head = 0.82 * radius * out, 0.55 * radius * out
        ends = [foot + [0, -SOLE, 0], head + [0, height - edge - 0.002, 0]]
        shapes.append(rod(*ends, 0.014, 8, 0.024).tiled(0.7, 0.35))
    return {wood: shapes}


def chair(wood: str, seat: str) -> Piece:
    """Return a dining chair: seat at 0.46 m, back to 0.84 m, four legs, two of which rise into the back."""
    w, d, h = 0.44, 0.42, 0.46
    legs = []
    for s in (-1, 1):
        legs.append(tube([(s * 0.20, 0, 0.19), (s * 0.185, h - 0.03, 0.165)], [0.014, 0.020], 8))
        back = [(s * 0.20, 0, -0.23), (s * 0.185, h, -0.185), (s * 0.180, 0.66, -0.205), (s * 0.175, 0.80, -0.245)]
        legs.append(tube(back, [0.014, 0.020, 0.018, 0.013], 8))
        legs.append(tube([(s * 0.195, 0.22, 0.177), (s * 0.194, 0.22, -0.208)], [0.010, 0.010], 6))
    turn = np.radians(np.linspace(-1, 1, 9) * 26)
    rail = [np.stack([0.42 * np.sin(turn), y + 0 * turn, -0.62 + b + 0.37 * np.cos(turn)], axis=1) for y, b in RAILS]
    slats = [_slat(rail[k], rail[k + 1]) for k in (0, 2)]
    pad = rounded_box((w, 0.05, d), 0.022, 2).at(0, h - 0.025, -0.005)
    return {wood: [s.tinted(0.5, 0.5) for s in (*legs, *slats)], seat: [pad.tiled(0.3, 0.3)]}


RAILS = ((0.555, -0.005), (0.63, -0.016), (0.70, -0.03), (0.81, -0.062))  # heights and lean of the chair's slats


def _slat(low: np.ndarray, high: np.ndarray) -> Shape:
    """Return a curved board between two edges, 16 mm thick."""
    up = high - low
    n = np.array([0, 0, 1.0]) - up * (up[:, 2:] / (up * up).sum(axis=1, keepdims=True))
    n *= 0.008 / np.sqrt((n * n).sum(axis=1, keepdims=True))
    around = np.stack([low + n, high + n, high - n, low - n, low + n], axis=1)
    rows = []
    for k in range(4):  # four faces with sharp edges between them
        strip = around[:, k : k + 2].reshape(-1, 3)
        i = 2 * np.arange(len(low) - 1)[:, None]
        rows.append((strip, np.concatenate([i + [0, 2, 3], i + [0, 3, 1]])))
    ends = [(around[0, :4], np.array([[0, 1, 2], [0, 2, 3]])), (around[-1, :4], np.array([[0, 2, 1], [0, 3, 2]]))]
    vertices, faces, count = [], [], 0
    for v, f in (*rows, *ends):
        vertices.append(v)
        faces.append(f + count)
        count += len(v)
    return Shape(np.concatenate(vertices), np.concatenate(faces), np.zeros((count, 2)))


def shelf(width: float, height: float, depth: float, boards: int, wood: str) -> Piece:
    """Return a bookcase with a back, its compartments equally high; their floors are at `shelf_levels`."""
    t = 0.028
    side = box((t, height, depth), "-z-y")
    shapes = [side.at(s * (width - t) / 2, 0, 0) for s in (-1, 1)]
    inner = width - 2 * t
    for y in shelf_levels(height, boards):
        shapes.append(box((inner, t, depth - 0.012), "-x+x-z").at(0, y - t, 0.006))
    shapes.append(box((inner, 0.05, depth - 0.04), "-x+x-z-y").at(0, -SOLE, 0))  # plinth
    shapes.append(wall((-inner / 2, 0, -depth / 2 + 0.012), (inner, 0, 0), (0, height - t, 0), FINE))
    return {wood: [s.tiled(0.7, 0.35) for s in shapes]}


def shelf_levels(height: float, boards: int) -> np.ndarray:
    """Return the heights of the upper sides of a bookcase's boards, the top one last."""
    return np.linspace(0.075, height, boards)


def books(rng, width: float, depth: float, height: float, pick, at_side: bool = False) -> list[Shape]:
    """Return books that stand side by side along x from x = 0, about `width` [m], their spines at z = 0.

    pick(): the texture coordinates of a cover's colour; at_side: the first one touches the bookcase.
    Covers that another book hides are left out: two walls a hair apart would be light's problem, and nobody's joy.
    """
    sizes, x = [], 0.0
    while True:
        thick, tall = 0.022 + 0.026 * rng.random(), height * (0.68 + 0.3 * rng.random())
        if x + thick > width:
            break
        sizes.append((x, thick, tall))
        x += thick
    heights = [np.inf if at_side else 0.0, *(tall for *_, tall in sizes), 0.0]
    shapes = []
    for k, (x, thick, tall) in enumerate(sizes):
        book = [sheet((0, 0, 0), (thick, 0, 0), (0, tall, 0)), sheet((0, tall, 0), (thick, 0, 0), (0, 0, -depth))]
        left, right = heights[k], heights[k + 2]
        if left < tall:
            book.append(sheet((0, left, -depth), (0, 0, depth), (0, tall - left, 0)))
        if right < tall:
            book.append(sheet((thick, right, 0), (0, 0, -depth), (0, tall - right, 0)))
        shapes.append(joined(*book).tinted(*pick()).at(x, 0, 0))
    return shapes


def lying_books(sizes, pick) -> list[Shape]:
    """Return a pile of books: (width, height, depth, degrees) of each, from below to above."""
    shapes, y = [], 0.0
    for w, h, d, degrees in sizes:
        shapes.append(rounded_box((w, h, d), 0.004).tinted(*pick()).turned(degrees).at(0, y, 0))
        y += h
    return shapes


def floor_lamp(height: float, metal: str, shade: str, diffuser: str) -> Piece:
    """Return a lamp with a drum shade that glows, and a glowing diffuser in its upper and lower opening.

    The bulb itself is left out: what it sends through cloth and diffusers is given to them, and
    light that leaves large surfaces needs far fewer photons than a small bulb in a deep shade.
    """
    r, tall = 0.21, 0.27
    low = height - tall
    foot = [(0, -SOLE), (0.15, -SOLE), (0.15, 0.012), (0.14, 0.02), (0.02, 0.026), (0, 0.026)]
    stem = rod((0, 0.02, 0), (0, low + 0.05, 0), 0.011, 6)
    discs = [turned_body([(r, low), (0.011, low)], 32).flipped(), turned_body([(r - 0.02, height), (0, height)], 32)]
    return {
        metal: [turned_body(foot, 28), stem],
        shade: [turned_body([(r, low), (r - 0.02, height)], 32)],
        diffuser: discs,
    }


def globe_lamp(radius: float, metal: str, glass: str) -> Piece:
    """Return a glowing ball on a small foot."""
    foot = turned_body([(0, 0), (0.06, 0), (0.06, 0.012), (0.03, 0.03), (0.03, 0.045)], 20)
    return {metal: [foot], glass: [ball(radius, 20).at(0, 0.03 + radius * 0.97, 0)]}


def vase(profile, height: float, material: str, segments: int = 24) -> Piece:
    """Return a turned vase with a rim; profile (radius, height) as shares of the height, from the foot up."""
    outside = np.array(profile, float) * height
    r, y = outside[-1]
    neck = [(r - 0.006, y), (r - 0.012, y - 0.03), (0, y - 0.035)]
    return {material: [turned_body([(0, 0), *outside, *neck], segments)]}


def curtain(width: float, height: float, folds: int, material: str, columns: int = 6, rows: int = 14) -> Piece:
    """Return cloth that hangs in folds along x, its upper edge at `height`; two-sided."""
    s, t = np.meshgrid(np.linspace(0, 1, folds * columns + 1), np.linspace(0, 1, rows + 1), indexing="ij")
    a = 2 * np.pi * folds * s
    swing = 0.035 * (0.75 + 0.25 * t)  # wider at the hem
    x = width * (s - 0.5) + 0.012 * np.sin(2 * a) * t
    z = swing * np.sin(a) + 0.008 * np.sin(1.7 * a / folds + 5 * t)
    y = height * (1 - t) + 0.015
    vertices = np.stack([x, y, z], axis=2).reshape(-1, 3)
    uv = np.stack([s * width * 1.6, t * height], axis=2).reshape(-1, 2)
    return {material: [Shape(vertices, grid_faces(folds * columns + 1, rows + 1)[:, ::-1], uv).tiled(0.3, 0.3)]}


def rubber_plant(rng, height: float, pot: str, leaf: str, stem: str, soil: str) -> Piece:
    """Return a plant of large leaves in a pot."""
    r = 0.17
    body = [(0, 0), (0.72 * r, 0), (0.78 * r, 0.01), (r, 0.30), (0.94 * r, 0.305), (0.92 * r, 0.27)]
    shapes: Piece = {pot: [turned_body(body, 24)], soil: [turned_body([(0.93 * r, 0.27), (0, 0.275)], 24)], leaf: []}
    sticks = []
    for lean, tall in ((0.0, height), (0.16, 0.82 * height), (-0.14, 0.72 * height)):
        turn = 2 * np.pi * rng.random()
        top = np.array([np.cos(turn) * lean, 0, np.sin(turn) * lean])
        t = np.linspace(0, 1, 6)[:, None]
        line = top * t**1.5 + np.array([0, 0.27, 0]) + t * np.array([0, tall - 0.27, 0])
        sticks.append(tube(line, np.linspace(0.011, 0.005, 6), 6))
        count = int(11 * tall / height)
        for k in range(count):
            share = 0.22 + 0.78 * (k + 0.5) / count
            at = np.array([np.interp(share, t[:, 0], line[:, j]) for j in range(3)])
            length = 0.27 * (1 - 0.35 * share) * (0.85 + 0.3 * rng.random())
            steep = 20 + 45 * share + 12 * (rng.random() - 0.5)
            one = _leaf(length).turned(steep, -np.eye(3)[0]).turned(137.5 * k + 40 * rng.random())
            shapes[leaf].append(one.at(*at))
    return shapes | {stem: sticks}


def _leaf(length: float) -> Shape:
    """Return a leaf that lies along +z, folded along its rib, its tip hanging."""
    t = np.linspace(0, 1, 7)
    half = 0.23 * length * np.sin(np.pi * np.clip(t, 0, 1) ** 0.8) ** 0.8
    half[0], half[-1] = 0.004, 0.0005
    droop = -0.28 * length * t * t
    rows = [np.stack([s * half, droop + 0.3 * half * abs(s), t * length], axis=1) for s in (-1, 0, 1)]
    return Shape(np.concatenate(rows), grid_faces(3, 7)[:, ::-1], np.zeros((21, 2)))


def picture(width: float, height: float, frame: str, canvas: str, border: float = 0.03) -> Piece:
    """Return a framed picture that hangs in the plane z = 0, its middle at the origin; its image fills the canvas."""
    deep = 0.035
    ends = (-height / 2 - border, height / 2)
    bars = [box((width + 2 * border, border, deep), "-z").at(0, y, deep / 2 - 0.002) for y in ends]
    upright = box((border, height, deep), "-z-y+y").at(0, -height / 2, deep / 2 - 0.002)
    bars = [b.tinted(0.5, 0.5) for b in (*bars, *(upright.at(s * (width + border) / 2, 0, 0) for s in (-1, 1)))]
    cells = (max(2, round(width / 0.15)), max(2, round(height / 0.15)))
    face = sheet((-width / 2, -height / 2, 0.029), (width, 0, 0), (0, height, 0), cells)
    return {frame: bars, canvas: [face.painted(0, 1, 1, 0)]}
