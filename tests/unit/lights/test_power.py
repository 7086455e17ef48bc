"""Electric power and maintained light by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from app.rest.calculation_surface import maintained_levels, surface_steps
from app.rest.surface_grid import level_of
from app.session.readouts import per_100_lux
from app.settings import Settings
from gi_core.files.formats.boundary import Boundary
from gi_core.files.formats.photometry_file import read_photometry
from gi_core.files.load import load_scene
from gi_core.lights.power import Power, power_of
from gi_core.model import Model
from gi_core.scene import CalculationSurface
from gi_core.scene.types import PHOTOMETRIC
from tests.support.photometry import write_ies, write_ldt
from tests.support.toml_rooms import room_file, table

LAMPS = (
    table("light", type="point", name="bulb", position=(0, 0, 2.5), flux=(1000,) * 3),
    *(table("light", type="photometric", name=name, file="down.ies", position=at, direction=(0, 0, -1))
      for name, at in (("down", (1, 1, 2.5)), ("down 2", (-1, 1, 2.5)))),
)  # fmt: skip


@pytest.fixture
def room(tmp_path):
    write_ies(tmp_path / "down.ies", [0.0, 45.0, 90.0], [0.0], np.array([[500.0, 300.0, 0.0]]))
    stated = {"maintenance_factor": 0.8, "watts": {"bulb": 12.5}}
    return lambda *more, **keys: load_scene(room_file(tmp_path, (5, 4, 3), *LAMPS, *more, **(stated | keys)))


def test_photometric_files_state_watts(tmp_path):
    gammas, table = [0.0, 45.0, 90.0], np.array([[500.0, 300.0, 0.0]])
    for file in (
        write_ies(tmp_path / "a.ies", gammas, [0.0], table),
        write_ldt(tmp_path / "a.ldt", 1, gammas, [0.0], table),
    ):
        watts = read_photometry(file, file.name, Boundary(tmp_path)).watts
        assert watts == {".ies": 50.0, ".ldt": 40.0}[file.suffix]
    text = file.read_text().splitlines()
    text[31] = "unknown"
    file.write_text("\n".join(text))
    assert read_photometry(file, file.name, Boundary(tmp_path)).watts == 0.0


def test_power_by_hand(room):
    scene, of_file = room(), 50.0
    assert scene.watts == (("bulb", 12.5),)
    model = Model(scene)
    level, levels = level_of(model), model.emitters.lamps.full()
    assert level.area == pytest.approx(20.0)
    whole = power_of(model.emitters, scene, levels, (), level.area)
    assert whole.total == pytest.approx(12.5 + 2 * of_file) and whole.unknown == ()
    assert whole.per_area == pytest.approx(whole.total / 20)
    levels[model.emitters.lamps.names.index("bulb")] = 0.4
    own = power_of(model.emitters, scene, levels, (("down", 40.0),), level.area)
    assert own.of_lamp == pytest.approx({"bulb": 5.0, "down": 40.0, "down 2": of_file})
    bare = power_of(model.emitters, replace(scene, watts=()), levels, (), level.area)
    assert bare.unknown == ("bulb",)


def test_maintained_light_is_that_of_lamps_times_the_factor(room):
    """The sky's light, which needs no cleaning of lamps, stays; EN 12464-1 asks for maintained illuminance."""
    opening = {"wall": "ceiling", "position": (-1, -1), "size": (2, 2)}
    scene = room(table("light", type="sky", radiance=(100,) * 3), room={"openings": [opening]})
    model = Model(scene)
    names, level = model.emitters.lamps.names, level_of(model)
    full = model.emitters.lamps.full()
    surface = CalculationSurface("a", "", (0, 0), (1, 1), 0.75, points=(2, 2))

    def mean(levels) -> float:
        *_, light = surface_steps(model, surface, level, {}, levels, 0, 0.01)
        return light.numbers.mean[0]

    dark = full * np.array([[name == "light 4"] for name in names])
    whole, daylight = mean(full), mean(dark)
    kept = mean(maintained_levels(model, full, Settings()))
    assert daylight > 0.1 * whole and kept == pytest.approx(daylight + 0.8 * (whole - daylight), rel=0.02)
    assert mean(maintained_levels(model, full, Settings(maintenance_factor=1.0))) == whole


def test_power_per_100_lux_needs_the_watts_of_all_lamps():
    """Lamps without known watts made a room of 663 lx look like one of 0.03 W/m2 per 100 lx."""
    light = SimpleNamespace(numbers=SimpleNamespace(mean=(200.0, 1.0)), surface=CalculationSurface("desk"))
    one = Power({"bulb": 30.0}, (), 10.0)
    assert per_100_lux(one, light, PHOTOMETRIC).startswith("1.5")
    assert per_100_lux(one._replace(unknown=("panel",)), light, PHOTOMETRIC) == ""
