"""Generates cornell.glb and pawn.glb, and the path in cornell.toml: `python -m scenes.make_cornell`.

Geometry as measured (Cornell University Program of Computer Graphics), millimetres turned to metres.
Departures from the data, each because light would otherwise be wrong: the lamp's opening is cut out of the
coplanar ceiling; the boxes have no bottoms, which would be coplanar with the floor that stays whole.
All surfaces are one-sided: walls face into the room, the front is open, boxes face outwards.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scenes.cornell_spectra import GREEN, LUMINAIRE_REFLECTANCE, RED, WHITE, lamp_rgb, reflectance_rgb
from scenes.glb import Part, glb_bytes, material, write
from scenes.key_frames import Loop, there_and_back, write_paths

MM = 1e-3
TOP = 548.8
FLOOR = [(552.8, 0, 0), (0, 0, 0), (0, 0, 559.2), (549.6, 0, 559.2)]
CEILING = [(556, TOP, 0), (556, TOP, 559.2), (0, TOP, 559.2), (0, TOP, 0)]
BACK = [(549.6, 0, 559.2), (0, 0, 559.2), (0, TOP, 559.2), (556, TOP, 559.2)]
GREEN_WALL = [(0, 0, 559.2), (0, 0, 0), (0, TOP, 0), (0, TOP, 559.2)]
RED_WALL = [(552.8, 0, 0), (549.6, 0, 559.2), (556, TOP, 559.2), (556, TOP, 0)]
LAMP = [(343, TOP, 227), (343, TOP, 332), (213, TOP, 332), (213, TOP, 227)]
SMALL_BOX = ([(130, 65), (82, 225), (240, 272), (290, 114)], 165)  # (x, z) of the corners, height
LARGE_BOX = ([(423, 247), (265, 296), (314, 456), (472, 406)], 330)
ROOM_CENTRE = np.array([278.0, 274.4, 279.6])

PAWN_HEIGHT, PAWN_RADIUS = 0.17, 0.036  # [m]; it passes the 78 mm between the large box and the red wall
PAWN_SEGMENTS = 24  # every vertex is estimated each frame: 36 cost 1.6 times as much and look the same
PAWN_REFLECTANCE = (0.85, 0.84, 0.80)
# Half profile (radius, height) as a share of the height; `None` parts the smooth runs.
PAWN_PROFILE = [
    [(0.0, 0.0), (0.206, 0.0)],
    [(0.206, 0.0), (0.212, 0.012), (0.212, 0.045), (0.206, 0.058)],
    [(0.206, 0.058), (0.192, 0.072), (0.184, 0.10), (0.172, 0.125), (0.150, 0.145)],
    [(0.150, 0.145), (0.154, 0.152), (0.154, 0.168), (0.150, 0.175)],
    [(0.150, 0.175), (0.122, 0.215), (0.104, 0.27), (0.092, 0.34), (0.084, 0.42), (0.080, 0.50), (0.080, 0.565)],
    [(0.080, 0.565), (0.105, 0.575), (0.130, 0.588), (0.137, 0.600), (0.130, 0.612), (0.105, 0.625), (0.088, 0.633)],
]
PAWN_SPEED = 0.15  # [m/s]
# Where it goes on the floor, (x, z) [m]: in between the boxes, past the red wall, behind the large box, to the green.
PAWN_STOPS = [
    (0.370, 0.100), (0.345, 0.150), (0.322, 0.206), (0.350, 0.165), (0.410, 0.150), (0.470, 0.180), (0.505, 0.260),
    (0.511, 0.340), (0.511, 0.406), (0.508, 0.470), (0.470, 0.508), (0.390, 0.515), (0.300, 0.508), (0.220, 0.440),
    (0.150, 0.345), (0.060, 0.330), (0.050, 0.400), (0.090, 0.480), (0.200, 0.500),
]  # fmt: skip
PAWN_HEAD = 0.200  # radius of the ball on top, share of the height; it ends at height 1


def cornell_parts() -> list[Part]:
    """Return the room by material, in metres."""
    inwards = [_quad(q, ROOM_CENTRE, 1) for q in (FLOOR, BACK, *_ceiling_around_lamp())]
    for corners, height in (SMALL_BOX, LARGE_BOX):
        centre = np.array([np.mean([c[0] for c in corners]), height / 2, np.mean([c[1] for c in corners])])
        sides = [
            [(*_at(a, 0),), (*_at(a, height),), (*_at(b, height),), (*_at(b, 0),)]
            for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
        ]
        top = [_at(c, height) for c in corners]
        inwards += [_quad(q, centre, -1) for q in (*sides, top)]
    return [
        _joined("white", inwards),
        _joined("green", [_quad(GREEN_WALL, ROOM_CENTRE, 1)]),
        _joined("red", [_quad(RED_WALL, ROOM_CENTRE, 1)]),
        _joined("lamp", [_quad(LAMP, ROOM_CENTRE, 1)]),
    ]


def pawn_part() -> Part:
    """Return the pawn: its base's centre at the origin, y up, in metres."""
    start = np.arcsin(0.0875 / PAWN_HEAD)  # where the neck of 0.0875 meets the ball
    angles = np.linspace(start, np.pi, 11)
    head = [(PAWN_HEAD * np.sin(a), 1 - PAWN_HEAD - PAWN_HEAD * np.cos(a)) for a in angles]
    runs = [np.array(r) * PAWN_HEIGHT for r in (*PAWN_PROFILE, head)]
    widest = max(r[:, 0].max() for r in runs[:2])
    profile = np.concatenate([runs[0], *(r[1:] for r in runs[1:])])
    profile[:, 0] *= PAWN_RADIUS / widest
    profile[[0, -1], 0] = 0.0
    return Part("ivory", *_turned(profile))


