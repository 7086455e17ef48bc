"""Shares of the light at a point by lamp, last surface and bounces, against closed forms and the reference."""

import dataclasses
import math

import numpy as np
import pytest

from gi_core.files.load import load_scene
from gi_core.gather.origins import BOUNCES, COUNTS, GROUPS, LAMPS, STRAIGHT, SURFACES, origin_steps
from gi_core.gather.reference import reference_irradiance
from gi_core.geometry.error import luminance
from gi_core.model import Model
from gi_core.rays.all_objects import occluded_in_world
from gi_core.scene.types import PointLight
from tests.support.scene_builders import furnace_scene

RHO = 0.5
BULB = (0.42, 0.3, 0.15)


def last(scene, position, normal, levels=None, seed=0, model=None):
    model = model or Model(scene)
    levels = model.emitters.lamps.full() if levels is None else levels
    *_, origins = origin_steps(model, np.array(position), np.array(normal, float), {}, levels, seed)
    return origins


def by_name(shares):
    return {share.name: share for share in shares}


def view_factor(half_side: float, height: float) -> float:
    """Return that of a point below the middle of a parallel square: four times a corner's (Siegel, Howell)."""
    x = half_side / height
    return 4 / math.pi * x / math.sqrt(1 + x * x) * math.atan(x / math.sqrt(1 + x * x))


def furnace():
    """A closed unit cube that emits and reflects the same everywhere: each bounce brings RHO of the one before."""
    scene = furnace_scene(reflectance=RHO, divisions=1)
    z = scene.static.vertices[scene.static.faces][:, :, 2]
    of = np.where((z == 0).all(axis=1), 0, np.where((z == 1).all(axis=1), 1, 2)).astype(np.int32)
    materials = tuple(scene.materials[0]._replace(name=name) for name in ("floor", "ceiling", "walls"))
    return dataclasses.replace(scene, static=scene.static._replace(face_material=of), materials=materials)


def test_shares_of_the_furnace():
    """By bounces (1 - rho) rho^k; by surface rho times its view factor, from the middle of the floor."""
    origins = last(furnace(), (0.5, 0.5, 0.0), (0, 0, 1))
    E, error = origins.total
    assert E == pytest.approx(math.pi / (1 - RHO), abs=4 * error + 1e-9) and error < 0.02 * E
    bounces = origins.shares(BOUNCES)
    wanted = [(1 - RHO) * RHO**k for k in range(len(COUNTS) - 1)]
    for share, name, value in zip(bounces, COUNTS, [*wanted, 1 - sum(wanted)], strict=True):
        assert share.name == name and share.share == pytest.approx(value, abs=4 * share.error + 1e-6)
        assert share.error < 0.004
    surfaces, F = by_name(origins.shares(SURFACES)), view_factor(0.5, 1.0)
    wanted = {STRAIGHT: 1 - RHO, "ceiling": RHO * F, "walls": RHO * (1 - F)}
    assert surfaces.keys() == wanted.keys(), "the floor does not see itself"
    for name, value in wanted.items():
        assert surfaces[name].share == pytest.approx(value, abs=4 * surfaces[name].error + 1e-6)
        assert surfaces[name].colour == pytest.approx((1, 1, 1))


@pytest.fixture(scope="module")
def cornell():
    """The Cornell box with a second lamp, a blue bulb."""
    scene = load_scene("cornell")
    bulb = PointLight("bulb", BULB, (0.2, 0.2, 0.9))
    return dataclasses.replace(scene, lights=(*scene.lights, bulb))


SPOT, UP = (0.42, 0.0, 0.1), (0.0, 1.0, 0.0)


