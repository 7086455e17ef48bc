"""The hemisphere over a glossy receiver: the light of its cells, its rays and its lobe, to be drawn.

Made on the solver's thread and read by the window. Directions are in the receiver's frame, its normal along z.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gi_core.base.random_numbers import basis
from gi_core.bsdf.table import Tables
from gi_core.gloss.light import Directions, gloss_radiance, room_for
from gi_core.gloss.sharp import is_sharp

if TYPE_CHECKING:
    from gi_core.solver import Solver


class HemisphereView(NamedTuple):
    """Light and lobe of one receiver."""

    position: np.ndarray  # (3,) float64 [m], relative to `Model.origins[0]`
    frame: np.ndarray  # (3, 3) float64, rows: the frame's axes there
    cells: np.ndarray  # (CELLS, 6) float32, see Directions
    reflected: bool  # pictures show a reflection in their place, cells are black
    rays: np.ndarray  # (m, 3) float64, towards the light
    kind: np.ndarray  # (m,) int64: KEPT, REMOVED, ADDED
    lobe: np.ndarray  # (5,) float64
    along: np.ndarray  # (3,) float64, the tangent
    tables: Tables

    def lobe_towards(self, eye: np.ndarray, light: np.ndarray) -> np.ndarray:
        """Return the luminance (n,) that an eye (3,) sees by light of irradiance 1 from directions (n, 3)."""
        n, local = len(light), self.frame @ (eye - self.position)
        cells = np.ones((n, 1, 6), np.float32)
        cells[:, 0, 3:] = light
        alone, up = np.zeros((n, 3)), np.tile([0.0, 0.0, 1.0], (n, 1))
        given = Directions(cells, np.zeros(1, np.int64), np.empty((0, 6), np.float32))
        lobes, tangents, out = np.tile(self.lobe, (n, 1)), np.tile(self.along, (n, 1)), room_for(n)
        one = np.ones((n, 3))
        gloss_radiance(given, np.arange(n, dtype=np.int32), one, alone, up, lobes, tangents, self.tables, local, out)
        return out.mean(axis=1)


def hemisphere_view(solver: Solver, receiver: int, ends: np.ndarray, kind: np.ndarray) -> HemisphereView | None:
    """Return the hemisphere over a receiver of the last frame; None without gloss there.

    ends (m, 2, 3): of segments across its disc, from the light on; kind (m,): KEPT, REMOVED, ADDED.
    """
    light, s, model = solver.frame.gloss, solver.surfaces, solver.model
    row = -1 if light is None else int(np.searchsorted(light.rows, receiver))
    if light is None or row == len(light.rows) or light.rows[row] != receiver:
        return None
    owner = int(light.place[row])
    place = int(np.searchsorted(light.changed, owner))
    is_changed = place < len(light.changed) and light.changed[place] == owner
    cells = (light.cells[place] if is_changed else light.resting[owner]).copy()
    faces = (s.corner_front == receiver).any(axis=1) | (s.corner_back == receiver).any(axis=1)
    face = int(np.flatnonzero(faces & ~np.isnan(s.lobe[:, 4]))[0])
    if reflected := bool(is_sharp(s)[face]):
        cells[:, :3] = 0.0
    o, normal = int(np.searchsorted(s.first_receiver[1:], receiver, "right")), model.object_receivers.normals[receiver]
    at = model.transforms(solver.frame.poses)
    ax, ay, az, bx, by, bz = basis(*normal)
    axes = np.array([[ax, ay, az], [bx, by, bz], normal])  # in the object's space
    frame = axes @ at.rotation[o].T
    cells[:, 3:] = cells[:, 3:] @ axes.T
    towards = ends[:, 0] - ends[:, 1]
    towards = towards / np.maximum(np.linalg.norm(towards, axis=1), 1e-30)[:, None]
    position = at.rotation[o] @ model.object_receivers.positions[receiver] + at.position[o]
    along = axes @ s.tangent[face] if len(s.tangent) else np.array([1.0, 0.0, 0.0])
    return HemisphereView(position, frame, cells, reflected, towards @ frame.T, kind, s.lobe[face], along, s.tables)
