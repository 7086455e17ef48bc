"""A new estimator is one class and one entry of the registry: solver, command line, chart and window then offer it."""

import csv
from collections.abc import Iterable

import numpy as np
import pytest

from app import __main__ as cli
from app.measure.chart import measure as chart_measure
from app.settings import Settings, make_solver, open_scene
from gi_core.estimators import CHEAPEST, ESTIMATORS, Estimator
from gi_core.estimators.base import Setting
from gi_core.estimators.counting import Counts, Find, Place, hits_on_faces
from gi_core.model import Model
from gi_core.photons.flux_sums import NOT_ADDITIVE, CutFlux, Evaluated, SubsetStore
from gi_core.photons.paths import Segments, bounced
from gi_core.rays.accelerator import Transforms
from gi_core.retrace.cuts import PoseChange
from tests.support.scene_builders import complete
from tests.support.viewer_hand import in_window, keys

SCENE = ["cornell", "--max-edge", "0.2", "--estimator", "toy"]


class Toy(Estimator):
    """The flux of the hits on each receiver's faces, summed by numpy alone."""

    about = "Hits by face."
    additive = on_faces = True

    def __init__(self, model: Model, setting: Setting):
        super().__init__(model, setting)
        self.area = 3 * model.object_receivers.areas
        self._parts, self._bounced, self._bounced_subsets = [self._sums_of()], [self._sums_of()], SubsetStore()

    def copied(self, model: Model, setting: Setting):
        raise NotImplementedError  # no edits

    def add_background(self, segments: Segments, thread: int) -> None:
        self._parts.append(self._sums_of(segments))
        self._bounced.append(self._sums_of(bounced(segments)))

    def prepare(self, photons: int) -> None:
        self._parts, self._bounced = [sum(self._parts)], [sum(self._bounced)]
        static = self.model.surfaces.receiver_range(0)
        self.subsets[photons], self._bounced_subsets[photons] = self._parts[0][static], self._bounced[0][static]
        self.photons = photons

    def background(self, photons: int, direct: bool = True) -> tuple[np.ndarray, np.ndarray]:
        sums = self.subsets if direct else self._bounced_subsets
        return sums[photons], self.area[self.model.surfaces.receiver_range(0)]

    def evaluate(self, frame: PoseChange) -> Evaluated:
        sums = self._sums_of(frame.kept_prefixes, frame.new_suffixes) - self._sums_of(frame.removed_suffixes.segments())
        sums[self.model.surfaces.receiver_range(0)] += self.background(frame.photons, frame.direct)[0]
        return self._read(sums, frame.direct)

    def counted(self, place: Place, find: Find) -> Counts:
        return hits_on_faces(self.model, place, find)

    def from_scratch(self, parts: Iterable[Segments], at: Transforms, direct: bool = True) -> Evaluated:
        return self._read(self._sums_of(*(parts if direct else map(bounced, parts))), direct)

    def _read(self, sums: np.ndarray, direct: bool) -> Evaluated:
        lamps = self.model.emitters.lamps.count
        return Evaluated.of_all(sums, self.area, np.full((len(sums), 1), NOT_ADDITIVE), CutFlux.none(lamps), direct)

    def _sums_of(self, *parts: Segments) -> np.ndarray:
        s, lamps = self.model.surfaces, self.model.emitters.lamps.count
        sums = np.zeros((len(self.area), lamps, 3), np.int64)
        for segments in parts:
            hit = np.flatnonzero(segments.hit_side >= 0)
            face, back = segments.hit_side[hit] >> 1, segments.hit_side[hit] & 1 == 1
            corners = np.where(back[:, None], s.corner_back[face], s.corner_front[face])
            segment, corner = np.nonzero(corners >= 0)
            at = corners[segment, corner], segments.lamp[hit[segment]]
            np.add.at(sums, at, segments.flux[hit[segment]])
        return sums.reshape(len(sums), 3 * lamps)


@pytest.fixture(autouse=True)
def registered(monkeypatch) -> type[Estimator]:
    monkeypatch.setitem(ESTIMATORS, "toy", Toy)
    return Toy


def test_frame_equals_from_scratch_and_the_shipped_estimator():
    settings = Settings("cornell", max_edge=0.2, photons=5000, estimator="toy")
    solver = complete(make_solver(open_scene(settings), settings))
    (name, pose), *_ = solver.poses.items()
    solver.move(name, pose._replace(position=tuple(np.add(pose.position, (0.1, 0.0, 0.05)))))
    lit = solver.irradiance
    assert solver.frame.changes.photons_cut and lit.any() and np.array_equal(lit, solver.from_scratch())
    solver.configure(estimator=CHEAPEST)
    solver.solve()
    np.testing.assert_allclose(lit, solver.irradiance, rtol=1e-12)


def test_info_render_and_bench_accept_a_new_estimator(tmp_path, capsys):
    assert cli.main(["info", *SCENE]) == 0
    assert "toy: as given" in capsys.readouterr().out
    few = ["--photons", "2000"]
    assert cli.main(["render", *SCENE, *few, "--size", "48x32", "--out", str(tmp_path / "toy.png")]) == 0
    assert cli.main(["bench", *SCENE, *few, "--frames", "2"]) == 0
    said = capsys.readouterr().out
    assert "toy" in said and "same bits     yes" in said
    assert cli.main(["info", "cornell", "--estimator", "tay"]) == 2
    assert "toy" in capsys.readouterr().err


@pytest.mark.slow
def test_the_chart_draws_its_curve(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setenv("GI_VIEWER_REFERENCE_DIR", str(tmp_path / "reference"))
    less = chart_measure.QUICK._replace(photons=(4096,), limit_photons=32_768, truth=0.1)
    monkeypatch.setattr(chart_measure, "QUICK", less)
    out = tmp_path / "chart"
    assert cli.main(["chart", *SCENE, "--quick", "--frames", "2", "--points", "60", "--out", str(out)]) == 0
    with open(out / "results.csv", newline="") as file:
        assert "toy" in {row["curve"] for row in csv.DictReader(file)}
    assert "toy" in (out / "chart.svg").read_text()


@in_window()
def test_window_lists_a_new_estimator(hand, viewer):
    session, number = viewer.session, list(ESTIMATORS).index("toy")
    hand.ctx.set_ref("Panel")
    hand.ctx.combo_click("##Estimator/Toy")
    hand.wait_for_light()
    assert session.light._solver.setting.estimator == session.settings.estimator == "toy"
    hand.press(keys()._1)
    hand.wait_for_light()
    assert session.light._solver.setting.estimator == list(ESTIMATORS)[0]
    hand.press(getattr(keys(), f"_{number + 1}"))
    hand.wait_for_light()
    assert session.light._solver.setting.estimator == "toy" and session.irradiance.any()
