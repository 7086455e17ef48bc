"""Numbered PNG files of the viewport, with their parameters as metadata."""

from __future__ import annotations

from pathlib import Path

from app.draw.legend import Legend, Marks, with_legend, with_marks
from app.draw.picture_files import write_png
from app.draw.renderer import Look, Renderer

SAMPLES_OF_A_SCREENSHOT = 8


def next_free(folder: Path) -> Path:
    """Return the first of gi-viewer-001.png, -002.png, ... that does not exist."""
    n = 1
    while (path := folder / f"gi-viewer-{n:03d}.png").exists():
        n += 1
    return path


def save(
    renderer: Renderer,
    look: Look,
    legend: Legend | None,
    metadata: dict[str, str],
    path: Path,
    scale: int = 1,
    marks: Marks | None = None,
    pixels: float = 1.0,
) -> Path:
    """Draw at `scale` times the viewport's size and write a PNG, with its legend and marks. Raises OSError.

    pixels: of the viewport per point of the marks.

    A picture of 4 times the size has a quarter of SAMPLES_OF_A_SCREENSHOT, so that it fits into memory.
    """
    (width, height), samples = renderer.size, renderer.samples_now
    renderer.resize(scale * width, scale * height, SAMPLES_OF_A_SCREENSHOT // scale)
    try:
        renderer.draw(look)
        picture = renderer.pixels()
    finally:
        renderer.resize(width, height, samples)
    picture = picture if marks is None else with_marks(picture, marks, scale * pixels)
    return write_png(path, picture if legend is None else with_legend(picture, legend), metadata)
