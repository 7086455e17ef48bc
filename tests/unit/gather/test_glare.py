"""UGR by hand, and of a luminaire against an emissive face."""

import math

import numpy as np
import pytest

from app.rest.calculation_surface import surface_steps
from app.rest.hold import Inputs, measured_steps, result_of
from app.rest.surface_grid import level_of
from app.session.readouts import described, judged
from app.session.report import _plan
from gi_core.files.load import load_scene
from gi_core.gather.glare import glare
from gi_core.model import Model
from gi_core.scene import CalculationSurface, SceneError
from gi_core.scene.types import UGR, UNITS
from tests.support.photometry import write_ies
from tests.support.toml_rooms import room_file, table

EYE, UP, VIEW = np.array([[0.0, 0.0, 1.2]]), np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
PANEL = table(
    "shape", type="plane", name="panel", size=(0.1, 0.1), position=(2, 0.5, 2.2), axis=(1, 0, 0), angle=180
)  # fmt: skip


def room(folder, kind: str, size=(0.1, 0.1)):
    """Return a room with a panel of 0.01 m2 and 3,000 cd/m2, 2 m ahead of the eye, 0.5 m aside, 1 m above.

    kind: "face" or "luminaire".
    """
    gammas = np.arange(0.0, 91.0)
    write_ies(folder / "lambert.ies", gammas, [0.0], 30.0 * np.cos(np.radians(gammas))[None])  # cd
    light = {"type": "photometric", "name": "panel", "file": "lambert.ies", "position": (2, 0.5, 2.2)}
    thing = PANEL if kind == "face" else table("light", **light, direction=(0, 0, -1), size=size)
    materials = {"room": {"reflectance": (0.5,) * 3}}
    if kind == "face":
        materials["panel"] = {"emission": (3000,) * 3}
    return Model(load_scene(room_file(folder, (8, 6, 3), thing, materials=materials)))


@pytest.mark.parametrize("kind", ["face", "luminaire"])
def test_glare_is_that_of_a_calculation_by_hand(tmp_path, kind):
    """d2 = 5.25 m2, cosine at the panel 0.4364: w = 8.313e-4 sr, 26.57 and 29.21 degrees, p = 2.724."""
    model = room(tmp_path, kind)
    levels = model.emitters.lamps.full()
    found = glare(model, levels, EYE, VIEW, UP, {}, 1)
    assert found.sources == pytest.approx([3000**2 * 8.313e-4 / 2.7244**2], rel=0.01)
    assert found.direct == pytest.approx([3000 * 8.313e-4 * 0.8729], rel=0.01)
    assert found.rating(found.direct + math.pi * 50.0) == pytest.approx([5.62], abs=0.03)  # a background of 50 cd/m2
    assert found.deviation(found.direct + 100.0, np.array([1.0])) == pytest.approx([8 / math.log(10) / 100])
    assert np.isnan(found.rating(found.direct)).all(), "no background"
    for away in (-VIEW, np.array([0.0, 0.0, -1.0])):
        assert not glare(model, levels, EYE, away, UP, {}, 1).sources.any(), "behind the eye"
    off = glare(model, 0 * levels, EYE, VIEW, UP, {}, 1)
    assert not off.sources.any() and not off.rating(np.zeros(1)).any(), "switched off: nothing glares in the dark"


def test_a_point_of_light_has_no_luminance(tmp_path):
    model = room(tmp_path, "luminaire", (0, 0))
    found = glare(model, model.emitters.lamps.full(), EYE, VIEW, UP, {}, 1)
    assert not found.sources.any() and not found.direct.any()


def test_a_surface_rates_glare_where_eyes_are(tmp_path):
    """The panel is ahead of eyes that look along x, at 1.2 m; turned round they do not see it."""
    model = room(tmp_path, "face")
    level = level_of(model)

    def measured(turn: float, views: int = 1):
        s = CalculationSurface("seat", "", (-1.0, 0.0), (0.2, 0.2), turn=turn, points=(1, 1), quantity=UGR, views=views)
        *_, light = surface_steps(model, s, level, {}, model.emitters.lamps.full(), 0, 0.02)
        return light

    ahead, behind = measured(0.0), measured(180.0)
    assert ahead.grid.positions[0] == pytest.approx([-1.0, 0.0, 1.2], abs=0.01)
    assert ahead.values[0] > 10 and 0 < ahead.errors[0] < 0.5 and behind.values[0] == 0
    assert [row[0] for row in ahead.rows()] == ["mean", "minimum", "maximum"]
    worst, aside = measured(180.0, 2), measured(90.0, 2)
    assert (
        worst.values == pytest.approx(ahead.values, abs=4 * ahead.errors[0]) and aside.values[0] < worst.values[0] - 1
    )
    assert np.array_equal(worst.grid.positions, behind.grid.positions) and worst.errors[0] < 0.5
    assert described(worst, level).endswith("1 x 1 points, the worst of 2 views")
    assert _plan(worst, "").endswith("up the page.</p>"), "UGR has no unit"
    asked = worst._replace(surface=worst.surface._replace(targets=(("maximum", 28.0),)))
    assert judged(asked, "maximum", UNITS["photometric"]) == "   at most 28: pass"


def test_lamps_hold_the_worst_view(tmp_path):
    """Eyes that look to both sides, the first away from the panel, have the glare of eyes that look at it."""
    model = room(tmp_path, "face")
    full, light = model.emitters.lamps.full(), {}
    desk = CalculationSurface("desk", "", (1.0, 0.0), (0.2, 0.2), points=(1, 1), targets=(("mean", 3.0),))
    for turn, views, most in ((0.0, 1, 28.0), (180.0, 2, 28.0), (180.0, 2, 5.0), (180.0, 1, 5.0)):
        place = {"position": (-1.0, 0.0), "size": (0.2, 0.2), "points": (1, 1), "targets": (("maximum", most),)}
        seat = CalculationSurface("seat", turn=turn, quantity=UGR, views=views, **place)
        *_, (_, (held, grids, unit)) = measured_steps(model, Inputs((seat, desk), 1.0, ()), 0, noise=0.02)
        answer = held.answer(full, held.counts(model.static))
        result = result_of(held, grids, unit, answer)
        light[turn, views, most] = result.lights[0].values
        assert bool(result.missing) == (views == 2 and most == 5.0), (turn, views, most, result.missing)
    ahead, both = light[0.0, 1, 28.0], light[180.0, 2, 28.0]
    assert both.shape == (1,) and both == pytest.approx(ahead, abs=0.3) and ahead[0] > 8


@pytest.mark.parametrize(
    "units, targets, message",
    [("radiometric", {"maximum": 19}, 'UGR needs luminances in cd/m2, got units = "radiometric"'),
     ("photometric", {"U0": 0.6}, "a target of UGR is its maximum, got 'U0'")],
)  # fmt: skip
def test_glare_that_has_no_meaning_is_refused(tmp_path, units, targets, message):
    surface = table("surface", name="s", quantity="UGR", targets=targets)
    with pytest.raises(SceneError) as refused:
        load_scene(room_file(tmp_path, (8, 6, 3), surface, units=units))
    assert message in str(refused.value)


def test_views_are_those_of_eyes(tmp_path):
    for keys, message in (({"views": 4}, "views are those of UGR"), ({"views": 0, "quantity": "UGR"}, "views must be")):
        with pytest.raises(SceneError, match=message):
            load_scene(room_file(tmp_path, (8, 6, 3), table("surface", name="s", **keys)))
