"""Classes of receivers that errors are quoted for."""

from __future__ import annotations

import numpy as np

from gi_core.geometry.border_angle import border_receivers
from gi_core.geometry.error import luminance
from gi_core.geometry.receivers import Receivers
from gi_core.geometry.surfaces import Surfaces

AFFECTED = 0.01  # of mean irradiance: a smaller change by the mobiles counts as none
CLASSES = ("untouched", "affected", "mobile", "border")


def receiver_classes(
    surfaces: Surfaces, receivers: Receivers, now: np.ndarray, background: np.ndarray
) -> dict[str, np.ndarray]:
    """Return which receivers are in each class, {name: (R,) bool}; each receiver is in exactly one.

    mobile: on a mobile. border: of the others, those at a border or corner, where a disc hangs over an
    edge or into a wall. affected: of the rest, those where the mobiles change luminance by more than
    AFFECTED of its mean; `now` and `background` are irradiance (R, 3) with mobiles and of the static
    scene alone (rows of mobiles are not looked at). untouched: what is left.
    """
    on_mobile = np.arange(len(receivers.areas)) >= surfaces.first_receiver[1]
    border = border_receivers(surfaces, len(receivers.areas)) & ~on_mobile
    light = luminance(now)
    w = receivers.areas
    mean = float((w * light).sum() / w.sum()) if w.sum() > 0 else 0.0
    changed = np.abs(light - luminance(background)) > AFFECTED * mean
    rest = ~on_mobile & ~border
    return {"untouched": rest & ~changed, "affected": rest & changed, "mobile": on_mobile, "border": border}
