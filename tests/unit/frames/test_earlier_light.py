"""Static light after an edit: that before it, changed as photons say."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gi_core.files.edits import Darken, Edit, Finish, Freeze, Light, Remove, edited
from gi_core.frames import first_frame
from gi_core.frames.edited_light import LightBefore
from gi_core.gather.estimate import Estimate, Source
from gi_core.gather.static import StaticGather
from gi_core.geometry.error import relative_error
from gi_core.scene.types import Pose, Scene
from gi_core.solver import Solver
from tests.physics.test_edits import room
from tests.support.lit_from_outside import l_room
from tests.support.receiver_samples import static_areas
from tests.support.scene_builders import box, gathered, merge, solve

GIVEN = {"photons": 16_384, "radius": 0.12, "seed": 5, "light": "best"}
RED = (("reflectance", (0.7, 0.2, 0.1)),)


def solved(scene: Scene, **given) -> Solver:
    return solve(scene, **GIVEN | given)


@pytest.fixture(scope="module")
def before() -> Solver:
    """A solver whose static part shows light of many more photons as gathered light."""
    solver, many = solved(room()), solved(room(), photons=400_000, light="photons")
    light = many.frame.background.irradiance_per_lamp(400_000)
    g = StaticGather(solver.model, solver.seed)
    g.noise, g.estimate = 0.01, Estimate(Source.RADIOSITY, light, np.zeros((len(light), 3)), 0.01, 0.01)
    solver.frame_light.static.gathered = g
    solver.frame_light.static.compare(solver.frame.background)
    assert solver.frame_light.is_gathered
    return solver


def light_before(solver: Solver) -> LightBefore | None:
    return solver.keep_results().get("light before", "").light


def after(before: Solver, *edits: Edit) -> Solver:
    return solve(edited(before.scene, edits), **GIVEN, results=before.keep_results())


def test_a_mobiles_colour_leaves_the_static_light_as_it_was(before):
    solver = after(before, Finish("ball", RED))
    assert np.array_equal(solver.frame_light.static.best.light, before.frame_light.static.best.light)
    assert solver.frame_light.is_gathered and np.array_equal(solver.irradiance, solver.from_scratch())


def test_unreached_receivers_are_filled_from_the_first_picture_on(before, monkeypatch):
    """Below the crate no light comes; all photons of an edited gallery took 39 s, and the gaps were black so long."""
    monkeypatch.setattr(first_frame, "FIRST_PICTURE", 2048)
    n = before.surfaces.receiver_range(0).stop
    before._first_frame.find_unreached(before.frame.background)
    shown = before.drawn(before.irradiance).irradiance[:n]
    filled = (before.irradiance[:n] == 0).all(axis=1) & (shown > 0).all(axis=1)
    assert filled.any()
    results = before.keep_results().of("photons")
    solver = Solver(edited(before.scene, (Finish("ball", RED),)), **GIVEN, results=results)
    solver.frame_light.static.begin_with(light_before(before))
    pictures = (step for step in solver.solve_steps() if step.picture and solver.frame_light.is_gathered)
    seen = [solver.drawn(solver.irradiance).irradiance[:n] for _ in pictures]
    assert len(seen) > 3 and all((light[filled] > 0).all() for light in seen)


@pytest.fixture(scope="module")
def with_bounces() -> Solver:
    """A solver whose static part shows light of 112 kept bounces."""
    solver = solved(room(), photons=65_536)
    for _ in solver.gather_steps():
        if solver.frame_light.static.gathered.bounces.paths >= 112:
            return solver
    raise AssertionError("too few bounces")


@pytest.mark.parametrize(
    "edits",
    [
        (Light("bulb", (("position", (0.7, 0.6, 0.3)), ("flux", (4.0, 3.0, 1.0)))),),
        (Finish("wall", (("reflectance", (0.2, 0.5, 0.8)),)),),
        (Light("bulb", (("flux", (1.0, 2.0, 6.0)),)), Finish("wall", RED)),
    ],
)
def test_kept_bounces_light_an_edited_scene_again(with_bounces, edits):
    scene = edited(room(), edits)
    solver = solve(scene, **GIVEN, results=with_bounces.keep_results())
    static, fresh = solver.frame_light.static, solved(scene)
    assert static._edited.paths == 112 and static.best.source is Source.EDITED
    for _ in fresh.gather_steps():
        if fresh.frame_light.static.gathered.bounces.paths >= 112 and fresh.frame_light.static.gathered.noise < 0.03:
            break
    truth, areas = fresh.frame_light.static.gathered._radiosity.mean, static_areas(fresh)
    mine = relative_error(static.best.irradiance, truth, areas).l1
    photons = relative_error(fresh.frame.background.irradiance(GIVEN["photons"]), truth, areas).l1
    assert mine < min(0.5 * photons, 2 * static.best.error + 0.02), (mine, photons, static.best.error)
    columns = with_bounces.frame_light.static.best.light, static.best.light
    stay = static._edited._lamps if not any(isinstance(edit, Finish) for edit in edits) else []
    for g, k in enumerate(stay):
        was, now = (light[:, 3 * i : 3 * i + 3] for light, i in zip(columns, (k, g), strict=True))
        assert k < 0 or ((was == now) | (now == 0.0)).all()  # 0: unreached
    assert np.array_equal(solver.irradiance, solver.from_scratch())


def test_light_of_a_sunlit_patch_counts_once():
    """Radiosity counts its bounce with direct light; kept bounces meet the patch themselves."""
    scene = replace(l_room(), mobiles=(), lights=l_room().lights[:1])
    results, totals = None, []
    for of in (scene, edited(scene, (Finish("grey 0.8", (("reflectance", (0.4,) * 3),)),))):
        solver = solve(of, photons=16_384, light="best", results=results)
        totals += [] if results is None else [solver.frame_light.static._edited._relit.irradiance]
        for _ in solver.gather_steps():
            if (gathered := solver.frame_light.static.gathered)._radiosity.paths >= 112:
                break
        assert len(gathered._radiosity._on_faces.bright.face)
        results = solver.keep_results()
    kept, fresh = (static_areas(solver) @ E for E in (*totals, gathered._radiosity.mean))
    assert kept == pytest.approx(fresh, rel=0.03)  # 1.36 times, counted twice


def test_bounces_of_other_geometry_are_left(with_bounces):
    static = after(with_bounces, Freeze("ball", Pose((0.5, 0.5, 0.5)))).frame_light.static
    assert static._edited.paths == 0 and static._before.bounces.paths == 112


def test_bounces_are_left_where_points_do_not_stand_for_a_new_lamp(with_bounces):
    panel = {"type": "panel", "position": (0.5, 0.5, 0.97), "direction": (0, 0, -1), "flux": (1,) * 3}
    for side, paths in ((0.5, 0), (0.0, 112)):
        lamp = Light("new", tuple({**panel, "size": (side, side)}.items()))
        assert after(with_bounces, lamp).frame_light.static._edited.paths == paths


def test_a_walls_colour_changes_the_light_with_little_noise(before):
    """By few photons the change has less noise than the light itself."""
    edits = Finish("wall", (("reflectance", (0.9, 0.7, 0.5)),)), Finish("crate", RED)
    solver = after(before, *edits)
    many = solved(edited(room(), edits), photons=400_000, light="photons")
    truth, areas = many.frame.background.irradiance(400_000), static_areas(many)
    mine = relative_error(solver.static_irradiance, truth, areas).l1
    photons = relative_error(solver.frame.background.irradiance(GIVEN["photons"]), truth, areas).l1
    unchanged = relative_error(before.frame_light.static.best.irradiance, truth, areas).l1
    assert unchanged > 0.2 and mine < 0.7 * photons, (unchanged, mine, photons)
    assert solver.frame_light.static.best.error < 2 * mine + 0.02
    assert np.array_equal(solver.irradiance, solver.from_scratch())


def test_a_frozen_mobile_shows_photons_and_its_room_the_light_before(before):
    solver = after(before, Freeze("ball", before.poses["ball"]))
    light, old = solver.frame_light.static.best.irradiance, before.frame_light.static.best.irradiance
    corner = np.flatnonzero((before.model.object_receivers.positions[: len(old)] == 0).all(axis=1))
    assert len(light) > len(old) and len(corner)
    assert np.isfinite(light).all() and (light >= 0).all() and (light[len(old) :].sum(axis=1) > 0).any()
    assert np.array_equal(solver.irradiance, solver.from_scratch())


def test_edits_in_a_row_begin_with_the_same_light(before):
    """Values of a dragged slider add no noise to each other."""
    first = after(before, Finish("wall", RED))
    assert light_before(first) is first.frame_light.static._edited.before
    back = solve(before.scene, **GIVEN, results=first.keep_results().of("photons", "light before"))
    assert np.array_equal(back.frame_light.static.best.light, before.frame_light.static.best.light)


def test_lamps_that_stay_keep_their_light(before):
    """A light that moves shows photons; a lamp that is removed leaves no light and no error."""
    g = before.frame_light.static.best
    per_lamp = dict(zip(before.lamps.names, np.split(g.light, 3, axis=1), strict=True))
    moved = after(before, Light("bulb", (("position", (0.7, 0.3, 0.5)),)))
    light = dict(zip(moved.lamps.names, np.split(moved.frame_light.static.best.light, 3, axis=1), strict=True))
    assert np.array_equal(light["lamp"], per_lamp["lamp"]) and np.array_equal(light["spot"], per_lamp["spot"])
    assert moved.frame_light.is_gathered and np.array_equal(moved.irradiance, moved.from_scratch())
    many = solved(moved.scene, photons=400_000, light="photons")
    truth, areas = many.frame.background.irradiance(400_000), static_areas(many)
    mine = relative_error(moved.static_irradiance, truth, areas).l1
    photons = relative_error(moved.frame.background.irradiance(GIVEN["photons"]), truth, areas).l1
    assert mine < 0.5 * photons, (mine, photons)
    assert 0.5 * mine < moved.frame_light.static.best.error < 2 * mine
    without = after(before, Darken("bulb"))
    assert without.lamps.names == ("lamp", "spot")
    left = np.concatenate([per_lamp["lamp"], per_lamp["spot"]], axis=1)
    assert np.array_equal(without.frame_light.static.best.light, left)
    assert without.frame_light.static.best.error <= g.error


def test_light_that_an_edit_changes_much_is_gathered_before_more_photons(before):
    """As at a launch. In classroom, another hour of the sun showed 12 % of error until the million photons had come."""
    darker = tuple(Darken(name) for name in ("lamp", "spot"))
    moved = edited(before.scene, (*darker, Light("bulb", (("position", (0.7, 0.3, 0.5)),))))
    for kept in (None, Estimate(Source.EDITED, np.ones((1, 3)), np.ones((1, 1)), 0.1, 0.1)):
        solver = Solver(moved, **GIVEN | {"photons": 200_000}, results=before.keep_results())
        for progress in solver.solve_steps():
            if kept is not None and solver.frame_light.static.gathered is None:  # as another session has stored it
                g, n = StaticGather(solver.model, solver.seed), len(solver.static_irradiance)
                g.estimate = kept._replace(light=np.ones((n, 3)), variance=np.ones((n, 1)))
                solver.frame_light.static.gathered = g
            if progress.picture and solver.frame_light.source is Source.RADIOSITY:
                break
        assert solver.frame.photons < first_frame.DRAGGED and solver.frame_light.source is Source.RADIOSITY


def test_a_moved_light_leaves_unreached_receivers_dark():
    """Smoothing lit those in the ceiling a little, so that they were not filled: a lamp's side turned black."""
    plain = room()
    hung = merge(plain.static, box((0.2, 0.2, 0.8), (0.8, 0.8, 1.05), 3, 3))  # its upper corners in the ceiling
    before = gathered(solved(replace(plain, static=hung), photons=65_536))
    unreached = before.frame_light.unreached.static.rows
    moved = after(before, Light("bulb", (("position", (0.1, 0.5, 0.85)),)))
    assert len(unreached) > 8 and (moved.static_irradiance[unreached] == 0).all()
    assert (moved.drawn(moved.irradiance).irradiance[unreached] > 0).any(axis=1).all()
    assert np.array_equal(moved.irradiance, moved.from_scratch())


