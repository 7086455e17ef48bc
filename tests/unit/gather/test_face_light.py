"""Faces reflect the light of delta lights that falls on them, and bright ones get rays."""

from dataclasses import replace

import numpy as np
import pytest

from gi_core.gather import candidates
from gi_core.gather.radiosity import Radiosity, face_light
from gi_core.gather.reference import reference_irradiance
from gi_core.geometry.error import error_less_noise, luminance
from gi_core.model import Model
from tests.support.lit_from_outside import FLOOR, MATERIALS, l_room
from tests.support.scene_builders import furnace_scene

WING = replace(l_room(), mobiles=(), lights=l_room().lights[:1])  # sun by a window of 1.5 x 1.5 m, faces of 0.4 m


def radiosity(scene, pairs: int) -> tuple[Radiosity, np.ndarray]:
    """Return radiosity at a scene's static receivers after so many pairs of sets, and their areas."""
    model = Model(scene)
    rows = model.surfaces.receiver_range(0)
    areas = model.object_receivers.areas[rows]
    gather = Radiosity(model, 0, *(a[rows] for a in model.evaluation_points), areas)
    for _ in range(pairs):
        gather.add_pair()
    return gather, areas


def test_floor_reflects_the_flux_of_the_sunbeam():
    """Irradiance of the sun times the window, less what falls on walls: here all of it reaches the floor."""
    model = Model(WING)
    s = model.surfaces
    light = face_light(model, 0, model.object_receivers.areas)
    floor = np.flatnonzero((s.normals[:, 2] > 0.99) & (s.vertices[0][s.faces[0]][..., 2].max(axis=1) < 1e-6))
    reflected = light.reflected[2 * floor].astype(np.float64)
    index = light.bright.lights.of_face[floor]
    reflected[index >= 0] = light.of_bright[index[index >= 0]]
    flux = (s.areas[floor, None] * reflected).sum(axis=0)
    (sun,) = WING.lights
    way = np.array(sun.direction) / np.linalg.norm(sun.direction)
    rho = np.array(MATERIALS[FLOOR].reflectance)
    assert flux == pytest.approx(rho * 1.5 * 1.5 * abs(way[0]) * np.array(sun.irradiance), rel=0.03)


def test_scenes_without_delta_lights_measure_nothing():
    light = face_light(Model(furnace_scene()), 0, np.ones(1))
    assert not len(light.receivers) and not len(light.reflected) and not len(light.bright.face)


@pytest.mark.slow
def test_coarse_room_with_a_sunbeam_has_the_light_of_whole_paths():
    """By the mean of corners the room had a twentieth too much."""
    gather, areas = radiosity(WING, 5)
    truth, error = reference_irradiance(WING, *gather._starts[:2], 1000, 5)
    assert error_less_noise(gather.mean, truth, luminance(error), areas) < 0.025
    assert (areas @ gather.mean) / (areas @ truth) == pytest.approx(1.0, abs=0.01)


@pytest.mark.slow
def test_rays_to_bright_faces_lower_the_noise_and_keep_the_light(monkeypatch):
    with_rays, areas = radiosity(WING, 3)
    monkeypatch.setattr(candidates, "LEAST_BRIGHT", np.inf)
    without, _ = radiosity(WING, 3)
    assert len(with_rays._on_faces.bright.face) and not len(without._on_faces.bright.face)
    assert with_rays.noise < 0.6 * without.noise
    assert (areas @ with_rays.mean) / (areas @ without.mean) == pytest.approx(1.0, abs=0.03)
