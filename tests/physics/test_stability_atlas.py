"""The failure atlas: measurements agree with predictions, and remedies work.

Over all rows together a correct program fails with probability 1e-3 (Sidak). Each test has power: a
prediction 25 % outside its uncertainty would be rejected, which is checked with the same numbers. The rows are
defined in app/measure/atlas/.
"""

import math

import numpy as np
import pytest

from app.measure import atlas
from app.measure.atlas import CHAPTERS, discs, estimates, gloss
from app.measure.atlas import row as atlas_row
from app.measure.atlas.row import (
    BLACK,
    AtlasRow,
    Number,
    View,
    ball,
    beyond,
    box,
    fan,
    near,
    over_seeds,
    scene,
    sheet,
    solved,
)
from gi_core.geometry.surfaces import face_normals
from tests.support.significance import p_values, sidak

TESTS = 115  # numbers tested, an upper bound
LEVEL = sidak(1e-3, TESTS)
SEEN = 1.25
HELPED = 0.02  # how near a remedy must come


def p_value(number: Number, expected: float, within: float = 0.0) -> float:
    off = float(np.clip(number.mean - expected, -within, within))
    return float(p_values(number.mean - off, expected, number.error, max(number.runs - 1, 1)))


def check(row: AtlasRow) -> None:
    m = row.measured
    if math.isinf(row.within):
        assert m.mean < row.predicted, row
    elif m.error == 0:
        assert m.mean == pytest.approx(row.predicted, rel=1e-9, abs=max(row.within, 0)), row
    else:
        assert p_value(m, row.predicted, row.within) >= LEVEL, f"{row.key}: {m}, predicted {row.predicted:.4g}"
        for wrong in ((row.predicted + row.within) * SEEN, (row.predicted - row.within) / SEEN):
            assert p_value(m, wrong, row.within) < LEVEL, f"{row.key}: {m} would not be distinguished from {wrong:.4g}"
    if row.remedied is not None:
        allowed = HELPED + row.aim_within + 4 * row.remedied.error
        assert abs(row.remedied.mean - row.aim) <= allowed, f"{row.key}: {row.remedied}, should be {row.aim:.4g}"


# The page has more photons than these tests need: divisors, with which `check` still has power for each row.
FEWER = {
    estimates.small_surfaces: 2, estimates.thin_wall: 8, estimates.corners: 8, discs.walls_and_corners: 2,
    discs.table_leg: 8, discs.larger_than_the_room: 16, discs.curved_inside: 16,
    discs.lamp_near_a_surface: 32, discs.shadow_edge: 8, estimates.textbook: 8,
    estimates.beside_a_mobile: 8, gloss.blur: 16, gloss.grazing: 2, gloss.noise: 2, gloss.shading_normals: 2,
    gloss.below_the_surface: 12, gloss.more_than_arrives: 8,
}  # fmt: skip


