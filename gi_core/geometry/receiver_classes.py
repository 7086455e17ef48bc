"""Receiver classes of error statistics."""

from __future__ import annotations

import numpy as np

from gi_core.geometry.border_angle import border_receivers
from gi_core.geometry.error import luminance
from gi_core.geometry.receivers import Receivers
from gi_core.geometry.surfaces import Surfaces

AFFECTED = 0.01  # of mean luminance: least change that counts
CLASSES = ("untouched", "affected", "mobile", "border")


def receiver_classes(
    surfaces: Surfaces, receivers: Receivers, now: np.ndarray, background: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the members of each class, {name: (R,) bool}; each receiver is in exactly one class, the first of these.

    mobile: on a mobile. border: at a border or corner, where a disc hangs over an edge or into a wall. affected:
    mobiles change luminance by more than AFFECTED of its mean; `now` and `background` are irradiance (R, 3) with
    mobiles and of the static part alone (rows of mobiles are ignored). untouched: all others.
    """
    on_mobile = np.arange(len(receivers.areas)) >= surfaces.first_receiver[1]
    border = border_receivers(surfaces, len(receivers.areas)) & ~on_mobile
    light = luminance(now)
    w = receivers.areas
    mean = float((w * light).sum() / w.sum()) if w.sum() > 0 else 0.0
    changed = np.abs(light - luminance(background)) > AFFECTED * mean
    rest = ~on_mobile & ~border
    return {"untouched": rest & ~changed, "affected": rest & changed, "mobile": on_mobile, "border": border}
