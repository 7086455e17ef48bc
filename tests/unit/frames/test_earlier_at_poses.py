"""Light gathered at resting poses before an edit that keeps the static part."""

import copy

import numpy as np
import pytest

from gi_core.files.edits import Duplicate, Edit, Finish, Remove, edited
from gi_core.frames.edited_light import LightAtPoses
from gi_core.gather import pose_gather, static
from gi_core.geometry.error import relative_error
from gi_core.scene.types import Pose
from gi_core.solver import Solver
from tests.physics.test_edits import room
from tests.support.scene_builders import solve

GIVEN = {"photons": 8192, "radius": 0.12, "seed": 5, "light": "best"}
SLIGHTLY = Finish("ball", (("reflectance", (0.28, 0.7, 0.58)),))
DARK = Finish("box", (("reflectance", (0.02, 0.02, 0.02)),))


@pytest.fixture(scope="module")
def before() -> Solver:
    """A solver whose poses have light by paths."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(static, "ENOUGH", 0.03)
        patch.setattr(pose_gather, "AS_GOOD", 0.1)
        solver = solve(room(), **GIVEN)
        list(solver.gather_pose_steps())
    assert replaced(solver) > 0.5
    return solver


def replaced(solver: Solver) -> float:
    """Return the share of receivers that do not show the light of their frame's photons."""
    return float((solver.frame.own != solver.irradiance).any(axis=1).mean())


def kept(solver: Solver) -> LightAtPoses:
    return solver.keep_results().get("light at poses", f"{solver.model.static_key} {solver.seed}")


def after(before: Solver, *edits: Edit) -> Solver:
    solver = solve(edited(before.scene, edits), **GIVEN, results=before.keep_results())
    assert np.array_equal(solver.irradiance, solver.from_scratch())
    return solver


def test_it_stays_on_show_with_its_errors(before):
    solver = after(before, SLIGHTLY)
    areas = before.model.object_receivers.areas
    own = relative_error(before.frame.own, before.irradiance, areas).l1
    assert relative_error(solver.irradiance, before.irradiance, areas).l1 < 0.1 * own
    at = solver.model.transforms(solver.poses)
    deviation = solver.frame_light.deviation(at, solver.frame.background)
    rows = solver.frame_light.at_poses._edited.rows
    assert np.array_equal(deviation[rows], before.frame_light.deviation(at, before.frame.background)[rows])
    assert deviation[rows].mean() > 0


def test_it_changes_as_photons_say(before, monkeypatch):
    solver, many = after(before, DARK), Solver(edited(before.scene, [DARK]), **GIVEN)
    many.solve()
    monkeypatch.setattr(static, "ENOUGH", 0.02)
    monkeypatch.setattr(pose_gather, "AS_GOOD", 0.1)
    list(many.gather_pose_steps())
    rows = many.frame_light.gathered_at(many.model.transforms(many.poses)).rows
    truth, areas = many.irradiance[rows], before.model.object_receivers.areas[rows]
    pictures = solver.irradiance, before.irradiance, solver.frame.own
    left, unchanged, own = (relative_error(E[rows], truth, areas).l1 for E in pictures)
    assert left < 0.4 * own and left < 0.85 * unchanged, (left, unchanged, own)


def test_edits_in_a_row_change_the_light_before_the_first(before):
    """Black and back again: factors of the light in between would leave none."""
    black = after(before, Finish("ball", (("reflectance", (0.0, 0.0, 0.0)),)))
    back = after(black, Finish("ball", (("reflectance", before.scene.materials[2].reflectance),)))
    assert np.allclose(back.irradiance, before.irradiance, rtol=1e-9, atol=1e-12)


def test_other_poses_and_levels_show_their_own_light(before):
    solver = after(before, SLIGHTLY)
    pose, E = solver.poses["ball"], solver.irradiance
    assert replaced(solver) > 0.5
    solver.move("ball", Pose((0.3, 0.3, 0.4)))
    assert replaced(solver) == 0 and np.array_equal(solver.irradiance, solver.from_scratch())
    solver.set_lamps({"bulb": 0.5})
    solver.move("ball", pose)
    assert replaced(solver) == 0
    solver.set_lamps({"bulb": 1.0})
    assert np.array_equal(solver.irradiance, E) and np.array_equal(E, solver.from_scratch())


@pytest.mark.parametrize("clearly", [0.1, 100.0])
def test_paths_at_the_poses_take_over(clearly, before, monkeypatch):
    """In the end, though the light on show is as good."""
    monkeypatch.setattr(static, "ENOUGH", 0.03)
    monkeypatch.setattr(pose_gather, "CLEARLY", clearly)
    solver = after(before, DARK)
    list(solver.gather_pose_steps())
    at = solver.model.transforms(solver.poses)
    found = solver.frame_light.gathered_at(at)
    assert found.used.all() == (clearly < 1) and np.array_equal(solver.irradiance[found.rows], found.mean)
    assert np.array_equal(solver.frame_light.deviation(at, solver.frame.background)[found.rows], found.deviation)
    assert np.array_equal(solver.irradiance, solver.from_scratch())
    assert kept(solver).irradiance is solver.irradiance, "the next edit begins with theirs"


@pytest.mark.parametrize("edit", [Duplicate("ball 2", "ball", Pose((0.8, 0.3, 0.3))), Remove("ball"), Remove("box")])
def test_mobiles_that_stay_keep_theirs(edit, before):
    solver = after(before, edit)
    for name in {"box", "ball"} & set(solver.model.names):
        rows, rows_before = (s.surfaces.receiver_range(1 + s.model.names.index(name)) for s in (solver, before))
        earlier = solver.frame_light.at_poses._edited
        assert kept(solver) is earlier.before, "the light before the first edit"
        there = np.isin(earlier.rows, np.arange(rows.start, rows.stop))
        assert there.any()
        assert np.array_equal(earlier.rows_before[there] - rows_before.start, earlier.rows[there] - rows.start)
    new = solver.surfaces.receiver_range(len(solver.model.names)) if isinstance(edit, Duplicate) else slice(0)
    assert np.array_equal(solver.irradiance[new], solver.frame.own[new])
    if isinstance(edit, Duplicate):
        solver.move("ball 2", Pose((0.5, 0.2, 0.5)))
        assert replaced(solver) > 0.3 and np.array_equal(solver.irradiance, solver.from_scratch())


def test_edits_of_the_static_part_begin_with_photons(before):
    solver = after(before, Finish("wall", (("reflectance", (0.5, 0.5, 0.5)),)))
    assert replaced(solver) == 0


def test_static_light_that_improves_is_no_change(before):
    """Light at the poses has it already."""
    solver = after(before, SLIGHTLY)
    earlier, shown = solver.frame_light.at_poses._edited, solver.frame.own
    improved = copy.deepcopy(shown)
    n = solver.surfaces.receiver_range(0).stop
    improved[:n] += 0.25 * solver.static_irradiance
    a = earlier.irradiance(shown, solver.static_irradiance)
    b = earlier.irradiance(improved, 1.25 * solver.static_irradiance)
    static = earlier.rows < n
    np.testing.assert_allclose(a[static], b[static], rtol=1e-9, atol=1e-12)
