"""Generates furnace.glb and cube.glb: `python -m scenes.make_furnace`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scenes.glb import Part, glb_bytes, material, write

RHO = 0.5
RADIANCE = (1.0, 0.5, 0.25)  # Le [W/m2/sr]
CUBE = 0.15  # [m]
# Twelve triangles of the unit cube, fronts outwards.
CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float64)
QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
FACES = np.concatenate([QUADS[:, [0, 1, 2]], QUADS[:, [0, 2, 3]]])


def furnace_part() -> Part:
    """Return the unit box, fronts inwards."""
    return Part("furnace", CORNERS, FACES[:, ::-1])


def cube_part() -> Part:
    """Return a cube standing on the origin, fronts outwards."""
    return Part("grey", (CORNERS - [0.5, 0.0, 0.5]) * CUBE, FACES)


def files() -> dict[str, bytes]:
    """Return the generated files by name."""
    return {
        "furnace.glb": glb_bytes([furnace_part()], [material("furnace", [RHO] * 3, RADIANCE)]),
        "cube.glb": glb_bytes([cube_part()], [material("grey", [RHO] * 3)]),
    }


if __name__ == "__main__":
    write(Path(__file__).parent, files())
