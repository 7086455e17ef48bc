"""The failure atlas as a page and as Markdown: what rows have in common is said once, above their numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from itertools import groupby

import numpy as np

from app.measure.atlas.row import Row
from app.measure.html_page import document, image, table

TITLE = "Failure atlas"
INTRO = (
    "Where each method fails, what theory predicts, what is measured, and what helps. Numbers are irradiance over "
    "truth unless it says otherwise. Measured: mean ± standard error, where chance has a part in it; predicted ± what "
    "theory leaves open. Pictures show irradiance, exposed alike."
)


def predicted(row: Row) -> str:
    """Return what theory says of a row, and how well it knows it."""
    if not np.isfinite(row.known):
        return f"< {row.predicted:.4g}"
    return f"{row.predicted:.4g}" + (f" ± {row.known:.1g}" if row.known else "")


def markdown(measured: Mapping[str, Sequence[Row]]) -> str:
    """Return the rows of each chapter as tables, one line a row."""
    head = ("where", "theory", "predicted", "measured", "remedy", "with it", "should be", "cost")
    lines = [f"# {TITLE}", "", INTRO, ""]
    for title, rows in measured.items():
        lines += [f"## {title}", "", "| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
        for row in rows:
            where = row.where + ("" if row.what == Row._field_defaults["what"] else f" [{row.what}]")
            with_it, aim = _remedied(row)
            cells = where, row.theory, predicted(row), str(row.measured), row.remedy, with_it, aim, row.cost
            lines.append("| " + " | ".join(cells) + " |")
        lines.append("")
    return "\n".join(lines)


def page(measured: Mapping[str, Sequence[Row]], pictures: Mapping[str, np.ndarray]) -> str:
    """Return the page, whole in itself; pictures: (h, w, 3) uint8 by the keys of rows."""
    parts = [f"<p>{escape(INTRO)}</p>"]
    for title, rows in measured.items():
        parts.append(f"<h2>{escape(title)}</h2>")
        for _, alike in groupby(rows, lambda row: row.title or row.where):
            parts += _group(list(alike), pictures)
    return document(TITLE, parts)


def _group(rows: list[Row], pictures: Mapping[str, np.ndarray]) -> list[str]:
    """Return what is said of rows of one title: what they have in common above a table of the rest."""
    head, columns = ["", "predicted", "measured"], [[row.where, predicted(row), str(row.measured)] for row in rows]
    if any(row.remedied is not None for row in rows):
        head += ["with the remedy", "should be"]
        columns = [[*line, *_remedied(row)] for line, row in zip(columns, rows, strict=True)]
    told = []
    for name, field in (("Theory", "theory"), ("Remedy", "remedy"), ("Cost", "cost"), ("Numbers", "what")):
        texts = [getattr(row, field) for row in rows]
        if len(set(texts)) > 1:
            head.append(name.lower())
            columns = [[*line, text] for line, text in zip(columns, texts, strict=True)]
        elif texts[0] and texts[0] != Row._field_defaults.get(field):
            told.append(f"<b>{name}</b> {escape(texts[0])}")
    parts = [f"<h3>{escape(rows[0].title or rows[0].where)}</h3>", f"<p>{'; '.join(told)}</p>", table(head, columns)]
    for row in rows:
        if row.key in pictures:
            sides = f"{row.where}: left as it fails, right with the remedy" if row.view.helps else row.view.caption
            shown = image(pictures[row.key], sides)
            parts.append(f"<figure>{shown}<figcaption>{escape(sides)}</figcaption></figure>")
    return parts


def _remedied(row: Row) -> tuple[str, str]:
    return ("", "") if row.remedied is None else (str(row.remedied), f"{row.aim:.4g}")
