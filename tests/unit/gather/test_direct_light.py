"""Direct light of static receivers, and the part that mobiles block."""

from dataclasses import replace

import numpy as np
import pytest

from gi_core.gather.direct_light import DirectLight
from gi_core.gather.reference_sample import gather_sample
from gi_core.lights.next_event import MOST_DELTA
from gi_core.model import Model
from gi_core.scene.pose import axis_angle
from gi_core.scene.types import DirectionalLight, Mobile, PointLight, Pose, Scene, SkyLight, SpotLight
from tests.support.lit_from_outside import sky_room
from tests.support.photometry import luminaire
from tests.support.scene_builders import BLACK, box, floor, gathered, lamp, merge, quad, solve

LIGHTS = {
    "lamp": (),
    "bulb": (PointLight("bulb", (0.4, 0.3, 0.8), (3.0, 2.0, 1.0)),),
    "spot": (SpotLight("spot", (-0.4, 0.1, 0.9), (0.3, 0.0, -1.0), (2.0, 2.0, 2.0), 10.0, 40.0),),
    "sun": (DirectionalLight("sun", (0.3, 0.2, -1.0), (1.0, 0.9, 0.7)),),
    "sky": (SkyLight("sky", (0.2, 0.3, 0.5)),),
    "clear sky": (SkyLight("clear sky", (0.2, 0.3, 0.5), 12, (0.4, 0.3, 0.5)),),
    "panel": (luminaire("panel", (0.0, -0.5, 0.9), (2.0, 2.0, 1.0), size=(0.3, 0.2)),),
    "downlight": (luminaire("downlight", (-0.5, -0.5, 0.9), (2.0, 2.0, 1.0)),),
}
POSES = {"box": Pose((0.1, 0.0, 0.3), axis_angle((0.0, 0.0, 1.0), 30.0)), "slab": Pose((-0.3, -0.2, 0.45))}


def scene(*names: str, mobiles: bool = True) -> Scene:
    """A black floor with a post and a black wall, a box and a slab over it, under some of LIGHTS."""
    post, wall = box((0.5, 0.5, 0.0), (0.6, 0.6, 0.3), 2), quad((-1.0, 1.0, 0), (2.0, 0, 0), (0, 0, 0.7), (9, 3))
    parts = [floor(2.0, 13), post, wall]
    if "lamp" in names:
        parts.append(quad((-0.2, 0.4, 1.0), (0, 0.4, 0), (0.3, 0, 0), (1, 1), 1))
    things = (
        Mobile("box", box((-0.1, -0.1, -0.1), (0.1, 0.1, 0.1), 2), Pose((0.0, 0.0, 0.5))),
        Mobile("slab", box((-0.2, -0.1, -0.01), (0.2, 0.1, 0.01), 1), Pose((0.0, 0.4, 0.5))),
    )
    lights = tuple(light for name in names for light in LIGHTS[name])
    return Scene(merge(*parts), (BLACK, lamp(8.0)), things if mobiles else (), lights, up=(0.0, 0.0, 1.0), name="stage")


def measured(model: Model, seed: int = 5) -> DirectLight:
    direct = DirectLight(model, seed)
    direct.measure()
    return direct


def standing(of: Scene) -> Scene:
    """Return a scene whose mobiles are static, at POSES."""
    at = Model(of).transforms(POSES)
    parts = [of.static]
    for o, mobile in enumerate(of.mobiles, 1):
        there = mobile.mesh.vertices @ at.rotation[o].T + at.position[o]
        parts.append(mobile.mesh._replace(vertices=there))
    far = Mobile("far", box((-0.1, -0.1, -0.1), (0.1, 0.1, 0.1), 1), Pose((0.0, 0.0, 0.9)))
    return replace(of, static=merge(*parts), mobiles=(far,))


@pytest.mark.parametrize("name", LIGHTS)
def test_it_is_the_light_that_paths_find_on_black_surfaces(name):
    place = scene(name)
    model = Model(replace(place, mobiles=()))
    light = measured(Model(place)).per_lamp.reshape(model.first_probe, -1, 3).sum(axis=1)
    rows = np.arange(model.first_probe)[::3]
    *_, truth = gather_sample(model, {}, rows, np.ones(len(rows)), 3, 0.003, most_paths=1e6)
    assert truth.irradiance.max() > 0.1
    exact = name in ("bulb", "spot", "downlight")
    error = np.abs(light[rows] - truth.irradiance).sum() / truth.irradiance.sum()
    assert error < (1e-6 if exact else 0.03)
    assert light[rows].sum() == pytest.approx(truth.irradiance.sum(), rel=1e-6 if exact else 0.01)


