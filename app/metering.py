"""The exposure that suits the view, from the light on the receivers in it."""

from __future__ import annotations

import numpy as np

from app.camera import Turntable
from app.session import Session
from app.tonemap import meter, view_weights


def metered(session: Session, camera: Turntable) -> float:
    """Return the exposure [EV] that puts the median radiance in view at mid-grey; nothing in view: of all surfaces."""
    solver = session.solver
    receivers = solver.receivers
    radiance = np.zeros_like(receivers.positions)
    drawn = np.zeros(len(radiance), bool)
    for o, mesh in enumerate(session.meshes):
        front, back = session.colours(o)
        both = mesh.back >= 0
        for rows, colour in ((mesh.front, front), (mesh.back[both], back[both])):
            radiance[rows] = colour
            drawn[rows] = True
    eye = camera.as_camera()
    areas = np.where(drawn, receivers.areas, 0.0)  # probes are not surfaces
    weights = view_weights(
        receivers.positions, receivers.normals, areas, eye.position, eye.target, eye.vertical_fov_degrees
    )
    return meter(radiance, weights if weights.sum() > 0 else areas)
