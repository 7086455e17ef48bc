"""Sharp gloss: noise factors, and the reflections that a scene needs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from app.measure.scene_info import material_lines
from gi_core.bsdf.models import lobe
from gi_core.bsdf.table import join
from gi_core.bsdf.tabulate import tabulate
from gi_core.geometry.surfaces import flatten
from gi_core.gloss.sharp import MOST_NOISE, PLANES, TAPS, noise_factor, reflectors, sharp_lobe
from gi_core.scene.types import Gloss, Material, Mobile, Scene
from tests.support.scene_builders import box, merge, quad, sphere

NONE = join([])
METAL = Gloss((0.9, 0.7, 0.3))


def ggx(alpha: float, f0: float = 0.9) -> np.ndarray:
    return np.array([f0, f0, f0, 1.0, alpha])


@pytest.mark.parametrize("alpha", [0.02, 0.05, 0.1, 0.15])
def test_the_noise_factor_of_ggx_is_that_of_its_peak(alpha):
    """Integrals of a narrow lobe: of D^2 over pi D, so 1 / sqrt(12) / alpha."""
    assert noise_factor(ggx(alpha), NONE) == pytest.approx(1 / math.sqrt(12) / alpha, rel=0.06)
    assert noise_factor(ggx(alpha, 0.04), NONE) == pytest.approx(noise_factor(ggx(alpha), NONE), rel=0.03)


def test_a_mirror_is_noise_alone_and_a_matt_table_has_none():
    assert noise_factor(ggx(0.0), NONE) == math.inf
    matt = join([tabulate((lobe("oren_nayar", {}),))])
    assert noise_factor(np.array([0, 0, 0, 0, -1.0]), matt) == pytest.approx(1.0, abs=0.05)


def test_only_lobes_of_too_much_noise_are_reflections():
    assert sharp_lobe(ggx(0.2), NONE) is None
    assert noise_factor(ggx(0.2), NONE) < MOST_NOISE < noise_factor(ggx(0.14), NONE)
    mirror, rough = sharp_lobe(ggx(0.0), NONE), sharp_lobe(ggx(0.1), NONE)
    assert len(mirror.taps) == 1 and TAPS // 2 <= len(rough.taps) <= TAPS
    # Taps stand for the lobe: their solid angles have its width, pi (2 alpha)^2 for the half of a GGX lobe.
    inner = np.sort(rough.taps[:, 2])[: len(rough.taps) // 2]
    assert (inner**2).sum() == pytest.approx(math.pi * 0.2**2, rel=0.35)
    np.testing.assert_allclose(mirror.albedo[-1], 0.9, rtol=1e-6)
    np.testing.assert_allclose(mirror.albedo[0], 1.0, rtol=0.01)


def test_lobes_towards_the_light_are_no_reflections():
    back = lobe("lafortune", {"kd": 0.0, "cx": 1.0, "cy": 1.0, "cz": 1.0, "n": 200.0})
    tables = join([tabulate((back,), True)])
    row = np.array([0, 0, 0, 0, -1.0])
    assert noise_factor(row, tables) > MOST_NOISE
    assert sharp_lobe(row, tables) is None


def test_brushed_metal_has_taps_along_its_grain():
    tables = join([tabulate((lobe("ward", {"kd": 0.0, "ks": 0.7, "ax": 0.03, "ay": 0.3}),), True)])
    taps = sharp_lobe(np.array([0, 0, 0, 0, -1.0]), tables).taps
    assert np.abs(taps[:, 1]).mean() > 5 * np.abs(taps[:, 0]).mean()


def hall(mirrors: int = 1) -> Scene:
    """A hall with flat mirrors of falling size, a chrome ball on the static part, a golden and a satin mobile."""
    materials = (
        Material("wall"),
        Material("mirror", (0, 0, 0), gloss=METAL._replace(alpha=0.0)),
        Material("chrome", (0, 0, 0), gloss=METAL._replace(alpha=0.05)),
        Material("satin", gloss=Gloss(alpha=0.3)),
    )
    flat = [quad((0.1, 0.01 + 0.01 * k, 0.1), (0.6 - 0.05 * k, 0, 0), (0, 0, 0.6), (2, 2), 1) for k in range(mirrors)]
    static = merge(box((0, 0, 0), (2, 2, 2), 2, 0, inward=True), *flat, sphere((1, 1, 1), 0.2, 2, 2))
    gold = Mobile("gold", box((-0.08, -0.08, -0.08), (0.08, 0.08, 0.08), 1, 2))
    return Scene(static, materials, (gold, Mobile("satin", sphere((0, 0, 0), 0.1, 2, 3))), name="hall")


def test_flat_parts_are_planes_and_others_probes():
    surfaces, _ = flatten(hall())
    static, gold, satin = reflectors(surfaces)
    (plane,) = (r for r in static if r.way == "planar")
    (ball,) = (r for r in static if r.way == "probe")
    np.testing.assert_allclose(np.abs(plane.plane), (0, 1, 0, 0.01), atol=1e-9)
    np.testing.assert_allclose(ball.centre, (1, 1, 1), atol=1e-9)
    assert len(plane.faces) == 8 and len(ball.faces) == 320
    (cube,) = gold  # its sides are too small for a plane each
    assert (cube.way, len(cube.faces)) == ("probe", 12) and satin == ()


def test_tiles_of_a_floor_are_one_plane():
    """36 tiles with joints between them: each is small, and one plane reflects for all of them."""
    tiles = [quad((0.1 + 0.3 * i, 0.01, 0.1 + 0.3 * j), (0, 0, 0.28), (0.28, 0, 0), (1, 1), 1)
             for i in range(6) for j in range(6)]  # fmt: skip
    scene = replace(hall(0), static=merge(box((0, 0, 0), (2, 2, 2), 2, 0, inward=True), *tiles))
    (floor,) = reflectors(flatten(scene)[0])[0]
    assert floor.way == "planar" and len(floor.faces) == 72
    np.testing.assert_allclose(floor.plane, (0, 1, 0, 0.01), atol=1e-9)


def test_a_closed_tube_is_no_plane():
    """Its normals cancel: no direction remains that could be a plane's."""
    a = 2 * np.pi * np.arange(13) / 12
    p = np.stack([np.cos(a), np.sin(a), 0 * a], axis=1)
    sides = [quad(p[k], p[k + 1] - p[k], (0, 0, 1), (1, 1), 1) for k in range(12)]
    scene = replace(hall(), static=merge(*sides))
    assert [r.way for r in reflectors(flatten(scene)[0])[0]] == ["probe"]


def test_a_scene_has_a_bounded_number_of_planes():
    surfaces, _ = flatten(hall(PLANES + 3))
    static = reflectors(surfaces)[0]
    assert len({r.number for r in static if r.way == "planar"}) == PLANES
    probes = [r for r in static if r.way == "probe"]
    assert sum(len(r.faces) for r in static) == 8 * (PLANES + 3) + 320 and len(probes) == 4


def test_info_names_the_way_of_each_material():
    scene = hall()
    lines = {line.split('"')[1]: line for line in material_lines(scene, flatten(scene)[0])[1:]}
    assert "gloss by planar (noise factor inf)" in lines["mirror"]
    assert "gloss by probe (noise factor 5.8)" in lines["chrome"]
    assert "gloss by cells (noise factor 1.2)" in lines["satin: satin"], "of the mobile of that name"
    assert "gloss" not in lines["wall"]
