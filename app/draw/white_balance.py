"""White balance: gains per channel that turn the light of a scene's lamps neutral, as a camera's white balance does.

The gains keep the luminance of white surfaces, so that exposure does not depend on them. False colours, errors and
numbers show the light itself.
"""

from __future__ import annotations

import numpy as np

from gi_core.geometry.error import luminance

Gains = tuple[float, float, float]
NEUTRAL: Gains = (1.0, 1.0, 1.0)
MOST = 4.0  # largest gain: stage light of one colour keeps its colour


def gains_for(flux: np.ndarray) -> Gains:
    """Return gains for lamps of a total flux (3,) [W]; NEUTRAL without light."""
    if not (total := float(luminance(flux))) > 0:
        return NEUTRAL
    gains = total / np.maximum(flux, total / MOST)
    red, green, blue = (gains * total / float(luminance(gains * flux))).tolist()
    return red, green, blue
