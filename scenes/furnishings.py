"""Furnishings of a room: books, lamps, vases, curtains, a plant, pictures. Pieces as in furniture.py."""

from __future__ import annotations

import numpy as np

from scenes.furniture import SOLE, Piece
from scenes.modelling import Shape, box, grid_faces, joined, rounded_box, sheet
from scenes.round_shapes import ball, rod, tube, turned_body


def books(rng, width: float, depth: float, height: float, pick, at_side: bool = False) -> list[Shape]:
    """Return books that stand side by side along x from x = 0, about `width` [m], their spines at z = 0.

    pick(): the texture coordinates of a cover's colour; at_side: the first one touches the bookcase.
    Covers that another book hides are left out: in slots a millimetre wide no estimate is any good.
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

    The bulb itself is left out: its light through cloth and diffusers is given to them, and
    light that leaves large surfaces needs far fewer photons than a small bulb in a deep shade.
    """
    r, tall = 0.21, 0.27
    low = height - tall
    foot = [(0, -SOLE), (0.15, -SOLE), (0.15, 0.012), (0.14, 0.02), (0.02, 0.026), (0, 0.026)]
    stem = rod((0, 0.02, 0), (0, low + 0.05, 0), 0.011, 6)
    discs = [turned_body([(r, low), (0.011, low)], 32).flipped(), turned_body([(r - 0.02, height), (0, height)], 32)]
    return {
        metal: [turned_body(foot, 18), stem],
        shade: [turned_body([(r, low), (r - 0.02, height)], 32)],
        diffuser: discs,
    }


def globe_lamp(radius: float, metal: str, glass: str) -> Piece:
    """Return a glowing ball on a small foot."""
    foot = turned_body([(0, 0), (0.06, 0), (0.06, 0.012), (0.012, 0.022), (0.012, 0.12)], 8)
    return {metal: [foot], glass: [ball(radius, 20).at(0, 0.11 + radius * 0.97, 0)]}


def vase(profile, height: float, material: str, segments: int = 24) -> Piece:
    """Return a turned vase with a rim; profile (radius, height) as shares of the height, from the foot up."""
    outside = np.array(profile, float) * height
    r, y = outside[-1]
    neck = [(r - 0.006, y), (r - 0.012, y - 0.03), (0, y - 0.035)]
    return {material: [turned_body([(0, 0), *outside, *neck], segments)]}


def curtain(width: float, height: float, folds: int, material: str, columns: int = 6, rows: int = 13) -> Piece:
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
    # A hair in front of the frame: at the foot of a rim light changes within millimetres, which no disc can follow.
    face = sheet((-width / 2, -height / 2, deep - 0.001), (width, 0, 0), (0, height, 0), cells)
    return {frame: bars, canvas: [face.painted(0, 1, 1, 0)]}
