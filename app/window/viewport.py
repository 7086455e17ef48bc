"""The viewport: picture, camera control, drags on mobiles.

Mouse input goes by the window's hover state: inside a window `io.want_capture_mouse` is always true. A drag goes on
when the cursor leaves the viewport.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np
from imgui_bundle import imgui

from app.draw.camera import MAX_PITCH, PARALLEL, WIDE, Bounds, Turntable, from_camera, scene_bounds
from app.draw.false_colour import Scale, automatic_scale, fixed_scale
from app.draw.legend import Legend, of_scale
from app.draw.picking import Hit
from app.draw.raycast import visible_irradiance
from app.draw.readout import Pinned, Reading, new_pin, read, read_pin
from app.draw.renderer import Look, Renderer
from app.draw.units import units_of
from app.draw.white_balance import NEUTRAL
from app.session.picture import Picture
from app.session.readouts import free_name
from app.session.session import Session
from app.settings import ILLUMINANCE
from app.window import drag
from app.window.gizmo import Gizmo
from app.window.legend import of_errors
from app.window.view_content import Shown
from app.window.wipe import Wipe
from app.worker import Call, Worker
from gi_core.display.dilation import Drawn
from gi_core.scene import Camera
from gi_core.scene.pose import three

K = imgui.Key
FLY_KEYS = (K.d, K.a), (K.e, K.q), (K.w, K.s)  # right, up, forward, each with its opposite
FLY_SPEED, FLY_FASTER = 0.6, 4.0  # of the lit radius per second; times that with Shift
FIRST_FIT = 0.1  # s that false colours wait for their first scale; later ones are fitted behind the picture
FLIGHT_SECONDS = 0.35  # of a camera animation
THRESHOLD_PIXELS = 2.0  # shorter motions are a click
MARGIN = 1.6  # of the distance at which an object just fits
OUTLINE_PIXELS = 2.0  # at 96 dots per inch
BUTTONS = {"left": 0, "right": 1, "middle": 2}


class Viewport:
    """The camera and the state of the mouse."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.camera: Turntable | None = None
        self.home: Turntable | None = None
        self.bounds: Bounds | None = None  # of everything
        self.room: Bounds | None = None  # limits of drags
        self.selected = ""  # name of a mobile
        self.clicked: Hit | None = None  # place of the static part, unless a mobile was selected since
        self.hover: Hit | None = None  # mobile under the cursor
        self.pointed: Hit | None = None  # surface under the cursor
        self.reading: Reading | None = None  # light there
        self.pinning = False  # the next click pins a read-out
        self.pinned: tuple[Pinned, ...] = ()  # light at the pins
        self._pins_read: tuple | None = None  # arguments of these
        self.grab: drag.Grab | None = None
        self.wipe = Wipe()
        self.gizmo = Gizmo()
        self.shown: Shown | None = None  # content of the colour buffers
        self.scale: Scale | None = None  # of false colours
        self._scaled: tuple | None = None  # arguments of the last scale
        self._fitting: Call | None = None  # the scale under way
        self._worker = Worker("false colours")
        self._seen_from: Turntable | None = None  # camera of the last frame
        self.size = (1.0, 1.0)  # points
        self.origin = (0.0, 0.0)
        self._steering: tuple[str, int] | None = None  # ("orbit" or "pan", button)
        self._pressed: tuple[Turntable, Hit | None] | None = None  # camera and static place at a press
        self._flight: tuple[Turntable, Turntable, float] | None = None
        self._asked: tuple | None = None  # arguments of the last pick
        self._drawn: tuple | None = None  # parameters of the last draw

    def adopt(self, session: Session, keep_view: bool = False) -> None:
        """Show a ready session through the scene's camera; `keep_view`: through the user's, if it was moved."""
        stays = keep_view and self.camera != self.home
        same_faces = keep_view and len(session.scene.static.faces) == len(self.session.scene.static.faces)
        self.clicked, self._pressed = self.clicked if same_faces else None, None
        self.session = session
        self.hover = self.pointed = self.reading = self.grab = self._steering = self._flight = None
        self.shown = self._asked = self._drawn = self._pins_read = None
        self.pinning, self.pinned, self._fitting, self._scaled = False, (), None, None
        self.bounds = scene_bounds(session.model, session.poses)
        if self.selected not in session.poses:
            self.selected = next(iter(session.poses)) if len(session.poses) == 1 else ""
        self.room = drag.room_for(self.bounds, session.scene.up)
        self.home = from_camera(session.scene.camera, session.scene.up, self.bounds, self._lit)
        self.camera = self.camera if stays else self.home

    @property
    def aspect(self) -> float:
        return self.size[0] / max(self.size[1], 1)

    @property
    def is_moving(self) -> bool:
        return self._flight is not None or self._steering is not None

    def redraw(self) -> None:
        """Draw again in the next frame; call after other use of the renderer."""
        self._drawn = None

    def go_home(self) -> None:
        self.fly_to(self.home)

    def fly_to(self, camera: Turntable) -> None:
        self._flight = (self.camera, camera, 0.0)

    def framed(self) -> Turntable:
        """Return a camera that shows the selected object, or everything, from the present direction."""
        s, bounds, margin = self.session, self._lit, 1.0
        if self.selected in s.poses:
            o = 1 + [m.name for m in s.scene.mobiles].index(self.selected)
            points = s.model.vertices_at(o, s.poses)
            bounds, margin = Bounds(three(points.min(axis=0)), three(points.max(axis=0))), MARGIN
        distance = margin * bounds.radius / math.sin(self.camera.fov / 2)
        return replace(self.camera, pivot=three(bounds.centre), distance=distance)

    def toggle_parallel(self) -> None:
        """Change between a parallel view and perspective; things at the orbit centre keep their size."""
        self._flight = None
        wide = self.home.fov if not self.home.is_parallel else WIDE
        self.camera = self.camera.with_fov(wide if self.camera.is_parallel else PARALLEL)

    def bookmark(self) -> str:
        """Keep the present view under a name; return the name."""
        s, c = self.session, self.camera.as_camera()
        name = free_name((name for name, _ in s.settings.cameras), "view")
        view = (*c.position, *c.target, c.vertical_fov_degrees)
        s.edit(cameras=(*s.settings.cameras, (name, view)))
        return name

    def show_bookmark(self, k: int) -> None:
        """Fly to a kept view; nothing happens without that many."""
        views = self.session.settings.cameras
        if k < len(views):
            n = views[k][1]
            camera = Camera((n[0], n[1], n[2]), (n[3], n[4], n[5]), n[6])
            self.fly_to(from_camera(camera, self.session.scene.up, self.bounds, self._lit))

    @property
    def _lit(self) -> Bounds:
        """The box that light reaches; a ground slab may be far larger."""
        return Bounds(tuple(self.session.chosen.low), tuple(self.session.chosen.high))

    def along(self, quarter_turns: int | None) -> Turntable:
        """Return a camera that shows everything along an axis: None from above, else turned from the front."""
        lit = self._lit
        quarter = math.pi / 2
        yaw = quarter * (round(self.home.yaw / quarter) + (quarter_turns or 0))
        distance = lit.radius / math.sin(self.camera.fov / 2)
        pitch = float(MAX_PITCH) if quarter_turns is None else 0.0
        return replace(self.camera, pivot=three(lit.centre), distance=distance, yaw=yaw, pitch=pitch)

    # Input ------------------------------------------------------------------------------------------

    def handle_input(self, seconds: float) -> None:
        """Read mouse and modifiers of this frame and move dragged mobiles."""
        self.origin = tuple(imgui.get_cursor_screen_pos())
        space = imgui.get_content_region_avail()
        self.size = (max(space.x, 1.0), max(space.y, 1.0))
        if self.camera is None:
            return
        io = imgui.get_io()
        hovered = imgui.is_window_hovered() and self._inside(io.mouse_pos)
        self._fly(seconds)
        if self._may_wipe and self.wipe.handle(io, self.origin[0], self.size[0], hovered):
            self._leave()
        elif self.grab is not None:
            self._continue_drag(io)
        elif self._steering is not None:
            self._continue_steering(io, seconds)
        elif hovered:
            self._update_hover(io)
            self._press(io)
        else:
            self._leave()
        if hovered and io.mouse_wheel:
            self._flight = None
            self.camera = self.camera.dolly(io.mouse_wheel)
        self._show_cursor(hovered, io)

    @property
    def _may_wipe(self) -> bool:
        two = self.shown is not None and len(self.shown.sides) == 2
        return two and self.grab is None and self._steering is None

    @property
    def clicked_material(self) -> str:
        """The material at the place of the static part clicked last; "" without one."""
        scene = self.session.scene
        return "" if self.clicked is None else scene.materials[scene.static.face_material[self.clicked.face]].name

    def place_at(self, mouse) -> Hit | None:
        """Return the surface under a point of the window; None outside of the picture and where there is none."""
        return self._pick_at(mouse) if self.camera is not None and self._inside(mouse) else None

    def cancel_drag(self) -> bool:
        """Restore the dragged mobile's pose, or pin nothing; return False without a drag."""
        if self.pinning:
            self.pinning = False
            return True
        if self.grab is None:
            return False
        self.grab = None
        self.session.end_drag(keep=False)
        return True

    def _press(self, io) -> None:
        if self.gizmo.takes_mouse:
            return
        if imgui.is_mouse_double_clicked(0):
            hit = self._pick(io)
            if hit is not None:
                self.fly_to(self.camera.centred(hit.point))
            return
        shift, alt, ctrl = io.key_shift, io.key_alt, io.key_ctrl
        if imgui.is_mouse_clicked(BUTTONS["left"]):
            if self.pinning:
                self.pin()
            elif self.hover is not None:
                self._begin_drag(drag.mode_of(shift, alt, ctrl), io)
            else:
                self._steering = ("pan" if shift else "orbit", BUTTONS["left"])
                self._pressed = self.camera, self._pick(io)
        elif imgui.is_mouse_clicked(BUTTONS["right"]):
            # Many window managers take Alt+drag, so the right button does the same.
            if self.hover is not None:
                self._begin_drag(drag.FACE, io)
            else:
                self._steering = ("look", BUTTONS["right"])
        elif imgui.is_mouse_clicked(BUTTONS["middle"]):
            self._steering = ("pan", BUTTONS["middle"])
        if self._steering is not None:
            self._flight = None

    def _begin_drag(self, mode: str, io) -> None:
        mobile = self.session.scene.mobiles[self.hover.object - 1].name
        u, v = self._uv(io.mouse_pos)
        self._flight = None
        self.selected, self.clicked = mobile, None
        self.session.playing = False
        self.session.begin_drag()
        pose = self.session.poses[mobile]
        box = self.session.model.vertices_at(self.hover.object, self.session.poses)
        self.grab = drag.Grab(mobile, mode, self.hover.point, pose, self.camera, u, v, box.min(axis=0), box.max(axis=0))

    def _continue_drag(self, io) -> None:
        button = BUTTONS["left"] if imgui.is_mouse_down(BUTTONS["left"]) else BUTTONS["right"]
        if imgui.is_mouse_down(button):
            moved = imgui.is_mouse_dragging(button, THRESHOLD_PIXELS) or self.session.poses != self.session.before_drag
            if moved:
                # The camera may have dollied since the press: the ray is of the current camera.
                grab = self.grab._replace(camera=self.camera)
                pose = drag.dragged(grab, *self._uv(io.mouse_pos), self.aspect, self.room)
                if pose != self.session.poses[grab.mobile]:
                    self.session.move({grab.mobile: pose})
        else:
            self.grab = None
            self.session.end_drag()

    @property
    def is_flying(self) -> bool:
        """Whether the letters fly the camera: while the right button looks around."""
        return self._steering is not None and self._steering[0] == "look"

    def _continue_steering(self, io, seconds: float) -> None:
        motion, button = self._steering
        if not imgui.is_mouse_down(button):
            self._steering = None
            if self._pressed is not None and self._pressed[0] == self.camera:  # a click
                self.clicked = self._pressed[1]
            self._pressed = None
            return
        dx, dy = io.mouse_delta.x / self.size[1], io.mouse_delta.y / self.size[1]
        if dx or dy:
            self.camera = getattr(self.camera, motion)(dx, dy)
        if self.is_flying and not io.want_text_input:
            speed = FLY_SPEED * self._lit.radius * (FLY_FASTER if io.key_shift else 1.0) * seconds
            lengths = [speed * (imgui.is_key_down(a) - imgui.is_key_down(b)) for a, b in FLY_KEYS]
            if any(lengths):
                self.camera = self.camera.fly(*lengths)

    def _fly(self, seconds: float) -> None:
        if self._flight is None:
            return
        start, end, t = self._flight
        t += seconds / FLIGHT_SECONDS
        self.camera = start.towards(end, t)
        self._flight = (start, end, t) if t < 1 else None

    # Picking ----------------------------------------------------------------------------------------

    def _update_hover(self, io) -> None:
        asked = (tuple(io.mouse_pos), self.camera, self.session.version, self.session.settings.cull, self.shown is None)
        if asked == self._asked:
            return
        self._asked = asked
        hit = self._pick(io)
        self.pointed, self.hover = hit, hit if hit is not None and hit.object > 0 else None
        self.reading = None if hit is None or self.shown is None else self._read(hit, io)
        self.session.receiver = -1 if hit is None else self._receiver(hit)

    def _receiver(self, hit: Hit) -> int:
        """Return the receiver nearest to a hit, on the side that is seen; -1 on the back of a one-sided face."""
        s = self.session
        surfaces, poses = s.model.surfaces, s.light.snapshot.poses
        vertices = surfaces.faces[hit.object][hit.face]
        corners = s.model.vertices_at(hit.object, poses)[vertices]
        f = surfaces.first_face[hit.object] + hit.face
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        front = normal @ (hit.point - self.camera.eye()) < 0
        nearest = int(np.argmin(((corners - hit.point) ** 2).sum(axis=1)))
        return int((surfaces.corner_front if front else surfaces.corner_back)[f][nearest])

    def _read(self, hit: Hit, io) -> Reading:
        """Return the light of the picture at a hit under the cursor."""
        (u, v), s, sides = self._uv(io.mouse_pos), self.session, self.shown.sides
        side = sides[-1 if u > self.wipe.at else 0]
        _, direction = self.camera.ray(u, v, self.aspect)
        height = round(self.size[1] * io.display_framebuffer_scale.y)
        drawn, mesh = Drawn(side.irradiance, side.weights), s.meshes[hit.object]
        return read(hit, direction, self.camera, height, s.scene, s.model, s.light.snapshot.poses, mesh, drawn)

    def _leave(self) -> None:
        """Forget the point under the cursor."""
        self.hover = self.pointed = self.reading = self._asked = None

    # Pins -------------------------------------------------------------------------------------------

    def pin(self) -> None:
        """Pin a read-out to the surface under the cursor; without one, the next click does."""
        s = self.session
        if self.pointed is None:
            self.pinning = not self.pinning
            return
        self.pinning = False
        pins = s.settings.pins
        direction = self.pointed.point - self.camera.eye()
        name = free_name(pin.name for pin in pins)
        s.edit(pins=(*pins, new_pin(name, self.pointed, direction, s.scene, s.model, s.light.snapshot.poses)))

    def unpin(self) -> None:
        """Remove the pin under the cursor, else the last one."""
        pins = self.session.settings.pins
        if pins:
            k = len(pins) - 1 if self._pin_under_cursor is None else self._pin_under_cursor
            self.session.edit(pins=pins[:k] + pins[k + 1 :])

    @property
    def _pin_under_cursor(self) -> int | None:
        mouse, em = imgui.get_io().mouse_pos, imgui.get_font_size()
        places = self.on_screen(np.array([p.position for p in self.pinned]).reshape(-1, 3))
        for k, at in enumerate(places):
            if at is not None and math.hypot(at[0] - mouse.x, at[1] - mouse.y) < em:
                return k
        return None

    def read_pins(self) -> None:
        """Read the light at the pins, when it or they have changed."""
        s, shown = self.session, self.shown
        asked = s.settings.pins, s.version, shown is None
        if asked == self._pins_read:
            return
        self._pins_read = asked
        side = None if shown is None else shown.sides[0]
        if side is None:
            self.pinned = ()
            return
        drawn, poses = Drawn(side.irradiance, side.weights), s.light.snapshot.poses
        self.pinned = tuple(
            read_pin(pin, s.picker, s.scene, s.model, poses, s.meshes, drawn) for pin in s.settings.pins
        )

    def on_screen(self, points: np.ndarray) -> list[tuple[float, float] | None]:
        """Return where points (n, 3) [m] are in the window; None behind the eye."""
        matrix = self.camera.projection(self.aspect) @ self.camera.view()
        x, y, _, w = matrix @ np.c_[points, np.ones(len(points))].T
        (left, top), (width, height) = self.origin, self.size
        with np.errstate(divide="ignore", invalid="ignore"):
            across, down = left + width * (x / w + 1) / 2, top + height * (1 - y / w) / 2
        return [(a, b) if near > 0 else None for a, b, near in zip(across.tolist(), down.tolist(), w, strict=True)]

    def _pick(self, io) -> Hit | None:
        return self._pick_at(io.mouse_pos)

    def _pick_at(self, mouse) -> Hit | None:
        origin, direction = self.camera.ray(*self._uv(mouse), self.aspect)
        s = self.session
        return s.picker.pick(origin, direction, s.pose_list, s.settings.cull)

    def _uv(self, mouse) -> tuple[float, float]:
        return (mouse.x - self.origin[0]) / self.size[0], (mouse.y - self.origin[1]) / self.size[1]

    def _inside(self, mouse) -> bool:
        u, v = self._uv(mouse)
        return 0 <= u < 1 and 0 <= v < 1

    # Drawing ----------------------------------------------------------------------------------------

    @property
    def picture(self) -> Picture:
        """Parameters of the current picture."""
        split = self.wipe.at if self.shown is not None and len(self.shown.sides) == 2 else None
        s = self.session
        scale = self.scale if s.settings.show == ILLUMINANCE else None
        return Picture(s.settings, self.camera, s.version, split, scale, units_of(s.scene.units))

    @property
    def legend(self) -> Legend | None:
        """Legend of the current picture; None: it shows light."""
        if self.shown is not None and self.shown.errors is not None:
            return of_errors(self.shown.errors)
        picture = self.picture
        return None if picture.scale is None else of_scale(picture.scale, picture.units)

    def rescale(self, at_rest: bool) -> None:
        """Fit the scale of false colours to the picture: at rest, so that colours do not flicker in motion."""
        s, shown = self.session, self.shown
        at_rest, self._seen_from = at_rest and self.camera == self._seen_from, self.camera  # the wheel turns, or not
        if s.settings.show != ILLUMINANCE or shown is None:
            self.scale = self._scaled = self._fitting = None
            return
        given = s.settings.illuminance_range, s.settings.isolines
        asked = s.version, self.camera, self.aspect, s.settings.cull, *given
        if self._fitting is None and asked != self._scaled and (at_rest or self.scale is None):
            self._scaled = asked
            if given[0] is not None:
                self.scale = fixed_scale(*given[0]).with_lines(given[1])
                return
            at, camera = s.model.transforms(s.light.snapshot.poses), self.camera.relative_to(s.model.origins[0])
            drawn, cull = Drawn(shown.sides[0].irradiance, shown.sides[0].weights), s.settings.cull
            self._fitting = self._worker.submit(
                partial(_fitted, s.model.accelerator, at, s.meshes, drawn, camera, self.aspect, cull)
            )
        if self._fitting is not None and self._fitting.wait(FIRST_FIT if self.scale is None else 0.0):
            fitting, self._fitting = self._fitting, None
            self.scale = fitting.result().with_lines(s.settings.isolines)

    @property
    def is_fitting(self) -> bool:
        """Whether a scale of false colours is under way."""
        return self._fitting is not None

    def close(self) -> None:
        """End the thread that fits scales."""
        self._worker.close()

    @property
    def _marked(self) -> int:
        """The object with an outline, -1 for none."""
        if self.grab is not None:
            return 1 + [m.name for m in self.session.scene.mobiles].index(self.grab.mobile)
        return -1 if self.hover is None else self.hover.object

    def look(self, outlined: bool = True) -> Look:
        """Return the current picture for the renderer."""
        settings, camera, _, split, scale, _ = self.picture
        return Look(
            camera.projection(self.aspect) @ camera.relative_to(self.session.model.origins[0]).view(),
            self.session.models(),
            settings.exposure or 0.0,
            settings.tone_map,
            settings.cull,
            self._marked if outlined else -1,
            OUTLINE_PIXELS * imgui.get_style().font_scale_dpi * imgui.get_io().display_framebuffer_scale.y,
            textured=settings.show == "radiance",
            as_is=self.shown is not None and (self.shown.errors is not None or self.shown.recomputed is not None),
            scale=scale,
            line_scale=imgui.get_style().font_scale_dpi * imgui.get_io().display_framebuffer_scale.y,
            split=split,
            gains=self.session.gains if settings.white_balance else NEUTRAL,
            eye=camera.relative_to(self.session.model.origins[0]).eye(),
        )

    def draw(self, renderer: Renderer, samples: int) -> None:
        """Show the scene; draw it first if anything has changed."""
        scale = imgui.get_io().display_framebuffer_scale
        renderer.resize(round(self.size[0] * scale.x), round(self.size[1] * scale.y), samples)
        wanted = (renderer.size, samples, self._marked, self.picture)
        if wanted != self._drawn:
            renderer.draw(self.look())
            self._drawn = wanted
        imgui.image(imgui.ImTextureRef(renderer.texture), self.size, (0, 1), (1, 0))
        self.gizmo.draw(self)

    def _show_cursor(self, hovered: bool, io) -> None:
        C = imgui.MouseCursor_
        if self.grab is not None:
            imgui.set_mouse_cursor(_CURSORS[self.grab.mode])
        elif self._steering is not None:
            imgui.set_mouse_cursor(C.resize_all)
        elif hovered and self.hover is not None:
            imgui.set_mouse_cursor(_CURSORS[drag.mode_of(io.key_shift, io.key_alt, io.key_ctrl)])

    def readout(self) -> str:
        """Return one line about the light under the cursor; "" without a surface there and while the mouse drags."""
        dragging = self.grab is not None or self._steering is not None
        return "" if dragging or self.reading is None else self.reading.text()

    def hint(self) -> str:
        """Return one line about the current drag, or a drag of the hovered mobile; "" for neither."""
        io = imgui.get_io()
        if self.pinning:
            return "Click a surface to pin a read-out  ·  Esc cancels"
        if self.grab is not None:
            return f"{self.grab.mobile} {drag.MODES[self.grab.mode]}  ·  Esc cancels"
        if self.hover is not None:
            name = self.session.scene.mobiles[self.hover.object - 1].name
            mode = drag.mode_of(io.key_shift, io.key_alt, io.key_ctrl)
            others = "" if mode != drag.SLIDE else "  ·  Shift: up and down  ·  Alt: in the image plane  ·  Ctrl: turn"
            return f"Drag {name}: {drag.MODES[mode]}{others}"
        return ""


def _fitted(*view) -> Scale:
    """Return the scale that suits a view; arguments of visible_irradiance()."""
    return automatic_scale(visible_irradiance(*view))


_CURSORS = {
    drag.SLIDE: imgui.MouseCursor_.resize_all,
    drag.RAISE: imgui.MouseCursor_.resize_ns,
    drag.FACE: imgui.MouseCursor_.hand,
    drag.TURN: imgui.MouseCursor_.resize_ew,
}