@pytest.mark.parametrize("name", LIGHTS)
def test_mobiles_block_as_much_as_static_objects_there(name):
    place, level = scene(name), np.array([[0.5, 1.0, 2.0]])
    model, still = Model(place), Model(standing(place))
    direct, blocked_by_static = measured(model), measured(still)
    n = len(direct.per_lamp)
    levels = np.repeat(level, model.emitters.lamps.count, axis=0)
    blocked = direct.blocked(model.transforms(POSES), levels)
    before = direct.per_lamp.reshape(n, -1, 3).sum(axis=1) * level
    after = blocked_by_static.per_lamp[:n].reshape(n, -1, 3).sum(axis=1) * level
    assert (blocked.sum(axis=1) > 0.1 * before.sum(axis=1)).sum() >= 4
    same = np.abs(before - blocked - after).max(axis=1) < 1e-5 * before.max()
    assert same.mean() > 0.99, "rays that graze an edge may differ"
    assert (blocked <= before * (1 + 1e-12)).all() and (blocked >= 0).all()


def test_several_lamps_are_measured_apart_and_add_up():
    place = scene(*LIGHTS)
    model = Model(place)
    direct, at, lamps = measured(model), model.transforms(POSES), model.emitters.lamps
    whole, parts = direct.blocked(at, lamps.full()), np.zeros((len(direct.per_lamp), 3))
    for g in range(lamps.count):
        alone = np.zeros((lamps.count, 3))
        alone[g] = 1.0
        some = direct.blocked(at, alone)
        assert some.any()
        parts += some
    assert parts == pytest.approx(whole, rel=1e-9)


def test_threads_do_not_matter_and_absent_mobiles_block_nothing():
    one, many = (Model(scene(*LIGHTS), threads=n) for n in (1, 3))
    a, b = measured(one), measured(many)
    at, full = one.transforms(POSES), one.emitters.lamps.full()
    assert np.array_equal(a.per_lamp, b.per_lamp) and np.array_equal(a.blocked(at, full), b.blocked(at, full))
    away = {name: Pose((50.0, 50.0, 50.0)) for name in POSES}
    assert not a.blocked(one.transforms(away), full).any()


def test_what_resting_mobiles_block_is_kept(monkeypatch):
    """Mobiles that move, rest, return and hide the same light have the bits of a new gathering."""
    model = Model(scene(*LIGHTS), threads=2)
    kept, full, tested, real = measured(model), model.emitters.lamps.full(), [], DirectLight._find_blocked
    monkeypatch.setattr(DirectLight, "_find_blocked", lambda d, at, k, *a: tested.extend(k) or real(d, at, k, *a))
    away, low = Pose((50.0, 50.0, 50.0)), POSES["slab"]._replace(position=(0.0, 0.0, 0.1))  # under the box
    history = ({}, {"slab": low}, {"slab": low}, {"box": away, "slab": low}, {"slab": away}, {})
    for poses, moved in zip(history, ([0, 1], [1], [], [0], [0, 1], [1]), strict=True):
        at = model.transforms(POSES | poses)
        found, again = kept.blocked(at, full), tested.copy()
        assert again == moved
        assert found.any() and np.array_equal(found, measured(Model(model.scene, 1)).blocked(at, full))
        tested.clear()


def test_nothing_is_measured_for_very_many_delta_lights():
    bulbs = tuple(PointLight(f"bulb {k}", (0.01 * k, 0.0, 0.8), (0.1, 0.1, 0.1)) for k in range(MOST_DELTA + 1))
    assert not measured(Model(replace(scene("lamp"), lights=bulbs))).is_known
    assert measured(Model(replace(scene("lamp"), lights=bulbs[1:]))).is_known
    solver = solve(replace(scene("lamp"), lights=bulbs), photons=2000, light="best")
    solver.move_all(POSES)
    assert np.array_equal(solver.irradiance, solver.from_scratch())


def test_a_shadow_of_few_photons_has_no_noise():
    """Photons of a frame measure bounced light alone, and black surfaces have none."""
    solver = gathered(solve(scene("lamp", "bulb"), photons=1 << 15, light="best", radius=0.1, seed=2))
    solver.move_all(POSES, photons=4096, paths=8)
    few = solver.irradiance[: solver.surfaces.receiver_range(0).stop].copy()
    solver.move_all({name: Pose((0.0, 0.0, 5.0)) for name in POSES})
    solver.move_all(POSES)
    assert np.array_equal(few, solver.irradiance[: len(few)]), "any number of photons: the same shadow"
    assert (few < 0.8 * solver.static_irradiance).any()
    at = solver.model.transforms(POSES)
    light, blocked = solver.frame_light.direct_at(at, solver.frame.background)
    share = np.divide(blocked, light, out=np.zeros_like(light), where=light > 0)
    G = solver.static_irradiance
    assert few == pytest.approx(np.maximum(G - np.minimum(G, light) * np.minimum(share, 1.0), 0.0))


