"""Lights of scene files: panels, and values changed one by one."""

from pathlib import Path

import numpy as np
import pytest

from gi_core.files.formats.boundary import Boundary
from gi_core.files.formats.toml_fields import Table
from gi_core.files.formats.toml_file import COSINE, GAMMAS, PLANES, Luminaires, changed_light, read_light
from gi_core.lights.photometric import flux_of
from gi_core.scene import PointLight, SkyLight, SpotLight
from gi_core.scene.errors import SceneError

PANEL = {"type": "panel", "position": [1, 2, 3], "direction": [0, -2, 0], "flux": [1, 2, 3], "size": [0.6, 0.3]}


def read(values: dict):
    here = Luminaires(Path(), Boundary(Path()), "radiometric", (0.0, 1.0, 0.0))
    return read_light(values, "light", "light 0", here)


def test_a_panel_has_constant_luminance():
    light = read(PANEL)
    assert light.name == "light 0" and light.size == (0.6, 0.3) and light.flux == (1, 2, 3) and light.c0 == (1, 0, 0)
    between = np.linspace(0, 90, 1234)
    cosine = np.cos(np.radians(between))
    assert np.abs(np.interp(between, GAMMAS, COSINE[0]) - cosine).max() < 4e-5
    assert flux_of(GAMMAS, PLANES, COSINE) == pytest.approx(np.pi, rel=1e-4)


@pytest.mark.parametrize(
    ("light", "values", "changed"),
    [
        (PointLight("a", (0, 0, 0), (1, 1, 1)), {"flux": [1, 2, 3]}, {"flux": (1, 2, 3)}),
        (SpotLight("a", (0, 0, 0), (0, 0, 1), (1, 1, 1), 5, 10), {"outer_degrees": 20}, {"outer_degrees": 20.0}),
        (SkyLight("a", (1, 1, 1)), {"radiance": [0, 0, 1]}, {"radiance": (0, 0, 1)}),
        (read(PANEL), {"size": [0.1, 0.2], "c0": [0, 0, 1]}, {"size": (0.1, 0.2), "c0": (0, 0, 1)}),
    ],
)
def test_given_values_replace_a_lights_own(light, values, changed):
    assert changed_light(light, Table(values, "light", None)) == light._replace(**changed)
    with pytest.raises(SceneError, match="unknown key 'name'"):
        changed_light(light, Table({"name": "b"}, "light", None))
