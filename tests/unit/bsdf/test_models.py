"""Formulas of reflection models: reciprocity, albedo, limits, and values of other programs.

Diffuse reflection: samples follow the density, and their weights conserve the flux.
"""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from gi_core.bsdf import ggx as kernels
from gi_core.bsdf import lambertian
from gi_core.bsdf.models import MODELS, blinn, eon, ggx, he, lobe
from gi_core.bsdf.models.common import fresnel
from tests.support.brdf_cases import COPPER, SETS, lobes
from tests.support.brdf_tables import direction, exact, nodes

FIGURES = json.loads((Path(__file__).parent / "mitsuba_figures.json").read_text(encoding="utf-8"))
WHITE = {"n": 0, "k": 1}  # F = 1


def _pairs(count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Return directions i and o (n, 3) above the surface, half of the o near the mirror direction of i."""
    rng = np.random.default_rng(3)
    i, o = rng.normal(size=(2, count, 3))
    o[::2] = i[::2] * (-1, -1, 1) + rng.normal(scale=0.05, size=(len(o[::2]), 3))
    for w in (i, o):
        w[:, 2] = np.abs(w[:, 2]) + 0.01
        w /= np.linalg.norm(w, axis=1, keepdims=True)
    return i, o


def _evaluate(model: str, values: dict, i: np.ndarray, o: np.ndarray) -> np.ndarray:
    return MODELS[model].evaluate(lobe(model, values).values(), i, o)


def _albedo(model: str, values: dict, angle: float, phi: float = 0.0) -> float:
    """Return the largest channel of the directional albedo at an angle of incidence [degrees], without kd."""
    found, i = lobe(model, values), direction(angle, phi)
    o, weights = nodes(i)
    total = weights @ exact([found], i, o) + MODELS[model].mirror(found.values(), i[2:])[0]
    return float(total.max())


def test_every_model_has_five_sets_and_describes_itself():
    assert set(SETS) == set(MODELS)
    for model, module in MODELS.items():
        assert len(SETS[model]) == 5
        assert module.__doc__ and "Flaws:" in module.__doc__ and module.SOURCE
        for rule in module.PARAMETERS.values():
            assert rule.meaning and rule.low <= np.min(rule.default) <= np.max(rule.default) <= rule.high


@pytest.mark.parametrize(("name", "found"), lobes(), ids=[name for name, _ in lobes()])
def test_values_are_finite_symmetric_and_zero_below_the_surface(name, found):
    i, o = _pairs()
    f = exact([found], i, o)
    assert f.shape == (len(i), 3) and np.isfinite(f).all() and f.min() >= 0.0
    below = o * (1, 1, -1)
    assert not exact([found], i, below).any() and not exact([found], below, i).any()
    for flip in ((-1, 1, 1), (1, -1, 1)):  # tables rely on it
        np.testing.assert_allclose(exact([found], i * flip, o * flip), f, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(("name", "found"), lobes(), ids=[name for name, _ in lobes()])
def test_reciprocity_holds_where_it_is_claimed(name, found):
    i, o = _pairs()
    there, back = exact([found], i, o), exact([found], o, i)
    if MODELS[found.model].RECIPROCAL:
        np.testing.assert_allclose(there, back, rtol=1e-9, atol=1e-12)
    else:
        assert np.abs(there - back).max() > 0.1 * there.max()


def test_phong_breaks_reciprocity_by_the_ratio_of_cosines():
    i, o = _pairs()
    there, back = (_evaluate("phong", {"n": 5}, *pair)[:, 0] for pair in ((i, o), (o, i)))
    seen = np.minimum(there, back) > 1e-9
    np.testing.assert_allclose((there / np.maximum(back, 1e-300))[seen], (o[:, 2] / i[:, 2])[seen], rtol=1e-9)
    i, o = direction(25)[None], direction(65, 180)[None]
    ratio = _evaluate("phong", {"n": 20}, o, i)[0, 0] / _evaluate("phong", {"n": 20}, i, o)[0, 0]
    assert ratio == pytest.approx(2.14, abs=0.01)


def test_strauss_breaks_reciprocity_by_cosines_and_fresnel():
    """s = 0.7, m = 0: r = 0.343; F raises the lobe with the angle of incidence alone."""

    def fresnel_of(degrees):
        x = degrees / 90
        return (1 / (x - 1.12) ** 2 - 1 / 1.12**2) / (1 / 0.12**2 - 1 / 1.12**2)

    def shadow_of(degrees):
        x = degrees / 90
        return (1 / 0.01**2 - 1 / (x - 1.01) ** 2) / (1 / 0.01**2 - 1 / 1.01**2)

    i, o = direction(25)[None], direction(65, 180)[None]
    there, back = (_evaluate("strauss", {"s": 0.7, "m": 0}, *pair)[0, 0] for pair in ((i, o), (o, i)))
    shadow = shadow_of(25) * shadow_of(65)
    share = [0.343 + 0.443 * fresnel_of(degrees) * shadow for degrees in (25, 65)]
    expected = share[0] / share[1] * math.cos(math.radians(65)) / math.cos(math.radians(25))
    assert there / back == pytest.approx(expected, rel=1e-9)
    assert expected == pytest.approx(0.427, abs=0.001)


# Directional albedo at 0, 60, 75, 85, 89 degrees. The last four models have no second source: they are regressions.
ALBEDOS = {
    "phong": ({"ks": 1, "n": 20}, (0.955, 0.955, 1.00, 1.515, 5.31)),
    "blinn": ({"ks": 1, "n": 20}, (1, 0.328, 0.153, 0.077, 0.055)),
    "torrance_sparrow": ({"m": 0.3, **WHITE}, (0.996, 0.925, 0.927, 0.970, 0.993)),
    "ward": ({"ks": 1, "ax": 0.3, "ay": 0.3}, (0.794, 0.422, 0.280, 0.234, 0.360)),
    "lewis": ({"ks": 1, "n": 20}, (1, 0.500, 0.271, 0.138, 0.097)),
    "schlick": ({"C": 1, "r": 0.2}, (0.844, 0.925, 1.117, 1.488, 1.794)),
    "oren_nayar": ({"rho": 1, "sigma": 0.5}, (0.784, 0.883, 0.918, 0.940, 0.948)),
    "lafortune": ({"ks": 1, "n": 20}, (1, 0.500, 0.271, 0.138, 0.097)),
    "eon": ({"rho": 1, "r": 0.8}, (1, 1, 1, 1, 1)),
    "perfect_specular": ({"ks": 0.7}, (0.7, 0.7, 0.7, 0.7, 0.7)),
    "strauss": ({"C": 1, "s": 0.7, "m": 1}, (0.314, 0.342, 0.430, 0.976, 4.356)),
    "poulin_fournier": ({"ks": 1, "d": 1.5, "h": 0.2, "n": 200}, (0.897, 0.231, 0.070, 0.016, 0.0065)),
    "ggx": ({"f0": 1, "alpha": 0.3}, (0.877, 0.822, 0.824, 0.898, 0.970)),
    "he": ({"sigma": 0.18, "tau": 3, **WHITE}, (1.000, 0.992, 0.961, 0.814, 0.103)),
}


@pytest.mark.parametrize("model", ALBEDOS)
def test_directional_albedos_are_those_of_the_table(model):
    values, expected = ALBEDOS[model]
    found = [_albedo(model, values, angle) for angle in (0, 60, 75, 85, 89)]
    np.testing.assert_allclose(found, expected, atol=1.5e-3, rtol=2e-3)


def test_albedos_at_normal_incidence_have_closed_forms():
    for n in (1.0, 7.0, 60.0):
        assert _albedo("phong", {"ks": 1, "n": n}, 0) == pytest.approx((n + 1) / (n + 2), rel=1e-3)
        assert _albedo("lewis", {"ks": 1, "n": n}, 0) == pytest.approx(1, rel=1e-3)
        assert _albedo("blinn", {"ks": 1, "n": n}, 0) == pytest.approx(1, rel=1e-3)
    assert _albedo("torrance_sparrow", {"m": 0.6, **WHITE}, 0) == pytest.approx(0.80, abs=5e-3)
    assert _albedo("lafortune", {"ks": 1, "n": 20, "cz": 1.1}, 0) == pytest.approx(1.1**20, rel=1e-3)
    h = 3 / (1 - 0.9)
    assert _albedo("strauss", {"C": 0.5, "s": 0.9, "m": 0}, 0) == pytest.approx(0.729 * (h + 1) / (h + 2), rel=1e-3)
    assert _albedo("oren_nayar", {"rho": 1, "sigma": 0}, 40) == pytest.approx(1, rel=1e-3)


def test_bounded_ward_never_exceeds_its_strength_and_the_original_does():
    bounded = [_albedo("ward", {"ks": 1, "ax": 0.3, "ay": 0.3, "bounded": 1}, angle) for angle in (0, 60, 75, 85, 89)]
    np.testing.assert_allclose(bounded, (0.91, 0.82, 0.78, 0.81, 0.92), atol=6e-3)
    assert _albedo("ward", {"ks": 1, "ax": 0.3, "ay": 0.3}, 89.9) > 1.0


@pytest.mark.parametrize("r", [0.0, 0.3, 1.0])
def test_eon_passes_the_white_furnace_and_its_single_scattering_has_a_closed_form(r):
    assert _albedo("eon", {"rho": 1, "r": r}, 70) == pytest.approx(1, abs=1e-3)
    i = direction(70)
    o, weights = nodes(i)
    multiple = _evaluate("eon", {"rho": 1, "r": r}, np.broadcast_to(i, o.shape), o)[:, 0]
    half = _evaluate("eon", {"rho": 1e-9, "r": r}, np.broadcast_to(i, o.shape), o)[:, 0] * 1e9  # single scattering
    assert weights @ half == pytest.approx(eon.single_albedo(r, i[2:])[0], rel=2e-3)
    assert (multiple >= half - 1e-9).all()


@pytest.mark.parametrize("alpha", [0.05, 0.3, 1.0])
@pytest.mark.parametrize("angle", [0, 45, 80])
def test_ggx_passes_the_weak_white_furnace(alpha, angle):
    """Heitz 2014: D G1(i) / (4 cos i) integrates to 1 over all o, those below the surface included."""
    i = direction(angle)
    x, w = np.polynomial.legendre.leggauss(100)
    root, psi = 0.5 * (x + 1), (np.arange(128) + 0.5) * (2 * math.pi / 128)
    slope = alpha * root**2 / (1 - root**2)  # from 0 to infinity
    cos_h = 1 / np.sqrt(1 + slope**2)
    solid = cos_h**3 * slope * alpha * 2 * root / (1 - root**2) ** 2 * 0.5 * w * (2 * math.pi / 128)
    across = np.maximum(0, cos_h[:, None] * (slope[:, None] * np.cos(psi) * i[0] + i[2]))  # dw_o = 4 (i.h) dw_h
    masking = 1 / (1 + ggx.smith(alpha, i[2:])[0])
    total = (ggx.distribution(alpha, cos_h)[:, None] * across * solid[:, None]).sum() * masking / i[2]
    assert total == pytest.approx(1, abs=2e-3)


def test_sum_of_he_agrees_with_exact_terms_below_and_above_the_switch():
    for g, b in ((0.01, 0.0), (3.0, 7.0), (25.0, 10.0), (39.9, 60.0), (40.1, 60.0), (90.0, 400.0)):
        terms = [math.exp(m * math.log(g) - g - math.lgamma(m + 1) - b / m) / m for m in range(1, int(3 * g + 60))]
        found = he._interference(np.array([g]), np.array([b]))[0]
        assert found == pytest.approx(math.fsum(terms), rel=1e-9 if g < 40 else 3e-3)


def test_smooth_he_is_a_mirror_and_rough_he_is_beckmanns_lobe():
    smooth = lobe("he", {"sigma": 0.005, "tau": 3, **WHITE})
    assert he.mirror(smooth.values(), np.array([1.0, 0.5])).min() > 0.97
    # sigma 2, tau 20: slope m = 2 sigma / tau = 0.2, g = 2000
    i = direction(20)
    o, _ = nodes(i, 12, 12)
    o = o[(o[:, 2] > 0.7)]
    rough = _evaluate("he", {"sigma": 2, "tau": 20, **WHITE}, np.broadcast_to(i, o.shape), o)
    grooves = _evaluate("torrance_sparrow", {"m": 0.2, **WHITE}, np.broadcast_to(i, o.shape), o)  # G = 1 here
    np.testing.assert_allclose(rough, grooves, rtol=5e-3, atol=1e-3 * grooves.max())


def _strips(p: dict, i: np.ndarray, o: np.ndarray, count: int) -> float:
    """Return Poulin and Fournier's f by brute force: strips of one period, each tested against all cylinders near."""
    d, h, n = p["d"], p["h"], p["n"]
    y = (np.arange(count) + 0.5) / count * d - 0.5 * d
    half = min(math.acos(1 - h), math.asin(min(1.0, 0.5 * d)))
    floor = math.cos(half)
    on_arc = np.abs(y) < math.sin(half)
    z = np.where(on_arc, np.sqrt(np.maximum(0, 1 - y * y)), floor)
    ny, nz = np.where(on_arc, y, 0.0), np.where(on_arc, z, 1.0)

    def is_open(w):
        free = ny * w[1] + nz * w[2] > 0
        size = math.hypot(w[1], w[2])
        if size < 1e-12:
            return free
        wy, wz = w[1] / size, w[2] / size
        for centre in d * np.arange(-8, 9):
            by, bz = y - centre, z
            along = by * wy + bz * wz
            inside = along**2 - (by**2 + bz**2 - 1)
            far = -along + np.sqrt(np.maximum(0, inside))
            near = -along - np.sqrt(np.maximum(0, inside))
            for t in (near, far):  # a hit on the part of the circle above the floor, ahead of the point
                hit = (inside > 0) & (t > 1e-7) & (bz + t * wz > floor)
                free &= ~hit
        return free

    half_vector = (i + o) / np.linalg.norm(i + o)
    seen = is_open(i) & is_open(o)
    cos_i, cos_o = ny * i[1] + nz * i[2], ny * o[1] + nz * o[2]
    value = blinn.lobe(n, ny * half_vector[1] + nz * half_vector[2]) * cos_i * cos_o / nz  # ds = dy / nz
    return float(np.where(seen, value, 0).mean() / (i[2] * o[2]))


@pytest.mark.parametrize("values", [{"d": 1.5, "h": 0.2}, {"d": 4, "h": 0.9}, {"d": 1, "h": 0.6}, {"d": 2.2, "h": 0.9}])
def test_poulin_fournier_is_the_sum_over_strips(values):
    """Rays against circles, 4,000 strips per period; directions across the cylinders, along them and between."""
    p = {"n": 30.0, **values}
    found, expected = [], []
    for angles in ((30, 90, 40, 270), (70, 90, 20, 90), (80, 60, 75, 250), (10, 0, 10, 180), (60, 45, 85, 200)):
        i, o = direction(*angles[:2]), direction(*angles[2:])
        found.append(_evaluate("poulin_fournier", {"ks": 1, **p}, i[None], o[None])[0, 0])
        expected.append(_strips(p, i, o, 4000))
    np.testing.assert_allclose(found, expected, rtol=0.01, atol=1e-3 * max(expected))


def _mitsuba(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return np.array(FIGURES["i"]), np.array(FIGURES["o"]), np.array(FIGURES["f"][name])


def _beckmann_smith(m: float, cos: np.ndarray) -> np.ndarray:
    """Return Smith's masking for Beckmann's slopes, (n, 1)."""
    u = cos / np.sqrt(1 - cos * cos) / m
    hidden = np.exp(-u * u) / (2 * math.sqrt(math.pi) * u) - 0.5 * np.vectorize(math.erfc)(u)
    return (1 / (1 + hidden))[:, None]


def test_fresnel_of_air_is_not_negative():
    """Rounding gave -1e-16, and so did tables of an index of 1."""
    air = fresnel(np.linspace(0, 1, 1001), 1.0, 0.0)
    assert air.min() == 0.0 and air[1:].max() < 1e-9


def test_fresnel_agrees_with_mitsuba():
    cosines = np.array(FIGURES["fresnel"]["cosines"])
    for n, k, reflectances in FIGURES["fresnel"]["n, k, reflectances"]:
        np.testing.assert_allclose(fresnel(cosines, n, k)[:, 0], reflectances, atol=1e-5)


def test_mirrors_agree_with_mitsubas_conductor():
    """`tinted`: F = 1, times a colour. `copper`: He's mirror of sigma 0.005 um, without its loss exp(-g)."""
    cosines = np.array(FIGURES["fresnel"]["cosines"])
    tinted = lobe("perfect_specular", {"ks": (0.8, 0.5, 0.2)}).values()
    mirrored = MODELS["perfect_specular"].mirror(tinted, cosines)
    np.testing.assert_allclose(mirrored, FIGURES["mirrors"]["tinted"], rtol=1e-6)
    np.testing.assert_allclose(fresnel(cosines, *COPPER.values()), FIGURES["mirrors"]["copper"], rtol=1e-5)
    g = (4 * math.pi * 0.005 * cosines[:, None] / np.array((0.61, 0.55, 0.465))) ** 2
    smooth = he.mirror(lobe("he", {"sigma": 0.005, "tau": 3, **COPPER}).values(), cosines)
    np.testing.assert_allclose(smooth * np.exp(g), FIGURES["mirrors"]["copper"], rtol=1e-5)


def test_diffuse_agrees_with_mitsuba():
    _, _, f = _mitsuba("diffuse")
    kd = MODELS["perfect_diffuse"].diffuse(lobe("perfect_diffuse", {"kd": (0.8, 0.5, 0.2)}).values())
    np.testing.assert_allclose(np.tile(kd / math.pi, (len(f), 1)), f, rtol=1e-6)


def _separable(alpha: float, i: np.ndarray, o: np.ndarray) -> np.ndarray:
    """Return Mitsuba's masking of both directions, multiplied, over ours, correlated by height: (n, 1)."""
    li, lo = ggx.smith(alpha, i[:, 2]), ggx.smith(alpha, o[:, 2])
    return ((1 + li + lo) / ((1 + li) * (1 + lo)))[:, None]


@pytest.mark.parametrize("alpha", [0.1, 0.6])
def test_ggx_agrees_with_mitsuba_but_for_the_correlation_of_heights(alpha):
    i, o, f = _mitsuba(f"ggx {alpha}")
    ours = _evaluate("ggx", {"f0": 1, "alpha": alpha}, i, o)
    np.testing.assert_allclose(ours * _separable(alpha, i, o), f, rtol=1e-5)


@pytest.mark.parametrize("roughness", [0.3, 0.8])
def test_metal_agrees_with_principled_but_for_the_correlation_of_heights_and_further_reflections(roughness):
    """Metallic 1: the model `ggx`, and the kernels' metal without its base, which holds further reflections."""
    i, o, f = _mitsuba(f"principled metal {roughness}")
    alpha, f0 = roughness**2, (0.8, 0.5, 0.2)
    model = _evaluate("ggx", {"f0": f0, "alpha": alpha}, i, o)
    np.testing.assert_allclose(model * _separable(alpha, i, o), f, rtol=1e-5)
    given = kernels.albedos(), np.array([*f0, 1.0, alpha]), np.zeros(3)
    np.testing.assert_allclose([kernels.value(*given, *a, *b) for a, b in zip(i, o, strict=True)], model, rtol=1e-6)


@pytest.mark.parametrize(("name", "alpha"), [("black roughplastic 0.2", 0.2), ("black principled 0.5", 0.25)])
def test_gloss_of_plastic_agrees_with_mitsuba_but_for_the_correlation_of_heights_and_schlicks_f(name, alpha):
    """Mitsuba has Fresnel's equations of index 1.5; Schlick's F of 0.04 is 0.77 to 1.07 of them."""
    i, o, f = _mitsuba(name)
    h = (i + o) / np.linalg.norm(i + o, axis=1, keepdims=True)
    equations = fresnel((o * h).sum(axis=1), 1.5, 0)
    lossless, ours = (_evaluate("ggx", {"f0": f0, "alpha": alpha}, i, o) for f0 in (1, 0.04))
    np.testing.assert_allclose(lossless * _separable(alpha, i, o) * equations, f, rtol=1e-5)
    ratio = ours / (lossless * equations)
    assert 0.76 < ratio.min() < 0.78 and 1.05 < ratio.max() < 1.07


def test_torrance_sparrow_agrees_with_mitsuba_but_for_the_masking():
    """Mitsuba has Smith's masking (a rational fit, within 1 %); ours is that of V-shaped grooves."""
    i, o, f = _mitsuba("beckmann 0.3 copper")
    h = (i + o) / np.linalg.norm(i + o, axis=1, keepdims=True)
    grooves = np.minimum(1, 2 * h[:, 2] * np.minimum(i[:, 2], o[:, 2]) / (o * h).sum(axis=1))[:, None]
    smith = _beckmann_smith(0.3, i[:, 2]) * _beckmann_smith(0.3, o[:, 2])
    ours = _evaluate("torrance_sparrow", {"ks": 1, "m": 0.3, **COPPER}, i, o)
    np.testing.assert_allclose(ours / grooves * smith, f, rtol=0.01, atol=1e-4)


def test_rough_he_agrees_with_mitsubas_beckmann():
    """sigma 1.25, tau 50: slope 0.05 at g of about 800, where the mirror is gone and the lobe is Beckmann's."""
    i, o, f = _mitsuba("beckmann 0.05")
    upright = (i[:, 2] > 0.35) & (o[:, 2] > 0.35) & (f[:, 0] > 1e-3 * f[:, 0].max())
    assert upright.sum() >= 5
    ours = _evaluate("he", {"sigma": 1.25, "tau": 50, **WHITE}, i, o)
    np.testing.assert_allclose(ours[upright], f[upright], rtol=0.03)


@pytest.mark.parametrize(
    ("model", "values", "message"),
    [
        ("wards", {}, "unknown reflection model 'wards'; did you mean 'ward'?"),
        ("glass", {}, 'unknown reflection model \'glass\'; there is "perfect_diffuse", "perfect_specular"'),
        (["ward"], {}, "unknown reflection model ['ward']; did you mean 'ward'?"),
        ("ward", {"alpha": 1}, 'ward has no parameter "alpha"; it has kd, ks, ax, ay, bounded'),
        ("ward", {"ax": 0.001}, "ax of ward must be a number from 0.02 to 1, got 0.001"),
        ("ward", {"ax": math.nan}, "ax of ward must be a number from 0.02 to 1, got nan"),
        ("ward", {"ax": (1, 1, 1)}, "ax of ward must be a number from 0.02 to 1, got (1, 1, 1)"),
        ("ward", {"ks": (1, 1)}, "ks of ward must be a number or three (r, g, b) from 0 to 1, got (1, 1)"),
        ("ward", {"ks": "red"}, "ks of ward must be a number or three (r, g, b) from 0 to 1, got 'red'"),
        ("ward", {"ks": True}, "ks of ward must be a number or three (r, g, b) from 0 to 1, got True"),
        ("ward", {"ks": 10**400}, "ks of ward must be a number or three (r, g, b) from 0 to 1, got 1000"),
    ],
)
def test_wrong_parameters_are_one_sentence(model, values, message):
    with pytest.raises(ValueError) as caught:
        lobe(model, values)
    assert str(caught.value).startswith(message) and "\n" not in str(caught.value)


def test_factors_of_a_combination_are_checked():
    for factor in (-1, math.inf, 1e300, 10**400, True, "2"):
        with pytest.raises(ValueError, match="factor of lewis must be a number from 0 to 1e\\+06, got "):
            lobe("lewis", {}, factor)


@pytest.mark.parametrize(
    ("model", "values", "stronger"),
    [
        ("ward", {"ax": 0.3, "ay": 0.1}, "x"),
        ("ward", {"ax": 0.1, "ay": 0.3, "bounded": 1}, "y"),
        ("schlick", {"r": 0.05, "p": 0.3}, "y"),  # A is largest for h across the tangent, w = 0
        ("poulin_fournier", {"n": 200}, "y"),  # cylinders lie along x and spread light across
        ("lafortune", {"cx": -1, "cy": -0.7, "cz": 0.9}, "x"),  # light along x meets the larger factor
    ],
)
def test_anisotropic_lobes_are_turned_as_their_documents_say(model, values, stronger):
    i, o = np.array([[0, 0, 1.0]] * 2), np.array([direction(25, 0), direction(25, 90)])
    if model == "lafortune":  # nothing but cz acts at normal incidence
        i = np.array([direction(45, 180), direction(45, 270)])
        o = np.array([direction(20, 0), direction(20, 90)])
    along, across = _evaluate(model, values, i, o)[:, 0]
    assert (along > 1.05 * across) == (stronger == "x") and (across > 1.05 * along) == (stronger == "y")


CELLS = 20
MIDDLES = (np.arange(2000) + 0.5) / 2000  # of cosines


def test_density_integrates_to_one_and_is_zero_below():
    assert 2 * math.pi * np.mean([lambertian.pdf(c) for c in MIDDLES]) == pytest.approx(1)
    assert lambertian.pdf(-0.5) == 0.0


def test_samples_are_unit_vectors_above_the_surface_and_follow_the_density():
    numbers = (np.arange(100) + 0.5) / 100
    found = np.array([lambertian.sample(u, v) for u in numbers for v in numbers])
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, rtol=1e-6)
    assert (found[:, 2] >= 0).all()
    rings = 2 * math.pi * np.array([lambertian.pdf(c) for c in MIDDLES]).reshape(CELLS, -1).mean(axis=1) / CELLS
    counted = np.histogram(found[:, 2], np.linspace(0, 1, CELLS + 1))[0] / len(found)
    np.testing.assert_allclose(counted, rings, atol=0.011)  # a row of 100 of 10,000 samples may cross an edge


def test_samples_are_isotropic_about_the_normal():
    numbers = (np.arange(64) + 0.5) / 64
    x, y, _ = np.array([lambertian.sample(u, v) for u in numbers for v in numbers]).T
    counted = np.histogram(np.arctan2(y, x), np.linspace(-math.pi, math.pi, 9))[0] / len(x)
    np.testing.assert_allclose(counted, 1 / 8, atol=0.01)


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.999])
def test_mean_weight_is_the_reflected_share(rho):
    """The mean of f cos / pdf over samples is the albedo; it never exceeds rho."""
    assert 0.0 <= lambertian.weight(rho) <= rho
    assert (lambertian.weight(rho) == 0.0) == (rho == 0.0)
