"""Where a camera shows a point: the inverse of `Turntable.ray`."""

from app.draw.camera import Turntable


def projected(camera: Turntable, point, aspect: float) -> tuple[float, float] | None:
    """Return the picture position (u, v) of a point, None behind the eye."""
    x, y, _, w = camera.projection(aspect) @ camera.view() @ [*point, 1.0]
    return ((x / w + 1) / 2, (1 - y / w) / 2) if w > 0 else None
