"""The painter: a session's light, or a first look at a scene, becomes vertex colours, then the picture."""

from __future__ import annotations

import moderngl
from imgui_bundle import imgui

from app.draw.bare_lights import bare_lights, light_faces
from app.draw.gl_textures import is_software
from app.draw.renderer import SAMPLES, Look, Renderer
from app.draw.tonemap import NEUTRAL
from app.draw.vertex_colours import colours, weights
from app.session.first_look import FirstLook
from app.session.session import Session
from app.settings import Settings
from app.window import view_content, window
from app.window.method_marks import RayCells
from app.window.viewport import Viewport


class Painter:
    """`open` with the window, `adopt` with each session, `draw` once per frame."""

    def __init__(self) -> None:
        self.ctx: moderngl.Context | None = None  # of the window
        self.renderer: Renderer | None = None  # None before the first scene or look
        self.software = False
        self.look: FirstLook | None = None  # in the colour buffers, before the first scene
        self._look_size: tuple | None = None  # of its last picture
        self.ray_cells = RayCells()  # over the picture
        self.uploaded = 0  # session.version in the colour buffers
        self._quiet = 0  # frames since the last change

    def open(self) -> None:
        """Draw by the current context of OpenGL."""
        self.ctx = window.current_context()
        self.software = is_software(self.ctx)

    def adopt(self, session: Session) -> None:
        """Draw the meshes of a session."""
        self._prepared().set_scene(session.meshes)
        self.uploaded = 0

    def draw_look(self, look: FirstLook, settings: Settings) -> None:
        """Draw a first look at a scene that opens into the current window, which it fills."""
        renderer = self._prepared()
        if self.look is not look:
            if self.look is None:
                renderer.set_scene(look.meshes)
            for o, mesh in enumerate(look.meshes):
                light = weights(mesh, look.drawn.weights)
                renderer.set_colours(o, *colours(mesh, look.drawn.irradiance, with_reflectance=True), light)
            self.look, self._look_size = look, None
        space = imgui.get_content_region_avail()
        width, height = max(space.x, 1.0), max(space.y, 1.0)
        scale = imgui.get_io().display_framebuffer_scale
        renderer.resize(round(width * scale.x), round(height * scale.y))
        if renderer.size != self._look_size:
            view = look.camera.projection(width / height) @ look.camera.relative_to(look.origin).view()
            gains = look.gains if settings.white_balance else NEUTRAL
            renderer.draw(Look(view, look.models, look.exposure, settings.tone_map, settings.cull, gains=gains))
            self._look_size = renderer.size
        imgui.image(imgui.ImTextureRef(renderer.texture), (width, height), (0, 1), (1, 0))

    def _prepared(self) -> Renderer:
        if self.renderer is None:
            self.renderer = Renderer(self.ctx, 1 if self.software else SAMPLES)
        return self.renderer

    def draw(self, session: Session, viewport: Viewport, holds: bool = False) -> None:
        """Draw the light of this frame.

        holds: light stays as it was last drawn, if this scene has been drawn.
        """
        changed = self.uploaded != session.version and not (holds and self.uploaded)
        busy = changed or session.refining or session.has_objects_moving or viewport.control.is_moving
        self._quiet = 0 if busy else self._quiet + 1
        if changed:
            self._upload(session, viewport)
            self.uploaded = session.version
        viewport.read(at_rest=not busy)
        viewport.draw(self.renderer, self.uploaded)

    @property
    def is_done(self) -> bool:
        """Whether the next frame would draw the same picture."""
        return self._quiet > 1

    def finish(self) -> None:
        """Wait for the frame, where the processor draws it.

        Without a screen it queues frames, and the next upload would wait for all of them.
        """
        if self.software:
            self.ctx.finish()

    def _upload(self, session: Session, viewport: Viewport) -> None:
        """Upload meshes, lights, gloss and colours of the light on show."""
        viewport.shown = shown = view_content.shown(session)
        lit = view_content.lit(session, shown)
        self.renderer.set_scene(lit.meshes)
        self.renderer.dim(lit.meshes)
        self.renderer.set_gloss(lit.gloss)
        self.renderer.set_lights(bare_lights(lit))
        self.renderer.set_light_faces(light_faces(session.model, lit.levels))
        colours = view_content.paint(lit, shown.errors, shown.recomputed)
        for o, (painted, weight) in enumerate(zip(colours, lit.weights, strict=True)):
            self.renderer.set_colours(o, *painted, weight)
            self.renderer.set_irradiance(o, lit.drawn.irradiance)
