"""The time budget: one photon subset per motion, all photons at rest. Counted on a test clock."""

from dataclasses import replace

import numpy as np
import pytest

from app.rest.results import Change
from app.rest.scheduler import TaskEnd
from app.session.log import ERROR
from app.session.session import STILL, Session
from app.session.solver_jobs import Step
from app.session.solver_thread import _timings
from gi_core.frames.light_setting import IN_A_ROW, PATHS, TIMED, FrameBudget, FrameSize
from gi_core.model import Model
from gi_core.scene import Pose
from tests.support import viewer_support as support
from tests.unit.gather.test_mobile import gathering

FRAME = 1 / 60
BUDGET_MS = 12.5


@pytest.fixture(autouse=True)
def fewest_photons_is_100(monkeypatch):
    monkeypatch.setattr("gi_core.frames.light_setting.LEAST_PHOTONS", 100)


def make(budget=BUDGET_MS, photon_seconds=16e-6, wrong=1.0, step_seconds=0.001):
    """Return a session with 1000 photons at rest: with 500 a move takes 12 ms, with all 20."""
    clock = support.Clock()
    solver = support.CountingSolver(support.room(1), clock, 10, photon_seconds, wrong)
    s = support.counting_session(solver, step_seconds, budget)
    while s.refining:
        frame(s)
    assert s.light.snapshot.photons == s.light.snapshot.photons_at_rest == 1000
    return s


def frame(s: Session) -> None:
    started = s.clock.now
    s.tick(FRAME)
    s.clock.now += max(FRAME - (s.clock.now - started), 0)


def drag(s: Session, frames: int, first: int = 0) -> list[int]:
    """Move the block in every frame; return how many photons each picture was made of."""
    shown = []
    for k in range(first, first + frames):
        s.move({"block": Pose((0.3 + 0.001 * k, 0.3, 0.5))})
        shown.append(s.light.snapshot.photons)
        frame(s)
    return shown


def test_a_change_found_beside_photons_is_a_new_picture():
    """Else its map stays that of an earlier light."""
    s = make()
    light, version = s.light, s.version
    rest = light.snapshot.rest._replace(change=Change(np.ones((1, 3)), np.ones((1, 3)), np.ones(1)))
    for _ in range(2):  # the second is nothing new
        light._take(Step(None, None, {}, TaskEnd("", False), rest))
        assert s.version == version + 1 and light.snapshot.rest is rest


def test_drag_uses_one_subset_and_release_all_photons():
    s = make()
    s.begin_drag()
    assert drag(s, 40) == [500] * 40
    assert s.light.snapshot.photons_at_rest == 1000
    there, version, settled = s.poses["block"], s.version, len(s.light._solver.moved_with)
    s.end_drag()
    frame(s)
    frame(s)
    assert s.light.snapshot.photons == 1000 and s.version > version and s.pose_list == [there]
    assert s.light._solver.moved_with[-1] == 1000 and s.irradiance is s.light._solver.irradiance
    for _ in range(10):
        frame(s)
    assert s.light._solver.moved_with[settled:] == [1000], "once is enough"


def test_held_mobile_shows_all_photons_then_the_same_subset():
    s = make()
    s.begin_drag()
    drag(s, 5)
    for _ in range(int(STILL / FRAME) - 1):
        frame(s)
        assert s.light.snapshot.photons == 500, "not at the first hesitation"
    for _ in range(5):
        frame(s)
    assert s.light.snapshot.photons == 1000 and s.motion.dragging and not s.light.partial
    assert drag(s, 5, first=5) == [500] * 5


def test_playing_uses_one_subset():
    s = make()
    s.toggle_play()
    for _ in range(20):
        frame(s)
        assert s.light.snapshot.photons == 500
    s.toggle_play()
    frame(s)
    frame(s)
    assert s.light.snapshot.photons == 1000


def test_budget_off_uses_all_photons():
    s = make(budget=0.0)
    s.begin_drag()
    assert drag(s, 10) == [1000] * 10


