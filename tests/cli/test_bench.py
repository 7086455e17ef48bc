"""`bench`: its numbers and its table."""

import json
from dataclasses import replace

import pytest

from app import __main__ as cli
from app.draw import motion
from app.measure import bench as command
from app.settings import STEP_PER_FRAME, Settings, make_solver, open_scene
from tests.support.cli_support import FAST, one_line
from tests.support.scene_builders import complete

KEYS = """format scene triangles receivers photons estimator control radius threads processor commit frames frame_ms
stages_ms share_cut segments_changed us_per_cut_photon from_scratch_ms from_scratch_ratio first_frame_ms
peak_rss_mb
bits_equal""".split()


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """Return a function that runs bench on cornell once for each choice of options; numbers and file."""
    folder, kept = tmp_path_factory.mktemp("bench"), {}

    def run(*options: str):
        if options not in kept:
            file = folder / f"{len(kept)}.json"
            assert cli.main(["bench", *FAST, "--frames", "24", "--json", str(file), *options]) == 0
            kept[options] = json.loads(file.read_text()), file
        return kept[options]

    return run


def test_json_has_every_number_and_light_equals_from_scratch(measured, estimator):
    n, _ = measured("--estimator", estimator)
    assert set(KEYS) <= set(n)
    assert n["bits_equal"] is True and n["frames"] == 24 and n["estimator"] == estimator and n["control"] is True
    f = n["frame_ms"]
    assert 0 < f["min"] <= f["median"] <= f["p95"] <= f["max"]
    assert 0 < f["cpu"] and (n["load"] is None or n["load"] >= 0)
    assert n["photons"] == 2000 and n["first_frame_ms"] > 0 and n["from_scratch_ms"] > 0 and n["stages_ms"]


def test_gathering_mobiles_are_timed(measured):
    n, _ = measured("--light", "best")
    assert n["bits_equal"] is True and "gather" in n["stages_ms"]


def test_step_option_sets_the_distance_per_frame(measured, monkeypatch):
    steps, walk = [], motion.walk
    monkeypatch.setattr(motion, "walk", lambda paths, step, frames: steps.append(step) or walk(paths, step, frames))
    n, _ = measured("--no-control", "--step", "0.2")
    size = make_solver(open_scene(Settings()), Settings(photons=10)).scene_size
    assert steps == [pytest.approx(0.002 * size)] and n["step_percent"] == pytest.approx(0.2)
    assert "one step of 0.2 % of the scene size" in "\n".join(command.table(n))


def test_the_table_has_frame_stages_and_control(measured):
    n, _ = measured("--no-control")
    text = "\n".join(command.table(n))
    assert n["control"] is False and "without artifact control" in text
    assert make_solver(open_scene(Settings()), Settings(photons=10, control=False)).setting.control is False
    assert "GI frame" in text and "same bits     yes" in text and "  estimate    " in text
    busy = "\n".join(command.table({**n, "load": 7.0}))
    assert "7.0 threads ran or waited" in busy and "CPU" in busy


def test_the_tree_bench_has_light_to_move():
    """Along the tree's path half a percent of the photons or more are cut in the median frame."""
    settings = Settings("tree", photons=10_000, estimator="impact_count")
    solver = complete(make_solver(open_scene(settings), settings))
    for frames in (50, 200):
        cut = []
        for poses in motion.walk(motion.paths_of(solver), STEP_PER_FRAME, frames):  # the tree is 1 m in size
            solver.move_all(poses)
            cut.append(solver.frame.changes.photons_cut)
        share = sorted(cut)[frames // 2] / solver.frame.photons
        assert share >= 0.005, f"{frames} frames: {100 * share:.3f} % of the photons cut in the median frame"


def test_bench_needs_a_mobile(capsys, monkeypatch):
    monkeypatch.setattr("app.settings.open_scene", lambda s: replace(open_scene(s), mobiles=()))
    assert cli.main(["bench", *FAST]) == 2
    assert "--mobile FILE" in one_line(capsys.readouterr().err)
