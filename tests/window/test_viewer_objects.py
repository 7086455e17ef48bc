"""Objects in the panel: selection, poses in numbers, rest on the floor; cameras that show them."""

import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from imgui_bundle import imgui

from app.cli import saved_scene
from app.session.free_place import lowered_pose
from app.session.session import History
from app.window.actions import objects as actions
from app.window.panel.objects import angles_of, turned
from app.window.panel.widgets import unsigned_zero
from gi_core.scene import Pose
from gi_core.scene.pose import axis_angle, multiply_quaternions, rotation
from gi_core.solver import Solver
from tests.support import viewer_support as support
from tests.support.projection import projected
from tests.support.scene_builders import merge, quad
from tests.support.viewer_hand import BLOCK_FRONT, in_window, keys


@in_window()
def test_there_is_one_selection_and_it_has_an_outline(hand, viewer):
    """After a click on an object and then a wall, Remove was for the object and Material for the wall."""
    K, wall, block, beside = keys(), (0.0, 0.5, 0.5), BLOCK_FRONT, (0.5, 1.1, 1.0)
    ctx, viewport, session = hand.ctx, viewer.viewport, viewer.session

    def click(point) -> None:
        ctx.mouse_move_to_pos(hand.at(point))
        ctx.mouse_click(0)
        ctx.yield_(3)

    def picture():
        ctx.mouse_move("//Panel/Objects")  # nothing is under the cursor
        return hand.pixels().astype(int)

    def may(button: str) -> bool:
        return not ctx.item_info(f"//Panel/{button}").item_flags & imgui.ItemFlags_.disabled

    click(beside)
    assert viewport.selection == () and viewport.clicked is None and viewport.surface == ""
    bare = picture()
    click(wall)
    assert viewport.selection == () and viewport.surface == "red"
    assert not any(map(may, ("Duplicate", "Remove", "Make static"))) and may("Make movable")
    of_wall = (picture() != bare).any(axis=2)
    click(block)
    assert viewport.selection == ("block",) and viewport.surface == "block"
    assert all(map(may, ("Duplicate", "Remove", "Make static"))) and not may("Make movable")
    of_block = (picture() != bare).any(axis=2)
    assert 100 < of_wall.sum() < 5000 and 100 < of_block.sum() < 5000 and not (of_wall & of_block).any()
    for modifier in (K.mod_ctrl, K.mod_shift):
        ctx.key_down(modifier)
        click(wall)
        ctx.key_up(modifier)
        assert viewport.selection == ("block",) and viewport.clicked is None
    click(wall)
    ctx.set_ref("Panel")
    ctx.item_click("**/block")
    assert viewport.selection == ("block",) and viewport.clicked is None
    click(wall)
    hand.press(K.f5)
    hand.wait(lambda: viewer.session is not session)
    hand.wait_for_light()
    assert viewport.selection == () and viewport.surface == "red", "a reload keeps the selection"
    assert not viewport.look(outlined=False).outlined and viewport.look(outlined=False).surface is None


