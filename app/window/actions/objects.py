"""Actions on objects: select, move, insert, duplicate, remove, join to the static part or take out of it."""

from __future__ import annotations

import os
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from imgui_bundle import imgui

from app.session.free_place import beside, lowered_pose
from app.session.log import WARNING
from app.window import dialogs
from app.window.parts import Window
from gi_core.files.edits import Duplicate, Finish, Freeze, Insert, Promote, Remove, Values
from gi_core.files.load import free_name
from gi_core.scene import Pose
from gi_core.scene.errors import utf8
from gi_core.scene.pose import carried, three

SHAPES: dict[str, dict[str, Any]] = {  # that the window inserts: values in units of that length
    "box": {"size": (1.0, 1.0, 1.0)},
    "sphere": {"radius": 0.5},
    "cylinder": {"radius": 0.5, "height": 1.0},
    "cone": {"radius": 0.5, "height": 1.0},
    "arch": {"size": (1.0, 1.0, 1.0), "thickness": 0.2},
}


def move(window: Window, name: str, pose: Pose, first: bool, last: bool) -> None:
    """Move an object, and other selected ones with it; from `first` to `last` is one step of undo."""
    session = window.session
    if first and not session.motion.dragging:
        session.motion.playing = False
        session.begin_drag()
    before = session.poses[name]
    if pose != before:
        companions = {other: session.poses[other] for other in window.viewport.selection if other != name}
        session.move({name: pose, **carried(companions, before, pose)})
    if last and session.motion.dragging:
        session.end_drag()


def refinish(window: Window, surface: str, part: str, material: Values) -> None:
    """Change the reflection of a part of a mobile, or of a material of the static part, which has no part."""
    window.session.change_scene(Finish(surface, material, part))


def rest(window: Window) -> None:
    """Lower each selected object onto the surface below it, the lowest one first."""
    session = window.session
    before, up = session.poses, np.array(session.scene.up)
    rested: dict[str, Pose] = {}

    def bottom(name: str) -> float:
        return float((session.model.vertices_at(1 + session.model.names.index(name), before) @ up).min())

    for name in sorted(window.viewport.selection, key=bottom):
        pose = lowered_pose(session.model, {**before, **rested}, name)
        if pose is None:
            window.log(f"nothing lies below {name}", WARNING)
        else:
            rested[name] = pose
    if rested:
        session.move(rested)
        session.history.push(before, {**before, **rested})


def insert(window: Window, name: str, place: np.ndarray | None = None) -> None:
    """Add a mobile from a mesh file, upright and clear of other objects at a place (3,) [m]; None: where one looks."""
    pose = None if place is None else Pose(three(place))
    file = os.path.abspath(os.path.expanduser(name))
    edit = Insert(_free_name(window, utf8(Path(file).stem)), file, pose)
    if place is None:
        _look_at(window, edit.name, window.viewport.looked_at)
    window.session.change_scene(edit)


def _look_at(window: Window, name: str, point: np.ndarray) -> None:
    """Tell where an inserted object is to be put."""
    window.session.inserted.near[name] = np.stack([point, window.viewport.view.camera.eye()])


def insert_shape(window: Window, kind: str) -> None:
    """Add a shape as a mobile at the place that was clicked, else where one looks."""
    session, at = window.session, window.viewport.clicked
    size = float(f"{session.chosen.scene_size / 8:.1g}")  # as meshes in other units get
    edit = Insert(_free_name(window, kind), shape=shape_of(kind, size))
    _look_at(window, edit.name, window.viewport.looked_at if at is None else at.point)
    session.change_scene(edit)


def shape_of(kind: str, size: float) -> tuple[tuple[str, Any], ...]:
    """Return the table of a shape of SHAPES that is `size` [m] high."""
    scaled = ((k, tuple(size * n for n in v) if isinstance(v, tuple) else size * v) for k, v in SHAPES[kind].items())
    return ("type", kind), *scaled


def choose_and_insert(window: Window) -> None:
    beside = window.files.suggestion(window.session)
    window.files.dialog.open("Insert an object", beside, dialogs.MESHES, partial(insert, window))


def duplicate(window: Window) -> None:
    """Put copies of the selected objects beside them."""
    session, names = window.session, _selected(window)
    if not names:
        return
    aside = beside(session, window.viewport.view.camera, names)
    edits: list[Duplicate] = []
    for name in names:
        pose = session.poses[name]
        at = pose._replace(position=three(pose.position + aside))
        edits.append(Duplicate(_free_name(window, name, (edit.name for edit in edits)), name, at))
    session.change_scene(*edits)


def remove(window: Window) -> None:
    if names := _selected(window):
        window.session.change_scene(*map(Remove, names))


def freeze(window: Window) -> None:
    """Join the selected objects, where they are, to the static part."""
    if names := _selected(window):
        window.session.change_scene(*(Freeze(name, window.session.poses[name]) for name in names))


def promote(window: Window) -> None:
    """Make the connected static piece that was clicked a mobile."""
    at, material = window.viewport.clicked, window.viewport.clicked_material
    if at is None:
        window.log("click on the static object that shall move, then make it movable", WARNING)
        return
    window.session.change_scene(Promote(_free_name(window, material), three(at.point)))


def reset_poses(window: Window) -> None:
    window.viewport.cancel_drag()
    window.session.reset_poses()


def undo(window: Window) -> None:
    if not _holds_a_field(window):
        window.viewport.cancel_drag()
        window.session.undo()


def redo(window: Window) -> None:
    if not _holds_a_field(window):
        window.viewport.cancel_drag()
        window.session.redo()


def _holds_a_field(window: Window) -> bool:
    """Whether the mouse holds a field of the panel: its next value would follow an undo as part of another step."""
    in_picture = window.viewport.mobile_drag.grab is not None or window.viewport.control.is_steering
    return imgui.is_any_item_active() and imgui.is_mouse_down(imgui.MouseButton_.left) and not in_picture


def _free_name(window: Window, name: str, taken: Iterable[str] = ()) -> str:
    """Return a name for a new object; those of edits that are still to come are taken too."""
    session = window.session
    return free_name((*(m.name for m in session.scene.mobiles), *(edit.name for edit in session.edits), *taken), name)


def _selected(window: Window) -> tuple[str, ...]:
    """Return the names of the selected objects, () with a line in the log without one."""
    if not (names := window.viewport.selection):
        window.log("select an object first", WARNING)
    return names