@pytest.fixture
def measured(monkeypatch):
    """Return a function that measures rows with as many photons as their tests need."""

    def measure(rows) -> list[AtlasRow]:
        def fewer(scene, photons, *arguments, **setting):
            return solved(scene, photons // FEWER.get(rows, 1), *arguments, **setting)

        for module in (atlas_row, estimates, gloss):
            monkeypatch.setattr(module, "solved", fewer)
        return list(rows())

    return measure


SLOW = {
    estimates.borders, estimates.corners, discs.table_leg, estimates.textbook, estimates.beside_a_mobile,
}  # fmt: skip
ROWS = [
    pytest.param(function, marks=[pytest.mark.slow] * (function in SLOW), id=function.__name__)
    for chapter in CHAPTERS.values()
    for function in chapter
    if function is not discs.smaller_and_smaller  # below
]


@pytest.mark.parametrize("rows", ROWS)
def test_measurements_agree_with_theory(rows, measured):
    found = measured(rows)
    assert found
    for row in found:
        check(row)


def test_borders_have_fans_of_every_angle():
    assert len(estimates.KINDS) == 15


def test_noise_of_discs_is_inversely_proportional_to_their_radius(measured):
    rows = measured(discs.smaller_and_smaller)
    for row in rows:
        check(row)
    noise = [row.measured.mean for row in rows]
    assert np.diff(np.log2(noise)) == pytest.approx(1.0, abs=0.1)


def test_shapes():
    """Areas and orientations of the shapes that predictions use."""
    for degrees in (30, 180, 330, 360):
        normals, areas = face_normals(fan((0, 0, 0), degrees))
        steps = degrees / 30
        assert areas.sum() == pytest.approx(steps * math.sin(math.radians(30)) / 2)
        assert (normals[:, 2] > 0.99).all()
    for inward in (False, True):
        cube, globe = box((0, 0, 0), (1, 2, 3), 2, inward=inward), ball(1.0, 24, inward=inward)
        for mesh, middle, area in ((cube, (0.5, 1, 1.5), 22.0), (globe, (0, 0, 0), 4 * math.pi)):
            normals, areas = face_normals(mesh)
            outward = ((mesh.vertices[mesh.faces].mean(axis=1) - middle) * normals).sum(axis=1) > 0
            assert (outward != inward).all()
            assert areas.sum() == pytest.approx(area, rel=0.01)
    assert [beyond(d, 2.0) for d in (-3, -2, 0, 2, 3)] == pytest.approx([1, 1, 0.5, 0, 0])
    assert beyond(1.0, 2.0) == pytest.approx(1 / 3 - math.sqrt(3) / (4 * math.pi))


def test_standard_error_of_the_mean():
    number = over_seeds(lambda seed: (float(seed % 2),), 8)[0]
    assert number.mean == 0.5
    assert number.error == pytest.approx(math.sqrt(8 / 28) / math.sqrt(8))


def test_the_command_writes_a_page_with_pictures(tmp_path, capsys):
    ground = scene(sheet((-1, -1, 0), (2, 0, 0), (0, 2, 0), (4, 4)), (BLACK,), (0, -3, 2), (0, 0, 0), ())
    setting = {"estimator": "tangent_plane", "radius": 0.1}
    rows = [
        AtlasRow(
            "a",
            "where <a>",
            "1 - α",
            0.5,
            Number(0.51, 0.01, 8),
            "light",
            Number(1.0),
            view=View(ground, 10, setting, setting),
        ),
        AtlasRow("b", "b", "0", 0.0, Number(0.0)),
    ]
    atlas.atlas(tmp_path / "new", {"Chapter": (lambda: iter(rows),)})
    assert sorted(p.name for p in (tmp_path / "new").iterdir()) == ["index.html"]
    page = (tmp_path / "new" / "index.html").read_text()
    assert "where &lt;a&gt;" in page and "0.510 ± 0.010" in page and "<title>Failure atlas</title>" in page
    assert page.count('src="data:image/png;base64,') == page.count("src=") == 1 and "://" not in page


def test_rows_of_one_title_share_common_cells():
    rows = [
        AtlasRow(name, name, theory, 1.0, Number(1.0), "shade", Number(aim), aim=aim, title="Sun", within=0.1)
        for name, theory, aim in (("noon", "bright", 0.0), ("dusk", "dim", 1.0))
    ]
    html = atlas.page({"Chapter": rows}, {})
    assert html.count("<h3>") == html.count("shade") == 1 and "<b>Remedy</b> shade" in html
    assert "<th>theory</th>" in html and "<td>bright</td>" in html and "<td>dim</td>" in html
    assert html.count("1 ± 0.1") == 2 and "<th>remedy</th>" not in html and "<b>Cost</b>" not in html


def test_printed_digits_end_at_the_uncertainty():
    said = {(0.08258, 0.0004): "0.08258 ± 0.00040", (61.99, 0.03): "61.990 ± 0.030", (3.0, 20.0): "3 ± 20"}
    assert {pair: str(Number(*pair)) for pair in said} == said
    assert [str(Number(x)) for x in (0.25, 0.0)] == ["0.25", "0"] and str(Number(1.25, 5e-17)) == "1.25"


def test_groups_are_found_by_position():
    solver = solved(scene(sheet((0, 0, 0), (1, 0, 0), (0, 1, 0), (2, 2)), (BLACK,), (0, -3, 2), (0, 0, 0), ()), 0)
    assert near((0.5, 0.5, 0), (0, 0, 0))(solver.receivers).sum() == 2
