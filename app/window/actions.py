"""Actions of the window, one table: name, function, keys, help text. The panel's buttons use the same names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from imgui_bundle import imgui

from app.cli.writable import write_whole
from app.draw.renderer import Renderer
from app.session.log import WARNING, Log
from app.session.reload import Reload
from app.session.session import Session
from app.settings import UsageError
from app.window import dialogs, screenshot, view_content
from app.window.files import Files
from app.window.panel.material import Refinish
from app.window.panel.objects import Move, Select
from app.window.panel.readouts import Edit
from app.window.viewport import Viewport
from app.window.window import toggle_full_screen

K = imgui.Key
ESTIMATOR_KEYS = (K._1, K._2, K._3, K._4, K._5, K._6, K._7, K._8, K._9)


Request = Select | Move | Refinish | Edit


class Window(Protocol):
    """The window's parts that actions use."""

    files: Files
    params: Any  # of hello_imgui
    help_open: bool
    metered: float
    log: Log
    session: Session
    reload: Reload
    viewport: Viewport
    renderer: Renderer | None
    estimators: dict[str, str]

    def open_scene(self, scene: str) -> None:
        """Open another scene."""

    def leave(self, ask: bool = True) -> None:
        """Close the window; `ask`: after the question about unsaved changes."""


class Action(NamedTuple):
    """A function of the window and the keys that call it."""

    run: Callable[[Window], None]
    chords: tuple[int, ...] = ()  # any of them
    keys: str = ""  # as the help shows them; "": not in the help
    help: str = ""
    needs_scene: bool = True
    label: str = ""  # in menus


def act(window: Window, name: str | Request) -> None:
    """Run an action or a request of the panel; without a scene, only an action that needs none."""
    match name:
        case Select(selected):
            window.viewport.selected, window.viewport.clicked = selected, None
            return
        case Refinish(surface, material):
            from gi_core.files.edits import Finish

            window.session.change_scene(Finish(surface, material))
            return
        case Move():
            _move(window, name)
            return
        case Edit(field, value, first, last):
            window.session.edit(first, last, **{field: value})
            return
    action = ACTIONS[name]
    if window.session.ready or not action.needs_scene:
        action.run(window)


def _move(window: Window, move: Move) -> None:
    """Move an object by the panel's fields."""
    session = window.session
    if move.first and not session.dragging:
        session.playing = False
        session.begin_drag()
    if move.pose != session.poses[move.name]:
        session.move({move.name: move.pose})
    if move.last and session.dragging:
        session.end_drag()


def _rest(window: Window) -> None:
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


def _insert(window: Window) -> None:
    folder = str(Path(window.files.suggestion(window.session)).parent)
    window.files.dialog.open("Insert an object", folder, dialogs.MESHES, partial(insert, window))


def _duplicate(window: Window) -> None:
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


def _remove(window: Window) -> None:
    from gi_core.files.edits import Remove

    if name := _selected(window):
        window.session.change_scene(Remove(name))


def _freeze(window: Window) -> None:
    from gi_core.files.edits import Freeze

    if name := _selected(window):
        window.session.change_scene(Freeze(name, window.session.poses[name]))


def _promote(window: Window) -> None:
    from gi_core.files.edits import Promote
    from gi_core.scene.pose import three

    at, material = window.viewport.clicked, window.viewport.clicked_material
    if at is None:
        window.log("click on the static object that shall move, then make it movable", WARNING)
        return
    window.session.change_scene(Promote(_free_name(window, material), three(at.point)))


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


def _look_along(quarter_turns: int | None, window: Window) -> None:
    window.viewport.control.look_along(quarter_turns)


def _bookmark(window: Window) -> None:
    window.log(f"kept as {window.viewport.control.bookmark()}; menu View shows it again")


def _show_bookmark(k: int, window: Window) -> None:
    window.viewport.control.show_bookmark(k)


def _open(window: Window) -> None:
    folder = str(Path(window.files.suggestion(window.session)).parent)
    window.files.dialog.open("Open a scene", folder, dialogs.SCENES, window.open_scene)


def _save(window: Window) -> None:
    if document := window.session.settings.document:
        _write(window, document)
    else:
        _save_as(window)


def _save_as(window: Window) -> None:
    suggestion = window.files.suggestion(window.session)
    window.files.dialog.save("Save the scene", suggestion, dialogs.SAVED, partial(_write, window))


