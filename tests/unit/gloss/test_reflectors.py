"""The reflections that a scene needs: planes, and places for probes.

Sharp gloss: noise factors, and the rays that stand for a lobe.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from app.measure.scene_info import material_lines
from gi_core.bsdf.models import lobe
from gi_core.bsdf.table import join
from gi_core.bsdf.tabulate import tabulate
from gi_core.gloss.reflectors import MOST_PLANES, MOST_PROBES, reflectors, ways
from gi_core.gloss.sharp import MOST_NOISE, TAPS, noise_factor, sharp_lobe
from gi_core.model import Model
from gi_core.scene.types import Gloss, Material, Mobile, Pose, Scene
from tests.support.scene_builders import box, merge, quad, sphere

METAL = Gloss((0.9, 0.7, 0.3))
MATERIALS = (
    Material("wall"),
    Material("mirror", (0, 0, 0), gloss=METAL._replace(alpha=0.0)),
    Material("chrome", (0, 0, 0), gloss=METAL._replace(alpha=0.05)),
    Material("satin", gloss=Gloss(alpha=0.3)),
    Material("lamp", emission=(5.0, 5.0, 5.0)),
    Material("lacquer", gloss=Gloss(alpha=0.02), two_sided=True),
)


def lamp(x: float, y: float, z: float):
    """Return a lamp of 0.4 x 0.4 that shines down."""
    return quad((x - 0.2, y, z - 0.2), (0.4, 0, 0), (0, 0, 0.4), (1, 1), 4)


def hall(mirrors: int = 1) -> Scene:
    """A hall with flat mirrors of falling size, a chrome ball on the static part, a golden and a satin mobile."""
    flat = [quad((0.1, 0.01 + 0.01 * k, 0.1), (0, 0, 0.6), (0.6 - 0.005 * k, 0, 0), (2, 2), 1) for k in range(mirrors)]
    static = merge(
        box((0, 0, 0), (2, 2, 2), 2, 0, inward=True), *flat, sphere((1, 1, 1), 0.2, 2, 2), lamp(1.5, 1.9, 1.0)
    )
    gold = Mobile("gold", box((-0.02, -0.02, -0.02), (0.02, 0.02, 0.02), 1, 2), Pose((0.3, 0.5, 1.7)))
    return Scene(static, MATERIALS, (gold, Mobile("satin", sphere((0, 0, 0), 0.1, 2, 3))), name="hall")


def area(model: Model, some, o: int = 0) -> float:
    return float(model.surfaces.areas[some.faces + int(model.surfaces.first_face[o])].sum())


def test_flat_parts_have_planes_and_all_have_probes():
    static, gold, satin = reflectors(Model(hall()))
    (flat,) = (r for r in static if r.plane is not None)
    (ball,) = (r for r in static if r.plane is None)
    np.testing.assert_allclose(np.abs(flat.plane.equation), (0, 1, 0, 0.01), atol=1e-9)
    np.testing.assert_allclose(ball.probe.centre, (1, 1, 1), atol=1e-9)
    assert len(flat.faces) == 8 and len(ball.faces) == 320
    assert ball.omitted == {ball.probe.number}, "from its middle, the ball would hide the room"
    assert ball.probe.seen > 0.95, "a ball in free space reflects what its middle sees"
    (cube,) = gold  # its sides are too small for a plane each
    assert cube.plane is None and len(cube.faces) == 12 and satin == ()
    assert cube.omitted == {cube.probe.number} and cube.probe.number not in (ball.probe.number, flat.probe.number)


def test_tiles_of_a_floor_are_one_plane():
    """36 tiles with joints between them: each is small, and one plane reflects for all of them."""
    tiles = [quad((0.1 + 0.3 * i, 0.01, 0.1 + 0.3 * j), (0, 0, 0.28), (0.28, 0, 0), (1, 1), 1)
             for i in range(6) for j in range(6)]  # fmt: skip
    floor = merge(box((0, 0, 0), (2, 2, 2), 2, 0, inward=True), *tiles, lamp(1.0, 1.9, 1.0))
    static = reflectors(Model(replace(hall(0), static=floor)))[0]
    assert {r.plane.number for r in static} == {0} and sum(len(r.faces) for r in static) == 72
    np.testing.assert_allclose(static[0].plane.equation, (0, 1, 0, 0.01), atol=1e-9)


def test_a_closed_tube_is_no_plane():
    """Its normals cancel: no direction remains that could be a plane's."""
    a = 2 * np.pi * np.arange(13) / 12
    p = np.stack([np.cos(a), np.sin(a), 0 * a], axis=1)
    sides = [quad(p[k], p[k + 1] - p[k], (0, 0, 1), (1, 1), 1) for k in range(12)]
    assert all(r.plane is None for r in reflectors(Model(replace(hall(), static=merge(*sides))))[0])


