"""Places of inserted objects."""

from dataclasses import replace

import numpy as np

from app.session.free_place import free_pose
from app.session.log import Log
from app.session.session import Session
from gi_core.geometry.mesh_parts import join
from gi_core.scene import Mobile, Pose
from tests.support import viewer_support as support
from tests.support.scene_builders import box

SCREEN = (0.35, 0.0, 0.45), (0.65, 0.6, 0.5)
EYE = np.array((0.5, 0.3, 0.95))


def test_an_object_is_put_where_the_eye_sees_it():
    """An arch inserted in cornell stood behind the short block."""
    room = support.room()
    stool = Mobile("stool", box((-0.05, 0.0, -0.05), (0.05, 0.1, 0.05)), Pose((0.5, 0.0, 0.8)))
    with_screen = replace(room, static=join([room.static, box(*SCREEN)], room.materials), mobiles=(stool,))
    session = Session(support.SETTINGS, Log(), open_with=lambda settings: None)
    session.adopt(support.opened(support.SETTINGS, with_screen))
    poses, behind = session.poses, np.array((0.5, 0.001, 0.3))
    hidden = free_pose(session, poses, "stool", np.stack([behind, behind + (0.0, 0.9, 0.0)]))
    assert hidden.position[2] < 0.45, "seen from above, it stands there"
    x, _, z = free_pose(session, poses, "stool", np.stack([behind, EYE])).position
    session.close()
    assert z > 0.5 or abs(EYE[0] + (x - EYE[0]) * (EYE[2] - 0.475) / (EYE[2] - z) - 0.5) > 0.15
