"""Work at rest on a machine with nothing stored: it ends, it is stored, and a failed job ends nothing else."""

import weakref
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from app.rest import jobs, live_error
from app.rest.jobs import ChangeJob, FineJob, Job, PoseJob, StaticJob, SurfacesJob, first_task
from app.rest.reference_store import SAVE_SECONDS, StaticStore
from app.rest.scheduler import RestWork
from app.session.log import ERROR, Log
from app.session.opening import Opened
from app.session.session import Session
from app.session.solver_jobs import Refine
from app.settings import CHANGE, Settings, State
from app.window import view_content
from gi_core.frames.first_frame import EARLY_PATHS
from gi_core.gather import static
from gi_core.gather.static import ALL_PATHS
from gi_core.scene import CalculationSurface, PointLight
from gi_core.solver import Solver
from tests.support import viewer_support as support
from tests.support.lit_from_outside import l_room
from tests.support.scene_builders import box_mobile, coloured_room, solve

SCENE = coloured_room((box_mobile(size=0.2),))
UNLIT = replace(SCENE, materials=tuple(m._replace(emission=(0.0,) * 3) for m in SCENE.materials), lights=())
TASK = 0.4 * SAVE_SECONDS  # s of the test's clock that each task takes: every third is past a save


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("GI_VIEWER_REFERENCE_DIR", str(tmp_path / "empty"))
    monkeypatch.setattr(static, "ENOUGH", 0.1)
    monkeypatch.setattr(live_error, "NOISE_OF_ERROR", 0.5)
    monkeypatch.setattr(live_error, "PICTURE_NOISE", 0.05)
    return tmp_path / "empty"


def opened(scene=SCENE) -> Session:
    """Return a session with a solver that works at once, but advances a simulated clock by TASK seconds."""
    settings = Settings(photons=3000, radius=0.06, neighbours=20, exposure=0.0, light="best")
    solver = Solver(scene, photons=3000, radius=0.06, light="best")
    clock = support.Clock()
    session = Session(settings, Log(), lambda settings: None, clock, support.Behind(clock, TASK))
    session.adopt(Opened(settings, solver, None, ()))
    return session


def rest(session: Session, tasks: int = 3000) -> None:
    """Let a session finish all work at rest."""
    for _ in range(tasks):
        session.tick(1 / 60, budget=2 * TASK)
        if session.light.is_idle and not session.refining:
            return
    raise AssertionError("no end of work at rest")


def errors(session: Session) -> list[str]:
    return [entry.text for entry in session.log.entries if entry.level == ERROR]


@pytest.mark.slow
def test_all_work_at_rest_is_done_and_stored_in_a_new_folder(folder, capfd):
    session = opened()
    assert not folder.exists()
    rest(session)
    assert session.light.snapshot.rest.gathered.fraction == 1.0 and session.light.snapshot.rest.report.done
    session.want(replace(session.settings, show="error"))
    rest(session)
    shown = view_content.shown(session)
    assert shown.errors is not None and not shown.coming
    assert errors(session) == [] and capfd.readouterr().err == ""
    store = StaticStore(session.light._solver.model, session.light._solver.seed)
    assert np.array_equal(store.load().state.mean, session.light._solver.frame_light.static.gathered.state.mean)
    assert len(list(folder.iterdir())) == 2, "the static light and the reference"
    assert np.array_equal(session.irradiance, session.light._solver.from_scratch())


def test_work_at_rest_ends_without_light():
    session = opened(UNLIT)
    rest(session)
    assert errors(session) == [] and not session.irradiance.any()
    assert session.light.snapshot.rest.report.done and not session.points.all


@pytest.mark.parametrize("fails", [False, True])
def test_fine_points_come_before_all_photons(fails, monkeypatch):
    """Once all radiosity is known: photons take longer. If they fail, photons go on."""
    calls = []

    def fail(*_):
        calls.append(1)
        raise RuntimeError("out of luck")

    monkeypatch.setattr(static, "ENOUGH", 0.007)
    if fails:
        monkeypatch.setattr("app.rest.jobs.FineJob.step", fail)
    session = opened(l_room())
    session.light.configure({"photons": 1 << 17}, 1.0)
    while session.light.snapshot.rest.fine is None and session.refining:
        session.tick(1 / 60, budget=2 * TASK)
    assert session.refining != fails and len(calls) == fails
    assert errors(session) == ["refining the picture has failed and stops until F5: out of luck"] * fails


