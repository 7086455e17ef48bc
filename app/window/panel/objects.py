"""The movable objects: list, pose of the selected one in numbers, playback, resets."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from imgui_bundle import imgui

from app.settings import Settings
from app.window.panel import widgets as ui
from app.window.parts import Window
from gi_core.scene import Pose
from gi_core.scene.pose import axis_angle, multiply_quaternions, rotation, three

AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
UPRIGHT = 1e-6  # cosine of the angle about y at which those about x and z are one
Angles = tuple[float, float, float]

_shown: list[tuple[str, Angles]] = []  # the selected object in motion, and its angles in the last frame


class Select(NamedTuple):
    """Request to select objects, the last one last."""

    names: tuple[str, ...]


class Move(NamedTuple):
    """Request to move an object and the other selected ones; from `first` to `last` is one step of undo."""

    name: str
    pose: Pose
    first: bool
    last: bool


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
            actions.add(Move(selected, moved, first, last))
    half = (imgui.get_content_region_avail().x - imgui.get_style().item_spacing.x) / 2
    if imgui.button("Rest on floor", (half, 0)):
        actions.add("rest")
    ui.tip("Lower each selected object until it stands on what lies below it.")
    imgui.same_line()
    if imgui.button("Frame", (half, 0)):
        actions.add("frame")
    ui.tip("Let the camera show the selected objects. Key F.")
    imgui.end_disabled()
    imgui.begin_disabled(not session.poses)
    if imgui.button(("Pause" if session.motion.playing else "Play") + "###Play", (half, 0)):
        actions.add("play")
    ui.tip("Move the objects along their paths, or one on a circle. Key Space.")
    imgui.same_line()
    if imgui.button("Reset poses", (half, 0)):
        actions.add("reset poses")
    ui.tip("Return every object to its start pose. Key R resets the view too.")
    imgui.end_disabled()
    _edits(bool(selected), window.viewport.clicked is not None, actions, half)
    return s


def _edits(selected: bool, piece: bool, actions: set[Any], half: float) -> None:
    """Draw the buttons that change the scene; piece: a place of the static part has been clicked."""
    if imgui.button("Insert...", (half, 0)):
        actions.add("insert")
    ui.tip("Add an object from a mesh file. Files may be dropped on the picture too.")
    for name, action, enabled, about in (
        ("Duplicate", "duplicate", selected, "Put copies beside the selected objects."),
        ("Remove", "remove", selected, "Remove the selected objects."),
        (
            "Make static",
            "freeze",
            selected,
            "Fix the selected objects in place. They join the static part: all that stands still.",
        ),
        (
            "Make movable",
            "promote",
            piece,
            "Click on the static part, then make the piece there an object that moves: all its connected triangles.",
        ),
    ):
        if action in ("duplicate", "freeze"):
            imgui.same_line()
        imgui.begin_disabled(not enabled)
        if imgui.button(name, (-1 if action == "promote" else half, 0)):
            actions.add(action)
        ui.tip(about)
        imgui.end_disabled()


def angles_of(pose: Pose, near: Angles = (0.0, 0.0, 0.0)) -> Angles:
    """Return the angles [degrees] about x, then y, then z whose product is the rotation of a pose.

    Two triples give each rotation, and many where y is 90: the one nearest to `near` is returned, each angle in
    (-180, 180]. By default it is that of the smallest angles.
    """
    R = rotation(pose)
    y = math.asin(min(max(-float(R[2, 0]), -1.0), 1.0))
    x, z = math.atan2(R[2, 1], R[2, 2]), math.atan2(R[1, 0], R[0, 0])
    if math.hypot(R[2, 1], R[2, 2]) < UPRIGHT:  # x and z turn about one axis
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
    x, y, z = (axis_angle(axis, angle) for axis, angle in zip(AXES, angles, strict=True))
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
            actions.add(Select(selection_after(names, selection, name, io.key_ctrl, io.key_shift)))
        if len(names) > 1:
            ui.tip("Ctrl adds or removes an object, Shift selects a range, Ctrl+A all.")
    imgui.end_child()
