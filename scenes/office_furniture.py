"""Furniture of the office, each piece standing on y = 0 about its own origin, facing +z. Pieces as in furniture.py."""

from __future__ import annotations

import numpy as np

from scenes.furniture import SOLE, Piece
from scenes.modelling import FINE, Shape, X, box, joined, rounded_box, sheet, wall
from scenes.round_shapes import ball, rod, tube, turned_body

LONG = 0.2  # [m] of the pieces of legs
TOP, THICK = 0.74, 0.028  # [m] height of desks and tables, thickness of their tops
DESK = (1.4, 0.8)  # [m] along x and z
MOUTH = np.array([0.34, 0.40, 0.20])  # [m] of a desk lamp's light from the middle of its foot
SCREEN = (1.4, 1.5)  # [m] of the free-standing screen
CABINET = (0.9, 1.8, 0.45)


def table(width: float, depth: float, wood: str, metal: str, inset: float = 0.06) -> Piece:
    """Return a table on four legs; the person sits at +z."""
    top = box((width, THICK, depth)).at(0, TOP - THICK, 0)
    x, z = width / 2 - inset, depth / 2 - inset
    legs = [_leg(0.04, TOP - THICK).at(s * x, 0, t * z) for s in (-1, 1) for t in (-1, 1)]
    return {wood: [top.tiled(0.9, 0.45)], metal: legs}


def _leg(width: float, height: float) -> Shape:
    """Return a square leg without ends, from within the floor to within the top."""
    side = wall((-width / 2, -SOLE, width / 2), (width, 0, 0), (0, height + 2 * SOLE, 0), LONG)
    return joined(*(side.turned(90 * k) for k in range(4)))


def divider(width: float, height: float, cloth: str) -> Piece:
    """Return a screen that stands on the tops of two desks, between them."""
    return {cloth: [rounded_box((width, height, 0.035), 0.012).tiled(0.4, 0.4)]}


def monitor(plastic: str, picture: str) -> Piece:
    """Return a monitor of 0.56 x 0.33 m on its foot."""
    w, h, low = 0.56, 0.33, 0.13
    body = box((w, h, 0.03), "+z").at(0, low, 0)
    foot = box((0.22, 0.012, 0.16), "-y").at(0, 0, -0.02)
    neck = box((0.05, low + 0.1, 0.02), "-y").at(0, 0, -0.026)
    face = sheet((-w / 2, low, 0.015), (w, 0, 0), (0, h, 0), (4, 3)).painted(0, 1, 1, 0)
    return {plastic: [body, foot, neck], picture: [face]}


def keyboard(plastic: str) -> Piece:
    return {plastic: [box((0.42, 0.018, 0.13), "-y")]}


def mug(glaze: str) -> Piece:
    side = [(0, 0), (0.036, 0), (0.040, 0.004), (0.040, 0.092), (0.035, 0.092), (0.034, 0.07), (0, 0.07)]
    return {glaze: [turned_body(side, 12)]}


def desk_lamp(metal: str, diffuser: str) -> Piece:
    """Return a lamp on a foot and two arms; its light leaves a round diffuser that looks down, at MOUTH."""
    elbow = np.array([-0.06, 0.33, -0.04])
    head = MOUTH + [0, 0.052, 0]
    foot = turned_body([(0, 0), (0.085, 0), (0.085, 0.012), (0.075, 0.018), (0, 0.02)], 18)
    low, high = rod((0, 0.015, 0), elbow, 0.007, 10), rod(elbow, head, 0.007, 10)
    x, y, z = MOUTH
    # From the rim upwards to the crown; the opening below is the diffuser.
    shade = turned_body([(0.070, 0.002), (0.072, 0.010), (0.045, 0.050), (0.020, 0.058), (0, 0.058)], 20).at(x, y, z)
    disc = turned_body([(0.070, 0.002), (0, 0.002)], 20).flipped().at(x, y, z)
    return {metal: [foot, low, high, ball(0.013, 10).at(*elbow), shade], diffuser: [disc]}


