"""The failure atlas as a page: texts that rows share stand once, above the table of their numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from itertools import groupby

import numpy as np

from app.measure.atlas.row import AtlasRow
from app.measure.html_page import document, image, table

TITLE = "Failure atlas"
INTRO = (
    "Failures of each method: prediction by theory, measurement and remedy. Numbers are irradiance / truth unless "
    "stated otherwise. Measured: mean ± standard error, for random numbers. Predicted: value ± uncertainty of the "
    "theory. Pictures show irradiance at equal exposure."
)


def predicted(row: AtlasRow) -> str:
    """Return the prediction of a row with its uncertainty."""
    if not np.isfinite(row.known):
        return f"< {row.predicted:.4g}"
    return f"{row.predicted:.4g}" + (f" ± {row.known:.1g}" if row.known else "")


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
    parts = [f"<h3>{escape(rows[0].title or rows[0].where)}</h3>", f"<p>{'; '.join(shared)}</p>", table(head, columns)]
    for row in rows:
        if row.key in pictures:
            sides = f"{row.where}: left as it fails, right with the remedy" if row.view.helps else row.view.caption
            shown = image(pictures[row.key], sides)
            parts.append(f"<figure>{shown}<figcaption>{escape(sides)}</figcaption></figure>")
    return parts
