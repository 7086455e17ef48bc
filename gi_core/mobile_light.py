"""Where frames take the light of mobiles from: the estimator's photons, or what their receivers gather."""

from __future__ import annotations

import numpy as np

from gi_core.accelerator import Transforms
from gi_core.ladder import FrameTimes
from gi_core.mobile_gather import MobileGather
from gi_core.model import Model
from gi_core.scene.errors import SceneError

MOBILE_LIGHT = ("photons", "gathered")
PATHS = (4, 8, 16, 32, 64, 128, 256)  # a receiver, that a frame can gather
REST = 64  # of them, where nothing else is asked for: some 4 % of noise


class MobileLight:
    """`kind` is one of MOBILE_LIGHT."""

    def __init__(self, model: Model, seed: int):
        self.kind = MOBILE_LIGHT[0]
        self._model, self._seed = model, seed
        self._gather: MobileGather | None = None
        self._times = FrameTimes()  # by paths
        self._poses: dict[int, bytes] = {}  # by paths, at the last frame of so many
        self._moved = True  # something, since then

    def choose(self, kind: str) -> None:
        """Take the light from elsewhere from now on. Raises SceneError for a kind that there is not."""
        if kind not in MOBILE_LIGHT:
            raise SceneError(f"mobile_light must be one of {', '.join(MOBILE_LIGHT)}, got {kind!r}")
        self.kind = kind

    def paths(self, wanted: int | None) -> int:
        """Return how many paths a receiver a frame gathers, 0 where it gathers none; None: REST.

        Raises SceneError for a number that is not one of PATHS.
        """
        if wanted is not None and wanted not in PATHS:
            raise SceneError(f"a frame can gather {', '.join(map(str, PATHS))} paths a receiver, got {wanted}")
        if self.kind == "photons" or not self._model.names:
            return 0
        return REST if wanted is None else wanted

    def put_on(self, irradiance: np.ndarray, at: Transforms, paths: int, anew: bool = False) -> None:
        """Replace the irradiance (R, 3) of receivers on mobiles by what they gather from that of the static part.

        paths: one of PATHS; anew: nothing that is kept from frames is used.
        """
        if anew:
            gather = MobileGather(self._model, self._seed)
        else:
            gather = self._gather = self._gather or MobileGather(self._model, self._seed)
            poses = at.rotation.tobytes() + at.position.tobytes()
            self._moved, self._poses[paths] = self._poses.get(paths) != poses, poses
        irradiance[gather.first :] = gather.irradiance(at, irradiance[: gather.first], paths.bit_length() - 1)

    def took(self, paths: int, seconds: float) -> None:
        """Take note of how long a frame's gathering took [s], unless nothing had moved: no ray was traced then."""
        if paths and self._moved:
            self._times.add(paths, seconds)

    def expected(self, paths: int) -> float:
        """Return how long so many paths a receiver are expected to take [s]; 0 if none have been gathered yet."""
        return (paths and self._times.expected(paths)) or 0.0

    def most_within(self, seconds: float) -> int | None:
        """Return the most of PATHS up to REST expected to fit, else the fewest; None where none are gathered."""
        if not self.paths(None):
            return None
        return max((n for n in PATHS if n <= REST and self.expected(n) <= seconds), default=PATHS[0])
