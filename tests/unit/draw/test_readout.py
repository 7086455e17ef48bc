"""The read-out equals the picture at its point."""

import math
from dataclasses import replace

import numpy as np
import pytest

from app.draw.camera import from_camera
from app.draw.picking import Picker
from app.draw.readout import STATIC, UNLIT, Reading, read, read_pin
from app.draw.shot import Shot
from app.draw.tonemap import to_display
from app.settings import Settings, make_solver
from app.values import Pin
from gi_core.display.dilation import Drawn
from gi_core.scene import Camera, Material, Mobile, Paint, PointLight, Pose, Scene, Texture
from gi_core.scene.pose import axis_angle
from gi_core.scene.types import PHOTOMETRIC, RADIOMETRIC, Gloss
from tests.support import closed_form
from tests.support.projection import projected
from tests.support.scene_builders import complete, merge, quad

SETTINGS = Settings(photons=2000, radius=0.1, size=(161, 121), tone_map="clip", exposure=0.0)
INTENSITY, HEIGHT = 500.0, 2.0  # [cd], [m]


def floor(units: str = "photometric", two_sided: bool = False) -> Scene:
    """A floor of 4 m under a point lamp, seen from above."""
    lamp = PointLight("lamp", (0, 0, HEIGHT), (4 * math.pi * INTENSITY,) * 3)
    materials = Material("oak", (0.5, 0.5, 0.5), (0.0, 0.0, 0.0), two_sided), Material("slate", (0.1, 0.2, 0.3))
    mobile = Mobile("tile", quad((-0.2, -0.2, 0), (0.4, 0, 0), (0, 0.4, 0), (2, 2), material=1), Pose((1.2, 0, 0.5)))
    static = quad((-2, -2, 0), (4, 0, 0), (0, 4, 0), (40, 40))
    return Scene(
        static,
        materials,
        (mobile,),
        (lamp,),
        camera=Camera((0.3, -2.5, 3.0), (0, 0, 0), 60.0),
        up=(0, 0, 1),
        units=units,
    )


def shot_of(scene: Scene, irradiance=None) -> Shot:
    solver = make_solver(scene, SETTINGS)
    r = solver.receivers
    E = closed_form.point_light(INTENSITY, (0, 0, HEIGHT), r.positions, r.normals)[:, None] * [1.0, 1.0, 1.0]
    solver.frame = solver.frame._replace(irradiance=E if irradiance is None else irradiance(solver))
    return Shot(solver, SETTINGS)


def reading_at(shot: Shot, point=None, uv=None, weights=None, cull=True) -> Reading | None:
    width, height = SETTINGS.size
    u, v = projected(shot.camera, point, width / height) if uv is None else uv
    solver = shot.solver
    origin, direction = shot.camera.ray(u, v, width / height)
    poses = [solver.poses[m.name] for m in solver.scene.mobiles]
    hit = Picker(solver.model).pick(origin, direction, poses, cull)
    lit = replace(shot.lit, drawn=Drawn(solver.irradiance, weights))
    return None if hit is None else read(lit, hit, direction, shot.camera, height)


@pytest.mark.parametrize(("units", "expected"), [("photometric", PHOTOMETRIC), ("radiometric", RADIOMETRIC)])
def test_a_point_lamp_over_a_floor_reads_as_its_closed_form(units, expected):
    """E = I cos / d^2 and L = rho E / pi, between vertices; linear interpolation over 0.1 m errs by 0.2 %."""
    shot = shot_of(floor(units))
    for x, y in ((0.0, 0.0), (0.33, -0.21), (-1.17, 0.84)):
        reading = reading_at(shot, (x, y, 0.0))
        E = closed_form.point_over_plane(INTENSITY, HEIGHT, math.hypot(x, y))
        assert reading.irradiance == pytest.approx(E, rel=2e-3)
        assert reading.radiance == pytest.approx(0.5 * E / math.pi, rel=2e-3)
        assert (reading.object, reading.material, reading.units) == (STATIC, "oak", expected)
    reading = reading_at(shot, (0.0, 0.0, 0.0))
    text, unknown = reading.text(), reading._replace(before=(100.0, math.nan)).text()
    assert f"light A 100, change +25 {expected.per_area}  ·" in unknown, "its error is not known yet"
    shown = {
        "photometric": "Illuminance 125 lx  ·  luminance 19.9 cd/m²  ·  static part, oak",
        "radiometric": "Irradiance 125 W/m²  ·  radiance 19.9 W/m²/sr  ·  static part, oak",
    }
    assert text == shown[units]


