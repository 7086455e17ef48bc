"""The scale of false colours, fitted to the picture by a thread of its own."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from app.draw.false_colour import Scale, automatic_scale, fixed_scale
from app.draw.raycast import visible_light
from app.settings import FALSE_COLOURS
from app.worker import Call, Worker

if TYPE_CHECKING:
    from app.draw.camera import Turntable
    from app.session.session import Session
    from app.window.camera_control import View
    from app.window.view_content import Shown


class ScaleFit:
    """`update` once per frame, `forget` with each new session, `close` with the window."""

    def __init__(self) -> None:
        self.scale: Scale | None = None
        self._asked: tuple | None = None  # arguments of the last scale
        self._fitting: Call | None = None  # the scale under way
        self._levels: bytes | None = None  # of the lamps in the last scale; None: of another scene, or none
        self._worker = Worker("false colours")
        self._seen_from: Turntable | None = None  # camera of the last frame

    @property
    def is_fitting(self) -> bool:
        """Whether a scale is under way."""
        return self._fitting is not None

    def update(self, s: Session, view: View, shown: Shown | None, at_rest: bool) -> None:
        """Fit the scale to the picture: with other lamps at once, else at rest, so that colours do not flicker."""
        at_rest, self._seen_from = at_rest and view.camera == self._seen_from, view.camera  # the wheel turns, or not
        if s.settings.show not in FALSE_COLOURS or shown is None:
            self.scale = self._asked = self._fitting = None
            return
        quantity, ends, lines = s.settings.show, s.settings.false_colour_range, s.settings.false_colour_lines
        asked = s.version, view.camera, view.aspect, s.settings.cull, quantity, ends, lines
        levels = s.light.snapshot.levels.tobytes()
        due = at_rest or self.scale is None or levels != self._levels
        if self._fitting is None and asked != self._asked and due:
            self._asked, self._levels = asked, levels
            if ends is not None:
                self.scale = fixed_scale(*ends, quantity).with_lines(lines)
                return
            lit, camera = replace(s.lit, drawn=shown.sides[0].drawn), view.camera.relative_to(s.model.origins[0])
            self._fitting = self._worker.submit(partial(_fitted, quantity, lit, camera, view.aspect, s.settings.cull))
        # false colours wait 0.1 s for their first scale; later ones are fitted behind the picture
        if self._fitting is not None and self._fitting.wait(0.1 if self.scale is None else 0.0):
            fitting, self._fitting = self._fitting, None
            self.scale = fitting.result().with_lines(s.settings.false_colour_lines)

    def forget(self) -> None:
        """Fit again in the next frame."""
        self._fitting = self._asked = self._levels = None

    def close(self) -> None:
        """End the thread."""
        self._worker.close()


def _fitted(quantity: str, *view) -> Scale:
    """Return the scale of a quantity that suits a view; the other arguments are those of visible_light()."""
    return automatic_scale(visible_light(*view), quantity)