@in_window()
def test_an_object_is_selected_and_moved_by_numbers(hand, viewer):
    K = keys()
    session, ctx, viewport = viewer.session, hand.ctx, viewer.viewport
    start = session.poses["block"]
    ctx.set_ref("Panel")
    ctx.item_click("**/block")
    assert viewport.selection == ("block",)
    ctx.item_input_value("##Position x", 0.62)
    hand.wait_for_light()
    assert session.poses["block"].position == (0.62, *start.position[1:]) and not session.motion.dragging
    ctx.item_input_value("##Rotation y", 30.0)
    hand.wait_for_light()
    turned_by = session.poses["block"]
    assert angles_of(turned_by) == pytest.approx((0.0, 30.0, 0.0), abs=1e-6)
    assert hand.light_is_that_from_scratch()

    ctx.item_click("Rest on floor")
    hand.wait_for_light()
    rested = session.poses["block"]
    assert rested.position[1] == pytest.approx(0.12, abs=1e-4)
    assert (rested.position[0], rested.quaternion) == (turned_by.position[0], turned_by.quaternion)
    for before in (turned_by, Pose((0.62, *start.position[1:])), start):
        hand.press(int(K.mod_ctrl) | int(K.z))
        assert session.poses["block"] == before, "each edit is one step"
    hand.press(int(K.mod_ctrl) | int(K.y))
    hand.wait_for_light()

    # Cameras: the object fills a good part of the picture, in its middle; from above; and back.
    hand.press(K.f)
    hand.wait(lambda: viewport.control.flight is None)
    centre = session.poses["block"].position
    assert projected(viewport.view.camera, centre, viewport.view.aspect) == pytest.approx((0.5, 0.5), abs=1e-6)
    view = viewport.view
    above, below = (projected(view.camera, (centre[0], y, centre[2]), view.aspect)[1] for y in (0.42, 0.18))
    assert 0.3 < below - above < 0.8
    viewer._do("top")
    hand.wait(lambda: viewport.control.flight is None)
    assert viewport.view.camera.basis()[2] @ (0, -1, 0) > 0.999
    viewer._do("side")
    hand.wait(lambda: viewport.control.flight is None)
    assert abs(viewport.view.camera.basis()[2] @ (1, 0, 0)) == pytest.approx(1.0, abs=1e-9)
    hand.press(K.home)
    hand.wait(lambda: viewport.control.flight is None)
    assert viewport.view.camera == viewport.control.home

    ctx.set_ref("Panel")
    ctx.item_input_value("##Position y", float("nan"))
    ctx.item_input_value("##Position z", 1e30)
    hand.wait_for_light()
    assert np.isfinite(session.irradiance).all() and np.isfinite(session.poses["block"].position).all()


def two_blocks():
    room = support.room(4)
    (block,) = room.mobiles
    left, right = (
        block._replace(name=name, pose=Pose((x, y, 0.5)), path=None)
        for name, x, y in (("left", 0.25, 0.3), ("right", 0.75, 0.6))
    )
    return replace(room, mobiles=(left, right))