def test_without_gathered_light_there_is_none_before_an_edit():
    assert light_before(solved(room())) is None and light_before(solved(room(), light="photons")) is None


def test_another_radius_is_not_compared(before):
    results = before.keep_results().of("photons")
    solver = Solver(before.scene, **GIVEN | {"radius": 0.2}, results=results)
    solver.frame_light.static.begin_with(light_before(before))
    solver.solve()
    assert not solver.frame_light.is_gathered and np.array_equal(solver.irradiance, solver.from_scratch())


def gathered_rounds(solver: Solver, rounds: int) -> StaticGather:
    """Gather whole paths until there are so many rounds."""
    for _ in solver.gather_steps():
        g = solver.frame_light.static.gathered
        if g.state is not None and g.state.rounds >= rounds:
            return g
    raise AssertionError("enough before")


@pytest.mark.parametrize(
    "edit", [Finish("ball", RED), Remove("ball"), Finish("wall", RED)], ids=["colour", "removed", "wall"]
)
def test_gathering_goes_on_where_the_static_part_stays(edit):
    """With the bits of a run without a break; the light on show stays, and so does the fraction that is done."""
    solver, other = solved(room()), solved(edited(room(), [edit]))
    g = gathered_rounds(solver, 3)
    results = solver.keep_results()
    shown = g.estimate
    gathered_rounds(solver, 4)  # the solver before goes on meanwhile
    new = solve(edited(solver.scene, [edit]), **GIVEN, results=results)
    goes_on = new.frame_light.static.gathered
    if edit == Finish("wall", RED):
        assert goes_on is None and new.frame_light.static.shows_earlier
        return
    assert goes_on.state.rounds == 3 and goes_on.fraction > 0.05
    assert np.array_equal(goes_on.estimate.light, shown.light)
    assert new.frame_light.is_gathered and np.array_equal(new.irradiance, new.from_scratch())
    mine, alone = gathered_rounds(new, 5), gathered_rounds(other, 5)
    for a, b in zip(mine.state, alone.state, strict=True):
        np.testing.assert_array_equal(a, b)
    assert g is solver.frame_light.static.gathered and goes_on is mine and mine is not g


