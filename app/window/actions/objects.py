"""Actions on objects: select, move, insert, duplicate, remove, join to the static part or take out of it."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from app.session.log import WARNING
from app.window import dialogs
from app.window.actions.parts import Window
from app.window.panel.objects import Move

if TYPE_CHECKING:
    from gi_core.files.edits import Values


def select(window: Window, name: str) -> None:
    window.viewport.selected, window.viewport.clicked = name, None


def move(window: Window, asked: Move) -> None:
    """Move an object by the panel's fields."""
    session = window.session
    if asked.first and not session.dragging:
        session.playing = False
        session.begin_drag()
    if asked.pose != session.poses[asked.name]:
        session.move({asked.name: asked.pose})
    if asked.last and session.dragging:
        session.end_drag()


def refinish(window: Window, surface: str, material: Values) -> None:
    """Change the reflection of a mobile or of a material of the static part."""
    from gi_core.files.edits import Finish

    window.session.change_scene(Finish(surface, material))


def rest(window: Window) -> None:
    """Lower the selected object onto what lies below it."""
    from app.session.resting import resting_pose

    session, name = window.session, window.viewport.selected
    if name not in session.poses:
        return
    pose = resting_pose(session.model, session.poses, name)
    if pose is None:
        window.log(f"nothing lies below {name}", WARNING)
        return
    before = session.poses
    session.move({name: pose})
    session.history.push(before, {**before, name: pose})


def is_mesh(name: str) -> bool:
    """Return whether a file is a mesh file by its suffix."""
    from gi_core.files.formats.mesh_file import SUFFIXES

    return Path(name).suffix.lower() in SUFFIXES


def insert(window: Window, name: str, place: np.ndarray | None = None) -> None:
    """Add a mobile from a mesh file, upright at a place (3,) [m]; None: on the floor."""
    from gi_core.files.edits import Insert
    from gi_core.scene import Pose
    from gi_core.scene.pose import three

    pose = None if place is None else Pose(three(place))
    window.session.change_scene(Insert(_free_name(window, Path(name).stem), name, pose))


def choose_and_insert(window: Window) -> None:
    folder = str(Path(window.files.suggestion(window.session)).parent)
    window.files.dialog.open("Insert an object", folder, dialogs.MESHES, partial(insert, window))


def duplicate(window: Window) -> None:
    """Put a copy of the selected object beside it."""
    from gi_core.files.edits import Duplicate

    session, name = window.session, _selected(window)
    if not name:
        return
    names = [m.name for m in session.scene.mobiles]
    v, pose = session.model.vertices_at(1 + names.index(name), session.poses), session.poses[name]
    up = session.scene.up
    axis = min(range(3), key=lambda k: abs(up[k]))  # horizontal
    place = list(pose.position)
    place[axis] += float(v[:, axis].max() - v[:, axis].min())
    at = pose._replace(position=(place[0], place[1], place[2]))
    session.change_scene(Duplicate(_free_name(window, name), name, at))


def remove(window: Window) -> None:
    from gi_core.files.edits import Remove

    if name := _selected(window):
        window.session.change_scene(Remove(name))


def freeze(window: Window) -> None:
    """Join the selected object, where it is, to the static part."""
    from gi_core.files.edits import Freeze

    if name := _selected(window):
        window.session.change_scene(Freeze(name, window.session.poses[name]))


def promote(window: Window) -> None:
    """Make the connected static piece that was clicked a mobile."""
    from gi_core.files.edits import Promote
    from gi_core.scene.pose import three

    at, material = window.viewport.clicked, window.viewport.clicked_material
    if at is None:
        window.log("click on the static object that shall move, then make it movable", WARNING)
        return
    window.session.change_scene(Promote(_free_name(window, material), three(at.point)))


def reset_poses(window: Window) -> None:
    window.viewport.cancel_drag()
    window.session.reset_poses()


def undo(window: Window) -> None:
    window.viewport.cancel_drag()
    window.session.undo()


def redo(window: Window) -> None:
    window.viewport.cancel_drag()
    window.session.redo()


def _free_name(window: Window, name: str) -> str:
    """Return a name for a new object; those of edits that are still to come are taken too."""
    from gi_core.files.load import free_name

    session = window.session
    return free_name((*(m.name for m in session.scene.mobiles), *(edit.name for edit in session.edits)), name)


def _selected(window: Window) -> str:
    """Return the name of the selected object, "" with a line in the log without one."""
    name = window.viewport.selected
    if name in window.session.poses:
        return name
    window.log("select an object first", WARNING)
    return ""
