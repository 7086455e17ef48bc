"""Light gathered at resting poses with mobiles in place; it replaces a frame's own (`gi_core.gather.pose_gather`)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gi_core.base.pause import Progress, pause
from gi_core.frames.edited_light import EditedAtPoses, LightAtPoses
from gi_core.gather.pose_gather import STAGE, PoseGather, PoseGathers, Static
from gi_core.model import Model
from gi_core.rays.accelerator import Transforms


class PoseLight:
    """Light of the last poses, each at some levels (G, 3) of the lamps."""

    def __init__(self, model: Model, seed: int):
        self._model = model
        self._gathers = PoseGathers(model, seed)
        self._edited: EditedAtPoses | None = None

    def find(self, at: Transforms, levels: np.ndarray) -> PoseGather | None:
        """Return the light gathered at poses, None if there is none."""
        return self._gathers.find(at, levels)

    def replaced(
        self, E: np.ndarray, static: Callable[[], np.ndarray], at: Transforms, levels: np.ndarray
    ) -> np.ndarray:
        """Return irradiance E (R, 3) at poses, with light gathered there in its place; the same array where none was.

        static: returns that of the static part without mobiles (n, 3) [W/m2], as the frame has it.
        """
        out = E
        if (edited := self._edited_at(at, levels)) is not None:
            out = E.copy()
            out[edited.rows] = edited.irradiance(E, static())
        if (light := self.find(at, levels)) is not None and (shown := self._shown(light, edited)).any():
            out = E.copy() if out is E else out
            out[light.rows[shown]] = light.mean[shown]
        return out

    def _shown(self, light: PoseGather, edited: EditedAtPoses | None) -> np.ndarray:
        """Return which receivers (n,) bool show gathered light: in the end all do in place of light before an edit."""
        ended = edited is not None and light.enough and len(light.mean) > 0
        return np.ones(len(light.rows), bool) if ended else light.used

    def _edited_at(self, at: Transforms, levels: np.ndarray) -> EditedAtPoses | None:
        edited = self._edited
        return edited if edited is not None and edited.is_at(at, levels) else None

    def before_edit(
        self, irradiance: np.ndarray, own: np.ndarray, static: np.ndarray, deviation: np.ndarray, at: Transforms,
        levels: np.ndarray,
    ) -> LightAtPoses | None:  # fmt: skip
        """Return the light of a frame for the scene after an edit; None where none was gathered at its poses.

        irradiance, own (R, 3) [W/m2]: with that light and without; static (n, 3), deviation (R,): as in LightAtPoses.
        The light before edits in a row is that before the first.
        """
        if own is irradiance:
            return None
        edited, light = self._edited_at(at, levels), self.find(at, levels)
        if edited is not None and (light is None or not self._shown(light, edited).any()):
            return edited.before
        return LightAtPoses(self._model, at, levels, irradiance, own, static, deviation)

    def begin_with(self, before: LightAtPoses | None) -> None:
        """Show light before an edit, changed as frames say, until there is better; the static part is the same."""
        self._edited = None if before is None else EditedAtPoses(before, self._model)

    def deviation(self, at: Transforms, levels: np.ndarray, of_static: np.ndarray) -> np.ndarray:
        """Return the standard error (R,) of the luminance at poses [W/m2], 0 where frames light mobiles.

        of_static (n,): that of the static part's light without mobiles.
        """
        out = np.zeros(len(self._model.object_receivers.areas))
        out[: len(of_static)] = of_static
        if (edited := self._edited_at(at, levels)) is not None:
            out[edited.rows] = edited.before.deviation[edited.rows_before]
        if (light := self.find(at, levels)) is not None and (shown := self._shown(light, edited)).any():
            out[light.rows[shown]] = light.deviation[shown]
        return out

    def gather(
        self, at: Transforms, levels: np.ndarray, photons: int, irradiance: np.ndarray, static: np.ndarray,
        disc_area: float, gathered: Callable[[], Static | None], refresh: Callable[[], None],
    ) -> None:  # fmt: skip
        """Gather at poses, see `PoseGather.gather`; refresh: called where frames change.

        irradiance (R, 3), static (n, 3) [W/m2]: of the frame of all `photons` there, and without mobiles; disc_area
        [m2]; gathered: returns the static part's light and its standard error once it is better than that of photons.
        """
        begun = self._gathers.begin(at, levels, photons, irradiance, static, disc_area)
        pause(Progress(STAGE, begun.fraction, False))

        def take() -> None:
            ended = begun.enough and self._edited_at(at, levels) is not None
            if changed := ended or bool(begun.used.any()):
                refresh()
            pause(Progress(STAGE, begun.fraction, changed))

        begun.gather(gathered, take)
