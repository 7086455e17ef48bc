"""The first look at a scene."""

from __future__ import annotations

import numpy as np
import pytest

from gi_core.display.first_look import first_looks
from gi_core.gather.reference import reference_irradiance
from gi_core.geometry.error import luminance
from gi_core.geometry.evaluation_points import evaluation_points
from gi_core.model import Model
from tests.support.viewer_support import room


@pytest.mark.slow
def test_light_of_a_first_look_is_close_to_the_reference():
    """Within 8 % (l1, by area) on static part and mobile, 5 % measured; levels of lamps count."""
    scene = room()
    model = Model(scene)
    receivers = model.receivers_at(model.start_poses())
    points, normals = evaluation_points(model.surfaces, receivers)
    truth, _ = reference_irradiance(scene, points, normals, 1 << 10, 1, model=model)
    level = 0.25
    looks = list(first_looks(scene, model, np.full((1, 3), level), 0))
    found = [look.drawn for look in looks]
    seen = np.minimum(*(1.0 if drawn.weights is None else drawn.weights for drawn in found)) == 1.0
    weights = receivers.areas * seen
    errors = [
        weights @ np.abs(luminance(drawn.irradiance / level) - luminance(truth)) / (weights @ luminance(truth))
        for drawn in found
    ]
    assert max(errors) < 0.08
    assert all(0.3 < look.noise / error < 1.5 for look, error in zip(looks, errors, strict=True))
