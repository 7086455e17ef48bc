"""The first look at a scene, in the viewport while kernels compile; its camera can be moved."""

from __future__ import annotations

from imgui_bundle import imgui

from app.draw.camera import Turntable
from app.draw.renderer import Look, Renderer
from app.draw.vertex_colours import colours, weights
from app.draw.white_balance import NEUTRAL
from app.session.first_look import FirstLook
from app.settings import Settings


class Preview:
    """Draws looks of one scene with the window's renderer."""

    def __init__(self) -> None:
        self.camera: Turntable | None = None  # None: as the scene's
        self._uploaded: FirstLook | None = None
        self._drawn: tuple | None = None  # parameters of the last draw

    def draw(self, renderer: Renderer, look: FirstLook, settings: Settings, samples: int) -> None:
        """Draw a look into the current window, which it fills."""
        if self._uploaded is not look:
            if self._uploaded is None:
                renderer.set_scene(look.meshes)
            for o, mesh in enumerate(look.meshes):
                light = weights(mesh, look.drawn.weights)
                renderer.set_colours(o, *colours(mesh, look.drawn.irradiance, with_reflectance=True), 0, light)
            self._uploaded, self._drawn = look, None
        space, io = imgui.get_content_region_avail(), imgui.get_io()
        width, height = max(space.x, 1.0), max(space.y, 1.0)
        camera = self._moved(self.camera or look.camera, height)
        scale = io.display_framebuffer_scale
        renderer.resize(round(width * scale.x), round(height * scale.y), samples)
        wanted = camera, renderer.size
        if wanted != self._drawn:
            view = camera.projection(width / height) @ camera.relative_to(look.origin).view()
            gains = look.gains if settings.white_balance else NEUTRAL
            renderer.draw(Look(view, look.models, look.exposure, settings.tone_map, settings.cull, gains=gains))
            self._drawn = wanted
        imgui.image(imgui.ImTextureRef(renderer.texture), (width, height), (0, 1), (1, 0))

    def _moved(self, camera: Turntable, height: float) -> Turntable:
        """Return the camera after orbit, pan and zoom of this frame."""
        io = imgui.get_io()
        if not imgui.is_window_hovered():
            return camera
        before = camera
        dx, dy = io.mouse_delta.x / height, io.mouse_delta.y / height
        if imgui.is_mouse_dragging(0):
            camera = camera.pan(dx, dy) if io.key_shift else camera.orbit(dx, dy)
        elif imgui.is_mouse_dragging(2):
            camera = camera.pan(dx, dy)
        if io.mouse_wheel:
            camera = camera.dolly(io.mouse_wheel)
        if camera is not before:
            self.camera = camera
        return camera
