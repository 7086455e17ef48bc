"""The first look at a scene. Probes of an estimator that counts hits on faces: linear interpolation within the face."""

from dataclasses import replace

import numpy as np
import pytest

from gi_core.display import first_look
from gi_core.display.first_look import first_looks
from gi_core.frames.frame import probe_irradiance
from gi_core.gather.reference import reference_irradiance
from gi_core.geometry.error import luminance
from gi_core.geometry.surfaces import evaluation_points
from gi_core.model import Model
from gi_core.scene.types import Mesh, Probe
from tests.support.scene_builders import plane_scene
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
    looks = list(first_looks(scene, model, np.full((1, 3), level), 1.0, 0))
    found = [drawn for drawn, _ in looks]
    seen = np.minimum(*(1.0 if drawn.weights is None else drawn.weights for drawn in found)) == 1.0
    weights = receivers.areas * seen
    errors = [
        weights @ np.abs(luminance(drawn.irradiance / level) - luminance(truth)) / (weights @ luminance(truth))
        for drawn in found
    ]
    assert max(errors) < 0.08
    assert all(0.3 < noise / error < 1.5 for (_, noise), error in zip(looks, errors, strict=True))


def test_receivers_that_no_path_lights_are_no_black_flecks(monkeypatch):
    """In a kitchen lit by its windows, one receiver in thirty was black in light of four paths."""
    scene = room()
    model = Model(scene)
    n = len(model.object_receivers.areas)
    missed = (np.random.default_rng(1).random(n) < 0.2) & (np.diff(model.adjacency.first) > 2)

    def light(*of, **options) -> tuple[np.ndarray, np.ndarray]:
        return tuple(np.where(missed[:, None], 0.0, level) * np.ones(3) for level in (1.0, 0.3))

    monkeypatch.setattr(first_look, "reference_irradiance", light)
    drawn, _ = next(first_looks(scene, model, np.ones((1, 3)), 1.0, 0))
    assert missed.sum() > 10 and (drawn.irradiance[missed] > 0.4).all()


TURNED = np.array([(0.36, 0.48, -0.8), (-0.8, 0.6, 0.0), (0.48, 0.64, 0.6)]).T


@pytest.mark.parametrize("turn", [np.eye(3), TURNED], ids=["level", "tilted"])
@pytest.mark.parametrize("height", [0.0, 1e-9, 1e-3, 0.3, 40.0])
def test_probes_read_linear_light_exactly(turn, height):
    local = np.array([(0.67, 0.33, height), (-0.9, 0.2, height), (0.01, -0.4, height)])
    places, normal = local @ turn.T, turn[:, 2]
    probes = tuple(Probe(str(k), tuple(p), tuple(normal)) for k, p in enumerate(places))
    floor = plane_scene(divisions=3).static
    static = Mesh((floor.vertices + (0, 0, height)) @ turn.T, *floor[1:])
    model = Model(replace(plane_scene(), static=static, probes=probes), threads=1)

    def light(points: np.ndarray) -> np.ndarray:
        return 1 + np.outer((points @ turn)[:, 0], (0.1, 0.2, 0.3))

    read = probe_irradiance(model, light(model.receivers_at({}).positions), on_faces=True)
    assert np.allclose([read[p.name] for p in probes], light(places), rtol=1e-5)
