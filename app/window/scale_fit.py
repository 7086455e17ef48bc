"""The scale of false colours, fitted to the picture."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from app.draw.false_colour import Scale, automatic_scale, fixed_scale
from app.draw.raycast import visible_light
from app.settings import FALSE_COLOURS

if TYPE_CHECKING:
    from app.draw.camera import Turntable
    from app.session.session import Session
    from app.window.camera_control import View
    from app.window.view_content import Shown


class ScaleFit:
    """`update` once per frame, `forget` with each new session. A fit takes 3 to 5 ms, of luminance with gloss 17."""

    def __init__(self) -> None:
        self.scale: Scale | None = None
        self._asked: tuple | None = None  # arguments of the last scale
        self._levels: bytes | None = None  # of the lamps in the last scale; None: of another scene, or none
        self._seen_from: Turntable | None = None  # camera of the last frame

    def update(self, s: Session, view: View, shown: Shown | None, at_rest: bool) -> None:
        """Fit the scale to the picture: with other lamps at once, else at rest, so that colours do not flicker."""
        at_rest, self._seen_from = at_rest and view.camera == self._seen_from, view.camera  # the wheel turns, or not
        if s.settings.show not in FALSE_COLOURS or shown is None:
            self.scale = self._asked = None
            return
        quantity, ends, lines = s.settings.show, s.settings.false_colour_range, s.settings.false_colour_lines
        asked = s.version, view.camera, view.aspect, s.settings.cull, quantity, ends, lines
        levels = s.light.snapshot.levels.tobytes()
        if asked == self._asked or not (at_rest or self.scale is None or levels != self._levels):
            return
        self._asked, self._levels = asked, levels
        if ends is not None:
            self.scale = fixed_scale(*ends, quantity).with_lines(lines)
            return
        lit, camera = replace(s.lit, drawn=shown.sides[0].drawn), view.camera.relative_to(s.model.origins[0])
        seen = visible_light(lit, camera, view.aspect, s.settings.cull)
        self.scale = automatic_scale(seen, quantity).with_lines(lines)

    def forget(self) -> None:
        """Fit again in the next frame."""
        self._asked = self._levels = None
