"""Generates tree.glb and ring.glb, and the paths in tree.toml and tree_worst.toml: `python -m scenes.make_tree`.

z is up; the ground is 1 x 1.

The report's tree scene in numbers: 71,966 static triangles, a ground of 0.02 x 0.02 squares, a tree of
edges about 0.01, a mobile of 500 triangles.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scenes.glb import Part, glb_bytes, material, write
from scenes.key_frames import Loop, loop, write_paths
from scenes.tree_growth import bark, grow, leaves

TRIANGLES = 71_966
CELLS = 50  # of the ground along a side
LAMP_SIDE, LAMP_HEIGHT = 0.3, 1.6
LAMP_RADIANCE = (30.0, 27.0, 22.5)
DOME_RADIUS, DOME_HEIGHT, DOME_RINGS = 1.05, 1.7, 8  # close round the ground, or most photons never see it
AROUND = 40  # vertices around skirt and dome: every fifth of the ground's edge
SKIRT_RADII = (0.8, 0.92)
SKY_SHARE = 0.10  # of the lamp's flux: a dim sky
SKY_COLOUR = np.array([0.75, 0.9, 1.15])
GROUND, SKIRT = (0.74, 0.69, 0.60), (0.74, 0.71, 0.65)
DOME = (0.5, 0.5, 0.5)
BARK, LEAF = (0.33, 0.24, 0.17), (0.20, 0.42, 0.10)
RING_RADIUS, TUBE_RADIUS = 0.080, 0.048  # of the mobile, a ring of 25 x 10 quads
RING_COLOUR = (0.85, 0.62, 0.25)
SPEED = 0.3  # of the ring [m/s]: a frame of 1/20 s moves it by 1.5 % of the ground, as in the report
CLOVER_RADIUS, CLOVER_DEPTH, CLOVER_HEIGHT = 0.332, 0.160, 0.094  # out to the corners, in to the trunk, near the ground
ELLIPSE_RADII, ELLIPSE_HEIGHT = (0.16, 0.10), 1.25  # between crown and lamp
DECIMALS = 6  # micrometres: the same float32 whatever the platform's sine


def tree_parts() -> list[Part]:
    """Return the static part by material."""
    ground, skirt, dome, lamp = _ground(), _skirt(), _dome(), _lamp()
    skeleton = grow()
    wood = bark(skeleton)
    rest = TRIANGLES - sum(len(f) for _, f in (ground, skirt, dome, lamp, wood))
    parts = {
        "ground": ground,
        "skirt": skirt,
        "dome": dome,
        "lamp": lamp,
        "bark": wood,
        "leaf": leaves(skeleton, rest),
    }
    return [Part(name, np.round(v, DECIMALS), f) for name, (v, f) in parts.items()]


def ring_part() -> Part:
    """Return the mobile, around its origin, 500 triangles."""
    n, m = 25, 10
    a, b = np.meshgrid(2 * np.pi * np.arange(n) / n, 2 * np.pi * np.arange(m) / m, indexing="ij")
    r = RING_RADIUS + TUBE_RADIUS * np.cos(b)
    vertices = np.stack([r * np.cos(a), r * np.sin(a), TUBE_RADIUS * np.sin(b)], axis=2).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")
    at = [((i + s) % n) * m + (j + t) % m for s, t in ((0, 0), (1, 0), (1, 1), (0, 1))]
    quads = np.stack(at, axis=2).reshape(-1, 4)
    return Part("brass", np.round(vertices, DECIMALS), np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))


def files() -> dict[str, bytes]:
    """Return the generated files by name."""
    materials = [
        material("ground", GROUND),
        material("skirt", SKIRT),
        material("dome", DOME, sky_radiance()),
        material("lamp", (0.3, 0.3, 0.3), LAMP_RADIANCE),
        material("bark", BARK),
        material("leaf", LEAF, two_sided=True),
    ]
    return {
        "tree.glb": glb_bytes(tree_parts(), materials),
        "ring.glb": glb_bytes([ring_part()], [material("brass", RING_COLOUR)]),
    }


def paths() -> dict[str, Loop]:
    """Return the ring's paths by scene file."""

    def clover(a):
        r = CLOVER_RADIUS - CLOVER_DEPTH * np.cos(4 * a)
        return np.stack([0.5 + r * np.cos(a), 0.5 + r * np.sin(a), np.full(len(a), CLOVER_HEIGHT)], axis=1)

    def ellipse(a):
        x, y = ELLIPSE_RADII
        return np.stack([0.5 + x * np.cos(a), 0.5 + y * np.sin(a), np.full(len(a), ELLIPSE_HEIGHT)], axis=1)

    return {
        "tree.toml": loop(clover, keys=128, speed=SPEED, turns=6),
        "tree_worst.toml": loop(ellipse, keys=32, speed=SPEED, turns=2),
    }


