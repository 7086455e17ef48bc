"""The viewport: input goes to camera, mobiles and pins; the picture is drawn.

Mouse input depends on the window's hover state: inside a window `io.want_capture_mouse` is always true. A drag goes on
when the cursor leaves the viewport.
"""

from __future__ import annotations

import math

import numpy as np
from imgui_bundle import imgui

from app.draw.camera import Turntable
from app.draw.legend import Legend, of_scale
from app.draw.picking import Hit
from app.draw.renderer import Look, Renderer
from app.draw.tonemap import NEUTRAL
from app.session.lights import LightId
from app.session.open_scene import Finished
from app.session.picture import Picture
from app.session.session import Session
from app.settings import FALSE_COLOURS
from app.window import drag
from app.window.camera_control import LOOK, ORBIT, PAN, CameraControl, View
from app.window.drag import MobileDrag
from app.window.lamp_handles import LampHandles
from app.window.legend import ScaleFit, of_errors
from app.window.pointer import Pins, Pointer, pick
from app.window.view_content import Shown
from gi_core.scene.types import UNITS, part_named

BESIDE = 1e-3  # of the scene's size: a point so far before a surface
FADING_SECONDS, FADING_STEPS = 0.5, 4  # of the outline of a surface, with a picture per step


class Viewport:
    """`handle_input`, then `draw` once per frame; `adopt` with each session."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.view = View()
        self.control = CameraControl(self.view)
        self.pointer = Pointer()
        self.pins = Pins()
        self.mobile_drag = MobileDrag()
        self.lamps = LampHandles()
        self.scale_fit = ScaleFit()
        self._selection: tuple[str, ...] = ()  # names of mobiles
        self.clicked: Hit | None = None  # place of the selected surface of the static part; None: it has none selected
        self._surface: tuple[str, np.ndarray] | None = None  # material of that surface, and its faces
        self._until = {"outline": 0.0, "name": 0.0}  # s of ImGui's clock: of a surface, of an estimator
        self.chosen_part = ""  # of the mobile pressed last, or chosen in the panel
        self.shown: Shown | None = None  # content of the colour buffers
        self._pressed: tuple[Turntable, Hit | None] | None = None  # camera and static place at a press
        self._drawn: tuple | None = None  # parameters of the last draw
        self.is_redrawn = False  # this frame's picture is not that of the frame before

    def adopt(self, session: Session, keep_view: bool = False) -> None:
        """Show a ready session through the scene's camera; `keep_view`: through the user's, if it was moved.

        Mobiles and lights that an edit adds are then selected.
        """
        appeared = tuple(name for name in session.poses if keep_view and name not in self.session.poses)
        same_faces = keep_view and len(session.scene.static.faces) == len(self.session.scene.static.faces)
        self.clicked, self._pressed = self.clicked if same_faces else None, None
        first = session.model.surfaces.first_receiver
        if keep_view and np.array_equal(first, self.session.model.surfaces.first_receiver):
            session.held_receiver = self.session.held_receiver
        before = self.lamps.selected
        self.lamps.adopt(session, self.session if keep_view else None)
        if self.lamps.selected not in (None, before):
            self.select_lamp(self.lamps.selected)
        self.session = session
        self.shown = self._drawn = self._surface = None
        self.scale_fit.forget()
        self.control.adopt(session, keep_view)
        self.pointer, self.pins = Pointer(), Pins()
        self.mobile_drag = MobileDrag(drag.room_for(self.control.bounds, self.control.lit, session.scene.up))
        if appeared:
            self.select(appeared)
        elif not self.selection and self.clicked is None and self.lamps.selected is None and len(session.poses) == 1:
            self.select(tuple(session.poses))

    @property
    def selection(self) -> tuple[str, ...]:
        """Names of the selected mobiles of this scene, the last selected one last."""
        return tuple(name for name in self._selection if name in self.session.poses)

    def select(self, names: tuple[str, ...]) -> None:
        """Select mobiles, and no place of the static part, nor a lamp."""
        self._selection, self.clicked, self.lamps.selected = names, None, None

    def select_lamp(self, lamp: LightId | None) -> None:
        """Select a lamp by one of its lights, and no mobile."""
        self.select(())
        self.lamps.selected = lamp

    def redraw(self) -> None:
        """Draw again in the next frame; call after other use of the renderer."""
        self._drawn = None

    # Input ------------------------------------------------------------------------------------------

    def handle_input(self, seconds: float) -> None:
        """Read mouse and modifiers of this frame; move the camera and dragged mobiles."""
        view, control = self.view, self.control
        view.origin = tuple(imgui.get_cursor_screen_pos())
        space = imgui.get_content_region_avail()
        view.size = (max(space.x, 1.0), max(space.y, 1.0))
        if view.camera is None:
            return
        io = imgui.get_io()
        hovered = imgui.is_window_hovered() and view.contains(io.mouse_pos)
        control.advance(seconds)
        if self.session.ready and self.shown is not None:
            self.lamps.update(self.session, view, hovered)
        if (grab := self.mobile_drag.grab) is not None:
            self.mobile_drag.follow(self.session, view)
            if self.mobile_drag.grab is None:
                self._select_by(grab)
        elif self.lamps.held is not None:
            self.lamps.follow(self.session, view, self.mobile_drag.room)
        elif control.is_steering:
            if not control.steer(io, seconds):
                self._release()
        elif hovered:
            self.pointer.update(self.session, view, self.shown)
            self._press(io)
        else:
            self.pointer.leave()
        if hovered and io.mouse_wheel:
            control.zoom(io.mouse_wheel)
        self._show_cursor(hovered, io)

    def _press(self, io) -> None:
        """Act on a button that went down in this frame."""
        if imgui.is_mouse_double_clicked(drag.LEFT):
            hit = pick(self.session, self.view, io.mouse_pos)
            if hit is not None:
                self.control.fly_to(self.view.camera.centred(hit.point))
            return
        shift, on_mobile = io.key_shift, self.pointer.hover is not None
        if imgui.is_mouse_clicked(drag.LEFT):
            if self.pins.waiting:
                self.pin()
            elif self.lamps.press(self.session, self.view, drag.mode_of(shift, io.key_alt, io.key_ctrl)):
                self.select_lamp(self.lamps.selected)
            elif self.pins.ask(self.session, self.view):
                pass
            elif on_mobile:
                self._begin_drag(drag.mode_of(shift, io.key_alt, io.key_ctrl))
            else:
                self.control.begin(PAN if shift else ORBIT, drag.LEFT)
                self._pressed = self.view.camera, pick(self.session, self.view, io.mouse_pos)
        elif imgui.is_mouse_clicked(drag.RIGHT):
            # Many window managers take Alt+drag, so the right button does the same.
            if self.lamps.press(self.session, self.view, drag.FACE):
                self.select_lamp(self.lamps.selected)
            elif on_mobile:
                self._begin_drag(drag.FACE)
            else:
                self.control.begin(LOOK, drag.RIGHT)
        elif imgui.is_mouse_clicked(drag.MIDDLE):
            self.control.begin(PAN, drag.MIDDLE)

    def _begin_drag(self, mode: str) -> None:
        """Grab the mobile under the cursor, and with a selected one the whole selection."""
        self.control.stop()
        scene, hover = self.session.scene, self.pointer.hover
        mobile = scene.mobiles[hover.object - 1]
        name = mobile.name
        self.chosen_part = part_named(name, scene.materials[mobile.mesh.face_material[hover.face]].name)
        if name not in self.selection and mode not in (drag.RAISE, drag.TURN):
            self.select((name,))
        moves = self.selection if name in self.selection else (name,)
        self.mobile_drag.begin(self.session, self.view, hover, mode, moves)
        self.clicked = None

    def _select_by(self, grab: drag.Grab) -> None:
        """Select after a drag or a click: Ctrl + click adds or removes an object, Shift + click adds it."""
        name, remaining = grab.mobile, tuple(n for n in self.selection if n != grab.mobile)
        if self.session.poses != self.session.motion.before:
            self.select(self.selection if name in self.selection else (name,))
        elif grab.mode == drag.TURN and name in self.selection:
            self.select(remaining)
        elif grab.mode in (drag.TURN, drag.RAISE):
            self.select((*remaining, name))
        elif grab.mode == drag.SLIDE:
            self.select((name,))
            self._hold_receiver()

    def _release(self) -> None:
        """Select the surface under a click, and no mobile; a click is a press and a release by the same camera.

        With Ctrl or Shift, which select several objects, a click beside them changes nothing.
        """
        io = imgui.get_io()
        if self._pressed is not None and self._pressed[0] == self.view.camera and not (io.key_ctrl or io.key_shift):
            self.select(())
            self.clicked = self._pressed[1]
            self._until["outline"] = imgui.get_time() + 2.0 + FADING_SECONDS
            self._hold_receiver()
        self._pressed = None

    def _hold_receiver(self) -> None:
        """Keep the method at the clicked receiver on show; at the cursor's after a click there again, or beside all."""
        s = self.session
        clicked = s.receiver if s.settings.show_disc else -1
        s.held_receiver = -1 if clicked == s.held_receiver else clicked

    def cancel_drag(self) -> bool:
        """Restore the dragged mobile's pose, or pin nothing; return False without a drag."""
        if self.pins.waiting:
            self.pins.waiting = False
            return True
        return self.lamps.cancel(self.session) or self.mobile_drag.cancel(self.session)

    def pin(self, asks: bool = False) -> None:
        """Pin a read-out to the surface under the cursor, and ask for its origins; without one, the next click does."""
        self.pins.add(self.session, self.view, self.pointer.pointed, asks)

    def place_at(self, mouse) -> Hit | None:
        """Return the surface under a point of the window; None outside of the picture and where there is none."""
        inside = self.view.camera is not None and self.view.contains(mouse)
        return pick(self.session, self.view, mouse) if inside else None

    @property
    def looked_at(self) -> np.ndarray:
        """The point (3,) [m] just before the surface in the middle of the picture, else the one orbited about."""
        session, camera = self.session, self.view.camera
        hit = session.picker.pick(*camera.ray(0.5, 0.5, self.view.aspect), session.pose_list, session.settings.cull)
        at = hit.point if hit is not None else np.array(camera.pivot)
        return at - BESIDE * session.chosen.scene_size * camera.basis()[2]

    @property
    def clicked_material(self) -> str:
        """The material at the place of the static part clicked last; "" without one."""
        scene = self.session.scene
        return "" if self.clicked is None else scene.materials[scene.static.face_material[self.clicked.face]].name

    @property
    def surface(self) -> str:
        """The material clicked last, else the object selected last; "" for neither."""
        return self.clicked_material or (self.selection[-1] if self.selection else "")

    @property
    def parts(self) -> tuple[str, ...]:
        """Parts of the selected object, by material; () for a material of the static part."""
        return () if self.clicked is not None or not self.surface else self.session.parts_of(self.surface)

    @property
    def part(self) -> str:
        """The part chosen, else the first; "" without parts."""
        parts = self.parts
        return self.chosen_part if self.chosen_part in parts else parts[0] if parts else ""

    @property
    def finish(self) -> Finished:
        """The reflection of the selected surface, or of its part."""
        return self.session.finish_of(self.surface, self.clicked is not None, self.part)

    # Drawing ----------------------------------------------------------------------------------------

    @property
    def picture(self) -> Picture:
        """Parameters of the current picture."""
        s = self.session
        scale = self.scale_fit.scale if s.settings.show in FALSE_COLOURS else None
        return Picture(s.settings, self.view.camera, s.version, scale, UNITS[s.scene.units])

    @property
    def legend(self) -> Legend | None:
        """Legend of the current picture; None: it shows light, or how receivers were computed."""
        if self.shown is not None and self.shown.recomputed is not None:
            return None
        if self.shown is not None and self.shown.errors is not None:
            return of_errors(self.shown.errors)
        picture = self.picture
        return None if picture.scale is None else of_scale(picture.scale, picture.units)

    def read(self, at_rest: bool) -> None:
        """Fit the scale of false colours, at rest; read the pins."""
        self.scale_fit.update(self.session, self.view, self.shown, at_rest)
        self.pins.read(self.session, self.shown)

    @property
    def _surface_opacity(self) -> float:
        """Opacity of the selected surface's outline, which would cover a floor with grout lines, or false colours."""
        left = self._until["outline"] - imgui.get_time()
        return math.ceil(FADING_STEPS * min(max(left / FADING_SECONDS, 0.0), 1.0)) / FADING_STEPS

    @property
    def is_fading(self) -> bool:
        """Whether an outline or a name will go without input."""
        outlined = self.clicked is not None and self._surface_opacity > 0
        return outlined or imgui.get_time() < self._until["name"]

    def name_estimator(self) -> None:
        """Write the estimator's name into the picture for a moment."""
        self._until["name"] = imgui.get_time() + 3.0  # s

    def named_estimator(self) -> str:
        """Return the name of an estimator just chosen, and whether the picture is still that of another; "": none."""
        s, now = self.session.settings, imgui.get_time()
        if now >= self._until["name"]:
            return ""
        name = (s.estimator or "").replace("_", " ").capitalize()
        if not self.session.is_current:
            self.name_estimator()
            return f"{name}: computing"
        return f"{name}, photons only" if s.light == "photons" else f"{name}, best available light"

    @property
    def _marked(self) -> tuple[tuple[int, ...], int, str, float]:
        """What has an outline: the selected objects, the one under the cursor, -1: none, the material selected."""
        grab, hover, names = self.mobile_drag.grab, self.pointer.hover, self.session.model.names
        selected = tuple(sorted(1 + names.index(name) for name in self.selection))
        pointed = 1 + names.index(grab.mobile) if grab is not None else hover.object if hover is not None else -1
        material, opacity = self.clicked_material, self._surface_opacity
        return selected, -1 if pointed in selected else pointed, material if opacity else "", opacity

    def _faces_of(self, material: str) -> np.ndarray | None:
        """Return the faces (k,) of the static part of a material, those that an edit changes; None for ""."""
        if not material:
            return None
        if self._surface is None or self._surface[0] != material:
            scene = self.session.scene
            numbers = [k for k, m in enumerate(scene.materials) if m.name == material]
            self._surface = material, np.flatnonzero(np.isin(scene.static.face_material, numbers))
        return self._surface[1]

    def look(self, outlined: bool = True) -> Look:
        """Return the current picture for the renderer."""
        settings, camera, _, scale, _ = self.picture
        near = camera.relative_to(self.session.model.origins[0])
        pixels = imgui.get_style().font_scale_dpi * imgui.get_io().display_framebuffer_scale.y
        selected, pointed, material, opacity = self._marked if outlined else ((), -1, "", 0.0)
        return Look(
            camera.projection(self.view.aspect) @ near.view(),
            self.session.models(),
            settings.exposure or 0.0,
            settings.tone_map,
            settings.cull,
            selected,
            pointed,
            self._faces_of(material),
            opacity,
            2.0 * pixels,
            textured=settings.shows_radiance,
            as_is=self.shown is not None and (self.shown.errors is not None or self.shown.recomputed is not None),
            scale=scale,
            line_scale=pixels,
            gains=self.session.gains if settings.white_balance else NEUTRAL,
            eye=near.eye(),
        )

    def draw(self, renderer: Renderer, light: int) -> None:
        """Show the scene; draw it first if anything has changed. light: version of the renderer's."""
        scale, size = imgui.get_io().display_framebuffer_scale, self.view.size
        renderer.resize(round(size[0] * scale.x), round(size[1] * scale.y))
        wanted = (renderer.size, self._marked, self.picture._replace(light=light))
        self.is_redrawn = wanted != self._drawn
        if self.is_redrawn:
            renderer.draw(self.look())
            self._drawn = wanted
        imgui.image(imgui.ImTextureRef(renderer.texture), size, (0, 1), (1, 0))

    def _show_cursor(self, hovered: bool, io) -> None:
        grab, lamp = self.mobile_drag.grab, self.lamps
        if lamp.takes_mouse and (hovered or lamp.held is not None):
            imgui.set_mouse_cursor(imgui.MouseCursor_.hand)
        elif grab is not None:
            imgui.set_mouse_cursor(_CURSORS[grab.mode])
        elif self.control.is_steering:
            imgui.set_mouse_cursor(imgui.MouseCursor_.resize_all)
        elif hovered and self.pointer.hover is not None:
            imgui.set_mouse_cursor(_CURSORS[drag.mode_of(io.key_shift, io.key_alt, io.key_ctrl)])

    def readout(self) -> str:
        """Return one line about the light under the cursor; "" without a surface there and while the mouse drags."""
        dragging = self.mobile_drag.grab is not None or self.lamps.held is not None or self.control.is_steering
        return "" if dragging or self.pointer.reading is None else self.pointer.reading.text()

    def hint(self) -> str:
        """Return one line about the current drag, or a drag of the hovered mobile; "" for neither."""
        io, grab, hover = imgui.get_io(), self.mobile_drag.grab, self.pointer.hover
        if self.pins.waiting:
            return "Click a surface to pin a read-out  ·  Esc cancels"
        if lamp := self.lamps.hint(drag.mode_of(io.key_shift, io.key_alt, io.key_ctrl)):
            return lamp
        if grab is not None:
            several = len(self.mobile_drag.companions)
            subject = f"{grab.mobile} and {several} more:" if several else grab.mobile
            return f"{subject} {drag.MODES[grab.mode]}  ·  Esc cancels"
        if hover is not None:
            name = self.session.scene.mobiles[hover.object - 1].name
            mode = drag.mode_of(io.key_shift, io.key_alt, io.key_ctrl)
            keys = "" if mode != drag.SLIDE else "  ·  Shift: up and down  ·  Alt: in the image plane  ·  Ctrl: turn"
            return f"Drag {name}: {drag.MODES[mode]}{keys}"
        return ""


_CURSORS = {
    drag.SLIDE: imgui.MouseCursor_.resize_all,
    drag.RAISE: imgui.MouseCursor_.resize_ns,
    drag.FACE: imgui.MouseCursor_.hand,
    drag.TURN: imgui.MouseCursor_.resize_ew,
}