@pytest.mark.parametrize(
    "names", [("lamp",), ("lamp", "bulb"), ("sky",), ("clear sky",), ("panel", "sun"), ("bulb", "spot", "downlight")]
)
def test_halves_of_the_points_tell_the_error_of_shadows(names):
    """It is near the scatter of shares between seeds; that of light from points is exact."""
    model, shares, errors = Model(scene(*names)), [], []
    at, levels = model.transforms(POSES), model.emitters.lamps.full()
    for seed in range(12):
        direct = measured(model, seed)
        blocked, light = (E.sum(axis=1) for E in (direct.blocked(at, levels), direct.at(at, levels)))
        shares.append(np.divide(blocked, blocked + light, out=np.zeros_like(light), where=blocked > 0))
        errors.append(direct.share_error(levels))
    scatter, stated = np.std(shares, axis=0, ddof=1), np.sqrt(np.mean(np.square(errors), axis=0))
    if "bulb" in names and "lamp" not in names:
        assert np.max(shares) > 0.8 and scatter.max() < 1e-12 and not stated.any()
    else:
        assert 0.8 < np.sqrt(np.mean(stated**2) / np.mean(scatter**2)) < 2.6


@pytest.mark.parametrize("edit", ["moved", "dimmed", "added", "removed", "twice"])
def test_points_that_an_edit_leaves_are_not_measured_again(edit, monkeypatch):
    names = ("sun", "panel", "lamp", "bulb", "spot", "clear sky", "downlight")
    before, bulb = scene(*names), LIGHTS["bulb"][0]
    sun, sky = (LIGHTS[name][0] for name in ("sun", "clear sky"))
    changes = {
        "moved": {"sun": sun._replace(direction=(0.5, 0.2, -0.6)), "clear sky": sky._replace(sun=(-0.5, -0.2, 0.6))},
        "dimmed": {
            "bulb": bulb._replace(flux=(1.0, 0.5, 0.2)),
            "panel": LIGHTS["panel"][0]._replace(flux=(1.0,) * 3),
        },
        "removed": {"bulb": None},
    }.get(edit, {})
    lights = [changes.get(light.name, light) for light in before.lights]
    lights += {"added": [bulb._replace(name="b")], "twice": [bulb, bulb]}.get(edit, [])
    after = replace(before, lights=tuple(light for light in lights if light is not None))
    old, asked = measured(Model(before)), []
    measure = DirectLight._measure
    monkeypatch.setattr(DirectLight, "_measure", lambda *a: asked.append(len(a[-1])) or measure(*a))
    new = DirectLight(Model(after), 5)
    assert Model(after).static_rays_key == Model(before).static_rays_key
    new.begin_with(old.kept())
    assert new.is_known == (edit in ("dimmed", "removed")) and not asked
    new.measure()
    assert set(asked) == {"moved": {64 + 256}, "added": {1}, "twice": {2}}.get(edit, set())
    fresh, at = measured(Model(after)), Model(after).transforms(POSES)
    assert np.array_equal(new.per_lamp, fresh.per_lamp) and fresh.per_lamp.any()
    assert all(np.array_equal(a, b) for a, b in zip(new._groups, fresh._groups, strict=True))
    assert not np.array_equal(new.per_lamp, old.per_lamp) or edit in ("added", "twice")
    levels = np.ones((Model(after).emitters.lamps.count, 3))
    assert np.array_equal(new.at(at, levels), fresh.at(at, levels))


def test_directions_through_a_window_are_the_same_for_any_sky():
    before = replace(sky_room(0.5), mobiles=())
    (sky,) = (light for light in before.lights if isinstance(light, SkyLight))
    after = replace(before, lights=(SkyLight(sky.name, (0.3, 0.3, 0.4), 12, (0.4, 0.5, 0.3)),))
    old, new = measured(Model(before)), DirectLight(Model(after), 5)
    assert Model(after).emitters.arriving[0] < 1.0
    new.begin_with(old.kept())
    fresh = measured(Model(after))
    assert new.is_known and np.array_equal(new.per_lamp, fresh.per_lamp) and fresh.per_lamp.any()
