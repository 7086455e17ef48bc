"""Settings of an estimator, and the valid range of each value."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from gi_core.base.fixed_point import MAX_PHOTONS
from gi_core.scene.errors import SceneError


class Setting(NamedTuple):
    """Settings of an estimator; `search` changes its time, not its bits."""

    estimator: str  # a key of ESTIMATORS
    radius: float  # of the disc, or the largest of a search [m]
    neighbours: int  # k of photon_map
    control: bool = True  # artifact control of tangent_plane, see `gi_core.discs.region`
    search: str = "disc_index"  # a key of `gi_core.discs.search.SEARCHES`: how tangent_plane finds disc intersections
    border_correction: bool = True  # photon_map at borders: alpha / 2 pi of a disc, see `gi_core.geometry.border_angle`
    textbook: bool = False  # photon_map counts the k-th hit too, as in the report: k / (k - 1) too much

    def changed(self, choices: Mapping[str, Mapping], **values) -> Setting:
        """Return the setting with the given values replaced; None keeps a value.

        choices: the registries of fields that name something. Raises SceneError for a bad value.
        """
        checked = {}
        for name, value in values.items():
            if name not in self._fields:
                raise SceneError(f"there is no setting {name!r}; there are {', '.join(self._fields)}")
            if value is None:
                continue
            if name in choices:
                if value not in choices[name]:
                    raise SceneError(f"{name} must be one of {', '.join(choices[name])}, got {value!r}")
                checked[name] = value
            else:
                checked[name] = bool(value) if isinstance(getattr(self, name), bool) else number(name, value)
        return self._replace(**checked)


_WHOLE = {"photons": (0, MAX_PHOTONS), "neighbours": (1, 100_000), "threads": (1, 1024)}  # others: finite and > 0


def number(name: str, value, kept=None):
    """Return `value` as a number in the valid range of its name, or `kept` for None. Raises SceneError."""
    if value is None:
        return kept
    low, high = _WHOLE.get(name, (0, np.inf))
    rule = f"a whole number from {low} to {high}" if name in _WHOLE else "a finite number > 0"
    try:
        given = float(value)
    except (TypeError, ValueError):
        raise SceneError(f"{name} must be {rule}, got {value!r}") from None
    whole = name in _WHOLE
    if not np.isfinite(given) or not low <= given <= high or (given != int(given) if whole else given <= 0):
        raise SceneError(f"{name} must be {rule}, got {value!r}")
    return int(given) if whole else given
