"""Numbered PNG files of the viewport, with their parameters as metadata."""

from __future__ import annotations

from pathlib import Path

from app.draw.legend import Legend, with_legend
from app.draw.png import write_png
from app.draw.renderer import Look, Renderer

SAMPLES_PER_PIXEL = 8


def next_free(folder: Path) -> Path:
    """Return the first of gi-viewer-001.png, -002.png, ... that does not exist."""
    n = 1
    while (path := folder / f"gi-viewer-{n:03d}.png").exists():
        n += 1
    return path


def save(renderer: Renderer, look: Look, legend: Legend | None, metadata: dict[str, str], path: Path) -> Path:
    """Draw at the viewport's size with SAMPLES_PER_PIXEL and write a PNG, with its legend. Raises OSError."""
    size, samples = renderer.size, renderer.samples_now
    renderer.resize(*size, SAMPLES_PER_PIXEL)
    try:
        renderer.draw(look)
        picture = renderer.pixels()
    finally:
        renderer.resize(*size, samples)
    return write_png(path, picture if legend is None else with_legend(picture, legend), metadata)
