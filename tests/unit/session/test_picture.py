"""Parameters of pictures: different light has different parameters, and the same light the same."""

from __future__ import annotations

from dataclasses import replace

from app.draw.shot import home_camera
from app.rest.scheduler import RestWork
from app.session.picture import Picture
from app.session.snapshot import snapshot_of
from app.settings import REFERENCE, Settings
from gi_core.solver import Solver
from tests.support import viewer_support as support


def test_different_light_has_different_parameters():
    solver = Solver(support.room(4), photons=3000, radius=0.06)
    solver.solve()
    work, settings = RestWork(solver, lambda: 0.0), Settings(scene="room", exposure=1.0)
    picture = Picture(settings, home_camera(solver))

    def metadata() -> dict[str, str]:
        return picture.metadata(snapshot_of(solver, work))

    by_photons = metadata()
    assert by_photons == metadata()
    assert by_photons["static_light"] == by_photons["mobile_light"] == "photons" and by_photons["control"] == "True"
    assert by_photons["error"] == "not measured" and by_photons["commit"] and by_photons["comparison"] == "-"
    solver.configure(light="best")
    solver.solve()
    best = metadata()
    assert best["mobile_light"] == "gathered, 64 paths per receiver" and best["static_light"] == "photons"
    steps = solver.gather_steps()
    while not solver.frame_light.is_gathered:
        next(steps)
    early = metadata()
    assert early["static_light"].startswith("gathered, error ")
    while solver.frame_light.static.gathered.estimate.error >= early_error(early):
        next(steps)
    assert metadata()["static_light"] != early["static_light"]
    solver.configure(light="photons")
    solver.solve()
    assert metadata() == by_photons
    solver.configure(textbook=True, estimator="photon_map")
    solver.solve()
    assert {k for k, v in metadata().items() if v != by_photons[k]} == {"estimator", "textbook", "irradiance"}
    while (task := work.next_task(settings)) is not None:
        task.run()
    assert metadata()["error"].endswith(" %")


def early_error(entries: dict[str, str]) -> float:
    return 0.99 * float(entries["static_light"].split()[-2]) / 100


def test_the_wipe_and_the_reference_are_parameters():
    solver = Solver(support.room(1), photons=500, radius=0.06)
    solver.solve()
    work, settings = RestWork(solver, lambda: 0.0), Settings(compare=REFERENCE, reference=True, exposure=1.0)
    while work.live_error.picture is None:
        work.next_task(settings).run()
    plain = Picture(settings, home_camera(solver))
    wiped = plain._replace(split=0.3)
    entries = wiped.metadata(snapshot_of(solver, work))
    assert entries["light_shown"] == "reference" and entries["comparison"] == "reference right of 0.3 of the width"
    assert plain != wiped != wiped._replace(settings=replace(settings, tone_map="clip"))
