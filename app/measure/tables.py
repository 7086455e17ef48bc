"""Pages of measurements in HTML, one file each, with tables and pictures.

Pages have a style for wide and narrow windows, light and dark.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Sequence
from html import escape

import numpy as np

STYLE = """
:root { color-scheme: light dark; --ink: #222; --paper: #fff; --faint: #ddd; --line: #888; }
@media (prefers-color-scheme: dark) { :root { --ink: #ddd; --paper: #191a1d; --faint: #3a3b40; --line: #888; } }
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper);
       max-width: 1240px; margin: 2em auto; padding: 0 1em; }
h1 { font-size: 1.7em; line-height: 1.2; } h2 { margin-top: 2em; font-size: 1.3em; }
h3 { margin: 2.2em 0 0.3em; font-size: 1.05em; } h3 + p { margin-top: 0; }
p { max-width: 62em; } .wide { overflow-x: auto; } .wide > svg { width: 100%; min-width: 800px; height: auto; }
table { border-collapse: collapse; font-size: 0.88em; font-variant-numeric: tabular-nums; }
th, td { padding: 0.25em 0.7em; text-align: right; border-bottom: 1px solid var(--faint); white-space: nowrap; }
th { border-bottom: 2px solid var(--line); vertical-align: bottom; }
th.text, td.text { text-align: left; white-space: normal; min-width: 11em; vertical-align: top; }
figure { margin: 0.8em 0 0; }
img { max-width: 100%; height: auto; display: block; }
figcaption { font-size: 0.88em; margin: 0.3em 0 1em; }
"""


def document(title: str, parts: Iterable[str]) -> str:
    """Return the HTML of a page; `parts` are HTML, below the title."""
    head = (
        '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{STYLE}</style>"
    )
    body = "\n".join([f"<h1>{escape(title)}</h1>", *parts])
    return f"<!doctype html>\n<html lang='en'><head>{head}</head><body>\n{body}\n</body></html>\n"


def html_table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """Return an HTML table that scrolls if it is too wide."""
    lines = list(lines)
    # cells longer than 24 characters are text and may be wrapped
    words = [k == 0 or any(len(line[k]) > 24 for line in lines) for k in range(len(head))]

    def cells(kind: str, texts: Sequence[str]) -> str:
        marked = zip([' class="text"' if is_text else "" for is_text in words], texts, strict=True)
        return "<tr>" + "".join(f"<{kind}{mark}>{escape(text)}</{kind}>" for mark, text in marked) + "</tr>"

    rows = cells("th", head) + "".join(cells("td", line) for line in lines)
    return f"<div class='wide'><table>{rows}</table></div>"


def image(picture: np.ndarray, alt: str) -> str:
    """Return a picture (h, w, 3) uint8 as an HTML element; alt: its description."""
    from PIL import Image

    data = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(picture)).save(data, "PNG", optimize=True)
    source = "data:image/png;base64," + base64.b64encode(data.getvalue()).decode()
    return f'<img src="{source}" alt="{escape(alt)}" width="{picture.shape[1]}" height="{picture.shape[0]}">'
