"""Actions on lamps: select, add, change, copy, remove, give the distribution of a photometric file."""

from __future__ import annotations

import os
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from app.session.lights import (
    DAYLIGHT,
    DROP,
    NEW_DAYLIGHT,
    LightId,
    Room,
    in_place_of,
    new_light,
    panel_of_faces,
    photometric,
)
from app.session.log import WARNING
from app.window import dialogs
from app.window.panel.lights import FILE
from app.window.parts import Window
from app.window.viewport import BESIDE
from gi_core.base.vectors import unit
from gi_core.files.completion.pilot import ring
from gi_core.files.edits import Darken, Daylight, Light, Values
from gi_core.files.load import free_name
from gi_core.geometry.error import luminance
from gi_core.lights.daylight import SKY, SUN
from gi_core.lights.lamps import OTHERS
from gi_core.scene.errors import utf8
from gi_core.scene.pose import three
from gi_core.scene.types import PlacedLight


def change(window: Window, light: LightId | None, values: Values) -> None:
    """Change a light, or the daylight (None)."""
    edit = Light(light.name, values, number=light.number) if light is not None else Daylight(values)
    window.session.change_scene(edit)


def add(window: Window, kind: str) -> None:
    """Add a lamp below the ceiling, over the surface clicked last, else over the middle of the picture.

    kind: of `KINDS` of the panel.
    """
    if kind == FILE:
        choose_file(window, None)
    elif kind == DAYLIGHT:
        _add_daylight(window)
    else:
        _add(window, kind, new_light(kind, _room(window)))


def _add_daylight(window: Window) -> None:
    """Add sun and sky, in place of the lights of these names."""
    replaced = [Darken(light.name, 1) for light in window.session.lights if light.name in (SUN, SKY)]
    values = {key: value for key, value in NEW_DAYLIGHT._asdict().items() if value is not None}
    window.session.change_scene(*replaced, Daylight(tuple(values.items())))


def choose_file(window: Window, lamp: LightId | None) -> None:
    """Ask for a photometric file for a lamp, or for a new one."""
    beside, use = window.files.suggestion(window.session), partial(use_file, window, lamp)
    window.files.dialog.open("Choose a luminaire", beside, dialogs.LUMINAIRES, use)


def use_file(window: Window, lamp: LightId | None, name: str, at: np.ndarray | None = None) -> None:
    """Give a lamp the distribution of a photometric file, or add one with it; at (3,) [m]: over this place."""
    file, room = os.path.abspath(os.path.expanduser(name)), _room(window, at)
    if lamp is None:
        _add(window, utf8(Path(file).stem), photometric({}, room), file)
        return
    kept = in_place_of(window.session.lights[lamp], room.photometric)
    window.session.change_scene(Light(lamp.name, photometric(kept, room), file, number=lamp.number))


def choose_file_for_selected(window: Window) -> None:
    lamp = window.viewport.lamps.selected
    if lamp in window.session.lights:
        choose_file(window, lamp)


def duplicate(window: Window) -> None:
    """Put a copy of the selected lamp beside it."""
    session, lamp = window.session, _selected(window)
    if lamp is None:
        return
    light = session.lights.get(lamp)
    if light is None:
        window.log("surfaces that shine cannot be copied; make the lamp movable first", WARNING)
        return
    values: Values = ()
    if isinstance(light, PlacedLight):
        right = window.viewport.view.camera.basis()[0]
        # the copy lies 0.05 of the scene's size aside
        values = (("position", three(np.array(light.position) + 0.05 * session.chosen.scene_size * right)),)
    session.change_scene(Light(_free_name(window, lamp.name), values, of=lamp.name, number=lamp.number))


def remove(window: Window) -> None:
    """Remove the selected lamp; of a lamp of several lights, the selected one."""
    session, lamp = window.session, _selected(window)
    if lamp is None:
        return
    several = sum(other.name == lamp.name for other in session.lights) > 1
    if len(session.model.emitters.lamps.names) == 1 and not several:
        window.log("the last lamp stays: without it there is no light; add another one first", WARNING)
        return
    if session.settings.solo == lamp.name and not several:
        session.want(replace(session.settings, solo=""))  # else all others would stay dark
    session.change_scene(Darken(lamp.name, lamp.number if several else None))