def test_a_scene_has_a_bounded_number_of_planes():
    static = reflectors(Model(hall(MOST_PLANES + 3)))[0]
    numbers = {r.plane.number for r in static if r.plane is not None}
    assert numbers == set(range(MOST_PLANES))
    assert sum(len(r.faces) for r in static) == 8 * (MOST_PLANES + 3) + 320, "the rest looks into probes"


def test_a_scene_without_light_has_probes_too():
    dark = replace(hall(), materials=(*MATERIALS[:4], Material("lamp"), *MATERIALS[5:]))
    assert sum(len(r.faces) for r in reflectors(Model(dark))[0]) == 328


def test_probes_of_two_rooms_stand_in_their_light():
    """Lacquered rooms with walls of two sheets each: no probe stands between sheets or outside, one in each room.

    The light never sees the outside or the gaps, whose area is larger than that of the rooms.
    """
    rooms = [box((3 * k, 0, 0), (3 * k + 2, 2, 2), 4, 5, inward=True) for k in range(2)]
    shells = [box((3 * k - 0.4, -0.4, -0.4), (3 * k + 2.4, 2.4, 2.4), 4, 5) for k in range(2)]
    lamps = [lamp(3 * k + 1, 1.9, 1.0) for k in range(2)]
    model = Model(Scene(merge(*rooms, *shells, *lamps), MATERIALS, name="two rooms"))
    static = reflectors(model)[0]
    s = model.surfaces
    middles = s.vertices[0][s.faces[0]].mean(axis=1)
    for k in range(2):
        inside = [r for r in static if (np.abs(middles[r.faces] - (3 * k + 1, 1, 1)) < 1.01).all()]
        assert sum(area(model, r) for r in inside) == pytest.approx(24.0)
        (centre,) = {tuple(r.probe.centre) for r in inside}
        assert (np.abs(np.array(centre) - (3 * k + 1, 1, 1)) < 0.95).all(), "it stands in the room that it shows"
        assert all(r.probe.seen > 0.95 and not r.omitted for r in inside)


def test_a_room_in_the_dark_corner_of_another_is_served_less():
    """A screen hides half of a lacquered room from any place: the measured share says so."""
    walls = box((0, 0, 0), (4, 2, 2), 4, 5, inward=True)
    screens = [quad((1.0 + k, 0, 0.7 * (k % 2)), (0, 2, 0), (0, 0, 1.3), (2, 2), 0) for k in range(3)]
    seen = []
    for parts in ((), screens):
        model = Model(Scene(merge(walls, *parts, lamp(0.5, 1.9, 1.0), lamp(3.5, 1.9, 1.0)), MATERIALS, name="screens"))
        of = ways(model)
        known = ~np.isnan(of.seen)
        seen.append(np.average(of.seen[known], weights=model.surfaces.areas[known]))
        assert len({r.probe.number for r in reflectors(model)[0]}) <= MOST_PROBES
    assert seen[0] > 0.99 and 0.5 < seen[1] < seen[0] - 0.05


def test_info_names_the_way_of_each_material():
    scene = hall()
    lines = {line.split('"')[1]: line for line in material_lines(scene, Model(scene))[1:]}
    assert "gloss by planar (noise factor inf; probes show" in lines["mirror"]
    assert "gloss by probe (noise factor 5.8; probes show" in lines["chrome"]
    assert lines["satin: satin"].endswith("gloss by cells (noise factor 1.2)"), "of the mobile of that name"
    assert "gloss" not in lines["wall"]


NONE = join([])


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
