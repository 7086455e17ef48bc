"""Digests of the light traced in the shipped scenes, to show that a change leaves the bits of photons as they are.

    python -m studies.traced_bits            # compare with tests/physics/traced_bits.json
    python -m studies.traced_bits --write    # after a change that is meant to alter them

Rays are those of `bvh`, whose arithmetic is the program's own, in one thread. `inputs` is the digest of geometry,
materials, lamps and of this machine's sines: where it differs from the file's, the others say nothing.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gi_core.files.load import load_scene
from gi_core.solver import Solver

FILE = Path(__file__).parent.parent / "tests" / "physics" / "traced_bits.json"
SCENES = ("cornell", "furnace", "gallery", "living_room", "office", "tree", "showroom")
PHOTONS = 2000
RADIUS = 0.1  # [m]
SHIFT = (0.02, 0.05, 0.02)  # [m], of the first mobile


def traced_bits(name: str) -> Iterator[tuple[str, str]]:
    """Yield the digests of a scene: inputs, paths, fates and sums of the background, and those of a moved mobile."""
    scene = load_scene(name)
    solver = Solver(
        scene, photons=PHOTONS, radius=RADIUS, estimator="tangent_plane", control=False, rays="bvh", threads=1
    )
    # No scene has a pane, and each photon has one direct segment.
    surfaces, world = solver.surfaces._replace(means=(), pane=(), panes=()), solver.model.world._replace(panes=())
    yield "inputs", digest(surfaces, world, solver.model.emitters, _sines())
    solver.solve()
    first = solver.frame
    paths, _ = first.store.subset(PHOTONS)
    yield "paths", digest(paths[:-1])
    yield "fates", digest(first.store.fates)
    yield "sums", digest(first.background.estimate.background(PHOTONS))
    mobile = scene.mobiles[0]
    solver.move(mobile.name, mobile.pose._replace(position=tuple(np.add(mobile.pose.position, SHIFT))))
    change = solver.frame.change
    parts = change.removed_suffixes.segments()[:-1], change.new_suffixes[:-1], change.fates
    yield "moved", digest(*parts, solver.frame.evaluated.sums)


def digest(*values) -> str:
    """Return a digest (16 hex digits) of arrays, numbers and tuples of them."""
    out = hashlib.md5(usedforsecurity=False)
    _add(out, values)
    return out.hexdigest()[:16]


def _add(out, value) -> None:
    if isinstance(value, tuple):
        for part in value:
            _add(out, part)
    elif isinstance(value, np.ndarray):
        out.update(f"{value.dtype}{value.shape}".encode() + np.ascontiguousarray(value).tobytes())
    elif isinstance(value, int | float | str | bool | np.generic | None):
        out.update(repr(value).encode())


def _sines() -> np.ndarray:
    """Return values of the functions that kernels take from the machine's library."""
    x = [0.01 * k for k in range(1000)]
    return np.array([f(a) for f in (math.sin, math.cos, math.exp, math.atan) for a in x])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write the digests to the file of the test")
    write = parser.parse_args().write
    found = {name: dict(traced_bits(name)) for name in SCENES}
    if write:
        FILE.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        return 0
    kept = json.loads(FILE.read_text(encoding="utf-8"))
    for name, digests in found.items():
        differs = [part for part, value in digests.items() if kept[name][part] != value]
        print(f"{name:12} {'differs: ' + ', '.join(differs) if differs else 'the same'}")
    return int(found != kept)


if __name__ == "__main__":
    sys.exit(main())
