"""Tables of reflection models: draws follow their density, weights equal f cos / pdf, albedos equal quadrature."""

import math
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from scipy import stats

from gi_core.bsdf import table, tabulate
from gi_core.bsdf.models import MODELS, Lobe, lobe
from tests.support.brdf_cases import ANGLES, lobes
from tests.support.brdf_tables import densities, direction, draws, exact, nodes, values

pytestmark = pytest.mark.slow  # 15 CPU s for 75 sets
DRAWS, WEIGHED = 40_000, 5_000  # WEIGHED: draws whose weight is computed again
ROWS, COLUMNS = 20, 40  # cells of the chi-square test
GAUSS, EXACT, HALVINGS = 4, 8e-6, 9  # of a cell's integral: points per side, error (a tenth of chi2's), subdivisions
LAST = 1.0 - 2.0**-53  # the largest number drawn
AZIMUTH = 145.0  # of i: in the second quadrant, off every row of a table


OFF_ROWS = (41.3, 68.7)  # angles between rows of tables
# Mean |f - model| at them, relative, where it is above 1 %: kinks of shadows, and lobes that turn with i across rows.
BLURRED = {"poulin_fournier": 0.03, "lafortune-2": 0.035, "schlick-3": 0.015, "he-3": 0.015}


class Case(NamedTuple):
    """A set of parameters with two angles of incidence, and its table as the second of two materials."""

    name: str
    lobe: Lobe
    table: table.Table
    tables: table.Tables
    angles: tuple[float, ...]  # each model has every one at two of its five sets


def _blur(case: Case) -> float:
    return next((bound for name, bound in BLURRED.items() if case.name.startswith(name)), 0.01)


@pytest.fixture(scope="module", params=enumerate(lobes()), ids=[name for name, _ in lobes()])
def case(request) -> Case:
    k, (name, found) = request.param
    made = tabulate.tabulate((found,), scale=True)
    return Case(
        name,
        found,
        made,
        table.join([tabulate.tabulate((lobe("lewis", {"n": 3}),)), made]),
        (ANGLES[k % 5], ANGLES[(k + 2) % 5]),
    )


class Polar:
    """Directions o by theta and phi, each from 0 to 1. A sharp lobe fills few cells."""

    @staticmethod
    def directions(i, u, v):
        """Return o (..., 3) and the solid angle of du dv, for u (..., n, 1) and v (..., 1, n)."""
        theta, phi = 0.5 * math.pi * u, 2 * math.pi * v
        o = np.stack(np.broadcast_arrays(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)), -1)
        return o, math.pi**2 * np.sin(theta)

    @staticmethod
    def coordinates(i, o):
        """Return u and v (n,) of o (n, 3)."""
        return np.arccos(np.minimum(o[:, 2], 1.0)) * (2 / math.pi), np.arctan2(o[:, 1], o[:, 0]) / (2 * math.pi) % 1


class Half:
    """Directions o by the half vector: fourth root of y by psi about the azimuth of x, as `nodes` has them.

    Cells are as narrow as the lobe.
    """

    @staticmethod
    def directions(i, u, v):
        """Return o (..., 3) and the solid angle of du dv, for u (..., n, 1) and v (..., 1, n)."""
        y, psi = u**4, 2 * math.pi * v
        b = (np.cos(psi) * i[0] + np.sin(psi) * i[1]) / i[2]
        limit2 = (b + np.sqrt(b * b + 1.0)) ** 2
        scale = limit2 * (1.0 - y) + y
        slope = np.sqrt(y * limit2 / scale)
        cos_h = 1.0 / np.sqrt(1.0 + slope * slope)
        h = np.stack((slope * np.cos(psi) * cos_h, slope * np.sin(psi) * cos_h, cos_h), axis=-1)
        across = h @ i
        solid = 2.0 * across * cos_h**3 * (limit2 / scale) ** 2 * 4.0 * u**3
        return 2.0 * across[..., None] * h - i, 2 * math.pi * solid

    @staticmethod
    def coordinates(i, o):
        """Return u and v (n,) of o (n, 3)."""
        h = i + o
        x, y = h[:, 0] / h[:, 2], h[:, 1] / h[:, 2]
        slope2 = np.maximum(x * x + y * y, 1e-30)
        b = (x * i[0] + y * i[1]) / np.sqrt(slope2) / i[2]
        limit2 = (b + np.sqrt(b * b + 1.0)) ** 2
        root = (slope2 * limit2 / (np.maximum(0.0, limit2 - slope2) + slope2 * limit2)) ** 0.25
        return root, np.arctan2(y, x) / (2 * math.pi) % 1