def _write(window: Window, path: str) -> None:
    try:
        window.log(f"saved {window.files.save(window.session, window.viewport, path)}")
    except (UsageError, OSError) as problem:
        window.log(f"not saved: {getattr(problem, 'strerror', None) or problem}; {path}", WARNING)


def _copy_command(window: Window) -> None:
    command = window.files.command(window.session, window.viewport)
    imgui.set_clipboard_text(command)
    without = ", without its edits: save the scene for these" if window.session.edits else ""
    window.log(f"copied the command that opens this view{without}")


def _export(window: Window) -> None:
    def save(path: str) -> None:
        file = Path(path)
        file = file if file.suffix.lower() == ".csv" else file.with_name(file.name + ".csv")
        try:
            write_whole(file, view_content.readouts_csv(window.session, window.viewport.pins.shown))
            window.log(f"saved {file}")
        except OSError as problem:
            window.log(f"not saved: {problem.strerror or problem}; {file}", WARNING)

    suggestion = str(Path(window.files.suggestion(window.session)).with_suffix(".csv"))
    window.files.dialog.save("Export the read-outs", suggestion, dialogs.TABLES, save)


def _reset_settings(window: Window) -> None:
    window.session.reset_settings(window.metered)


def _toggle_help(window: Window) -> None:
    window.help_open = not window.help_open


def _cancel(window: Window) -> None:
    if not window.viewport.cancel_drag():
        window.help_open = False


def _toggle_panel(window: Window) -> None:
    panel = window.params.docking_params.dockable_window_of_name("Panel")
    panel.is_visible = not panel.is_visible


def _reset_poses(window: Window) -> None:
    window.viewport.cancel_drag()
    window.session.reset_poses()


def _reset_all(window: Window) -> None:
    _reset_poses(window)
    window.viewport.control.go_home()


def _undo(window: Window) -> None:
    window.viewport.cancel_drag()
    window.session.undo()


def _redo(window: Window) -> None:
    window.viewport.cancel_drag()
    window.session.redo()


def _toggle_reference(window: Window) -> None:
    settings = window.session.settings
    window.session.want(replace(settings, reference=not settings.reference))


def _toggle(field: str, window: Window) -> None:
    settings = window.session.settings
    change: dict[str, Any] = {field: not getattr(settings, field)}
    window.session.want(replace(settings, **change))


def _meter(window: Window) -> None:
    exposure = window.session.metered(window.viewport.view.camera)
    window.session.want(replace(window.session.settings, exposure=exposure))
    window.log(f"metered: {exposure:+.1f} EV")


def _save_picture(window: Window, path: Path) -> None:
    viewport, renderer = window.viewport, window.renderer
    metadata = viewport.picture.metadata(window.session.light.snapshot)
    look = viewport.look(outlined=False)
    try:
        scale = window.session.settings.picture_scale
        screenshot.save(renderer, look, viewport.legend, metadata, path, scale)
        window.log(f"saved {path}")
    except OSError as problem:
        window.log(f"not saved: {problem.strerror or problem}; {path}", WARNING)
    viewport.redraw()


def _save_picture_as(window: Window) -> None:
    def save(path: str) -> None:
        file = Path(path)
        _save_picture(window, file if file.suffix.lower() == ".png" else file.with_name(file.name + ".png"))

    window.files.dialog.save("Save the picture", str(screenshot.next_free(Path.cwd())), dialogs.PICTURES, save)


def _choose_estimator(k: int, window: Window) -> None:
    if k < len(window.estimators):
        window.session.choose_estimator(list(window.estimators)[k])


def _ctrl(key: int, more: int = 0) -> int:
    """Return the chord of Ctrl and a key. Of numbers: the flags of Python 3.11.2 refuse sums without a name."""
    return int(K.mod_ctrl) | int(more) | int(key)


