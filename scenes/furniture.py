"""Furniture of the living room and the gallery, each piece standing on y = 0 about its own origin, facing +z.

A piece is a dict from material to shapes, so that pieces are put into a room by `placed` and sorted by `parts_of`.
"""

from __future__ import annotations

import numpy as np

from scenes.glb import Part
from scenes.modelling import FINE, Shape, X, box, cushion, part, rounded_box, wall
from scenes.round_shapes import rod, tube, turned_body

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
    shapes += [rounded_box((width - 2 * arm, 0.58, 0.20), 0.06).at(0, 0.2, -depth / 2 + 0.10)]
    for s in (-1, 1):
        shapes += [rounded_box((seat - 0.01, 0.17, 0.72), 0.055).at(s * seat / 2, 0.28, 0.085)]
        back = rounded_box((seat - 0.02, 0.42, 0.17), 0.065).turned(-13, X)
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
        shapes.append(rod(*ends, 0.014, 6, 0.024).tiled(0.7, 0.35))
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
    bend = 0.37 * (np.cos(turn[0]) - np.cos(turn))  # backwards between the legs
    rail = [np.stack([0.42 * np.sin(turn), y + 0 * turn, z + bend], axis=1) for y, z in RAILS]
    slats = [_slat(rail[k], rail[k + 1]) for k in (0, 2)]
    pad = rounded_box((w, 0.05, d), 0.022, 2).at(0, h - 0.025, -0.005)
    return {wood: [s.tinted(0.5, 0.5) for s in (*legs, *slats)], seat: [pad.tiled(0.3, 0.3)]}


RAILS = ((0.555, -0.195), (0.63, -0.202), (0.70, -0.216), (0.81, -0.249))  # y and z of the chair's slats at the legs


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
    side = side._replace(uv=side.uv[:, ::-1])  # the grain runs upwards
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