def test_groups_agree_and_lamps_are_those_of_the_reference(cornell):
    model = Model(cornell)
    levels = model.emitters.lamps.full()
    levels[0] = 0.5
    origins = last(cornell, SPOT, UP, levels, model=model)
    for group in GROUPS:
        shares = origins.shares(group)
        assert sum(share.share for share in shares) == pytest.approx(1, abs=1e-9)
        few = origins.shares(group, 2)
        assert len(few) == 2 and sum(share.share for share in few) == pytest.approx(1, abs=1e-9)
    E, error = origins.total
    lamps = by_name(origins.shares(LAMPS))
    assert lamps.keys() == set(model.emitters.lamps.names)
    for g, name in enumerate(model.emitters.lamps.names):
        alone = np.zeros_like(levels)
        alone[g] = levels[g]
        args = cornell, np.array([SPOT]), np.array([UP]), 20_000, 7
        (truth,), (noise,) = reference_irradiance(*args, model=model, levels=alone)
        both = math.hypot(float(luminance(noise)), lamps[name].error * E, lamps[name].share * error)
        assert lamps[name].share * E == pytest.approx(float(luminance(truth)), abs=4 * both)
    # straight light of a bulb has a closed form
    off = np.array(BULB) - SPOT
    straight = by_name(origins.shares(BOUNCES))["0"].share * E
    only = levels.copy()
    only[list(model.emitters.lamps.names).index("bulb")] = 0
    lamp = last(cornell, SPOT, UP, only, model=model)
    rest = by_name(lamp.shares(BOUNCES))["0"]
    wanted = float(luminance(np.array([0.2, 0.2, 0.9]))) / (4 * math.pi) * off[1] / np.linalg.norm(off) ** 3
    slack = 4 * math.hypot(rest.error * lamp.total[0], rest.share * lamp.total[1])
    assert straight - rest.share * lamp.total[0] == pytest.approx(wanted, abs=2 * slack)


def test_errors_are_those_of_other_seeds(cornell):
    """Of 16 seeds, the deviation of each share is its standard error: a ratio of variances within chi-square bounds."""
    model = Model(cornell)
    levels = model.emitters.lamps.full()
    first = []
    for seed in range(16):
        first.append(next(origin_steps(model, np.array(SPOT), np.array(UP), {}, levels, seed)))
    for group in GROUPS:
        for name in by_name(first[0].shares(group)):
            these = [by_name(origins.shares(group))[name] for origins in first]
            ratio = np.var([s.share for s in these], ddof=1) / np.mean([s.error**2 for s in these])
            assert 0.2 < ratio < 3.0, (group, name, ratio)  # 15 degrees of freedom: outside by 1e-4 each


def test_the_dark_has_no_shares(cornell):
    model = Model(cornell)
    origins = last(cornell, SPOT, UP, np.zeros_like(model.emitters.lamps.full()), model=model)
    assert origins.total == (0.0, 0.0) and all(origins.shares(group) == () for group in GROUPS)


def test_ways_lead_past_nothing_to_the_lamps_of_their_shares(cornell):
    """Each leg is free, and the last one ends on a lamp; straight ways are as frequent as their share of the light."""
    model, straight, of_bulb, ways = Model(cornell), 0, 0, []
    for seed in range(8):
        origins = last(cornell, SPOT, UP, seed=seed, model=model)
        ways += origins.ways
    panel = cornell.static.vertices[cornell.static.faces][:, :, 1].max()
    for way in ways:
        places = way.places - model.origins[0]
        assert way.places[0] == pytest.approx(SPOT) and 2 <= len(places) <= 5 and max(way.colour) == 1.0
        on_bulb, on_panel = math.dist(way.places[-1], BULB) < 1e-9, abs(way.places[-1][1] - panel) < 0.01
        assert on_bulb or on_panel
        straight, of_bulb = straight + (len(places) == 2), of_bulb + on_bulb
        for a, b in zip(places, places[1:], strict=False):
            away = (b - a) / math.dist(a, b)
            line = (a + 1e-4 * away)[None], away[None], np.array([math.dist(a, b) - 2e-4])
            assert not occluded_in_world(model.accelerator, model.transforms(model.start_poses()), *line)[0]
    shares, lamps, n = by_name(origins.shares(BOUNCES)), by_name(origins.shares(LAMPS)), len(ways)
    few = sum(shares[name].share for name in COUNTS[:-1])
    for count, share in ((straight, shares["0"].share / few), (of_bulb, lamps["bulb"].share)):
        assert count / n == pytest.approx(share, abs=4 * math.sqrt(share * (1 - share) / n) + 0.02)