def files() -> dict[str, bytes]:
    """Return the generated files by name."""
    spectra = [("white", WHITE), ("green", GREEN), ("red", RED)]
    room = [material(name, reflectance_rgb(s)) for name, s in spectra]
    room.append(material("lamp", [LUMINAIRE_REFLECTANCE] * 3, lamp_rgb()))
    return {
        "cornell.glb": glb_bytes(cornell_parts(), room),
        "pawn.glb": glb_bytes([pawn_part()], [material("ivory", PAWN_REFLECTANCE)]),
    }


def paths() -> dict[str, Loop]:
    """Return the pawn's path by scene file."""
    stops = [(x, 0.0, z) for x, z in PAWN_STOPS]
    return {"cornell.toml": there_and_back(stops, parts=3, speed=PAWN_SPEED)}


def _at(corner, height):
    return (corner[0], height, corner[1])


def _ceiling_around_lamp():
    """Return four quads between the ceiling's outline and the lamp's: no corner lies within an edge."""
    inner = [LAMP[0], LAMP[1], LAMP[2], LAMP[3]]
    return [[CEILING[k], CEILING[(k + 1) % 4], inner[(k + 1) % 4], inner[k]] for k in range(4)]


def _quad(corners, centre, sign: int):
    """Return the corners [m], wound so that the front faces the centre (sign 1) or away from it (-1)."""
    p = np.array(corners, np.float64)
    normal = np.cross(p[1] - p[0], p[2] - p[0])
    if sign * float(normal @ (centre - p.mean(axis=0))) < 0:
        p = p[::-1]
    return p * MM


def _joined(name: str, quads) -> Part:
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(len(quads))])
    return Part(name, np.concatenate(quads), faces)


def _turned(profile: np.ndarray):
    """Return vertices and faces of a profile (n, 2) turned about y; its ends lie on the axis."""
    n, m = len(profile), PAWN_SEGMENTS
    turn = 2 * np.pi * np.arange(m) / m
    ring = profile[1:-1]
    around = np.stack(
        [
            ring[:, :1] * np.cos(turn),
            np.repeat(ring[:, 1:], m, axis=1),
            ring[:, :1] * np.sin(turn),
        ],
        axis=2,
    ).reshape(-1, 3)
    vertices = np.concatenate([around, [[0, profile[0, 1], 0], [0, profile[-1, 1], 0]]])
    bottom, top = len(vertices) - 2, len(vertices) - 1
    k, j = np.arange(m), (np.arange(m) + 1) % m
    faces = [np.stack([np.full(m, bottom), k, j], axis=1)]
    for i in range(n - 3):
        a, b, c, d = i * m + k, (i + 1) * m + k, (i + 1) * m + j, i * m + j
        faces += [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
    last = (n - 3) * m
    faces.append(np.stack([last + k, np.full(m, top), last + j], axis=1))
    return vertices, np.concatenate(faces)


if __name__ == "__main__":
    write(Path(__file__).parent, files())
    write_paths(Path(__file__).parent, paths())