def sky_radiance() -> np.ndarray:
    """Return the dome's Le: pi Le (dome's area) = SKY_SHARE pi L (lamp's area), in the mean of the channels."""
    v, f = _dome()
    p = v[f]
    cross = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    area = np.sqrt((cross * cross).sum(axis=1)).sum() / 2
    mean = SKY_SHARE * np.mean(LAMP_RADIANCE) * LAMP_SIDE**2 / area
    return np.round(mean * SKY_COLOUR / SKY_COLOUR.mean(), DECIMALS)


def _ground():
    s = np.arange(CELLS + 1) / CELLS
    x, y = np.meshgrid(s, s, indexing="ij")
    vertices = np.stack([x, y, np.zeros_like(x)], axis=2).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(CELLS), np.arange(CELLS), indexing="ij")
    a = (i * (CELLS + 1) + j).reshape(-1)
    b, c, d = a + CELLS + 1, a + CELLS + 2, a + 1
    return vertices, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def _lamp():
    h = LAMP_SIDE / 2
    corners = [[0.5 + x * h, 0.5 + y * h, LAMP_HEIGHT] for x, y in ((-1, -1), (-1, 1), (1, 1), (1, -1))]
    return np.array(corners), np.array([[0, 1, 2], [0, 2, 3]])


def _edge_of_ground():
    """Return AROUND points counter-clockwise along the edge of the ground, from a corner."""
    s = np.arange(AROUND // 4) / (AROUND // 4)
    zero, one = np.zeros_like(s), np.ones_like(s)
    x = np.concatenate([s, one, 1 - s, zero])
    y = np.concatenate([zero, s, one, 1 - s])
    return np.stack([x, y, np.zeros(AROUND)], axis=1)


def _circle(radius: float, height: float):
    a = 2 * np.pi * np.arange(AROUND) / AROUND + 1.25 * np.pi  # the first point lies over the first corner
    return np.stack([0.5 + radius * np.cos(a), 0.5 + radius * np.sin(a), np.full(AROUND, height)], axis=1)


def _bands(rings):
    """Return vertices and faces between rings of AROUND vertices; seen from above, inner ring first, they face up."""
    k, j = np.arange(AROUND), (np.arange(AROUND) + 1) % AROUND
    faces = []
    for i in range(len(rings) - 1):
        a, b, c, d = i * AROUND + k, (i + 1) * AROUND + k, (i + 1) * AROUND + j, i * AROUND + j
        faces += [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
    return np.concatenate(rings), np.concatenate(faces)


def _skirt():
    return _bands([_edge_of_ground(), *(_circle(r, 0.0) for r in (*SKIRT_RADII, DOME_RADIUS))])


def _dome():
    angles = np.pi / 2 * np.arange(DOME_RINGS) / DOME_RINGS
    rings = [_circle(DOME_RADIUS * np.cos(a), DOME_HEIGHT * np.sin(a)) for a in angles]
    v, f = _bands(rings)
    k, j = np.arange(AROUND), (np.arange(AROUND) + 1) % AROUND
    last = (DOME_RINGS - 1) * AROUND
    cap = np.stack([last + k, np.full(AROUND, len(v)), last + j], axis=1)
    return np.concatenate([v, [[0.5, 0.5, DOME_HEIGHT]]]), np.concatenate([f, cap])


if __name__ == "__main__":
    write(Path(__file__).parent, files())
    write_paths(Path(__file__).parent, paths())
