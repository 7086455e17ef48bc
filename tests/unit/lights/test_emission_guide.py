"""Guided emission of sun and sky."""

from dataclasses import replace

import numpy as np
import pytest

from gi_core.lights.emission import EVEN, Guide, emit, guided
from gi_core.lights.kinds import SKY, SUN
from gi_core.model import Model
from gi_core.scene.types import Scene, SkyLight
from tests.support.lit_from_outside import l_room, sky_room
from tests.support.scene_builders import plane_scene


def clear_room() -> Scene:
    scene = sky_room()
    skies = tuple(light._replace(cie=13, sun=(0.3, -0.2, 0.5)) for light in scene.lights)
    return replace(scene, lights=skies)


AROUND = np.array([0.0, 0, 0, 0, 0, 1, 2.0, 5, 0, 0, 0, -1])


@pytest.mark.parametrize("kind", [SKY, SUN])
def test_means_are_those_of_even_numbers(kind):
    """Within five standard errors: one chance in 10^6 each."""
    guide = Guide(kind, AROUND, np.zeros(0), lambda origin, _: 2 * ((origin[:, 0] > 0.5) & (origin[:, 1] > 1.0),))
    assert 0.02 < guide.arriving < 0.2
    rng = np.random.default_rng(1)
    drawn = np.array([guided(guide.table, *x) for x in rng.random((100_000, 4))])
    numbers, flux = drawn[:, :4], drawn[:, 4]
    assert (numbers >= 0).all() and (numbers <= 1).all() and (flux > 0).all() and flux.max() <= 1 / EVEN
    values = [np.ones(len(flux)), *numbers.T, *(numbers.T**2)]
    for value, expected in zip(values, [1.0] + [1 / 2] * 4 + [1 / 3] * 4, strict=True):
        assert (flux * value).mean() == pytest.approx(expected, abs=5 * (flux * value).std() / np.sqrt(len(flux)))


@pytest.mark.parametrize(("place", "least"), [(l_room, 0.2), (sky_room, 0.1), (clear_room, 0.1)])
def test_photons_meet_receivers_and_carry_the_flux_of_even_ones(place, least):
    model = Model(place())
    emitters, pilot = model.emitters, model.pilot
    assert ((pilot.first >= 0) & (pilot.first & 1 == 0)).mean() > least, "0.02 and 0.01 of even photons"
    assert (emitters.arriving < 0.1).all()
    assert emitters.effective(emitters.lamps.full()) == pytest.approx(1.0)
    flux = emit(emitters, 3, 0, 1 << 18)
    for g in range(emitters.lamps.count):
        carried = np.where(flux.lamp == g, flux.flux.max(axis=1), 0) * emitters.scale[g] * emitters.unit_flux
        sent = emitters.flux_of_lamps[g].max()
        assert carried.mean() == pytest.approx(sent, abs=5 * carried.std() / 2**9)


def test_photons_of_open_scenes_start_evenly():
    emitters = Model(plane_scene(SkyLight("sky", (1.0, 1.0, 1.0)))).emitters
    assert (emitters.arriving == 1.0).all() and not len(emitters.guides)