def test_photons_that_are_better_stay_on_show_while_gathering_goes_on():
    """Gathered light of more error than all photons had took the place of theirs."""
    solver = solved(room(), photons=400_000)
    for _ in solver.gather_steps():
        if math.isfinite(solver.frame_light.static.gathered.noise):
            break
    g = solver.frame_light.static.gathered
    g.estimate = g.estimate._replace(error=0.5)
    assert not solver.frame_light.static.compare(solver.frame.background)
    shown, results = solver.static_irradiance.copy(), solver.keep_results()
    new = Solver(edited(solver.scene, [Finish("ball", RED)]), **GIVEN | {"photons": 400_000}, results=results)
    for progress in new.solve_steps():
        if progress.picture:
            break
    static = new.frame_light.static
    assert not new.frame_light.is_gathered and new.frame.photons == 400_000
    assert np.array_equal(new.static_irradiance, shown)
    assert static.gathered._radiosity.paths == g._radiosity.paths > 0, "its paths are kept"


def test_an_edit_taken_back_brings_its_gathered_light_back():
    """Whole paths of the scene before are in the store, though another static part has been on show since."""
    solver = solved(room())
    g = gathered_rounds(solver, 3)
    wall = solve(edited(solver.scene, [Finish("wall", RED)]), **GIVEN, results=solver.keep_results())
    assert wall.frame_light.static.gathered is None and wall.frame_light.static.shows_earlier
    back = solve(solver.scene, **GIVEN, results=wall.keep_results())
    again = back.frame_light.static.gathered
    assert again is not g and again.state.rounds == 3 and np.array_equal(again.estimate.light, g.estimate.light)
    assert back.frame_light.static.best is again.estimate and not back.frame_light.static.shows_earlier
    assert np.array_equal(back.irradiance, solver.irradiance) and np.array_equal(back.irradiance, back.from_scratch())
