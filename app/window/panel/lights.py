"""The selected lamp: place, aim, beam and size of its light; lamps added, copied and removed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from imgui_bundle import imgui

from app.session.lights import BULB, NEW, PANEL, SKY, SPOT, SUN, Directed, LightId, aim_of, aimed, beam
from app.session.session import Session
from app.window.panel import widgets as ui
from app.window.parts import Window
from gi_core.lights.lamps import OTHERS
from gi_core.scene.errors import utf8
from gi_core.scene.pose import three
from gi_core.scene.types import DirectionalLight, Light, PhotometricLight, PlacedLight, PointLight, SpotLight

if TYPE_CHECKING:
    from gi_core.files.edits import Values

KINDS = {
    BULB: "A point that shines equally in all directions.",
    SPOT: "A point that shines into a cone.",
    PANEL: "A rectangle of constant luminance, as a ceiling panel.",
    SUN: "Parallel light.",
    SKY: "An overcast sky: a dome of constant luminance. Rooms need an opening.",
}
FILE = "from a file..."
AIM = {
    "Tilt": "Angle from straight down",
    "Heading": "Angle about the vertical",
    "Turn": "Angle about the lamp's own axis",  # of luminaires alone
}
CONE = {
    "Inner cone": "Angle from the axis up to which the light is full",
    "Outer cone": "Angle from the axis at which the light ends",
}

_headings: dict[LightId, float] = {}  # last heading: straight down has none
_held = [False]  # a field: its next value belongs to the same step of undo


class ChangeLight(NamedTuple):
    """Request to change a light; not `first`: the next value of a field that is still held."""

    light: LightId
    values: Values
    first: bool = True


class SelectLamp(NamedTuple):
    """Request to select a lamp by one of its lights; None: none."""

    light: LightId | None


class AddLamp(NamedTuple):
    """Request to add a lamp of a kind of NEW, or FILE."""

    kind: str


def draw(window: Window, actions: set[Any]) -> None:
    """Draw the selected lamp, and the buttons that add, copy and remove lamps."""
    session, selected = window.session, window.viewport.lamps.selected
    if selected is not None:
        light = session.lights.get(selected)
        imgui.push_id("light")
        if light is not None:
            _light(selected, light, session, actions)
        imgui.pop_id()
    half = (imgui.get_content_region_avail().x - imgui.get_style().item_spacing.x) / 2
    if selected is not None and selected.name != OTHERS:
        _buttons(selected in session.lights, actions, half)
    imgui.set_next_item_width(-1)
    if imgui.begin_combo("##Add lamp", "Add a lamp..."):
        for kind in (*NEW, FILE):
            if imgui.selectable(kind.capitalize(), False)[0]:
                actions.add(AddLamp(kind))
            ui.tip(KINDS.get(kind, "A luminaire by its maker's IES or EULUMDAT file (.ies, .ldt)."))
        imgui.end_combo()
    ui.tip("It hangs below the ceiling over the middle of the picture, or over the surface clicked last. Photometric "
           "files may be dropped on the picture too.")  # fmt: skip


def head(lamp: LightId, session: Session, actions: set[Any]) -> None:
    """Name the selected lamp and the kind of its light; of several lights, choose one."""
    kind = "the weaker ones together" if lamp.name == OTHERS else _kind(session.lights.get(lamp))
    ui.number(lamp.name, kind, "Selected lamp, and its kind. Click its row to select none.")
    several = [light for light in session.lights if light.name == lamp.name]
    if len(several) > 1:
        ui.label("Light")
        if imgui.begin_combo("##which", f"{lamp.number} of {len(several)}"):
            for light in several:
                if imgui.selectable(f"{light.number} of {len(several)}", light == lamp)[0]:
                    actions.add(SelectLamp(light))
            imgui.end_combo()
        ui.tip("Lights of one name are one lamp. Each has its own place.")


def _kind(light: Light | None) -> str:
    match light:
        case None:
            return "surfaces that shine"
        case PointLight():
            return BULB
        case SpotLight():
            return SPOT
        case PhotometricLight():
            from gi_core.files.formats.lights_table import COSINE

            return PANEL if light.intensity is COSINE else "photometric"
        case DirectionalLight():
            return SUN
    return SKY


def _light(lamp: LightId, light: Light, session: Session, actions: set[Any]) -> None:
    if isinstance(light, PlacedLight):
        values, *done = ui.fields("Position", light.position, ui.SPEED * session.chosen.scene_size, "%.3f")
        ui.tip("Position [m]: x, y, z. Drag, or double-click to type. In the picture, drag the lamp's mark.")
        _changed(lamp, (("position", three(values)),), done, actions)
    if isinstance(light, Directed):
        tilt, heading, turn = aim_of(light, session.scene.up, _headings.get(lamp, 0.0))
        _headings[lamp] = heading
        angles = [tilt, heading, turn]
        for k, (name, about) in enumerate(AIM.items()):
            if name == "Turn" and not isinstance(light, PhotometricLight):
                continue
            (angles[k],), *done = ui.fields(name, angles[k : k + 1], 0.5, "%.1f°", ("angle",))
            ui.tip(f"{about} [degrees]. In the picture, drag the ring where the lamp's axis meets a surface.")
            if done[0]:
                _headings[lamp] = angles[1]
            tilt, heading, turn = angles
            _changed(lamp, aimed(light, tilt, heading, turn, session.scene.up), done, actions)
    if isinstance(light, SpotLight):
        cone = [light.inner_degrees, light.outer_degrees]
        for k, (name, about) in enumerate(CONE.items()):
            (cone[k],), *done = ui.fields(name, cone[k : k + 1], 0.2, "%.1f°", ("angle",))
            ui.tip(f"{about} [degrees]. The flux stays.")
            _changed(lamp, beam(light, *cone), done, actions)
    if isinstance(light, PhotometricLight):
        values, *done = ui.fields("Size", light.size, ui.SPEED * session.chosen.scene_size, "%.3f m", ("C0", "C90"))
        ui.tip("Sides [m] of the rectangle that shines; 0 and 0: a point.")
        a, b = (max(v, 0.0) for v in values)
        sides = (a, b) if a == b == 0 else (max(a, ui.LEAST_SIDE), max(b, ui.LEAST_SIDE))
        _changed(lamp, (("size", sides),), done, actions)
        ui.label("File")
        file = session.file_of(lamp)
        if imgui.button((utf8(Path(file).name) if file else "Choose...") + "###file", (-1, 0)):
            actions.add("lamp file")
        ui.tip("Give this lamp the distribution of an IES or EULUMDAT file (.ies, .ldt).")


def _changed(lamp: LightId, values: Values, done: list[bool], actions: set[Any]) -> None:
    edited, begins, _ = done
    _held[0] &= not begins
    if edited:
        actions.add(ChangeLight(lamp, values, first=not _held[0]))
        _held[0] = True


def _buttons(has_place: bool, actions: set[Any], half: float) -> None:
    if has_place:
        if imgui.button("Duplicate lamp", (half, 0)):
            actions.add("duplicate lamp")
        ui.tip("Put a copy of the lamp beside it.")
    else:
        if imgui.button("Make movable###lamp", (half, 0)):
            actions.add("replace lamp")
        ui.tip("Put a panel of the same flux and size in place of the light of these surfaces: it can be moved and "
               "turned. The surfaces stay, dark.")  # fmt: skip
    imgui.same_line()
    if imgui.button("Remove lamp", (-1, 0)):
        actions.add("remove lamp")
    ui.tip("Remove the lamp. Surfaces that shine stay, dark.")