@in_window(scene=two_blocks)
def test_several_objects_are_selected_and_move_as_one(hand, viewer):
    K = keys()
    undo = int(K.mod_ctrl) | int(K.z)
    session, ctx, viewport = viewer.session, hand.ctx, viewer.viewport
    start = session.poses

    def front(name):
        x, y, z = session.poses[name].position
        return hand.at((x, y, z + 0.12))

    def click(name, modifier=None):
        hand.drag(front(name), front(name), modifier=modifier, steps=1)

    click("left")
    assert viewport.selection == ("left",)
    click("right", K.mod_ctrl)
    assert viewport.selection == ("left", "right") and viewport._marked == ((1, 2), -1, "", 0.0)
    click("right", K.mod_ctrl)
    assert viewport.selection == ("left",)
    click("right", K.mod_shift)
    click("right", K.mod_shift)
    assert viewport.selection == ("left", "right") and session.poses == start and not viewer.session.history.undo()

    # A drag of one of them moves both; one step of undo.
    at = front("left")
    hand.drag(at, (at[0] + 30, at[1]))
    shifts = [np.subtract(session.poses[name].position, start[name].position) for name in start]
    assert shifts[0][0] > 0.02 and np.array_equal(*np.round(shifts, 12)) and viewport.selection == ("left", "right")
    slid = session.poses
    at = front("right")
    hand.drag(at, (at[0] + 40, at[1]), modifier=K.mod_ctrl)
    turned_by = session.poses
    assert turned_by["left"].quaternion == pytest.approx(turned_by["right"].quaternion)
    middle, now = (np.mean([p.position for p in poses.values()], axis=0) for poses in (slid, turned_by))
    assert now == pytest.approx(middle, abs=1e-9) and turned_by["left"].position[2] != slid["left"].position[2]
    assert hand.light_is_that_from_scratch()
    for before in (slid, start):
        hand.press(undo)
        assert session.poses == before

    # Numbers, rest on the floor, the list.
    ctx.set_ref("Panel")
    ctx.item_input_value("##Position z", 0.55)
    hand.wait_for_light()
    assert [p.position[2] for p in session.poses.values()] == pytest.approx([0.55, 0.55])
    ctx.item_click("Rest on floor")
    hand.wait_for_light()
    assert [p.position[1] for p in session.poses.values()] == pytest.approx([0.12, 0.12], abs=1e-4)
    hand.press(undo)
    hand.press(undo)
    assert session.poses == start
    ctx.item_click("**/left")
    assert viewport.selection == ("left",)
    ctx.key_down(K.mod_shift)
    ctx.item_click("**/right")
    ctx.key_up(K.mod_shift)
    assert viewport.selection == ("left", "right")
    ctx.key_down(K.mod_ctrl)
    ctx.item_click("**/left")
    ctx.key_up(K.mod_ctrl)
    assert viewport.selection == ("right",)
    hand.press(int(K.mod_ctrl) | int(K.a))
    assert viewport.selection == ("left", "right")

    # Copies and removal, each one step.
    viewer._do("duplicate")
    hand.wait(lambda: viewer.session is not session)
    hand.wait_for_light()
    copied = viewer.session
    assert list(copied.poses) == ["left", "right", "left 2", "right 2"]
    shifts = [np.subtract(copied.poses[f"{name} 2"].position, start[name].position) for name in start]
    assert np.allclose(shifts[0], shifts[1]), "copies keep their places to each other"
    assert np.abs(shifts[0]).max() == pytest.approx(1.05 * 0.24), "beside along z, as there is no room along x"
    assert viewport.selection == ("left 2", "right 2")
    viewport.select(("left", "right"))
    viewer._do("remove")
    hand.wait(lambda: viewer.session is not copied)
    hand.wait_for_light()
    removed = viewer.session
    assert list(removed.poses) == ["left 2", "right 2"] and viewport.selection == ()
    hand.press(undo)
    hand.wait(lambda: viewer.session is not removed)
    hand.wait_for_light()
    assert viewer.session.poses == copied.poses and viewport.selection == ("left", "right")


def test_the_lower_of_two_objects_rests_first():
    """A stack above the floor rests as a stack."""
    scene = two_blocks()
    stacked = {"left": Pose((0.5, 0.8, 0.5)), "right": Pose((0.5, 0.5, 0.5))}
    session = SimpleNamespace(model=Solver(scene, photons=10, radius=0.1).model, scene=scene, poses=stacked)
    moved: dict[str, Pose] = {}
    session.move, session.history = moved.update, History()
    viewport = SimpleNamespace(selection=("left", "right"))
    actions.rest(SimpleNamespace(session=session, viewport=viewport, log=print))
    assert [moved[name].position[1] for name in ("right", "left")] == pytest.approx([0.12, 0.36], abs=1e-4)
    assert len(session.history._done) == 1


def test_no_number_is_shown_as_a_negative_zero():
    """After Insert, rounding put the object at -0.000 m."""
    for value, shown in ((-1e-9, "0.000"), (-0.0, "0.000"), (-0.0004, "0.000"), (-0.0006, "-0.001"), (0.25, "0.250")):
        assert "%.3f" % unsigned_zero(value, "%.3f") == shown  # noqa: UP031


def test_angles_are_those_of_the_rotation():
    rng = np.random.default_rng(3)
    for x, y, z in rng.uniform((-180, -89, -180), (180, 89, 180), (200, 3)):
        pose = turned(Pose((1.0, 2.0, 3.0)), (x, y, z))
        expected = [rotation(Pose(quaternion=axis_angle(a, v))) for a, v in zip(np.eye(3), (x, y, z), strict=True)]
        np.testing.assert_allclose(rotation(pose), expected[2] @ expected[1] @ expected[0], atol=1e-12)
        assert angles_of(pose, (x, y, z)) == pytest.approx((x, y, z), abs=1e-6) and pose.position == (1.0, 2.0, 3.0)
        least = angles_of(pose)
        np.testing.assert_allclose(rotation(turned(pose, least)), rotation(pose), atol=1e-12)
        assert np.abs(least).sum() < np.abs((x, y, z)).sum() + 1e-9