def test_a_surface_is_measured_and_light_kept_before_all_photons(monkeypatch):
    """Numbers took two minutes in the window for 6 s on the command line, and light A five after a drag."""
    monkeypatch.setattr(static, "ENOUGH", 0.007)
    surface = CalculationSurface("desk", "", (1.0, 1.0), (2.0, 2.0), 0.8, points=(2, 2))
    session = opened(replace(l_room(), surfaces=(surface,)))
    session.light.configure({"photons": 1 << 18}, 1.0)
    while session.refining and (session.light_to_keep is None or not session.light_to_keep.surfaces):
        session.tick(1 / 60, budget=2 * TASK)
    assert session.refining and [s.fraction for s in session.light_to_keep.surfaces] == [1]


def test_surfaces_wait_until_light_is_no_longer_early():
    """In classroom they took half the time, so the first clean picture came after 30 in place of 13 s."""
    surface = CalculationSurface("desk", "", (1.0, 1.0), (2.0, 2.0), 0.8, points=(8, 8))
    solver = Solver(replace(l_room(), surfaces=(surface,)), photons=1 << 17, light="best")
    work = RestWork(solver, support.Clock())
    job, seen = Refine(solver.solve_steps(), Settings(light="best", surfaces=(surface,))), []
    while "measuring surfaces" not in seen or work.fine.name not in seen:
        step = job.run(solver, work)
        assert step.progress is not None and (
            not step.urgent.name or not solver.frame_light.static.is_early(EARLY_PATHS)
        )
        seen.append(step.urgent.name)
    assert seen[:5] == [""] * 5
    work.end()


def test_levels_are_found_before_all_photons_are_there(monkeypatch):
    """They wait for paths at their points alone; the search says how far it is."""
    monkeypatch.setattr(jobs, "measured_steps", partial(jobs.measured_steps, noise=0.2))
    lamp = PointLight("bulb", (0.5, 0.5, 0.8), (10.0,) * 3)
    surface = CalculationSurface("desk", "", (0.5, 0.5), (0.6, 0.6), 0.5, points=(2, 2), targets=(("mean", 1.0),))
    solver = Solver(replace(UNLIT, lights=(lamp,)), photons=1_000_000, radius=0.06, light="best")
    steps, work = solver.solve_steps(), RestWork(solver, support.Clock())
    shares = []
    job = Refine(steps, Settings(light="best", hold=True, surfaces=(surface,)))
    while work.results().held is None:
        step = job.run(solver, work)
        assert step.progress is not None and not step.urgent.problem, "photons are done, levels are not"
        shares.append(work.results().finding)
    assert shares == sorted(shares) and len(shares) > 2 and shares[-1] == 1.0


def test_light_at_poses_begins_with_a_frame_of_the_best_static_light():
    """Begun between, all receivers counted as changed by mobiles: a sunlit house had black specks at first."""
    solver, steps = solve(SCENE, photons=3000, radius=0.06, light="best"), 0
    gathering, job = solver.gather_steps(), PoseJob(solver)
    while not solver.frame.gathered:
        next(gathering)
        due = first_task((job,), Settings(photons=3000, light="best")) is not None
        steps += (between := solver.frame_light.is_gathered and not solver.frame.gathered)
        assert due != between
    assert steps, "or this tests nothing"


JOBS = {
    "gathering the static light": "app.rest.jobs.StaticJob.step",
    "gathering the light at these poses": "app.rest.jobs.PoseJob.step",
    "timing frames": "app.rest.live_error.LiveError.step",
    "gathering the reference": "app.rest.live_error.ReferenceJob.step",
}


@pytest.mark.slow
@pytest.mark.parametrize("job", ["gathering the static light", "timing frames"])
def test_failed_job_ends_nothing_else(job, monkeypatch, capfd):
    calls = []

    def fail(*_):
        calls.append(1)
        raise RuntimeError("out of luck")

    monkeypatch.setattr(JOBS[job], fail)
    session = opened()
    rest(session)
    at_poses = session.light.snapshot.rest.at_poses
    line = f"{job} has failed and stops until F5: out of luck"
    assert len(calls) == 1 and errors(session) == [line]
    error_output = capfd.readouterr().err
    assert error_output.startswith("Traceback") and error_output.endswith("RuntimeError: out of luck\n")
    work, results = session.light._work, session.light.snapshot.rest
    measured, report = work.live_error._measured, results.report
    done = {
        "gathering the static light": session.light.snapshot.rest.gathered.fraction == 1.0,
        "gathering the light at these poses": at_poses is not None and at_poses.fraction == 1.0,
        "timing frames": len(measured.seconds) > 0 and measured.twin is None,
        "gathering the reference": report is not None and report.done,
    }
    assert done == {name: name != job for name in JOBS}
    pose = session.poses["box"]
    session.move({"box": pose._replace(position=(0.6, 0.5, 0.4))})
    rest(session)
    assert len(calls) == 1, "nor after a move"


