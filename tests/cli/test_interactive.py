"""Python and notebooks: linear pictures as arrays, short reprs, the notebook of the documentation."""

from dataclasses import replace

import numpy as np
import pytest

import app
from app import interactive
from app.draw.tonemap import to_display
from app.session.opening import Before
from app.settings import Settings, UsageError
from gi_core.files.edits import Finish
from gi_core.scene import Camera
from gi_core.solver import Solver
from tests.cli.test_render import card, checkered_room, shot_of
from tests.support.document_examples import ROOT
from tests.support.scene_builders import solve
from tests.support.viewer_support import room

FAST = {"photons": 4000, "radius": 0.06, "light": "photons"}


@pytest.fixture(scope="module")
def solver() -> Solver:
    return solve(room(), photons=4000, radius=0.06)


def test_render_returns_linear_radiance():
    """rho E / pi on a card of known light; nothing beside it."""
    shot = shot_of(card(), Settings(), [np.pi, 2 * np.pi, 0.0])
    picture = app.render(shot.solver, size=(96, 72))
    assert picture.shape == (72, 96, 3) and picture.dtype == np.float32 and not picture[0, 0].any()
    np.testing.assert_allclose(picture[36, 48], [0.5, 0.8, 0.0], rtol=1e-6)


def test_a_scene_is_solved_first_and_drawn_as_render_does(solver):
    """The same light as that of a solver; display values are those of the ray-cast picture, but for edges."""
    linear = app.render(room(), size=(96, 72), **FAST)
    np.testing.assert_array_equal(linear, app.render(solver, size=(96, 72)))
    shot = interactive._shot(solver, Settings(size=(96, 72), tone_map="clip", exposure=0.0, white_balance=False))
    apart = np.abs(to_display(linear, 0.0, "clip").astype(int) - shot.take()).max(axis=2)
    assert (apart[linear.any(axis=2)] > 8).mean() < 0.1


def test_another_camera_sees_another_place(solver):
    above = app.render(solver, Camera((0.5, 0.9, 0.51), (0.5, 0.0, 0.5), 50.0), (48, 48))
    assert above.all(axis=2).mean() > 0.99, "inside the closed room every ray hits"
    assert np.abs(above - app.render(solver, size=(48, 48))).max() > 0.05


def test_reprs_are_short(solver):
    scene = checkered_room()
    assert repr(scene) == '<Scene "room": 770 triangles, 1 lamp, block>'
    assert repr(replace(scene, mobiles=())).endswith("no mobiles>")
    assert repr(solver) == '<Solver of "room", 641 receivers: 4,000 photons, tangent_plane>'
    mobile = scene.mobiles[0]
    things = (scene, scene.static, scene.static.paint, scene.static.paint.textures[0], mobile, mobile.path, solver)
    assert all(len(repr(thing)) < 300 and "array(" not in repr(thing) for thing in things)


def test_show_opens_the_window_with_the_scene(monkeypatch):
    from app.window import viewer, window

    asked = []
    monkeypatch.setattr(window, "why_no_window", lambda: None)
    monkeypatch.setattr(viewer, "run", lambda settings, open_with: asked.append((settings, open_with)) or 0)
    scene = replace(room(), name="mine")
    assert app.show(scene, **FAST) == 0
    ((settings, open_with),) = asked
    opening = open_with(settings)
    opening._thread.join()
    assert opening.problem is None and opening.result.solver.scene.name == "mine"
    assert opening.result.solver.photons == 4000 and settings.scene == "mine"
    results = opening.result.solver.keep_results
    edit = Finish("red", (("reflectance", (0.1, 0.2, 0.3)),))
    after = open_with(replace(opening.result.settings, edits=(edit,)), before=Before(opening.result, results))
    after._thread.join()
    assert after.problem is None and (0.1, 0.2, 0.3) in [m.reflectance for m in after.result.solver.scene.materials]
    monkeypatch.setattr(window, "why_no_window", lambda: "no display")
    with pytest.raises(UsageError, match="no window: no display; app.render draws without one"):
        app.show(scene)


SMALLER = {  # of the notebook, so that it runs within seconds
    "seconds=3)": "seconds=0.1)",
    "(4_096, 16_384, 65_536)": "(4_096, 8_192)",
    "photons=50_000": "photons=10_000",
    "noise=0.02": "noise=0.1",
}


def test_the_notebook_runs_and_draws(tmp_path, monkeypatch):
    """A picture and the chart of the documentation's notebook."""
    import nbformat
    from nbclient import NotebookClient

    monkeypatch.setenv("GI_VIEWER_REFERENCE_DIR", str(tmp_path))
    notebook = nbformat.read(ROOT / "docs" / "notebook.ipynb", as_version=4)
    stored = [pictures_of(cell) for cell in notebook.cells]
    for cell in notebook.cells:
        for large, small in SMALLER.items():
            cell.source = cell.source.replace(large, small)
    assert all(any(small in cell.source for cell in notebook.cells) for small in SMALLER.values())
    NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(ROOT)}}).execute()
    drawn = [pictures_of(cell) for cell in notebook.cells]
    assert drawn == stored and sum(drawn) == 2


def pictures_of(cell) -> int:
    return sum("image/png" in output.get("data", {}) for output in cell.get("outputs", ()))