def test_frames_over_budget_reduce_the_subset_for_good():
    """All are predicted to fit, but need 20 of 8 ms. After a few late frames the subset shrinks until it fits."""
    s = make(budget=8.0, wrong=0.3)
    s.begin_drag()
    shown = drag(s, 40)
    assert shown[0] == 1000 and shown[-1] == 250, "250 take 8 ms"
    assert shown == sorted(shown, reverse=True)
    assert shown.index(500) == IN_A_ROW and shown[IN_A_ROW:].count(500) < 40
    s.end_drag()
    for _ in range(3):
        frame(s)
    s.begin_drag()
    assert drag(s, 1) == [1000], "chosen again"


def test_single_late_frame_changes_nothing():
    s = make()
    s.begin_drag()
    shown = []
    for k in range(30):
        s.light._solver.photon_seconds = 60e-6 if k % IN_A_ROW == 1 else 16e-6
        shown += drag(s, 1, first=k)
    assert set(shown) == {500}


def test_budget_change_applies_from_the_next_frame():
    s = make()
    s.toggle_play()
    frame(s)
    assert s.light.snapshot.photons == 500
    s.want(replace(s.settings, budget=9.0))
    frame(s)
    assert s.light.snapshot.photons == 250
    assert s.light._solver.count("configure") == 0, "nothing of it is the solver's business"


@pytest.mark.parametrize("action", ["undo", "Esc", "reset"])
def test_a_single_move_is_shown_at_once_then_in_the_light_of_all_photons(action):
    """1000 photons take 304 ms, 125 take 41: the picture has no need to lag behind its mobile."""
    s = make(budget=50.0, photon_seconds=300e-6)
    s.begin_drag()
    drag(s, 3)
    if action != "Esc":
        s.end_drag()
        for _ in range(60):
            frame(s)
        assert s.light.snapshot.photons == 1000
    started, act = s.clock.now, {"undo": s.undo, "reset": s.reset_poses, "Esc": lambda: s.end_drag(keep=False)}
    act[action]()
    assert s.pose_list == [s.poses["block"]] and s.light.snapshot.photons == 125
    assert s.clock.now - started <= 0.05
    for _ in range(60):
        frame(s)
    assert s.light.snapshot.photons == 1000 and not s.refining


def test_a_picture_of_few_photons_settles_before_refinement_goes_on():
    """A step of refinement would bring all photons too, with all its other work. The last move ends after the drag."""
    s = make(step_seconds=0.045)
    s.begin_drag()
    for x in (0.4, 0.41):
        frame(s)
        s.move({"block": Pose((x, 0.3, 0.5))})
    assert s.light.is_moving
    log = s.light._solver.log
    before = len(log)
    s.end_drag()
    for _ in range(30):
        frame(s)
    assert [what for what, _ in log[before:]][:3] == ["move", "move", "step"]
    assert s.light._solver.moved_with[-2:] == [500, 1000] and s.light.snapshot.photons == 1000


def test_refinement_at_rest_continues_from_the_subset():
    """When the drag begins, only the photons of the first picture are traced; the rest follows afterwards."""
    clock = support.Clock()
    solver = support.CountingSolver(support.room(1), clock, 40, 16e-6)
    s = support.counting_session(solver, 0.004, 9.0)
    while s.light.snapshot.photons_at_rest < 250:
        frame(s)
    s.begin_drag()
    steps = solver.count("step")
    shown = drag(s, 10)
    assert set(shown[1:]) == {s.light.snapshot.photons_at_rest} == {250} and solver.count("step") <= steps + 1
    s.end_drag()
    while s.refining:
        frame(s)
    assert s.light.snapshot.photons == 1000


def test_subsets_are_timed_once_at_rest_and_not_shown():
    """Smallest first, three times each, up to one that takes longer than the budget; then all photons as before."""
    s = make()
    timed = [photons for what, photons in s.light._solver.log if what == "timed"]
    assert timed == [*[125] * 3, *[250] * 3, *[500] * 3]
    version, light = s.version, s.irradiance
    for _ in range(20):
        frame(s)
    assert s.light._solver.count("timed") == 9 and s.version == version and s.irradiance is light
    s.want(replace(s.settings, radius=0.01))
    while s.refining:
        frame(s)
    assert s.light._solver.count("timed") == 18, "another setting, other times"
    s = make(budget=7.0)
    assert [photons for what, photons in s.light._solver.log if what == "timed"] == [*[125] * 3, *[250] * 3], (
        "250 take 8 ms"
    )
    assert make(budget=0.0).light._solver.count("timed") == 0