@pytest.mark.slow
def test_a_surface_is_measured_beside_all_other_work_and_again_at_other_poses():
    """Its light stays, marked as out of date, until that of the new poses is there; without a surface there is none."""

    solver = solve(SCENE, photons=3000, radius=0.06, light="best")
    surface = CalculationSurface("a", "", (0.5, 0.5), (0.6, 0.6), 0.5, points=(2, 2))
    settings = Settings(photons=3000, light="best", surfaces=(surface,))
    work, names = RestWork(solver, support.Clock()), []

    def until(done) -> None:
        for _ in range(4000):
            task = work.next_task(settings)
            if task is None or done():
                return
            names.append(task.name)
            work.run(task)
        raise AssertionError("the surface is not measured")

    until(lambda: work.results().surfaces)
    assert work._taken[SurfacesJob.name] > 0.3 * max(work._taken[name] for name in {*names} - {FineJob.name})
    until(lambda: work.results().surfaces[0].fraction == 1)
    first = work.results().surfaces[0]
    assert first.is_current and np.isfinite(first.values).all()
    name = solver.model.names[0]
    solver.move(name, solver.poses[name]._replace(position=(0.5, 0.5, 0.7)))
    work.next_task(settings)
    assert work.results().surfaces[0].values is first.values and not work.results().surfaces[0].is_current
    until(lambda: work.results().surfaces[0].is_current and work.results().surfaces[0].fraction == 1)
    assert not np.array_equal(work.results().surfaces[0].values, first.values)
    work.next_task(replace(settings, surfaces=()))
    assert work.results().surfaces == ()


def test_a_step_that_raises_lets_the_job_begin_again():
    """A surface whose step was broken off by a move had ended for its poses."""
    job, settings, begun = Job(None), Settings(photons=1000), []
    job.key = lambda settings: settings.photons
    job.begin = lambda: (begun.append(job._key), (1 // (1 - step) for step in range(3)))[1]
    assert first_task((job,), settings).run() is False
    with pytest.raises(ZeroDivisionError):
        first_task((job,), settings).run()
    assert first_task((job,), settings).run() is False and begun == [1000, 1000]
    assert first_task((job,), replace(settings, photons=2000)).run() is False and begun == [1000, 1000, 2000]


def test_a_change_since_a_is_that_of_the_state_on_show():
    """It had the errors of the state before, "+-0 lx" after a lamp was dimmed, until the next task was chosen."""
    solver = solve(SCENE, photons=3000, radius=0.06, light="best")
    of_A = State(weakref.ref(solver.model), tuple(solver.poses.items()), tuple(map(tuple, solver.levels.tolist())))
    job, settings = ChangeJob(solver), Settings(show=CHANGE, since=of_A)
    job.want(settings)
    job.step()
    assert job.result is not None
    solver.set_lamps({solver.lamps.names[0]: 0.5})
    assert job.result is None
    job.want(settings)
    job.step()
    assert job.result is not None and job.result.now is solver.irradiance


def test_light_at_new_poses_comes_before_other_work():
    """Static light and errors had two thirds of the time after each drag."""
    solver = solve(SCENE, photons=3000, radius=0.06, light="best")
    work, settings = RestWork(solver, support.Clock()), Settings(photons=3000, light="best", measure_errors=False)
    work.run(work.next_task(settings))
    while solver.frame_light.static.is_early(ALL_PATHS):
        work.run(work.next_task(settings))
    work._taken.update({StaticJob.name: 20.0, PoseJob.name: 20.0})
    name = solver.model.names[0]
    solver.move(name, solver.poses[name]._replace(position=(0.5, 0.5, 0.7)))
    names = []
    while len(names) < 4:
        task = work.next_task(settings)
        names += [task.name] * (task.name != FineJob.name)  # first of all
        work.run(task)
    assert {*names} == {PoseJob.name}
    work.end()


def test_light_at_poses_waits_for_all_radiosity():
    """Beside it static light took twice as long to lose its clouds in `render cornell --seconds 4`."""
    solver = solve(SCENE, photons=3000, radius=0.06, light="best")
    work, settings = RestWork(solver, support.Clock()), Settings(photons=3000, light="best", measure_errors=False)
    early = []
    while not early or early[-1]:
        task = work.next_task(settings)
        if task.name == PoseJob.name:
            break
        early.append(solver.frame_light.static.is_early(ALL_PATHS))
        work.run(task)
    assert early[0] and not solver.frame_light.static.is_early(ALL_PATHS)
    work.end()