ACTIONS = {
    "open": Action(_open, (_ctrl(K.o),), "Ctrl+O", "open a scene", False, "Open..."),
    "fade": Action(lambda w: w.session.fade(), (), "", "cross-fade to a light scene", False),
    "reload": Action(lambda w: w.reload.again(w.session), (K.f5,), "F5", "reload the scene's files", label="Reload"),
    "save": Action(_save, (_ctrl(K.s),), "Ctrl+S", "save the scene with its poses and settings", label="Save"),
    "save as": Action(
        _save_as, (_ctrl(K.s, K.mod_shift),), "Ctrl+Shift+S", "save it under another name", label="Save as..."
    ),
    "copy command": Action(
        _copy_command, (_ctrl(K.c),), "Ctrl+C", "copy the command line of this view", label="Copy as command line"
    ),
    "save picture": Action(
        lambda w: _save_picture(w, screenshot.next_free(Path.cwd())), (K.p, K.f12), "P, F12",
        "save picture and parameters as PNG here", label="Save picture",
    ),
    "save picture as": Action(_save_picture_as, label="Save picture as..."),
    "play": Action(lambda w: w.session.toggle_play(), (K.space,), "Space", "play or pause the motion"),
    "undo": Action(_undo, (_ctrl(K.z),), "Ctrl+Z", "undo the last move or edit", label="Undo"),
    "redo": Action(
        _redo, (_ctrl(K.z, K.mod_shift), _ctrl(K.y)), "Ctrl+Shift+Z, Ctrl+Y", "redo it", label="Redo"
    ),
    "cancel": Action(_cancel, (K.escape,), "Esc", "cancel the drag", needs_scene=False),
    "pin": Action(lambda w: w.viewport.pin(), (K.i,), "I", "pin a read-out under the cursor", label="Pin a read-out"),
    "unpin": Action(
        lambda w: w.viewport.unpin(), (K.delete,), "Del", "remove the read-out under the cursor, or the last one",
        label="Remove read-out",
    ),
    "export": Action(_export, label="Export read-outs..."),
    "reset all": Action(_reset_all, (K.r,), "R", "reset objects and view"),
    "reset poses": Action(_reset_poses, label="Reset objects"),
    "reset settings": Action(_reset_settings, label="Reset settings"),
    "reset view": Action(
        lambda w: w.viewport.control.go_home(), (K.home,), "Home", "reset the view", label="Reset view"
    ),
    "rest": Action(_rest, label="Rest on floor"),
    "insert": Action(_insert, label="Insert object..."),
    "duplicate": Action(_duplicate, (_ctrl(K.d),), "Ctrl+D", "duplicate the selected object", label="Duplicate"),
    "remove": Action(
        _remove, (int(K.mod_shift) | int(K.delete),), "Shift+Del", "remove the selected object", label="Remove"),
    "promote": Action(_promote, label="Make clicked object movable"),
    "freeze": Action(_freeze, label="Make object static"),
    "frame": Action(
        lambda w: w.viewport.control.frame(w.viewport.selected), (K.f,), "F", "show the selected object, or everything",
        label="Frame selected",
    ),
    "top": Action(partial(_look_along, None), label="Top"),
    "front": Action(partial(_look_along, 0), label="Front"),
    "side": Action(partial(_look_along, 1), label="Side"),
    "parallel": Action(
        lambda w: w.viewport.control.toggle_parallel(), (K.o,), "O", "parallel view, or perspective",
        label="Parallel view",
    ),
    "bookmark": Action(_bookmark, (K.b,), "B", "keep this view", label="Keep this view"),
    **{f"view {k}": Action(partial(_show_bookmark, k), (_ctrl(key),)) for k, key in enumerate(ESTIMATOR_KEYS)},
    "gizmo": Action(
        lambda w: w.viewport.gizmo.next_mode(), (K.g,), "G", "handles that move or turn the selected object",
        label="Move or turn handles",
    ),
    "full screen": Action(
        lambda w: toggle_full_screen(), (K.f11,), "F11", "full screen, or a window again", False, "Full screen"
    ),
    "reference": Action(
        _toggle_reference, (K._0,), "0", "switch between estimate and reference", label="Estimate or reference"
    ),
    "show paths": Action(partial(_toggle, "show_paths"), (K.v,), "V", "draw photon paths", label="Photon paths"),
    "show disc": Action(
        partial(_toggle, "show_disc"), (K.n,), "N", "draw the disc under the cursor and its segments", label="Disc"
    ),
    "show recomputed": Action(
        partial(_toggle, "show_recomputed"), (K.c,), "C", "colour by what the last frame computed", label="Recomputed"
    ),
    "meter": Action(_meter, (K.a,), "A", "meter the exposure from the view", label="Meter exposure"),
    "clear chart": Action(lambda w: w.session.points.clear()),
    "toggle panel": Action(_toggle_panel, (K.tab,), "Tab", "hide or show the panel", False, "Panel"),
    "help": Action(_toggle_help, (K.h,), "H", "hide or show this help", False, "Keys and mouse"),
    "quit": Action(lambda w: w.leave(), (_ctrl(K.q),), "Ctrl+Q", "quit", False, "Quit"),
    **{f"estimator {k}": Action(partial(_choose_estimator, k), (key,)) for k, key in enumerate(ESTIMATOR_KEYS)},
}  # fmt: skip