def replace_faces(window: Window) -> None:
    """Put a panel in place of the light of the selected lamp's surfaces."""
    session, lamp = window.session, _selected(window)
    if lamp is None:
        return
    values = panel_of_faces(session.scene, lamp.name, session.chosen.scene_size)
    if values is None:
        window.log(f"{lamp.name} shines in all directions: no panel can stand for it; add a bulb beside it", WARNING)
        return
    session.change_scene(Darken(lamp.name), Light(lamp.name, values))


def toggle_marks(window: Window) -> None:
    lamps = window.viewport.lamps
    lamps.are_shown = not lamps.are_shown


def _selected(window: Window) -> LightId | None:
    """Return the selected lamp, None with a line in the log for several together."""
    lamp = window.viewport.lamps.selected
    if lamp is not None and lamp.name == OTHERS:
        window.log("these are several lamps: select one by its mark in the picture", WARNING)
        return None
    return lamp


def _add(window: Window, name: str, values: Values, file: str = "") -> None:
    window.session.change_scene(Light(_free_name(window, name), values, file))


def _free_name(window: Window, name: str) -> str:
    session = window.session
    taken = (*session.model.emitters.lamps.names, *(m.name for m in session.scene.materials))
    return free_name((*taken, *(light.name for light in session.scene.lights), *(e.name for e in session.edits)), name)


def _room(window: Window, at: np.ndarray | None = None) -> Room:
    """Return the place of a new lamp: over a point (3,) [m], the surface clicked last, or the picture's middle."""
    session = window.session
    up, size = np.array(session.scene.up, np.float64), session.chosen.scene_size
    if at is None and window.viewport.clicked is not None:
        at = window.viewport.clicked.point
    if at is None:
        at = window.viewport.looked_at
    else:
        at = at - BESIDE * size * unit(at - window.viewport.view.camera.eye())
    below = session.picker.pick(at, -up, session.pose_list, True)
    floor = below.point if below is not None else at
    above = session.picker.pick(floor + BESIDE * size * up, up, session.pose_list, True)
    height = above.distance + BESIDE * size if above is not None else float("inf")
    if above is not None and min(_free(window, at, direction) for direction in ring(up, 8)) < 4 * BESIDE * size:
        floor = floor + _off_walls(window, floor + (1 - max(DROP.values())) * height * up, height / 3)
    e = session.model.emitters
    far = {light.name for light in session.scene.lights if not isinstance(light, PlacedLight)}
    fluxes = zip(e.lamps.names, luminance(e.flux_of_lamps).tolist(), strict=True)
    near = [flux for name, flux in fluxes if flux > 0 and name not in far]  # neither sun nor sky
    flux = float(np.mean(near)) if near else 1.0
    return Room(floor, height, up, size, session.scene.units == "photometric", flux)


def _free(window: Window, at: np.ndarray, direction: np.ndarray) -> float:
    """Return the distance [m] from a point (3,) to the first surface in a direction (3,); inf without one."""
    hit = window.session.picker.pick(at, direction, window.session.pose_list, True)
    return hit.distance if hit is not None else float("inf")


def _off_walls(window: Window, at: np.ndarray, reach: float) -> np.ndarray:
    """Return a horizontal shift (3,) [m] of a lamp at a point (3,) to `reach` [m] from walls, or halfway between them.

    A third of the height is the usual distance of lamps that wash walls. Of eight directions that of the nearest wall
    counts, and the one across it.
    """
    around, shift = ring(np.array(window.session.scene.up, np.float64), 8), np.zeros(3)
    nearest = int(np.argmin([_free(window, at, direction) for direction in around]))
    for across in (around[nearest], around[(nearest + 2) % 8]):
        near, far = (_free(window, at + shift, direction) for direction in (across, -across))
        wanted = min(reach, (near + far) / 2)
        shift = shift + (max(wanted - far, 0.0) - max(wanted - near, 0.0)) * across
    return shift
