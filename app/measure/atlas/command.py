"""`gi-viewer atlas --out DIR`: where the methods fail, what theory says of it, what is measured, what helps.

Writes index.html, atlas.md, and a picture of both sides of a failure where there is something to see, which are also
in the page: it is one file. Each is whole or not there. One that was stopped begins again: it takes a minute or two.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from app.cli.progress import Bar, compile_kernels
from app.draw.png import write_png
from app.draw.shot import Shot
from app.measure.atlas import mobiles, others, photon_map, programs, tangent_plane
from app.measure.atlas.page import markdown, page
from app.measure.atlas.row import Row, View, solved
from app.measure.html_page import write
from app.settings import Settings

CHAPTERS = {
    "Photon maps": photon_map.rows,
    "Density estimation on the tangent plane": tangent_plane.rows,
    "Impact count, sums and series": others.rows,
    "Mobiles and lamps in odd places": mobiles.rows,
    "Scale, meshes, time": programs.rows,
}
ROWS = 80  # about so many, for the bar
SIZE = (420, 280)  # pixels of one side of a picture
GAP = 6


def atlas(out: Path, chapters: dict[str, Callable[[], Iterator[Row]]] = CHAPTERS) -> list[Row]:
    """Measure every row and write index.html and atlas.md into a folder; return the rows. Raises OSError."""
    out.mkdir(parents=True, exist_ok=True)
    measured: dict[str, list[Row]] = {}
    pictures: dict[str, np.ndarray] = {}
    done = 0
    with Bar() as bar:
        compile_kernels(bar)
        for title, rows in chapters.items():
            measured[title] = []
            for row in rows():
                measured[title].append(row)
                done += 1
                bar(f"measuring: {row.key}", min(done / ROWS, 1.0))
                if row.view is not None:
                    pictures[row.key] = picture(row.view)
                    told = {"software": "gi-viewer atlas", "row": row.key}
                    write_png(out / f"{row.key}.png", pictures[row.key], told)
    write(out / "atlas.md", markdown(measured))
    write(out / "index.html", page(measured, pictures))
    return [row for rows in measured.values() for row in rows]


def picture(view: View) -> np.ndarray:
    """Return irradiance (h, w, 3) uint8 under the setting that fails, and beside it under the one that helps."""
    solver = solved(view.scene, view.photons, **view.fails)
    sides, exposure = [], None
    for setting in (view.helps, view.fails):  # exposed for the one that is right
        if setting is not None:
            solver.configure(**setting)
            solver.solve()
            shot = Shot(solver, Settings(scene="atlas", size=SIZE, show="irradiance", exposure=exposure))
            sides.insert(0, shot.take())
            exposure = shot.exposure
    gap = np.full((SIZE[1], GAP, 3), 255, np.uint8)
    return np.concatenate([sides[0], *(part for side in sides[1:] for part in (gap, side))], axis=1)
