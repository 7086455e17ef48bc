"""`gi-viewer atlas --out DIR`: failures of the methods, as theory predicts them and as they are measured.

Writes index.html, one file with pictures of both sides of each failure. A run takes a minute or two.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from app.cli.progress import Bar, compile_kernels
from app.cli.writable import write_whole
from app.draw.shot import Shot
from app.measure.atlas import gloss, gloss_limits, mobiles, others, photon_map, programs, ray_structures, tangent_plane
from app.measure.atlas.page import page
from app.measure.atlas.row import RAYS, AtlasRow, View, solved
from app.settings import Settings

CHAPTERS = {
    "Photon maps": photon_map.rows,
    "Density estimation on the tangent plane": tangent_plane.rows,
    "Impact count, sums and series": others.rows,
    "Mobiles and lamps in odd places": mobiles.rows,
    "Scale, meshes, time": programs.rows,
    "Gloss at vertices": gloss.rows,
    "Gloss at its limits": gloss_limits.rows,
    "Structures of rays": ray_structures.rows,
}
ROWS = 105  # about, for the bar
SIZE = (420, 280)  # pixels of one side of a picture
GAP = 6


def atlas(out: Path, chapters: dict[str, Callable[[], Iterator[AtlasRow]]] = CHAPTERS, rays: str | None = None) -> Path:
    """Measure every row and write index.html into a folder; return its path. Raises OSError.

    rays: the structure of all rows that name none, as for Solver.
    """
    out.mkdir(parents=True, exist_ok=True)
    before = RAYS.set(rays)
    try:
        file = out / "index.html"
        write_whole(file, page(*_measured(chapters, rays)))
        return file
    finally:
        RAYS.reset(before)


def _measured(chapters: dict[str, Callable[[], Iterator[AtlasRow]]], rays: str | None):
    """Return the rows by chapter, and the pictures by key."""
    measured: dict[str, list[AtlasRow]] = {}
    pictures: dict[str, np.ndarray] = {}
    done = 0
    with Bar() as bar:
        compile_kernels(bar, rays)
        for title, rows in chapters.items():
            measured[title] = []
            for row in rows():
                measured[title].append(row)
                done += 1
                bar(f"measuring: {row.key}", min(done / ROWS, 1.0))
                if row.view is not None:
                    pictures[row.key] = picture(row.view)
    return measured, pictures


def picture(view: View) -> np.ndarray:
    """Return a picture (h, w, 3) uint8 of irradiance with the setting that fails, and beside it with the remedy."""
    solver = solved(view.scene, view.photons, **view.fails)
    sides: list[np.ndarray] = []
    exposure = None
    for setting in (view.helps, view.fails):  # the remedy decides the exposure
        if setting is not None:
            solver.configure(**setting)
            solver.solve()
            shot = Shot(solver, Settings(scene="atlas", size=SIZE, show="irradiance", exposure=exposure))
            sides.insert(0, shot.take())
            exposure = shot.exposure
    gap = np.full((SIZE[1], GAP, 3), 255, np.uint8)
    return np.concatenate([sides[0], *(part for side in sides[1:] for part in (gap, side))], axis=1)
