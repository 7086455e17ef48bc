"""Receivers that the first view shows."""

import numpy as np

SAME_PLACE = 1e-5  # of the scene size: tolerance of a sight line at its end; a tile on a floor is thicker


def static_areas(solver) -> np.ndarray:
    """Return the areas (n,) [m2] of the static part's receivers."""
    return solver.model.object_receivers.areas[solver.surfaces.receiver_range(0)]


def in_view(solver) -> np.ndarray:
    """Return the rows of receivers with an area that the first view shows, ascending; mobiles hide nothing.

    Visibility is tested at evaluation points, off the edges: places under a tile or a skirting board are not visible.
    """
    from app.draw.shot import home_camera
    from gi_core.files.completion.camera_view import in_frame
    from gi_core.files.completion.pilot import Rays
    from gi_core.files.completion.viewpoint import first_seen
    from gi_core.geometry.surfaces import evaluation_points

    camera, receivers = home_camera(solver).as_camera(), solver.receivers
    points, normals = evaluation_points(solver.surfaces, receivers)
    facing = ((np.array(camera.position) - points) * normals).sum(axis=1) > 0
    framed = np.abs(in_frame(camera, solver.scene.up, points)).max(axis=1) < 1
    rows = np.flatnonzero(facing & framed & (receivers.areas > 0))
    to = points[rows] - camera.position
    length = np.sqrt((to * to).sum(axis=1))
    eye = np.broadcast_to(np.array(camera.position), to.shape)
    reached, _ = first_seen(Rays(solver.scene), eye, to / length[:, None])
    return rows[reached > length - SAME_PLACE * solver.scene_size]
