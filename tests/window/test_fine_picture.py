"""Fine points in the window: at rest as `render` draws them, in motion in the light of each frame."""

from dataclasses import replace
from functools import partial

import numpy as np

from app.draw import fine_mesh
from app.draw.shot import Shot
from gi_core.display.fine_points import fine_points
from gi_core.scene.types import Camera, Pose
from tests.support import viewer_support as support
from tests.support.lit_from_outside import l_room
from tests.support.viewer_hand import in_window


def sunlit():
    return replace(l_room(1.0), camera=Camera((0.6, 0.6, 1.7), (5.0, 1.6, 0.6), 60.0))


SETTINGS = replace(support.SETTINGS, scene="sunlit", light="best", radius=0.4, photons=30_000, exposure=-3.0)


@in_window(sunlit, settings=SETTINGS)
def test_the_window_draws_fine_points_as_a_picture_file_does_and_shades_them(hand, viewer, monkeypatch):
    monkeypatch.setattr(fine_mesh, "fine_points", partial(fine_points, most=5_000))
    session = viewer.session
    hand.wait(lambda: session.light.snapshot.rest.fine is not None and viewer._is_still)
    drawn, fine = hand.pixels(), session.light.snapshot.rest.fine
    assert viewer.viewport.shown.meshes is fine.meshes and len(fine.meshes[0].triangles) > 2000

    def shot():
        width, height = viewer.painter.renderer.size
        shot = Shot(session.light._solver, replace(session.settings, size=(width, height)))
        shot.camera = viewer.viewport.view.camera
        shot.refine()
        return shot.take()

    job = session._worker.submit(shot)
    hand.wait(lambda: job.wait(0.0))
    off = np.abs(drawn.astype(int) - job.result()).max(axis=2)
    assert (off > 12).mean() < 0.01, "the pictures differ along edges alone"

    # A mobile shades them in every frame.
    before = fine
    session.light.move({"box": Pose((4.6, 1.5, 0.02))})
    hand.wait(lambda: session.light.snapshot.poses["box"].position[0] == 4.6)
    moved = session.light.snapshot.rest.fine
    assert moved.light.points is before.light.points, "points of the earlier poses stay until the new ones are found"
    assert not np.array_equal(moved.light.own, before.light.own)
    at = session.model.transforms(session.light.snapshot.poses)
    assert np.array_equal(moved.light.own, moved.light.points.at(at, session.light.snapshot.levels).own)
    hand.wait(lambda: session.light.snapshot.rest.fine.light.points is not before.light.points)
