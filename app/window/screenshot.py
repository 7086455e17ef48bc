"""Numbered PNG files of the viewport, with their parameters as metadata."""

from __future__ import annotations

from pathlib import Path

from app.draw.camera import Turntable
from app.draw.renderer import Look, Renderer
from app.session.session import Session

SAMPLES_PER_PIXEL = 8


def next_free(folder: Path) -> Path:
    """Return the first of gi-viewer-001.png, -002.png, ... that does not exist."""
    n = 1
    while (path := folder / f"gi-viewer-{n:03d}.png").exists():
        n += 1
    return path


def parameters(session: Session, camera: Turntable) -> dict[str, str]:
    """Return the parameters that reproduce the picture."""
    s, light = session.settings, session.light.snapshot
    view = camera.as_camera()
    entries = {
        "scene": s.scene,
        "mobiles": " ".join(s.mobiles) or "-",
        "estimator": light.estimator,
        "photons": light.photons,
        "radius": f"{light.radius:.6g} m",
        "neighbours": light.neighbours,
        "seed": s.seed,
        "exposure": f"{s.exposure:.4f} EV",
        "tone_map": s.tone_map,
        "show": s.show,
        "cull": s.cull,
        "camera": f"position {_numbers(view.position)} target {_numbers(view.target)} "
        f"vertical_fov_degrees {view.vertical_fov_degrees:.6g}",
    }
    for name, pose in session.poses.items():
        entries[f"pose {name}"] = _numbers((*pose.position, *pose.quaternion))
    return {key: str(value) for key, value in entries.items()}


def save(renderer: Renderer, look: Look, session: Session, camera: Turntable, path: Path) -> Path:
    """Draw at the viewport's size with SAMPLES_PER_PIXEL and write a PNG. Raises OSError."""
    from app.draw.png import write_png

    size, samples = renderer.size, renderer.samples_now
    renderer.resize(*size, SAMPLES_PER_PIXEL)
    try:
        renderer.draw(look)
        picture = renderer.pixels()
    finally:
        renderer.resize(*size, samples)
    return write_png(path, picture, {"software": "gi-viewer", **parameters(session, camera)})


def _numbers(values) -> str:
    return ",".join(f"{v:.9g}" for v in values)
