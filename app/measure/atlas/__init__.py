"""`gi-viewer atlas --out DIR`: failures of the methods, as theory predicts them and as they are measured.

Writes index.html, one file with pictures of both sides of each failure. Texts that rows share stand once, above the
table of their numbers. A run takes a minute or two.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from html import escape
from itertools import groupby
from pathlib import Path

import numpy as np

from app.cli.progress import Bar, compile_kernels
from app.cli.writable import write_whole
from app.draw.shot import Shot
from app.measure.atlas import discs, gloss, structures
from app.measure.atlas import estimates as est
from app.measure.atlas.row import AtlasRow, View, solved
from app.measure.tables import document, html_table, image
from app.settings import Settings

TITLE = "Failure atlas"
INTRO = (
    "Failures of each method: prediction by theory, measurement and remedy. Numbers are irradiance / truth unless "
    "stated otherwise. Measured: mean ± standard error, for random numbers. Predicted: value ± uncertainty of the "
    "theory. Pictures show irradiance at equal exposure."
)


def predicted(row: AtlasRow) -> str:
    """Return the prediction of a row with its uncertainty."""
    if not np.isfinite(row.within):
        return f"< {row.predicted:.4g}"
    return f"{row.predicted:.4g}" + (f" ± {row.within:.1g}" if row.within else "")


def page(measured: Mapping[str, Sequence[AtlasRow]], pictures: Mapping[str, np.ndarray]) -> str:
    """Return the HTML of the page; pictures: (h, w, 3) uint8 by the keys of rows."""
    parts = [f"<p>{escape(INTRO)}</p>"]
    for title, rows in measured.items():
        parts.append(f"<h2>{escape(title)}</h2>")
        for _, alike in groupby(rows, lambda row: row.title or row.where):
            parts += _group(list(alike), pictures)
    return document(TITLE, parts)


def _group(rows: list[AtlasRow], pictures: Mapping[str, np.ndarray]) -> list[str]:
    """Return the section of rows with one title: shared texts, a table, pictures."""
    head, columns = ["", "predicted", "measured"], [[row.where, predicted(row), str(row.measured)] for row in rows]
    if any(row.remedied is not None for row in rows):
        head += ["with the remedy", "should be"]
        with_it = [("", "") if r.remedied is None else (str(r.remedied), f"{r.aim:.4g}") for r in rows]
        columns = [[*line, *more] for line, more in zip(columns, with_it, strict=True)]
    shared = []
    for name, field in (("Theory", "theory"), ("Remedy", "remedy"), ("Cost", "cost"), ("Numbers", "quantity")):
        texts = [getattr(row, field) for row in rows]
        if len(set(texts)) > 1:
            head.append(name.lower())
            columns = [[*line, text] for line, text in zip(columns, texts, strict=True)]
        elif texts[0] and texts[0] != AtlasRow._field_defaults.get(field):
            shared.append(f"<b>{name}</b> {escape(texts[0])}")
    parts = [
        f"<h3>{escape(rows[0].title or rows[0].where)}</h3>",
        f"<p>{'; '.join(shared)}</p>",
        html_table(head, columns),
    ]
    for row in rows:
        if row.key in pictures:
            sides = f"{row.where}: left as it fails, right with the remedy" if row.view.helps else row.view.caption
            shown = image(pictures[row.key], sides)
            parts.append(f"<figure>{shown}<figcaption>{escape(sides)}</figcaption></figure>")
    return parts


Measurement = Callable[[], Iterator[AtlasRow]]
CHAPTERS: dict[str, tuple[Measurement, ...]] = {
    "Photon maps": (est.borders, est.corners, est.small_surfaces, est.thin_wall),
    "Density estimation on the tangent plane": (
        discs.walls_and_corners, discs.table_leg, discs.curved_inside, discs.larger_than_the_room,
        discs.smaller_and_smaller, discs.shadow_edge, discs.lamp_near_a_surface,
    ),
    "Impact count and sums": (
        est.textbook, est.small_faces, est.naive_sums, est.beside_a_mobile,
    ),
    "Gloss": (
        gloss.noise, gloss.grazing, gloss.blur, gloss.shading_normals,
        gloss.sharper_than_drawn, gloss.below_the_surface, gloss.more_than_arrives,
    ),
    "Structures of rays": (structures.ray_structures,),
}  # fmt: skip


def atlas(out: Path, chapters: dict[str, tuple[Measurement, ...]] = CHAPTERS) -> Path:
    """Measure every row and write index.html into a folder; return its path. Raises OSError."""
    out.mkdir(parents=True, exist_ok=True)
    file = out / "index.html"
    write_whole(file, page(*_measured(chapters)))
    return file


def _measured(chapters: dict[str, tuple[Measurement, ...]]):
    """Return the rows by chapter, and the pictures by key."""
    measured: dict[str, list[AtlasRow]] = {}
    pictures: dict[str, np.ndarray] = {}
    functions = [(title, function) for title, chapter in chapters.items() for function in chapter]
    with Bar() as bar:
        compile_kernels(bar)
        for k, (title, function) in enumerate(functions):
            for row in function():
                measured.setdefault(title, []).append(row)
                bar(f"measuring: {row.key}", k / len(functions))
                if row.view is not None:
                    pictures[row.key] = picture(row.view)
    return measured, pictures


def picture(view: View) -> np.ndarray:
    """Return a picture (h, w, 3) uint8 of irradiance with the setting that fails, and beside it with the remedy."""
    side_size = (420, 280)  # pixels of one side of a picture
    solver = solved(view.scene, view.photons, **view.fails)
    sides: list[np.ndarray] = []
    exposure = None
    for setting in (view.helps, view.fails):  # the remedy decides the exposure
        if setting is not None:
            solver.configure(**setting)
            solver.solve()
            shot = Shot(solver, Settings(scene="atlas", size=side_size, show="irradiance", exposure=exposure))
            sides.insert(0, shot.take())
            exposure = shot.exposure
    gap = np.full((side_size[1], 6, 3), 255, np.uint8)  # pixels between the two sides
    return np.concatenate([sides[0], *(part for side in sides[1:] for part in (gap, side))], axis=1)