def test_a_pin_under_a_roof_reads_its_floor_whatever_is_far_away():
    """It was looked for from 0.001 of the size of everything: 448 m above the floor."""
    roofed = merge(floor().static, quad((-2, -2, 3), (4, 0, 0), (0, 4, 0), (2, 2)), quad((448e3, 0, 0), *np.eye(3)[:2]))
    shot = shot_of(replace(floor(), static=roofed))
    s = shot.solver
    del s.model.lit_part  # of the fixture's brief pilot
    picker, lit = Picker(s.model), replace(shot.lit, drawn=Drawn(s.irradiance, None))
    pinned = read_pin(Pin("P1", (0.33, -0.21, 0), (0, 0, 1)), picker, lit)
    expected = closed_form.point_over_plane(INTENSITY, HEIGHT, math.hypot(0.33, 0.21))
    assert pinned.reading.irradiance == pytest.approx(expected, rel=2e-3)


def test_a_mobile_reads_at_its_pose():
    shot = shot_of(floor())
    shot.solver.poses["tile"] = Pose((-0.6, 0.3, 0.7), axis_angle((0, 0, 1), 30))
    r = shot.solver.model.receivers_at(shot.solver.poses)
    E = closed_form.point_light(INTENSITY, (0, 0, HEIGHT), r.positions, r.normals)[:, None].repeat(3, axis=1)
    shot.solver.frame = shot.solver.frame._replace(irradiance=E)
    reading = reading_at(shot, (-0.63, 0.28, 0.7))
    exact = closed_form.point_light(INTENSITY, (0, 0, HEIGHT), np.array([[-0.63, 0.28, 0.7]]), np.array([[0, 0, 1.0]]))
    assert (reading.object, reading.material) == ("tile", "slate")
    assert reading.irradiance == pytest.approx(exact[0], rel=1e-2)


def test_a_vertex_of_small_weight_hardly_counts():
    """The centre of a floor whose middle vertex is dark: half the light beside it, or all of it by dilation."""

    def is_dark(solver):
        return np.hypot(*solver.receivers.positions[:, :2].T) < 1e-6

    shot = shot_of(floor(), lambda solver: np.where(is_dark(solver), 0.0, 1.0)[:, None].repeat(3, axis=1))
    dark = is_dark(shot.solver)
    weights = np.where(dark, 1e-3, 1).astype(np.float32)
    point = (0.05, 0.0, 0.0)
    assert reading_at(shot, point).irradiance == pytest.approx(0.5, rel=1e-3)
    assert reading_at(shot, point, weights=weights).irradiance == pytest.approx(1 / 1.001, rel=1e-3)


def test_backs_and_unknown_light_are_named():
    scene = replace(floor(), mobiles=(), camera=Camera((0.3, -2.5, -3.0), (0, 0, 0), 60.0))
    reading = reading_at(shot_of(scene), (0.3, 0.2, 0.0), cull=False)
    assert not reading.is_lit and reading.text() == f"{STATIC}, oak  ·  {UNLIT}"
    both = replace(scene, materials=(Material("oak", (0.5,) * 3, (9.0,) * 3, True), scene.materials[1]))
    ones = shot_of(both, lambda solver: np.ones(solver.irradiance.shape))
    assert reading_at(ones, (0.3, 0.2, 0.0)).radiance == pytest.approx(0.5 / math.pi), "emission is on the front"
    front = replace(both, camera=Camera((0.3, -2.5, 3.0), (0, 0, 0), 60.0))
    ones = shot_of(front, lambda solver: np.ones(solver.irradiance.shape))
    assert reading_at(ones, (0.3, 0.2, 0.0)).radiance == pytest.approx(0.5 / math.pi + 9)
    unknown = shot_of(floor(), lambda solver: np.full(solver.irradiance.shape, np.nan))
    assert reading_at(unknown, (0.3, 0.2, 0.0)).text().startswith("Illuminance not yet known")


