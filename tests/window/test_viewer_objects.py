"""Objects in the panel: selection, poses in numbers, rest on the floor; cameras that show them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from app.session.resting import resting_pose
from app.window.panel.objects import angles_of, turned
from gi_core.scene import Pose
from gi_core.scene.pose import axis_angle, multiply_quaternions, rotation
from gi_core.solver import Solver
from tests.support import viewer_support as support
from tests.support.viewer_hand import keys

pytest_plugins = ["tests.support.viewer_fixtures"]


@pytest.mark.gl
@pytest.mark.usefixtures("gl", "folder")
def test_an_object_is_selected_and_moved_by_numbers(play):
    K = keys()

    def script(hand, viewer):
        session, ctx, viewport = viewer.session, hand.ctx, viewer.viewport
        hand.wait_for_light()
        start = session.poses["block"]
        ctx.set_ref("Panel")
        ctx.item_click("**/block")
        assert viewport.selected == "block"
        ctx.item_input_value("##Position x", 0.62)
        hand.wait_for_light()
        assert session.poses["block"].position == (0.62, *start.position[1:]) and not session.dragging
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
        assert viewport.view.camera.project(centre, viewport.view.aspect) == pytest.approx((0.5, 0.5), abs=1e-6)
        view = viewport.view
        above, below = (view.camera.project((centre[0], y, centre[2]), view.aspect)[1] for y in (0.42, 0.18))
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

    play(script)


def test_angles_are_those_of_the_rotation():
    rng = np.random.default_rng(3)
    for x, y, z in rng.uniform((-180, -89, -180), (180, 89, 180), (200, 3)):
        pose = turned(Pose((1.0, 2.0, 3.0)), (x, y, z))
        expected = [rotation(Pose(quaternion=axis_angle(a, v))) for a, v in zip(np.eye(3), (x, y, z), strict=True)]
        np.testing.assert_allclose(rotation(pose), expected[2] @ expected[1] @ expected[0], atol=1e-12)
        assert angles_of(pose) == pytest.approx((x, y, z), abs=1e-6) and pose.position == (1.0, 2.0, 3.0)


@pytest.mark.parametrize("height", [0.1, 0.3, 0.7])
def test_an_object_rests_on_the_floor_from_above_and_from_just_inside(height):
    model = Solver(support.room(4), photons=10, radius=0.1).model
    tilted = multiply_quaternions(axis_angle((0, 0, 1), 45.0), (1.0, 0.0, 0.0, 0.0))
    upright, edge = (
        resting_pose(model, {"block": Pose((0.5, height, 0.5), q)}, "block") for q in ((1.0, 0.0, 0.0, 0.0), tilted)
    )
    assert upright.position == pytest.approx((0.5, 0.12, 0.5), abs=1e-4)
    if height > 0.12:
        assert edge.position[1] == pytest.approx(0.12 * math.sqrt(2), abs=1e-4)
    assert resting_pose(model, {"block": Pose((5.0, 1.0, 0.5))}, "block") is None
