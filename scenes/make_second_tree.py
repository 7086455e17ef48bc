"""Generates second_tree.glb and bauble.glb, and the path in second_tree.toml: `python -m scenes.make_second_tree`.

The report's second tree scene (section 2.7, figure 2.7) in spirit: another sort of tree and another ground,
both of bigger triangles than the first, so that larger discs pay. Here a fir on a round hill: edges of
0.04 to 0.08 where the first tree has 0.01, and a twelfth of its triangles. y is up.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scenes.glb import Part, glb_bytes, material, write
from scenes.key_frames import Loop, loop, write_paths
from scenes.modelling import Shape, grid_faces, joined, part, radiance, sheet
from scenes.round_shapes import ball, tube, turned_body

RADIUS, RINGS, AROUND = 1.2, 24, 48  # of the meadow; the sky stands on its rim
HILL, HILL_WIDTH = 0.10, 0.42  # height and breadth of the rise that the tree stands on
SKY_HEIGHT, SKY_RINGS = 1.7, 8
TOP, LOWEST = 1.08, 0.26  # heights of the tip and of the lowest boughs above the hill's foot
WHORLS = 17
SEED = 7

# Light. Flux = pi x radiance x area.
LAMP_SIDE, LAMP_CENTRE = 0.36, np.array([0.50, 1.25, 0.32])
LAMP_FLUX = np.array([14.0, 11.8, 8.4])  # [W] a late sun, seen as a square
SKY_FLUX = np.array([2.6, 3.6, 5.4])  # [W]

MEADOW, NEEDLES, BARK, SKY = (0.40, 0.47, 0.19), (0.13, 0.34, 0.17), (0.36, 0.25, 0.17), (0.15, 0.19, 0.24)
BAUBLE_RADIUS = 0.075
SPEED = 0.3  # of the bauble [m/s]


def tree_parts() -> list[Part]:
    """Return the static part, a part a material."""
    return [
        part("meadow", _meadow()),
        part("sky", _sky()),
        part("lamp", _lamp()),
        part("bark", _trunk()),
        part("needles", *_boughs()),
    ]


def height(r: np.ndarray) -> np.ndarray:
    """Return the height of the hill at a distance from its axis; level at the rim."""
    r = np.asarray(r, float)
    edge = np.clip((RADIUS - r) / 0.3, 0, 1)
    return HILL * np.exp(-((r / HILL_WIDTH) ** 2)) * edge * edge * (3 - 2 * edge)


def _meadow() -> Shape:
    r = RADIUS * np.arange(RINGS + 1) / RINGS
    return turned_body(np.stack([r[::-1], height(r)[::-1]], axis=1), AROUND)


def _sky() -> Shape:
    a = np.pi / 2 * np.arange(SKY_RINGS + 1) / SKY_RINGS
    return turned_body(np.stack([RADIUS * np.cos(a), SKY_HEIGHT * np.sin(a)], axis=1), AROUND).flipped()


def _lamp() -> Shape:
    """Return the square, facing the middle of the tree."""
    towards = np.array([0, 0.4, 0]) - LAMP_CENTRE
    towards /= np.sqrt(towards @ towards)
    across = np.cross([0, 1.0, 0], towards)
    across *= LAMP_SIDE / np.sqrt(across @ across)
    up = np.cross(towards, across)
    return sheet(LAMP_CENTRE - (across + up) / 2, across, up)._replace(normals=None)


def _trunk() -> Shape:
    y = np.linspace(height(0) - 0.04, TOP, 17)
    t = (y - y[0]) / (y[-1] - y[0])
    return tube(np.stack([0.006 * np.sin(5 * t), y, 0.006 * np.sin(7 * t)], axis=1), 0.036 * (1 - 0.93 * t), 10)


def _boughs() -> list[Shape]:
    """Return whorls of drooping boughs, shorter and steeper towards the tip."""
    rng = np.random.default_rng(SEED)
    shapes = []
    for k in range(WHORLS):
        share = k / (WHORLS - 1)  # 0 at the lowest whorl, 1 at the tip
        y = height(0) + LOWEST + (TOP - HILL - LOWEST - 0.06) * share**0.92
        count = round(10 - 4 * share)
        for i in range(count):
            length = (0.38 * (1 - share) ** 0.85 + 0.055) * (0.86 + 0.28 * rng.random())
            rise = 0.10 + 0.55 * share + 0.12 * (rng.random() - 0.5)
            turn = 360 * (i + 0.5 * (k % 2)) / count + 14 * (rng.random() - 0.5)
            shapes.append(_bough(length, rise, 0.62 - 0.22 * share).turned(turn).at(0, y, 0))
    return shapes


def _bough(length: float, rise: float, droop: float) -> Shape:
    """Return a bough along +z: a strip folded along its rib, broad near the trunk, with a serrated edge."""
    n = max(3, round(length / 0.065)) + 1
    t = np.linspace(0, 1, n)
    half = (0.16 * length + 0.022) * np.sin(np.pi * np.clip(0.12 + 0.88 * t, 0, 1)) ** 0.7
    half[1:-1] *= np.where(np.arange(1, n - 1) % 2, 1.0, 0.74)
    half[-1] = 0.003
    y = length * (rise * t - droop * t * t)
    rows = [np.stack([s * half, y - 0.45 * half * abs(s), 0.02 + t * length], axis=1) for s in (-1, 0, 1)]
    return Shape(np.concatenate(rows), grid_faces(3, n)[:, ::-1], np.zeros((3 * n, 2)))


def files() -> dict[str, bytes]:
    """Return the generated files by name."""
    parts = tree_parts()
    materials = [
        material("meadow", MEADOW),
        material("sky", SKY, radiance(SKY_FLUX, parts, "sky")),
        material("lamp", (0.3, 0.3, 0.3), radiance(LAMP_FLUX, parts, "lamp")),
        material("bark", BARK),
        material("needles", NEEDLES, two_sided=True),
    ]
    a = 2 * np.pi * np.arange(10) / 10
    eye = tube(0.013 * np.stack([np.cos(a), np.sin(a) + 1, 0 * a], axis=1), 0.004, 5, closed=True)
    cap = turned_body([(0.020, -0.004), (0.020, 0.014), (0.016, 0.018), (0, 0.018)], 12)
    bauble = [
        part("red", ball(BAUBLE_RADIUS, 20)),
        part("gold", joined(cap, eye.at(0, 0.012, 0)).at(0, BAUBLE_RADIUS, 0)),
    ]
    return {
        "second_tree.glb": glb_bytes(parts, materials),
        "bauble.glb": glb_bytes(bauble, [material("red", (0.72, 0.07, 0.05)), material("gold", (0.80, 0.57, 0.16))]),
    }


def paths() -> dict[str, Loop]:
    """Return the bauble's path by scene file: a circle that sways through the skirt of the tree."""

    def round_the_tree(a):
        r = 0.48 + 0.12 * np.cos(3 * a)
        return np.stack([r * np.cos(a + 0.9), 0.22 + 0.08 * np.sin(3 * a), r * np.sin(a + 0.9)], axis=1)

    return {"second_tree.toml": loop(round_the_tree, keys=48, speed=SPEED, turns=1)}


if __name__ == "__main__":
    write(Path(__file__).parent, files())
    write_paths(Path(__file__).parent, paths())