@pytest.mark.parametrize("height, far", [(0.1, 0.0), (0.3, 0.0), (0.7, 0.0), (0.7, 448e3)])
def test_an_object_rests_on_the_floor_from_above_and_from_just_inside(height, far):
    """far [m]: of a stray triangle, with which it hung 4.5 m above the floor."""
    scene = support.room(4)
    stray = [quad((far, 0, 0), (1, 0, 0), (0, 0, 1))] if far else []
    model = Solver(replace(scene, static=merge(scene.static, *stray)), photons=10, radius=0.1).model
    tilted = multiply_quaternions(axis_angle((0, 0, 1), 45.0), (1.0, 0.0, 0.0, 0.0))
    upright, edge = (
        lowered_pose(model, {"block": Pose((0.5, height, 0.5), q)}, "block") for q in ((1.0, 0.0, 0.0, 0.0), tilted)
    )
    assert upright.position == pytest.approx((0.5, 0.12, 0.5), abs=1e-4)
    if height > 0.12:
        assert edge.position[1] == pytest.approx(0.12 * math.sqrt(2), abs=1e-4)
    assert lowered_pose(model, {"block": Pose((5.0, 1.0, 0.5))}, "block") is None


def test_angles_are_the_smallest_of_a_rotation():
    """About the vertical they were 180, 25, 180 for a chair turned by 155 degrees."""
    assert angles_of(turned(Pose(), (0.0, 155.0, 0.0))) == pytest.approx((0.0, 155.0, 0.0), abs=1e-6)
    assert angles_of(turned(Pose(), (180.0, 25.0, 180.0))) == pytest.approx((0.0, 155.0, 0.0), abs=1e-6)
    assert angles_of(turned(Pose(), (0.0, 90.0, 0.0))) == pytest.approx((0.0, 90.0, 0.0), abs=1e-4)
    assert angles_of(turned(Pose(), (0.0, -90.0, 20.0))) == pytest.approx((20.0, -90.0, 0.0), abs=1e-4)
    assert angles_of(turned(Pose(), (0.0, 180.0, 0.0)))[1] == pytest.approx(180.0)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_angles_do_not_jump_in_a_drag(axis):
    """A field runs through half a turn and over y = 90; the other two stay."""
    shown = (100.0, 20.0, 40.0)
    for step in range(70):
        wanted = tuple(a + 5.0 * (k == axis) for k, a in enumerate(shown))
        new = angles_of(turned(Pose(), wanted), shown)
        away = [abs((a - b + 180) % 360 - 180) for a, b in zip(new, wanted, strict=True)]
        assert max(away) < 1e-3, (step, wanted, new)
        shown = new


@in_window()
def test_numbers_of_drags_and_sliders_are_saved_as_they_are_seen(hand, viewer, folder):
    """A saved scene had 0.6999999999999914 of a reflectance, and 17 digits of a drag."""
    start = hand.at(BLOCK_FRONT)
    hand.drag(start, (start[0] + 37, start[1] + 11))
    hand.ctx.set_ref("Panel")
    hand.ctx.item_input_value("##Exposure", 1.23456789)
    hand.ctx.yield_(3)
    document, _ = viewer.files.save(viewer.session, viewer.viewport, str(folder / "saved.toml"))
    text = document.read_text()
    without_camera = text[: text.index("[camera]")] + text[text.index("[poses]") :]
    numbers = re.findall(r"-?\d+\.\d+(?:e-?\d+)?", without_camera)
    assert len(numbers) > 7 and all(len(n.lstrip("-0.").replace(".", "")) <= 9 for n in numbers), numbers
    opened = saved_scene.read(str(document))
    assert dict(opened.poses)["block"][:3] == viewer.session.poses["block"].position
