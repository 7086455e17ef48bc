"""Actions of the window, one table: name, function, keys, help text. The panel's buttons use the same names."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from imgui_bundle import imgui

from app.window.actions import files, lamps, objects, views
from app.window.parts import Window
from app.window.window import toggle_full_screen

K = imgui.Key
ESTIMATOR_KEYS = (K._1, K._2, K._3, K._4, K._5, K._6, K._7, K._8, K._9)


class Action(NamedTuple):
    """A function of the window and the keys that call it."""

    run: Callable[..., object]  # of the window, and of the values that the panel gives with its request
    chords: tuple[int, ...] = ()  # any of them
    keys: str = ""  # as the help shows them; "": not in the help
    help: str = ""
    needs_scene: bool = True
    label: str = ""  # in menus


def act(window: Window, name: str, *values: Any) -> None:
    """Run an action; without a scene, only one that needs none."""
    action = ACTIONS[name]
    if window.session.ready or not action.needs_scene:
        action.run(window, *values)


def _ctrl(key: int, more: int = 0) -> int:
    """Return the chord of Ctrl and a key. Of numbers: the flags of Python 3.11.2 refuse sums without a name."""
    return int(K.mod_ctrl) | int(more) | int(key)


def _of_selected(of_lamp: Callable[[Window], None], of_objects: Callable[[Window], None]) -> Callable[[Window], None]:
    """Return an action on the selected lamp, else on the selected objects."""

    def run(window: Window) -> None:
        (of_objects if window.viewport.lamps.selected is None else of_lamp)(window)

    return run


ACTIONS = {
    # Of the panel, with values.
    "select": Action(lambda w, names: w.viewport.select(names)),
    "move": Action(objects.move),
    "choose part": Action(lambda w, part: setattr(w.viewport, "chosen_part", part)),
    "refinish": Action(objects.refinish),
    "select lamp": Action(lambda w, light: w.viewport.select_lamp(light)),
    "change light": Action(lamps.change),
    "add lamp": Action(lamps.add),
    "edit": Action(lambda w, field, value: w.session.edit(**{field: value})),
    "fold surface": Action(lambda w, surface: w.viewport.view.folded.symmetric_difference_update({surface})),
    # Of keys, menus and buttons.
    "open": Action(files.choose_scene, (_ctrl(K.o),), "Ctrl+O", "open a scene", False, "Open..."),
    "reload": Action(lambda w: w.reload.again(w.session), (K.f5,), "F5", "reload the scene's files", label="Reload"),
    "save": Action(files.save, (_ctrl(K.s),), "Ctrl+S", "save the scene with its poses and settings", label="Save"),
    "save as": Action(
        files.save_as, (_ctrl(K.s, K.mod_shift),), "Ctrl+Shift+S", "save it under another name", label="Save as..."
    ),
    "copy command": Action(
        files.copy_command, (_ctrl(K.c),), "Ctrl+C", "copy the command line of this view", label="Copy as command line"
    ),
    "save picture": Action(
        files.save_picture, (K.p, K.f12), "P, F12", "save picture and parameters as PNG here", label="Save picture"
    ),
    "save picture as": Action(files.save_picture_as, label="Save picture as..."),
    "play": Action(lambda w: w.session.toggle_play(), (K.space,), "Space", "play or pause the motion"),
    "undo": Action(objects.undo, (_ctrl(K.z),), "Ctrl+Z", "undo the last move or edit", label="Undo"),
    "redo": Action(
        objects.redo, (_ctrl(K.z, K.mod_shift), _ctrl(K.y)), "Ctrl+Shift+Z, Ctrl+Y", "redo it", label="Redo"
    ),
    "cancel": Action(views.cancel, (K.escape,), "Esc", "cancel the drag", needs_scene=False),
    "pin": Action(lambda w: w.viewport.pin(), (K.i,), "I", "pin a read-out under the cursor", label="Pin a read-out"),
    "ask": Action(
        lambda w: w.viewport.pin(asks=True), (K.j,), "J", "show where the light under the cursor comes from",
        label="Where light comes from",
    ),
    "unpin": Action(
        lambda w: w.viewport.pins.remove(w.session, w.viewport.view), (K.delete,), "Del",
        "remove the read-out under the cursor, or the last one", label="Remove read-out",
    ),
    "export": Action(files.export, label="Export read-outs..."),
    "report": Action(files.report, label="Report..."),
    "reset all": Action(views.reset_all, (K.r,), "R", "reset objects and view"),
    "reset poses": Action(objects.reset_poses, label="Reset objects"),
    "reset settings": Action(lambda w: w.session.reset_settings(), label="Reset settings"),
    "reset view": Action(
        lambda w: w.viewport.control.go_home(), (K.home,), "Home", "reset the view", label="Reset view"
    ),
    "rest": Action(objects.rest, label="Rest on floor"),
    "insert": Action(objects.choose_and_insert, label="Insert object..."),
    **{
        f"insert {kind}": Action(partial(objects.insert_shape, kind=kind), label=kind.capitalize())
        for kind in objects.SHAPES
    },
    "duplicate": Action(
        _of_selected(lamps.duplicate, objects.duplicate), (_ctrl(K.d),), "Ctrl+D",
        "duplicate the selected objects, or the lamp", label="Duplicate",
    ),
    "remove": Action(
        _of_selected(lamps.remove, objects.remove), (int(K.mod_shift) | int(K.delete),), "Shift+Del",
        "remove the selected objects, or the lamp", label="Remove",
    ),
    "duplicate lamp": Action(lamps.duplicate),
    "remove lamp": Action(lamps.remove),
    "replace lamp": Action(lamps.replace_faces),
    "lamp file": Action(lamps.choose_file_for_selected),
    "insert luminaire": Action(lambda w: lamps.choose_file(w, None), label="Insert luminaire..."),
    "lamp marks": Action(lamps.toggle_marks, (K.l,), "L", "show or hide the marks of lamps", label="Marks of lamps"),
    "select all": Action(
        lambda w: w.viewport.select(tuple(w.session.poses)), (_ctrl(K.a),), "Ctrl+A", "select all objects",
        label="Select all",
    ),
    "promote": Action(objects.promote, label="Make clicked object movable"),
    "freeze": Action(objects.freeze, label="Make object static"),
    "frame": Action(views.frame, (K.f,), "F", "show the selection, or everything", label="Frame selected"),
    "top": Action(lambda w: w.viewport.control.look_along(None), label="Top"),
    "front": Action(lambda w: w.viewport.control.look_along(0), label="Front"),
    "side": Action(lambda w: w.viewport.control.look_along(1), label="Side"),
    "parallel": Action(
        lambda w: w.viewport.control.toggle_parallel(), (K.o,), "O", "parallel view, or perspective",
        label="Parallel view",
    ),
    "bookmark": Action(views.bookmark, (K.b,), "B", "keep this view", label="Keep this view"),
    **{
        f"view {k}": Action(lambda w, k=k: w.viewport.control.show_bookmark(k), (_ctrl(key),))
        for k, key in enumerate(ESTIMATOR_KEYS)
    },
    "full screen": Action(
        lambda w: toggle_full_screen(), (K.f11,), "F11", "full screen, or a window again", False, "Full screen"
    ),
    "reference": Action(
        partial(views.toggle, "reference"), (K._0,), "0", "switch between estimate and reference",
        label="Estimate or reference",
    ),
    "show paths": Action(
        partial(views.toggle, "show_paths"), (K.v,), "V", "draw photon paths", label="Photon paths"
    ),
    "show disc": Action(
        partial(views.toggle, "show_disc"), (K.n,), "N", "draw the photons that count at the cursor or a click",
        label="What the estimator counts",
    ),
    "show recomputed": Action(
        partial(views.toggle, "show_recomputed"), (K.c,), "C", "colour the receivers that the last frame computed",
        label="What the frame computed",
    ),
    "meter": Action(views.meter, (K.a,), "A", "meter the exposure from the view", label="Meter exposure"),
    "keep light": Action(lambda w: w.session.keep_light(), label="Keep light as A"),
    "clear chart": Action(lambda w: w.session.points.clear()),
    "toggle panel": Action(views.toggle_panel, (K.tab,), "Tab", "hide or show the panel", False, "Panel"),
    "help": Action(views.toggle_help, (K.h,), "H", "hide or show this help", False, "Keys and mouse"),
    "quit": Action(lambda w: w.leave(), (_ctrl(K.q),), "Ctrl+Q", "quit", False, "Quit"),
    **{f"estimator {k}": Action(partial(views.choose_estimator, k), (key,)) for k, key in enumerate(ESTIMATOR_KEYS)},
}  # fmt: skip