def swivel_chair(cloth: str, plastic: str) -> Piece:
    """Return an office chair on five castors: seat at 0.47 m, back to 1.0 m, two arms."""
    seat = rounded_box((0.48, 0.075, 0.46), 0.03).at(0, 0.40, 0.01)
    back = rounded_box((0.44, 0.50, 0.055), 0.025).turned(-9, X).at(0, 0.52, -0.24)
    shapes = [tube([(0, 0.09, 0), (0, 0.41, 0)], 0.026, 10), box((0.2, 0.03, 0.2), "+y").at(0, 0.375, 0)]
    for k in range(5):
        a = 2 * np.pi * (k + 0.25) / 5
        out = np.array([np.cos(a), 0, np.sin(a)])
        shapes.append(tube([0.02 * out + [0, 0.115, 0], 0.30 * out + [0, 0.075, 0]], [0.024, 0.014], 10))
        shapes.append(ball(0.030, 10).at(*(0.29 * out + [0, 0.030, 0])))
    spine = [(0, 0.39, -0.10), (0, 0.40, -0.22), (0, 0.50, -0.275), (0, 0.74, -0.315)]
    shapes.append(tube(spine, 0.016, 10))
    pads = []
    for s in (-1, 1):
        shapes.append(tube([(s * 0.22, 0.39, 0), (s * 0.27, 0.42, 0), (s * 0.27, 0.64, -0.02)], 0.012, 10))
        pads.append(box((0.06, 0.022, 0.24)).at(s * 0.27, 0.635, 0.0))
    return {cloth: [seat.tiled(0.3, 0.3), back.tiled(0.3, 0.3)], plastic: [*shapes, *pads]}


def visitor_chair(cloth: str, metal: str) -> Piece:
    """Return a chair of a seat and a back on two bent tubes."""
    seat = rounded_box((0.46, 0.04, 0.44), 0.015).at(0, 0.44, 0)
    back = rounded_box((0.46, 0.30, 0.035), 0.014).turned(-12, X).at(0, 0.56, -0.235)
    legs = []
    for s in (-1, 1):
        x = s * 0.20
        legs.append(tube([(x, -SOLE, 0.20), (x, 0.445, 0.17)], 0.011, 10))
        line = [(x, -SOLE, -0.24), (x, 0.44, -0.19), (x, 0.60, -0.245), (x, 0.82, -0.29)]
        legs.append(tube(line, 0.011, 10))
    return {cloth: [seat.tiled(0.3, 0.3), back.tiled(0.3, 0.3)], metal: legs}


def screen(cloth: str, metal: str) -> Piece:
    """Return a free-standing screen on two feet."""
    w, h = SCREEN
    panel = rounded_box((w, h - 0.08, 0.05), 0.018).at(0, 0.08, 0)
    feet = [rounded_box((0.06, 0.02, 0.44), 0.008).at(s * (w / 2 - 0.2), 0, 0) for s in (-1, 1)]
    posts = [box((0.04, 0.08, 0.03), "+y-y").at(s * (w / 2 - 0.2), 0.012, 0) for s in (-1, 1)]
    return {cloth: [panel.tiled(0.4, 0.4)], metal: [*feet, *posts]}


def cabinet(front: str, paint: str) -> Piece:
    """Return a cabinet as high as a person, on a plinth."""
    w, h, d = CABINET
    body = box((w, h - 0.05, d), "+z").at(0, 0.05, 0)
    plinth = box((w - 0.06, 0.05, d - 0.06), "+y")
    face = wall((-w / 2, 0.05, d / 2), (w, 0, 0), (0, h - 0.05, 0), FINE).painted(0, 1, 1, 0)
    return {paint: [body, plinth], front: [face]}


def sideboard(width: float, wood: str, paint: str) -> Piece:
    """Return a low cupboard, 0.42 m deep and TOP high."""
    body = box((width, TOP - 0.03, 0.42), "+y-y-z").at(0, -SOLE, 0)
    top = rounded_box((width + 0.02, 0.034, 0.43), 0.006).at(0, TOP - 0.034, 0.004)
    return {paint: [body], wood: [top.tiled(0.9, 0.45)]}
