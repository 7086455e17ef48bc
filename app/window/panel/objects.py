"""The movable objects: list, pose of the selected one in numbers, playback, resets."""

from __future__ import annotations

import math
from typing import Any

from imgui_bundle import imgui

from app.settings import Settings
from app.window.panel import widgets as ui
from app.window.parts import Window
from gi_core.scene import Pose
from gi_core.scene.pose import axis_angle, multiply_quaternions, rotation, three

Angles = tuple[float, float, float]

_shown: list[tuple[str, Angles]] = []  # the selected object in motion, and its angles in the last frame


def draw(s: Settings, window: Window, actions: set[Any]) -> Settings:
    session, selection = window.session, window.viewport.selection
    _list(tuple(session.poses), selection, actions)
    selected = selection[-1] if selection else ""
    imgui.begin_disabled(not selected)
    pose = session.poses.get(selected, Pose())
    angles = angles_of(pose, *(last for name, last in _shown if name == selected))
    _shown[:] = [(selected, angles)] if session.in_motion or imgui.is_any_item_active() else []
    for name, values, about in (
        ("Position", pose.position, "Position of the object's origin [m]: x, y, z."),
        ("Rotation", angles, "Rotation [degrees] about x, then y, then z."),
    ):
        speed, digits = (ui.SPEED * session.chosen.scene_size, "%.3f") if name == "Position" else (0.5, "%.1f")
        numbers, edited, first, last = ui.fields(name, values, speed, digits)
        ui.tip(f"{about} Drag, or double-click to type.")
        if edited or first or last:
            moved = pose
            if edited:
                moved = pose._replace(position=three(numbers)) if name == "Position" else turned(pose, three(numbers))
            actions.add(("move", selected, moved, first, last))
    imgui.end_disabled()
    any_object, is_selected, play = bool(session.poses), bool(selected), "Pause" if session.motion.playing else "Play"
    ui.buttons(
        actions,
        ui.Button("rest", "Rest on floor", "Lower each selected object onto the surface below it.",
                  is_selected),
        ui.Button("frame", "Frame", "Let the camera show the selected objects. Key F.", is_selected),
        ui.Button("play", f"{play}###Play", "Move the objects along their paths, or one on a circle. Key Space.",
                  any_object),
        ui.Button("reset poses", "Reset poses", "Return every object to its start pose. Key R resets the view too.",
                  any_object),
        ui.Button("insert", "Insert...", "Add an object from a mesh file. Files may be dropped on the picture too."),
        ui.Button("duplicate", "Duplicate", "Put copies beside the selected objects.", is_selected),
        ui.Button("remove", "Remove", "Remove the selected objects.", is_selected),
        ui.Button("freeze", "Make static",
                  "Fix the selected objects in place. They join the static part: all that stands still.", is_selected),
        ui.Button("promote", "Make movable",
                  "Click on the static part, then make the piece there an object that moves: all its connected "
                  "triangles.", window.viewport.clicked is not None),
    )  # fmt: skip
    return s


def angles_of(pose: Pose, near: Angles = (0.0, 0.0, 0.0)) -> Angles:
    """Return the angles [degrees] about x, then y, then z whose product is the rotation of a pose.

    Two triples give each rotation, and many where y is 90: the one nearest to `near` is returned, each angle in
    (-180, 180]. By default it is that of the smallest angles.
    """
    R = rotation(pose)
    y = math.asin(min(max(-float(R[2, 0]), -1.0), 1.0))
    x, z = math.atan2(R[2, 1], R[2, 2]), math.atan2(R[1, 0], R[0, 0])
    if math.hypot(R[2, 1], R[2, 2]) < 1e-6:  # x and z turn about one axis
        side = math.copysign(1.0, y)
        z = math.radians(near[2])
        x = side * z + math.atan2(side * R[0, 1], side * R[0, 2])
    solutions = (x, y, z), (x + math.pi, math.pi - y, z + math.pi)
    both = [three(_wrapped(math.degrees(angle)) for angle in triple) for triple in solutions]
    return min(both, key=lambda triple: sum(abs(_wrapped(a - b)) for a, b in zip(triple, near, strict=True)))


def _wrapped(angle: float) -> float:
    """Return an angle [degrees] in (-180, 180], never -0.0."""
    return 180.0 - (180.0 - angle) % 360.0 + 0.0


def turned(pose: Pose, angles: Angles) -> Pose:
    """Return a pose with the rotation of angles [degrees] about x, then y, then z."""
    axes = (1, 0, 0), (0, 1, 0), (0, 0, 1)
    x, y, z = (axis_angle(axis, angle) for axis, angle in zip(axes, angles, strict=True))
    return pose._replace(quaternion=multiply_quaternions(z, multiply_quaternions(y, x)))


def selection_after(
    names: tuple[str, ...], selection: tuple[str, ...], name: str, ctrl: bool, shift: bool
) -> tuple[str, ...]:
    """Return the selection after a click on a name in the list; Shift selects from the first selected one."""
    if ctrl:
        remaining = tuple(n for n in selection if n != name)
        return remaining if name in selection else (*remaining, name)
    if shift and selection:
        first, last = (names.index(n) for n in (selection[0], name))
        step = 1 if last >= first else -1
        return tuple(names[k] for k in range(first, last + step, step))
    return (name,)


def _list(names: tuple[str, ...], selection: tuple[str, ...], actions: set[Any]) -> None:
    if not names:
        imgui.text_disabled("None: insert one, or click and make movable.")
        return
    rows = min(len(names), 12)  # 12 rows of the list; more objects scroll
    imgui.begin_child("##objects", (-1, rows * imgui.get_text_line_height_with_spacing()))
    for name in names:
        if imgui.selectable(name, name in selection)[0]:
            io = imgui.get_io()
            actions.add(("select", selection_after(names, selection, name, io.key_ctrl, io.key_shift)))
        if len(names) > 1:
            ui.tip("Ctrl adds or removes an object, Shift selects a range, Ctrl+A all.")
    imgui.end_child()
