"""Lamps: light is linear in their levels, and dimming equals a scene built with dimmed lamps."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from gi_core.estimators import ESTIMATORS
from gi_core.frames.background import Photons
from gi_core.frames.first_frame import FirstFrame
from gi_core.lights import emission
from gi_core.scene.errors import SceneError
from gi_core.scene.pose import axis_angle
from gi_core.scene.types import LampLevel, LightScene, Material, Mobile, PointLight, Pose, Scene, SkyLight
from gi_core.solver import Solver
from tests.support.scene_builders import box, merge, quad, solve, sphere

GIVEN = {"photons": 4000, "radius": 0.2, "neighbours": 12, "seed": 5}
MOVED = {"box": Pose((0.35, 0.6, 0.0), axis_angle((0, 0, 1), 30.0)), "ball": Pose((0.5, 0.5, 0.3))}
LAMPS = ("bulb", "firmament", "lamp", "strip")


def room(levels=None, names=LAMPS) -> Scene:
    """A room open to the sky with two area lamps, a bulb and two mobiles; levels: by lamp; names: of the lamps."""
    level = dict.fromkeys(LAMPS, 1.0) | (levels or {})
    bulb, sky, lamp, strip = names

    def lit(colour, name):
        return tuple(float(c) for c in np.multiply(colour, level[name]))

    materials = (
        Material("wall", (0.7, 0.6, 0.5)),
        Material(lamp, (0.5, 0.5, 0.5), lit((3.0, 2.0, 1.0), "lamp")),
        Material(strip, (0.2, 0.2, 0.2), lit((1.0, 2.0, 4.0), "strip")),
    )
    walls = box((0, 0, 0), (1, 1, 1), 3, 0, inward=True)
    low = (walls.vertices[walls.faces][:, :, 2] < 1).any(axis=1)  # no ceiling
    static = merge(
        walls._replace(faces=walls.faces[low], face_material=walls.face_material[low]),
        quad((0.3, 0.3, 0.99), (0, 0.2, 0), (0.2, 0, 0), (1, 1), 1),
        quad((0.01, 0.2, 0.6), (0, 0.5, 0), (0, 0, 0.1), (1, 1), 2),
    )
    mobiles = (
        Mobile("box", box((-0.12, -0.12, 0), (0.12, 0.12, 0.24), 1, 0), Pose((0.6, 0.4, 0.0))),
        Mobile("ball", sphere((0, 0, 0), 0.15, 1, 0), Pose((0.3, 0.7, 0.4))),
    )
    lights = (
        PointLight(bulb, (0.8, 0.8, 0.7), lit((0.5, 0.5, 2.0), "bulb")),
        SkyLight(sky, lit((0.3, 0.4, 0.5), "firmament"), 12, (0.5, 0.2, 0.4)),
    )
    return Scene(static, materials, mobiles, lights, up=(0, 0, 1), name="room")


def solved(scene: Scene, **more) -> Solver:
    return solve(scene, **GIVEN | more)


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_sums_of_lamps_equal_the_sums_without_lamps_integer_for_integer(estimator, monkeypatch):
    monkeypatch.setattr(emission, "FEW", 0.0)  # photons are guided per lamp, so four lamps emit others than one
    apart, together = solved(room(), estimator=estimator), solved(room(names=("light",) * 4), estimator=estimator)
    assert apart.lamps.names == ("lamp", "strip", "bulb", "firmament") and together.lamps.names == ("light",)
    for poses in ({}, MOVED):
        found = []
        for solver in (apart, together):
            solver.move_all(poses)
            estimate = solver.frame.background.estimate
            sums = (estimate.evaluate(solver.frame.change).sums, estimate.background(GIVEN["photons"])[0])
            found.append([s.reshape(len(s), -1, 3).sum(axis=1) for s in sums])
        for a, b in zip(*found, strict=True):
            np.testing.assert_array_equal(a, b)
        assert np.array_equal(apart.irradiance, together.irradiance)
    lit = [s.frame.fates["absorbed"] for s in (apart, together)]
    assert lit[0] == pytest.approx(lit[1], rel=1e-12)


def built(levels: dict[str, float], shares: np.ndarray, **more) -> Solver:
    """Return a solver of the room with dimmed lamps, whose photons are shared as given."""
    solver = Solver(room(levels), **GIVEN | more)
    photons = Photons(solver.model.with_shares(shares), GIVEN["seed"])
    solver._first_frame = FirstFrame(photons, solver.frame_light)
    solver.solve()
    return solver


@pytest.mark.parametrize("light", ["photons", "best"])
@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_dimming_equals_a_solver_built_with_those_fluxes(estimator, light):
    levels = {"bulb": 0.25, "lamp": 2.0, "strip": 0.7, "firmament": 1.3}
    shares = np.array([0.3, 0.2, 0.3, 0.2])
    dimmed, fresh = built({}, shares, estimator=estimator), built(levels, shares, estimator=estimator)
    dimmed.set_lamps(levels)
    for solver in (dimmed, fresh):
        solver.configure(light=light)
        solver.solve()
    for poses in ({}, MOVED):
        for solver in (dimmed, fresh):
            solver.move_all(poses)
        assert dimmed.irradiance == pytest.approx(fresh.irradiance, rel=1e-11, abs=1e-14)
        assert np.array_equal(dimmed.irradiance, dimmed.from_scratch())
        assert not np.allclose(dimmed.irradiance, built({}, shares).irradiance, rtol=1e-2)


def test_halving_all_lamps_halves_light_bit_for_bit():
    solver, half = solved(room()), solved(room(dict.fromkeys(LAMPS, 0.5)))
    solver.move_all(MOVED)
    half.move_all(MOVED)
    full = solver.irradiance.copy()
    solver.set_lamps(dict.fromkeys(LAMPS, 0.5))
    assert np.array_equal(solver.irradiance, 0.5 * full) and np.array_equal(half.irradiance, 0.5 * full)


level = st.sampled_from([0.0, 0.25, 1.0, 2.0, (1.0, 0.5, 0.25), 0.3])
BULB_ALONE = {"lamp": 0.0, "strip": 0.0, "firmament": 0.0}
dims = st.dictionaries(st.sampled_from(LAMPS), level, min_size=1, max_size=4)
moves = st.sampled_from([{}, MOVED, {"box": MOVED["box"]}, {"ball": Pose((0.9, 0.9, 0.2))}])


@settings(max_examples=12)
@given(
    st.lists(
        st.tuples(st.one_of(dims, moves), st.sampled_from(list(ESTIMATORS)), st.sampled_from(["best", "photons"])),
        min_size=1,
        max_size=5,
    )
)
def test_any_history_of_lamps_and_moves_equals_from_scratch(history):
    solver = solve(room(), **GIVEN | {"photons": 300})
    for change, estimator, light in history:
        solver.configure(estimator=estimator, light=light)
        solver.solve()
        if set(change) <= set(MOVED):
            solver.move_all(change)
        else:
            solver.set_lamps(change)
        assert np.array_equal(solver.irradiance, solver.from_scratch())
        assert (solver.irradiance >= 0).all() and np.isfinite(solver.irradiance).all()


@settings(max_examples=12)
@given(st.lists(dims, min_size=1, max_size=4))
@example([BULB_ALONE, {"strip": 0.02}])  # photons of the bulb alone are enough, but not those of these levels
def test_bits_depend_on_the_levels_alone(history):
    """As where the scene is saved and opened again; photons of a twin have no history either."""
    scene = room({"bulb": 0.05, "strip": 0.1, "firmament": 0.1})
    solver = solved(scene, photons=300, light="photons")
    for change in history:
        solver.set_lamps(change)
        solver.solve()
    levels = dict(zip(solver.lamps.names, solver.levels.tolist(), strict=True))
    for other in (solved(scene, photons=300, light="photons", lamps=levels), solver.twin(), solver.twin(fresh=True)):
        other.solve()
        assert np.array_equal(solver.irradiance, other.irradiance)
    full = solver.twin()
    full.set_lamps(dict.fromkeys(LAMPS, 1.0))
    full.solve()
    assert np.array_equal(full.irradiance, solved(scene, photons=300, light="photons").irradiance)


def test_a_slider_changes_the_shares_of_lamps_at_powers_of_four():
    emitters = solved(room({"bulb": 0.05})).model.emitters
    places = [np.array([[1e-3], [1e-3], [1.0], [x]]) * np.ones(3) for x in np.geomspace(1e-3, 1, 200)]
    assert len({tuple(emitters.shares_at(levels)) for levels in places}) <= 6
    assert min(emitters.shared(emitters.shares_at(levels)).effective(levels) for levels in places) > 0.6


def test_light_of_lamps_adds_up_at_rest_and_in_frames():
    solver = solved(room())
    solver.move_all(MOVED)
    whole, alone = solver.irradiance.copy(), np.zeros_like(solver.irradiance)
    for name in LAMPS:
        solver.set_lamps({other: float(other == name) for other in LAMPS})
        alone += solver.irradiance
    assert alone == pytest.approx(whole, rel=1e-12)
    solver.set_lamps(dict.fromkeys(LAMPS, 0.0))
    assert not solver.irradiance.any()


def test_a_lamp_alone_is_traced_again_with_more_photons_and_less_noise():
    def noise(solver: Solver) -> float:
        E, near = solver.irradiance, truth.irradiance
        return float(np.abs(E - near).sum() / near.sum())

    dim = dict.fromkeys(LAMPS, 0.0) | {"bulb": 1.0}
    truth = solved(room({n: 0.0 for n in LAMPS if n != "bulb"}), photons=200_000)
    weak = room({"bulb": 0.05})
    truth.set_lamps({"bulb": 0.05})
    solver = solved(weak, photons=8000)
    solver.set_lamps(dim)
    before, few, picture = noise(solver), solver.frame.effective_photons, solver.irradiance.copy()
    assert few < 0.25 * 8000
    shown = [solver.irradiance.copy() for p in solver.solve_steps() if not p.picture]
    assert np.array_equal(shown[0], picture), "the picture stays until the new light is there"
    assert solver.frame.effective_photons > 0.8 * 8000
    assert noise(solver) < 0.75 * before
    assert np.array_equal(solver.irradiance, solver.from_scratch())
    solver.set_lamps(dict.fromkeys(LAMPS, 1.0))
    assert not any(p.stage == "tracing" for p in solver.solve_steps()), "photons shared by flux are still there"
    assert np.array_equal(solver.irradiance, solved(weak, photons=8000).irradiance), "shared by flux again"


@pytest.mark.parametrize(
    "levels, rule",
    [
        ({"bulbs": 1.0}, "no lamp is called 'bulbs'; did you mean 'bulb'?"),
        ({"bulb": -1.0}, "a level is a number from 0 to 1000"),
        ({"bulb": float("nan")}, "a level is a number"),
        ({"bulb": (1.0, 2.0)}, "three of them"),
        ({"bulb": "on"}, "a level is a number"),
        ({"bulb": 10**400}, "a level is a number"),
    ],
)
def test_bad_levels_are_refused_and_change_nothing(levels, rule):
    solver = solve(room(), **GIVEN | {"photons": 300})
    before = solver.irradiance
    with pytest.raises(SceneError, match=rule.replace("(", r"\(")):
        solver.set_lamps(levels)
    assert solver.irradiance is before and (solver.levels == 1).all()


@pytest.mark.parametrize("last", ["bulb 19", "other lamps"])
def test_a_scene_of_many_lamps_keeps_the_brightest_apart(last):
    """A lamp may be called as the others together are: it is one of them."""
    called = [*(f"bulb {i}" for i in range(19)), last]
    bulbs = tuple(PointLight(name, (0.1 + 0.04 * i, 0.5, 0.9), (1.0 + i,) * 3) for i, name in enumerate(called))
    solver = Solver(replace(room(), lights=bulbs), **GIVEN | {"photons": 300})
    names = solver.lamps.names
    assert len(names) == 17 and names[-1] == "other lamps" and last in names and "bulb 0" not in names
    assert len(set(names)) == len(names)
    assert solver.model.emitters.shares.sum() == pytest.approx(1.0)


def test_light_scenes_name_lamps_of_the_scene():
    def named(*lamps: str) -> Scene:
        return replace(
            room(), light_scenes=(LightScene("evening", tuple(LampLevel(n, 0.5, (1.0, 0.8, 0.4)) for n in lamps)),)
        )

    Solver(named("bulb", "strip"), **GIVEN | {"photons": 0})
    with pytest.raises(SceneError, match="light scene \"evening\": no lamp is called 'lmp'; did you mean 'lamp'"):
        Solver(named("lmp"), **GIVEN | {"photons": 0})
