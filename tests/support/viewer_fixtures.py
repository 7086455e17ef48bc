"""Fixtures of the tests of the window, and of those that draw in a context without a window."""

import pytest

from gi_core.gather import static
from gi_core.instruments import compile_ahead
from tests.support import viewer_support as support
from tests.support.gl_drawing import EYE, IDENTITY, SIZE
from tests.support.viewer_hand import Hand


@pytest.fixture
def gl():
    reason = support.screenless()
    if reason:
        support.need_gl(reason)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv("GI_VIEWER_REFERENCE_DIR", str(tmp_path / "references"))
    return tmp_path


@pytest.fixture
def rough_light(monkeypatch):
    """Light of 4 % noise is enough at rest."""
    monkeypatch.setattr(static, "ENOUGH", 0.04)


@pytest.fixture
def few_kernels(monkeypatch):
    """Edits compile only the kernels that run."""
    monkeypatch.setattr(compile_ahead, "is_warm", lambda *of: True)


@pytest.fixture
def play(gl, folder):
    """Return a function that runs a script(hand, viewer) in a viewer of the small room."""

    def run(script, settings=support.SETTINGS, open_with=None, quits=False, keep_ini=False):
        from app.window.viewer import Viewer

        viewer = Viewer(settings, open_with or support.opening(support.room()))
        failed = []

        def test(ctx):
            try:
                script(Hand(viewer, ctx), viewer)
            except BaseException as problem:  # the engine would lose the traceback
                failed.append(problem)

        support.drive(viewer, test, quits, keep_ini)
        if failed:
            raise failed[0]
        return viewer

    return run


@pytest.fixture(scope="module")
def ctx():
    context = support.standalone_context()
    yield context
    context.release()


@pytest.fixture
def draw(ctx):
    """Return a function that draws objects and reads the picture back."""
    from app.draw.renderer import Look, Renderer

    def picture(objects, models=None, samples=1, camera=EYE, **look):
        renderer = Renderer(ctx, samples)
        renderer.set_scene(tuple(mesh for mesh, _, _ in objects))
        for o, (_, front, back) in enumerate(objects):
            renderer.set_colours(o, front, back)
        renderer.resize(*SIZE)
        models = tuple(models or [IDENTITY] * len(objects))
        aspect = SIZE[0] / SIZE[1]
        renderer.draw(Look(camera.projection(aspect) @ camera.view(), models, **look))
        return renderer.pixels().copy()

    yield picture
    assert ctx.error == "GL_NO_ERROR"