def test_the_first_frame_of_a_twin_is_not_counted():
    """It takes five times as long, and would end the timing of all others."""
    solver = make().light._solver
    assert solver.budget.within(1.0, (125, 250, 500), False) == (500, None)
    assert solver.budget._photon_times.of(125)[-1] == pytest.approx(solver.move_seconds(125))
    assert max(solver.budget._photon_times.of(125)) == pytest.approx(solver.move_seconds(125))


def test_timed_frames_move_mobiles_and_gather_by_all_numbers_of_paths():
    """Without a move no rays are traced, and their times stay unknown; the frame on show stays."""
    solver = gathering()
    solver.budget, light, poses = FrameBudget(), solver.irradiance, solver.poses
    timed = PATHS[::2]
    assert sum(1 for _ in _timings(solver, 60.0)) == TIMED * len(timed)
    assert solver.irradiance is light and solver.poses == poses
    assert [len(solver.budget._path_times.of(n)) for n in timed] == [TIMED - 1, *[TIMED] * (len(timed) - 1)]
    assert solver.size_within(60.0) == (300, PATHS[-1])


def test_drag_interrupts_the_timing_of_frames():
    s = make()
    s.want(replace(s.settings, radius=0.01))
    while s.light._solver.count("timed") < 12:
        frame(s)
    s.begin_drag()
    assert drag(s, 3) == [500] * 3
    assert s.light._solver.count("timed") <= 13
    s.end_drag()
    while s.refining:
        frame(s)
    assert s.light.snapshot.photons == 1000 and s.light._solver.frame.photons == 1000


def test_a_drag_breaks_off_the_frame_of_all_photons():
    """That frame takes 304 ms, one of 125 photons 41: the drag waits for the end of a stage."""
    s = make(budget=50.0, photon_seconds=300e-6, step_seconds=0.02)
    s.begin_drag()
    drag(s, 3)
    s.end_drag()
    while not s.light.is_moving:
        frame(s)
    there, started = Pose((0.5, 0.3, 0.5)), s.clock.now
    s.begin_drag()
    s.move({"block": there})
    while s.pose_list != [there]:
        frame(s)
    assert s.clock.now - started < 0.15 and s.light.snapshot.photons == 125
    s.end_drag()
    for _ in range(60):
        frame(s)
    assert s.light.snapshot.photons == 1000 and s.pose_list == [there]
    assert not [entry for entry in s.log.entries if entry.level == ERROR]


def test_esc_breaks_off_the_frame_of_its_drag():
    s = make(budget=50.0, photon_seconds=300e-6, step_seconds=0.05)
    start, log = s.poses["block"], s.light._solver.log
    s.begin_drag()
    drag(s, 3)
    assert s.light.is_moving
    before = len(log)
    s.end_drag(keep=False)
    while s.pose_list != [start]:
        frame(s)
    assert [poses for name, poses in log[before:] if name == "move"] == [{"block": start}]
    assert not [entry for entry in s.log.entries if entry.level == ERROR]


@pytest.mark.parametrize("action", ["drag", "undo", "Esc"])
def test_the_outline_stays_with_the_object_on_show(action):
    """The object, its light and its outline have the poses of the picture, not those that are waited for."""
    s = make(budget=50.0, photon_seconds=300e-6, step_seconds=0.1)
    s.model = Model(s.scene)
    s.begin_drag()
    drag(s, 3)
    if action == "undo":
        s.end_drag()
        for _ in range(200):
            frame(s)
    elif action == "drag":
        s.move({"block": Pose((0.5, 0.3, 0.5))})
    {"drag": lambda: None, "undo": s.undo, "Esc": lambda: s.end_drag(keep=False)}[action]()
    waited = 0
    while s.pose_list != [s.poses["block"]]:
        assert np.array_equal(s.models()[1][:3, 3], s.light.snapshot.poses["block"].position)
        waited += 1
        frame(s)
    assert waited and np.array_equal(s.models()[1][:3, 3], s.poses["block"].position)


def test_repeated_undo_shows_pictures():
    """Each frame begins a motion; if the next undo broke it off, a held key would show nothing."""
    s = make(budget=50.0, photon_seconds=300e-6, step_seconds=0.05)
    log, poses = s.light._solver.log, [{"block": Pose((0.3 + 0.1 * k, 0.3, 0.5))} for k in range(3)]
    before = len(log)
    for at in poses:
        s.move(at)
    while s.light.is_moving:
        frame(s)
    moved = [at for name, at in log[before:] if name == "move"]
    assert moved[0] == poses[0] and {"block": s.poses["block"]} == poses[-1]