def glossy(alpha: float) -> Shot:
    """A floor under a lamp of its own light, solved: dark, so that its highlight is most of its luminance."""
    scene = floor()
    oak = scene.materials[0]._replace(reflectance=(0.1,) * 3, gloss=Gloss((0.3,) * 3, alpha))
    solver = complete(
        make_solver(replace(scene, materials=(oak, scene.materials[1])), replace(SETTINGS, photons=20_000))
    )
    return Shot(solver, replace(SETTINGS, exposure=-4.0))


def test_the_luminance_of_gloss_is_that_of_the_picture():
    """The highlight follows the camera, and the reading with it; a reading has it as its pixel shows it."""
    shot, peaks = glossy(0.3), []
    for eye in ((0.3, -2.5, 3.0), (2.5, 0.3, 2.0)):
        shot.camera = from_camera(Camera(eye, (0, 0, 0), 60.0), (0, 0, 1), shot.camera.bounds)
        picture, (width, height) = shot.take().astype(int), SETTINGS.size
        for i, j in np.random.default_rng(4).integers((1, 1), (width - 1, height - 1), (200, 2)):
            around = picture[j - 1 : j + 2, i - 1 : i + 2].reshape(-1, 3)
            reading = reading_at(shot, uv=((i + 0.5) / width, (j + 0.5) / height))
            if reading is None or np.ptp(around, axis=0).max() > 6:
                continue
            shown = to_display(np.full(3, reading.radiance), -4.0, "clip")[0]
            assert around.min() - 2 <= shown <= around.max() + 2
        v, u = np.unravel_index(picture.sum(axis=2).argmax(), picture.shape[:2])
        peaks.append(reading_at(shot, uv=((u + 0.5) / width, (v + 0.5) / height)))
    assert not peaks[0].is_sharp and "without" not in peaks[0].text()
    assert all(p.radiance > 3 * 0.1 * p.irradiance / math.pi for p in peaks), "most of it is gloss"


def test_a_reflection_is_said_to_be_missing():
    shot = glossy(0.0)
    reading, rho = reading_at(shot, (0.2, 0.1, 0.0)), float(shot.lit.meshes[0].reflectance[0, 0])
    assert reading.is_sharp and reading.text().endswith("cd/m² without its reflection  ·  static part, oak")
    assert reading.radiance == pytest.approx(rho * reading.irradiance / math.pi, rel=1e-3)


def test_the_luminance_of_a_texture_is_that_of_the_picture():
    """The read-out of a pixel's middle lies within the pixels around it, textures included."""
    scene = floor()
    corners = scene.static.vertices[scene.static.faces][..., :2]
    n = len(corners)
    checks = (
        np.where((np.indices((64, 64)) // 8).sum(axis=0) % 2, 230, 90).astype(np.uint8)[..., None].repeat(3, axis=2)
    )
    paint = Paint((Texture(checks),), np.zeros(n, np.int32), (0.25 * corners).astype(np.float32), np.ones((n, 3, 3)))
    shot = shot_of(
        replace(scene, static=scene.static._replace(paint=paint)), lambda solver: np.full(solver.irradiance.shape, 2.0)
    )
    picture = shot.take().astype(int)
    width, height = SETTINGS.size
    rng, compared, values = np.random.default_rng(3), 0, set()
    for i, j in zip(rng.integers(1, width - 1, 300), rng.integers(1, height - 1, 300), strict=True):
        around = picture[j - 1 : j + 2, i - 1 : i + 2].reshape(-1, 3)
        if np.ptp(around, axis=0).max() > 2:
            continue  # an edge of the texture or of an object
        reading = reading_at(shot, uv=((i + 0.5) / width, (j + 0.5) / height))
        if reading is None:
            continue
        grey = to_display(np.full(3, reading.radiance), 0.0, "clip")[0]
        low, high = around.min(), around.max()
        assert low - 2 <= grey <= high + 2
        compared += 1
        values.add(int(grey) // 16)
    assert compared > 40 and len(values) > 1
