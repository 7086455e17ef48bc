"""`gi-viewer atlas --out DIR`: where the methods fail, what theory says of it, what is measured, what helps.

Writes index.html, atlas.md, and a picture of both sides of a failure where there is something to see. Each file
is whole or not there. One that was stopped begins again: it takes a minute or two.
"""

from __future__ import annotations

import html
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from app import atlas_others, atlas_photon_map, atlas_tangent_plane
from app.atlas_row import Row, View, solved
from app.png import write_png
from app.progress import Bar, compile_kernels
from app.render_command import Shot
from app.settings import Settings

CHAPTERS = {
    "Photon maps": atlas_photon_map.rows,
    "Density estimation on the tangent plane": atlas_tangent_plane.rows,
    "Impact count, and what concerns all": atlas_others.rows,
}
ROWS = 50  # about so many, for the bar
SIZE = (420, 280)  # pixels of one side of a picture
GAP = 6
HEAD = ("where", "theory", "predicted", "measured", "remedy", "with it", "should be", "what it costs")


def atlas(out: Path, chapters: dict[str, Callable[[], Iterator[Row]]] = CHAPTERS) -> list[Row]:
    """Measure every row and write index.html and atlas.md into a folder; return the rows. Raises OSError."""
    out.mkdir(parents=True, exist_ok=True)
    measured: dict[str, list[Row]] = {}
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
                    write_png(
                        out / f"{row.key}.png", picture(row.view), {"software": "gi-viewer atlas", "row": row.key}
                    )
    _write(out / "atlas.md", markdown(measured))
    _write(out / "index.html", page(measured))
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


def cells(row: Row) -> tuple[str, ...]:
    """Return what the table says of a row, in the order of HEAD."""
    aim = f"{row.aim:.4g}" if row.remedied is not None else ""
    known = f" (known to {row.known:.1g})" if 0 < row.known < np.inf else ""
    predicted = f"{row.predicted:.4g}{known}" if np.isfinite(row.known) else f"< {row.predicted:.4g}"
    remedied = "" if row.remedied is None else str(row.remedied)
    what = "" if row.what == "E / truth" else f" [{row.what}]"
    return row.where + what, row.theory, predicted, str(row.measured), row.remedy, remedied, aim, row.cost


def markdown(measured: dict[str, list[Row]]) -> str:
    lines = ["# Failure atlas", "", "Irradiance over truth, mean ± standard error, unless the row says otherwise.", ""]
    for title, rows in measured.items():
        lines += [f"## {title}", "", "| " + " | ".join(HEAD) + " |", "|---" * len(HEAD) + "|"]
        lines += ["| " + " | ".join(cells(row)) + " |" for row in rows] + [""]
    return "\n".join(lines)


def page(measured: dict[str, list[Row]]) -> str:
    body = []
    for title, rows in measured.items():
        body += [f"<h2>{html.escape(title)}</h2>", "<table>", _tr("th", HEAD)]
        for row in rows:
            body.append(_tr("td", cells(row)))
            if row.view is not None:
                caption = "left: as it fails; right: with the remedy" if row.view.helps else "as it fails"
                image = f'<img src="{row.key}.png" alt="{row.key}"><br><small>{caption}</small>'
                body.append(f'<tr><td colspan="{len(HEAD)}">{image}</td></tr>')
        body.append("</table>")
    return PAGE.format(body="\n".join(body))


def _tr(tag: str, texts) -> str:
    return "<tr>" + "".join(f"<{tag}>{html.escape(t)}</{tag}>" for t in texts) + "</tr>"


def _write(file: Path, text: str) -> None:
    aside = file.with_name(file.name + ".part")
    aside.write_text(text, encoding="utf-8")
    os.replace(aside, file)


PAGE = """<!doctype html>
<html lang="en"><meta charset="utf-8"><title>Failure atlas</title>
<style>
body {{ font: 15px/1.4 sans-serif; margin: 2em auto; max-width: 80em; color: #222; background: #fff }}
table {{ border-collapse: collapse; width: 100% }}
td, th {{ border-bottom: 1px solid #ccc; padding: .3em .6em; text-align: left; vertical-align: top }}
img {{ max-width: 100% }}
</style>
<h1>Failure atlas</h1>
<p>Where each method fails, what theory predicts, what is measured, and what helps. Numbers are irradiance over truth,
mean ± standard error, unless the row says otherwise. Pictures show irradiance, exposed alike.</p>
{body}
</html>
"""
