"""Fixtures that draw in a context without a window."""

import pytest

from tests.support import viewer_support as support
from tests.support.gl_drawing import EYE, IDENTITY, SIZE


@pytest.fixture(scope="module")
def ctx():
    context = support.standalone_context()
    yield context
    context.release()


@pytest.fixture
def draw(ctx):
    """Return a function that draws objects and reads the picture back."""
    from app.draw.renderer import Look, Renderer

    made = []

    def picture(objects, models=None, samples=1, camera=EYE, **look):
        renderer = Renderer(ctx, samples)
        made.append(renderer)
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
    for renderer in made:
        renderer.release()