def _cells(chart, i, o):
    """Return the cell (n,) of each direction o (n, 3)."""
    u, v = chart.coordinates(i, o)
    return np.minimum((u * ROWS).astype(int), ROWS - 1) * COLUMNS + (v * COLUMNS).astype(int) % COLUMNS


def _expected(tables, chart, i):
    """Return the integral of the density over each cell, by Gauss-Legendre points in a quadtree."""
    x, w = np.polynomial.legendre.leggauss(GAUSS)
    inner, weight = 0.5 * (x + 1.0), 0.25 * w[:, None] * w

    def integrals(corner, size):
        u, v = (corner[:, [k], None] + size[k] * inner for k in (0, 1))
        o, solid = chart.directions(i, u, v.reshape(-1, 1, GAUSS))
        density = densities(tables, 1, i, np.ascontiguousarray(o.reshape(-1, 3))).reshape(o.shape[:-1])
        return (density * solid * weight).sum(axis=(1, 2)) * size[0] * size[1]

    size = np.array((1 / ROWS, 1 / COLUMNS))
    owner = np.arange(ROWS * COLUMNS)
    corner = np.stack((owner // COLUMNS, owner % COLUMNS), axis=1) * size
    result, coarse = np.zeros(len(owner)), integrals(corner, size)
    for _ in range(HALVINGS):
        size = 0.5 * size
        corner = (corner[:, None] + size * ((0, 0), (0, 1), (1, 0), (1, 1))).reshape(-1, 2)
        fine = integrals(corner, size)
        parts = fine.reshape(-1, 4).sum(axis=1)
        rough = np.abs(parts - coarse) > EXACT
        np.add.at(result, owner[~rough], parts[~rough])
        again = np.repeat(rough, 4)
        owner, corner, coarse = np.repeat(owner, 4)[again], corner[again], fine[again]
        if not len(owner):
            break
    np.add.at(result, owner, coarse)
    return result


def _significance(counted, expected):
    """Return the probability of a chi-square as large; cells of less than 5 draws are pooled."""
    large = expected >= 5.0
    seen = np.append(counted[large], counted[~large].sum())
    hoped = np.append(expected[large], max(expected[~large].sum(), 1e-9))
    if hoped[-1] < 5.0:  # too few for a cell of their own
        seen, hoped = np.append(seen[:-2], seen[-2:].sum()), np.append(hoped[:-2], hoped[-2:].sum())
    return stats.chi2.sf(((seen - hoped) ** 2 / hoped).sum(), len(seen) - 1)


def test_draws_follow_the_density_and_carry_its_weight(case):
    """Chi-square at 1 % for all angles and sets together (Sidak); weights equal f cos / (pdf albedo).

    Each model has every angle once in each chart.
    """
    tables = case.tables
    numbers = np.random.default_rng([ord(c) for c in case.name]).random((DRAWS, 3))
    tests = len(lobes()) * len(case.angles)
    for angle, chart in zip(case.angles, (Polar, Half), strict=True):
        i = direction(angle, AZIMUTH)
        survival, share = table.albedo(tables, 1, *i), table.mirror_share(tables, 1, *i)
        drawn = draws(tables, 1, i, numbers)
        if survival == 0.0:
            assert not drawn[:, 3:].any()
            continue
        assert drawn[:, 3:].min() >= 0.0 and drawn[:, 3:].max() <= 1.0
        o = np.ascontiguousarray(drawn[:, :3])
        assert np.abs((o * o).sum(axis=1) - 1.0).max() < 1e-12 and o[:, 2].min() > -1e-12
        mirrored = numbers[:, 2] >= 1.0 - share
        assert np.abs(o[mirrored] - (-i[0], -i[1], i[2])).max(initial=0.0) < 1e-12
        assert stats.binomtest(int(mirrored.sum()), DRAWS, share).pvalue > 1e-5
        spread = ~mirrored & (o[:, 2] > 1e-9)
        density = densities(tables, 1, i, o[spread])
        assert density.min(initial=1.0) > 0.0
        few = np.flatnonzero(spread)[:WEIGHED]
        weight = values(tables, 1, i, o[few]) * o[few, 2:] / (density[:WEIGHED] * survival)[:, None]
        np.testing.assert_allclose(weight, drawn[few, 3:], atol=1e-6)
        if share > 1.0 - 1e-9:
            continue

        expected = _expected(tables, chart, i)
        assert expected.sum() == pytest.approx(1.0 - share, abs=1e-3)
        counted = np.bincount(_cells(chart, i, o[~mirrored]), minlength=len(expected))
        expected *= (DRAWS - mirrored.sum()) / expected.sum()
        p = _significance(counted, expected)
        assert p > 1.0 - 0.99 ** (1.0 / tests), (chart.__name__, angle, p)


@cache
def _quadrature(angle: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    i = direction(angle, AZIMUTH)
    return i, *nodes(i, 48, 64)


def test_albedo_is_that_of_the_formula_or_all_that_may_leave(case):
    """All sets by quadrature of the formula, within 0.8 %, or half of BLURRED; near 90 degrees within 2.5 %.

    Surfaces darkened by `scale` reflect what the diffuse part leaves, where the formula exceeds it.
    """
    for angle in (*ANGLES, *OFF_ROWS):
        i, o, weights = _quadrature(angle)
        mirror = MODELS[case.lobe.model].mirror(case.lobe.values(), i[2:])[0].max()
        total = float(weights @ exact([case.lobe], i, o).max(axis=1)) + mirror
        tolerance = 0.025 if angle > 80 else max(8e-3, 0.5 * _blur(case))
        room = 1.0 - case.table.diffuse.max()
        assert table.albedo(case.tables, 1, *i) == pytest.approx(min(total, room), rel=tolerance, abs=1e-9), angle


def test_values_between_rows_are_those_of_the_formula(case):
    """The mean of |f - model| over that of the model."""
    if case.table.limited:
        pytest.skip("darkened where it would reflect more than arrives")
    for angle in OFF_ROWS:
        i, o, weights = _quadrature(angle)
        model = exact([case.lobe], i, o)
        total = float(weights @ model.max(axis=1))
        off = np.abs(values(case.tables, 1, i, o) - model)
        assert weights @ off.max(axis=1) <= _blur(case) * total, angle


def test_albedo_leaves_room_for_the_diffuse_part(case):
    """No light is made at any angle, grazing ones included, nor by an i that is not above the surface."""
    for angle in (*np.linspace(0.0, 89.99, 40), 89.9999999):
        for azimuth in (0.0, 17.0, 90.0, 200.0):
            survival = table.albedo(case.tables, 1, *direction(angle, azimuth))
            assert 0.0 <= survival <= 1.0 - case.table.diffuse.max() + 1e-6
    below = direction(120.0)
    assert table.albedo(case.tables, 1, *below) == table.mirror_share(case.tables, 1, *below) == 0.0
    assert table.pdf(case.tables, 1, *below, 0.0, 0.0, 1.0) == 0.0
    assert table.value(case.tables, 1, *below, 0.0, 0.0, 1.0) == (0.0, 0.0, 0.0)
    assert table.value(case.tables, 1, 0.0, 0.0, 1.0, *below) == (0.0, 0.0, 0.0)
    assert table.sample(case.tables, 1, *below, 0.5, 0.5, 0.5)[3:] == (0.0, 0.0, 0.0)


def test_edges_of_the_numbers_give_valid_draws(case):
    """Every corner of the unit cube of numbers, at upright and at grazing incidence, parallel to axes as well."""
    ends = (0.0, 0.5, LAST)
    numbers = np.array([(u, v, w) for u in ends for v in ends for w in ends])
    for i in (direction(0), direction(45, 0), direction(45, 90), direction(89.99, 180), direction(89.9999999, 33)):
        drawn = draws(case.tables, 1, i, numbers)
        assert np.isfinite(drawn).all() and drawn[:, 3:].min() >= 0.0 and drawn[:, 3:].max() <= 1.0
        assert np.abs((drawn[:, :3] ** 2).sum(axis=1) - 1.0).max() < 1e-9 and drawn[:, 2].min() > -1e-9


@pytest.mark.parametrize(
    ("model", "values", "sentence"),
    [
        ("phong", {"ks": 0.5, "n": 20}, r"at 8\d to 89 degrees of incidence \(26\d\S* % at 89 degrees\)"),
        ("schlick", {"C": 1, "r": 0.2}, r"at 6\d to 89 degrees of incidence \(17[89]\S* % at 89 degrees\)"),
        ("strauss", {"s": 0.7, "m": 1, "C": 1}, r"at 8\d to 89 degrees of incidence \(45\d\S* % at 89 degrees\)"),
        ("lafortune", {"ks": 1, "cz": 1.1, "n": 20}, r"at 0 to 5\d degrees of incidence \(67\d\S* % at 0 degrees\)"),
        ("lafortune", {"ks": 1, "cz": 2, "n": 1000}, r"at 0 to 8\d degrees of incidence \(1.081e\+303 % at 0"),
        ("lewis", {"ks": 0.7, "kd": 0.5}, r"at 0 to 4\d degrees of incidence \(120\S* % at 0 degrees\)"),
        ("perfect_specular", {"ks": 0.7, "kd": 0.5}, r"at 0 to 89 degrees of incidence \(120 % at 0 degrees\)"),
    ],
)
def test_more_light_than_arrives_is_refused_or_darkened(model, values, sentence):
    found = (lobe(model, values),)
    with pytest.raises(ValueError, match=f"{model} reflects more light than arrives, {sentence}") as caught:
        tabulate.tabulate(found)
    assert "\n" not in str(caught.value) and "or set scale = true" in str(caught.value)
    made = tabulate.tabulate(found, scale=True)
    assert str(caught.value).startswith(made.limited) and made.limited
    tables, room = table.join([made]), 1.0 - made.diffuse.max()
    survivals = [table.albedo(tables, 0, *direction(angle)) for angle in (0, 60, 85, 89)]
    assert max(survivals) == pytest.approx(room, abs=1e-6)


def test_darkening_leaves_other_angles_alone():
    """Phong is darkened from 75 degrees on; at 60 its values are those of the formula."""
    found = lobe("phong", {"ks": 0.98, "n": 20})
    tables, i = table.join([tabulate.tabulate((found,), scale=True)]), direction(60)
    o, weights = nodes(i)
    assert table.albedo(tables, 0, *i) == pytest.approx(weights @ exact([found], i, o)[:, 0], rel=3e-3)


def test_diffuse_parts_above_one_are_refused_even_if_scaled():
    with pytest.raises(ValueError, match="lewis \\+ perfect_diffuse has a diffuse albedo of 1.1"):
        tabulate.tabulate((lobe("lewis", {"kd": 0.5}), lobe("perfect_diffuse", {"kd": 0.6})), scale=True)


def test_linear_combination_is_the_sum_of_its_lobes():
    """A sharp and a wide lobe, one returning light, a mirror and a diffuse part, with factors."""
    parts = (
        lobe("ward", {"ks": (0.9, 0.5, 0.2), "ax": 0.05, "ay": 0.05, "bounded": 1}, 0.4),
        lobe("lafortune", {"cx": 1, "cy": 1, "n": 3, "ks": 0.5}, 0.5),
        lobe("perfect_specular", {"ks": 0.6}, 0.3),
        lobe("perfect_diffuse", {"kd": 0.5}, 0.4),
    )
    made = tabulate.tabulate(parts)
    tables, i = table.join([made]), direction(50, 20)
    np.testing.assert_allclose(made.diffuse, 0.2)
    o, weights = nodes(i)
    model = exact(parts, i, o)
    found = values(tables, 0, i, o)
    assert weights @ np.abs(found - model).max(axis=1) < 0.01 * (weights @ model.max(axis=1))
    total = weights @ model.max(axis=1) + 0.18
    assert table.albedo(tables, 0, *i) == pytest.approx(total, rel=4e-3)
    assert table.mirror_share(tables, 0, *i) == pytest.approx(0.18 / total, rel=4e-3)


def test_density_of_a_table_is_nearly_reciprocal():
    """Interpolation breaks the reciprocity of f by less than 2 % of its largest value, away from grazing angles."""
    rng = np.random.default_rng(5)
    pairs = rng.normal(size=(200, 2, 3))
    pairs[:, :, 2] = np.abs(pairs[:, :, 2]) + 0.3
    pairs /= np.linalg.norm(pairs, axis=2, keepdims=True)
    for model, parameters in (("ward", {"ax": 0.1, "ay": 0.4}), ("torrance_sparrow", {}), ("eon", {}), ("lewis", {})):
        tables = table.join([tabulate.tabulate((lobe(model, parameters),))])
        there = np.array([table.value(tables, 0, *i, *o) for i, o in pairs])
        back = np.array([table.value(tables, 0, *o, *i) for i, o in pairs])
        assert np.abs(there - back).max() < 0.02 * there.max()


def test_isotropic_parameters_of_an_anisotropic_model_need_one_azimuth():
    assert tabulate.tabulate((lobe("ward", {"ax": 0.3, "ay": 0.3}),)).head[1] == 1
    assert tabulate.tabulate((lobe("ward", {"ax": 0.3, "ay": 0.31}),)).head[1] == tabulate.ANISOTROPIC.phis


def test_tables_of_one_material_are_made_once_and_equal():
    found = (lobe("ward", {"ax": 0.123, "ay": 0.123}),)
    made = tabulate.tabulate(found)
    assert tabulate.tabulate((lobe("ward", {"ay": 0.123, "ax": 0.123}),)) is made
    tabulate.tabulate.cache_clear()
    again = tabulate.tabulate(found)
    assert again is not made and np.array_equal(again.data, made.data) and np.array_equal(again.head, made.head)


def test_a_scene_without_tables_has_empty_arrays():
    empty, full = table.join([]), table.join([tabulate.tabulate((lobe("lewis"),))])
    assert empty.head.shape == (0, full.head.shape[1]) and empty.data.shape == (0,)
    assert (empty.head.dtype, empty.data.dtype) == (full.head.dtype, full.data.dtype)


@pytest.mark.parametrize(("low", "high"), [(1.0, 1.0), (0.0, 2.0), (2.0, 0.0), (3.0, 1e-9), (0.2, 5.0)])
def test_draws_inside_a_cell_follow_its_slope(low, high):
    """The area under the line from low to high, up to the returned share, is the given one."""
    for part in np.linspace(0.0, 1.0, 23):
        area = part * 0.5 * (low + high)
        share = table._linear(area, low, high)
        assert 0.0 <= share <= 1.0
        assert low * share + 0.5 * (high - low) * share**2 == pytest.approx(area, rel=1e-9, abs=1e-12)
