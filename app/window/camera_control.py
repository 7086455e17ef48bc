"""Camera control: orbit, pan, look around, fly, zoom; animated flights to views of the scene.

A view is the camera and the picture's place in the window, which relate cursor positions to points of the scene.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from imgui_bundle import imgui

from app.draw.camera import MAX_PITCH, PARALLEL, WIDE, Bounds, Turntable, from_camera, scene_bounds
from app.session.lights import LightId
from app.session.readouts import free_name
from app.session.session import Session
from gi_core.scene.pose import three

CLICK_PIXELS = 2.0  # shorter motions of the mouse are a click


class View:
    """`origin` and `size` [points] of the picture in the window; `camera`: None before the first scene.

    folded: names of calculation surfaces without their points.
    """

    def __init__(self) -> None:
        self.camera: Turntable | None = None
        self.origin = (0.0, 0.0)
        self.size = (1.0, 1.0)
        self.folded: set[str] = set()

    @property
    def aspect(self) -> float:
        return self.size[0] / max(self.size[1], 1)

    def uv(self, mouse) -> tuple[float, float]:
        """Return a point of the window in the picture, (0, 0) top left, (1, 1) bottom right."""
        return (mouse.x - self.origin[0]) / self.size[0], (mouse.y - self.origin[1]) / self.size[1]

    def contains(self, mouse) -> bool:
        """Return whether a point of the window is in the picture."""
        u, v = self.uv(mouse)
        return 0 <= u < 1 and 0 <= v < 1

    def ray(self, mouse) -> tuple[np.ndarray, np.ndarray]:
        """Return origin (3,) [m] and unit direction (3,) of the ray through a point of the window."""
        return self.camera.ray(*self.uv(mouse), self.aspect)

    def on_screen(self, points: np.ndarray) -> list[tuple[float, float] | None]:
        """Return where points (n, 3) [m] are in the window; None behind the eye."""
        matrix = self.camera.projection(self.aspect) @ self.camera.view()
        x, y, _, w = matrix @ np.c_[points, np.ones(len(points))].T
        (left, top), (width, height) = self.origin, self.size
        with np.errstate(divide="ignore", invalid="ignore"):
            across, down = left + width * (x / w + 1) / 2, top + height * (1 - y / w) / 2
        return [(a, b) if near > 0 else None for a, b, near in zip(across.tolist(), down.tolist(), w, strict=True)]


K = imgui.Key
FLY_KEYS = (K.d, K.a), (K.e, K.q), (K.w, K.s)  # right, up, forward, each with its opposite
ORBIT, PAN, LOOK = "orbit", "pan", "look"  # motions by the mouse, methods of Turntable


class CameraControl:
    """Moves the camera of a view: `steer` by the mouse, `fly_to` by an animation."""

    def __init__(self, view: View) -> None:
        self.view = view
        self.session: Session | None = None
        self.home: Turntable | None = None
        self.bounds: Bounds | None = None  # of everything
        self.flight: tuple[Turntable, Turntable, float] | None = None  # start, end, share of the way
        self._motion: tuple[str, int] | None = None  # ORBIT, PAN or LOOK, and the button that is held
        self._mouse = (0.0, 0.0)  # place of the mouse that the camera has followed
        self._is_click = False  # no motion yet

    def adopt(self, session: Session, keep_view: bool) -> None:
        """Show a session through its scene's camera; `keep_view`: through the user's, if it was moved."""
        stays = keep_view and self.view.camera != self.home
        self.session, self.flight, self._motion = session, None, None
        self.bounds = scene_bounds(session.model, session.poses)
        self.home = from_camera(session.scene.camera, session.scene.up, self.bounds, self.lit)
        self.view.camera = self.view.camera if stays else self.home

    @property
    def lit(self) -> Bounds:
        """The box that light reaches; a ground slab may be far larger."""
        return Bounds(tuple(self.session.chosen.low), tuple(self.session.chosen.high))

    # The mouse --------------------------------------------------------------------------------------

    @property
    def is_steering(self) -> bool:
        """Whether a button is held that moves the camera."""
        return self._motion is not None

    @property
    def is_looking(self) -> bool:
        """Whether the letters fly the camera: while the right button looks around."""
        return self._motion is not None and self._motion[0] == LOOK

    @property
    def is_moving(self) -> bool:
        return self.flight is not None or self.is_steering

    def begin(self, motion: str, button: int) -> None:
        """Steer until the button is released."""
        self.flight, self._motion = None, (motion, button)
        self._mouse, self._is_click = tuple(imgui.get_mouse_pos()), True

    def steer(self, io, seconds: float) -> bool:
        """Follow mouse and letters for a frame; return False in the frame in which the button is released.

        That frame has the motion up to the release: a quick one is in no other. A click leaves the camera as it is.
        """
        motion, button = self._motion
        view, (x, y) = self.view, self._mouse
        dx, dy = io.mouse_pos.x - x, io.mouse_pos.y - y
        self._is_click &= math.hypot(dx, dy) < CLICK_PIXELS
        if imgui.is_mouse_pos_valid() and not self._is_click and (dx or dy):
            view.camera = getattr(view.camera, motion)(dx / view.size[1], dy / view.size[1])
            self._mouse = tuple(io.mouse_pos)
        if not imgui.is_mouse_down(button):
            self._motion = None
            return False
        if self.is_looking and not io.want_text_input:
            speed = (2.4 if io.key_shift else 0.6) * self.lit.radius * seconds
            lengths = [speed * (imgui.is_key_down(a) - imgui.is_key_down(b)) for a, b in FLY_KEYS]
            if any(lengths):
                view.camera = view.camera.fly(*lengths)
        return True

    def zoom(self, notches: float) -> None:
        """Approach the pivot by notches of the wheel."""
        self.stop()
        self.view.camera = self.view.camera.dolly(notches)

    # Flights ----------------------------------------------------------------------------------------

    def fly_to(self, camera: Turntable) -> None:
        self.flight = (self.view.camera, camera, 0.0)

    def go_home(self) -> None:
        self.fly_to(self.home)

    def advance(self, seconds: float) -> None:
        """Continue a flight."""
        if self.flight is None:
            return
        start, end, t = self.flight
        t += seconds / 0.35
        self.view.camera = start.towards(end, t)
        self.flight = (start, end, t) if t < 1 else None

    def stop(self) -> None:
        """Break a flight off."""
        self.flight = None

    def frame(self, names: tuple[str, ...], lamp: LightId | None) -> None:
        """Show objects by name, else a lamp, or everything without either, from the present direction."""
        s, camera, bounds, margin = self.session, self.view.camera, self.lit, 1.0
        box = s.box_of(names) if names else s.box_of_lamp(lamp) if lamp is not None else None
        if box is not None:
            # 1.6 of the distance at which an object just fits
            bounds, margin = Bounds(three(box[0]), three(box[1])), 1.6
        distance = margin * bounds.radius / math.sin(camera.fov / 2)
        self.fly_to(replace(camera, pivot=three(bounds.centre), distance=distance))

    def look_along(self, quarter_turns: int | None) -> None:
        """Show everything along an axis: None from above, else turned from the front."""
        camera, lit, quarter = self.view.camera, self.lit, math.pi / 2
        yaw = quarter * (round(self.home.yaw / quarter) + (quarter_turns or 0))
        distance = lit.radius / math.sin(camera.fov / 2)
        pitch = float(MAX_PITCH) if quarter_turns is None else 0.0
        self.fly_to(replace(camera, pivot=three(lit.centre), distance=distance, yaw=yaw, pitch=pitch))

    def toggle_parallel(self) -> None:
        """Change between a parallel view and perspective; things at the orbit centre keep their size."""
        self.stop()
        camera = self.view.camera
        wide = self.home.fov if not self.home.is_parallel else WIDE
        self.view.camera = camera.with_fov(wide if camera.is_parallel else PARALLEL)

    def bookmark(self) -> str:
        """Keep the present view under a name; return the name."""
        s = self.session
        name = free_name((name for name, _ in s.settings.cameras), "view")
        s.edit(cameras=(*s.settings.cameras, (name, self.view.camera.as_camera())))
        return name

    def show_bookmark(self, k: int) -> None:
        """Fly to a kept view; nothing happens without that many."""
        views = self.session.settings.cameras
        if k < len(views):
            self.fly_to(from_camera(views[k][1], self.session.scene.up, self.bounds, self.lit))