def test_a_new_motion_keeps_the_last_pose_of_the_old_one():
    room = support.room(1)
    (block,) = room.mobiles
    solver = support.CountingSolver(
        replace(room, mobiles=(block, block._replace(name="other"))), support.Clock(), 10, 300e-6
    )
    s = support.counting_session(solver, 0.05, 50.0)
    while s.refining:
        frame(s)
    s.begin_drag()
    drag(s, 3)
    last = s.poses["block"]
    s.end_drag()
    assert s.light.is_moving and s.light.snapshot.poses["block"] != last
    s.begin_drag()
    s.move({"other": Pose((0.7, 0.3, 0.5))})
    assert s.poses["block"] == last
    while s.light.is_moving:
        frame(s)
    assert s.pose_list == [last, Pose((0.7, 0.3, 0.5))] == list(solver.poses.values())


def test_failed_settling_is_logged_once_and_the_drag_continues():
    s = make()
    s.begin_drag()
    drag(s, 3)
    move_all, asked = s.light._solver.move_all, []

    def broken(poses, photons=None, paths=None):
        asked.append(photons)
        raise ValueError("embree lost its scene")

    s.light._solver.move_all = broken
    s.end_drag()
    for _ in range(10):
        frame(s)
    assert asked == [None] and "embree lost its scene" in s.log.last.text and not s.light.partial
    s.light._solver.move_all = move_all
    s.begin_drag()
    assert drag(s, 2, first=3) == [500, 500]


def test_subset_never_falls_below_the_fewest_photons(monkeypatch):
    """A machine on which nothing fits: frames are late, but not below the fewest photons."""
    monkeypatch.setattr("gi_core.frames.light_setting.LEAST_PHOTONS", 1 << 14)
    for subsets, enough in (
        ((4_096, 65_536, 131_072, 1_000_000), 65_536),
        ((8_192, 16_384, 65_536, 131_072, 1_500_000), 16_384),
        ((4_096, 8_192, 16_384, 20_000), 16_384),
        ((4_096, 5_000), 5_000),
        ((1000,), 1000),
    ):
        budget = FrameBudget()
        for n in subsets:
            budget.record(FrameSize(n, 0), {"estimate": 1.0}, False)
        for _ in range(50):
            assert budget.choose(0.01, subsets, False) == (enough, None)
            budget.moved(1.0)


def test_without_photons_there_is_nothing_to_choose():
    assert FrameBudget().choose(0.01, (), False) == (None, None)


@pytest.mark.parametrize(
    "budget, chosen",
    [
        (0.016, (16_384, 32)),  # half of the budget would buy 16 paths
        (0.018, (65_536, 32)),  # photons before more paths ...
        (0.026, (65_536, 64)),  # ... and these in the time that is left
        (0.012, (16_384, 16)),  # beside the fewest photons: 24 would fit their share
        (0.004, (16_384, 4)),  # nothing fits
        (0.006, (16_384, 6)),  # photons take it all: paths have a part of the budget besides
        (1.0, (1_000_000, 256)),
    ],
)
def test_mobiles_have_paths_first(monkeypatch, budget, chosen):
    monkeypatch.setattr("gi_core.frames.light_setting.LEAST_PHOTONS", 1 << 14)
    subsets, paths = {16_384: 0.005, 65_536: 0.007, 1_000_000: 0.1}, {8: 0.0025, 16: 0.006, 32: 0.0105, 64: 0.0185}
    known = FrameBudget()
    for photons, seconds in subsets.items():
        known.record(FrameSize(photons, 0), {"estimate": seconds}, False)
    for count, seconds in paths.items():
        known.record(FrameSize(16_384, count), {"gather": seconds, "estimate": subsets[16_384]}, True)
    assert known.within(budget, tuple(subsets), True) == chosen


def test_unknown_costs_are_guessed_high(monkeypatch):
    monkeypatch.setattr("gi_core.frames.light_setting.LEAST_PHOTONS", 1 << 14)
    assert FrameBudget().within(0.016, (16_384, 65_536, 131_072), True) == (16_384, 4)
