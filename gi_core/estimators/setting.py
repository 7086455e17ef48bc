"""Settings of an estimator, and the valid range of each value."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from gi_core.base.fixed_point import MAX_PHOTONS
from gi_core.discs.search import DEFAULT
from gi_core.scene.errors import SceneError
from gi_core.scene.rules import FLAG, LENGTH, one_of, whole


class Setting(NamedTuple):
    """Settings of an estimator; `search` changes its time, not its bits."""

    estimator: str  # a key of ESTIMATORS
    radius: float  # of the disc, or the largest of a search [m]
    neighbours: int  # k of photon_map
    control: bool = True  # artifact control of tangent_plane, see `gi_core.discs.region`
    search: str = DEFAULT  # a key of `gi_core.discs.search.SEARCHES`: how tangent_plane finds disc intersections
    border_correction: bool = True  # photon_map at borders: alpha / 2 pi of a disc, `receiver_classes`
    textbook: bool = False  # photon_map counts the k-th hit too, as in the report: k / (k - 1) too much

    def changed(self, choices: Mapping[str, Mapping], **values) -> Setting:
        """Return the setting with the given values replaced; None keeps a value.

        choices: the registries of fields that name something. Raises SceneError for a bad value.
        """
        for name in values:
            if name not in self._fields:
                raise SceneError(f"there is no setting {name!r}; there are {', '.join(self._fields)}")
        rules = RULES | {name: one_of(names) for name, names in choices.items()}
        return self._replace(**{n: rules[n].check(n, value) for n, value in values.items() if value is not None})


RULES = {
    "photons": whole(0, MAX_PHOTONS), "neighbours": whole(1, 100_000), "threads": whole(1, 1024),
    "seed": whole(0, 2**63 - 1), "radius": LENGTH,
    "control": FLAG, "border_correction": FLAG, "textbook": FLAG,
}  # fmt: skip


def checked(name: str, value, kept=None, where: str = ""):
    """Return the value of a setting, or `kept` for None. Raises SceneError beyond the range of its name."""
    return kept if value is None else RULES[name].check(where + name, value)
