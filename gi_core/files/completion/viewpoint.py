"""Default camera: of many candidates, outside and inside, the one that shows most."""

from __future__ import annotations

import numpy as np

from gi_core.base.grouping import group_of
from gi_core.base.vectors import dot, length
from gi_core.files.completion.camera_view import ASPECT, axes, in_frames, picture_rays, unit
from gi_core.files.completion.pilot import AT_PLACE, BOUNCES, Box, Rays, cells, corners_of, ring, spread
from gi_core.scene.pose import to_world
from gi_core.scene.types import Camera, Scene

OUTSIDE_FOV = 40.0  # degrees
OUTSIDE = {
    8.0: 0.0,
    22.0: 0.1,
    40.0: 0.05,
}  # elevations [degrees] and their bonus in the open: tables are seen from above


def default_camera(scene: Scene, rays: Rays, box: Box, subject: np.ndarray, indoors: bool) -> Camera:
    """Return the camera that sees most of where light goes, filling its picture, with the mobile in view.

    subject: (3,) a place on the floor to look at where there is no mobile.
    """
    up = np.array(scene.up)
    around = np.roll(ring(up, 24), -2, axis=0)
    front = np.array((0.0, -1.0, 0.0) if up[2] > up[1] else (0.0, 0.0, 1.0))
    centre, shown = subject + up * 0.04 * box.size, np.zeros((0, 3))
    if scene.mobiles:
        mesh, pose = scene.mobiles[0].mesh, scene.mobiles[0].pose
        shown = to_world(pose, mesh.vertices[:: max(len(mesh.vertices) // 24, 1)])  # 24 points of the mobile
        centre = (shown.min(axis=0) + shown.max(axis=0)) / 2
    seen = spread(box, 240)  # 240 points of the scene whose visibility is counted for each camera tried

    tries = []
    low, high = (box.low, box.high) if indoors else _with_its_ends(box, rays)
    whole = (low + high) / 2
    for elevation, bonus in OUTSIDE.items():
        for k, level in enumerate(around):
            d = _raised(level, up, elevation)
            far = _distance(low, high, d, up)
            # Nearer, a room fills the picture; a lone object would be cut off.
            shares = (1.0, 0.85) if indoors else (1.0,)
            # 0.35: bonus of a view straight into an open room; 0.1: of a view of the front, which is +z in glTF and OBJ
            worth = (0.35 if k % 6 == 4 else 0.0) if indoors else bonus + 0.1 * float(level @ front)
            tries += [(whole + share * far * d, whole, OUTSIDE_FOV, worth) for share in shares]
    if scene.mobiles or indoors:
        heart = seen[2] @ seen[0]
        for elevation in (5.0, 15.0, 28.0):
            for level in around:
                d = _raised(level, up, elevation)
                t, _ = rays.hits(centre[None], d[None])
                for share in (0.6, 0.92):
                    at = centre + min(share * float(t[0]), 1.2 * box.size) * d
                    tries += [(at, target, 62.0, 0.0) for target in (centre, 0.5 * (centre + heart))]
    cameras = [Camera(tuple(map(float, at)), tuple(map(float, target)), fov) for at, target, fov, _ in tries]
    scores = _scores(cameras, up, seen, shown, _Lit(box), rays, box) + np.array([worth for *_, worth in tries])
    return cameras[int(np.argmax(scores))]


class _Lit:
    """Cells of the scene reached by the pilot's light, by side of a surface."""

    def __init__(self, box: Box):
        self._box, self.cells = box, cells(box, box.hits, box.normals)

    def holds(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Return which points (n,) bool are lit."""
        n = len(self.cells)
        group = group_of(np.concatenate([self.cells, cells(self._box, points, normals)]).T)
        lit = np.zeros(int(group.max(initial=-1)) + 1, bool)
        lit[group[:n]] = True
        return lit[group[n:]]


def _scores(cameras: list[Camera], up, seen, shown, lit: _Lit, rays: Rays, box: Box) -> np.ndarray:
    """Return the score (cameras,) of each view; the rays of all are cast at once."""
    eyes = np.array([c.position for c in cameras]).reshape(-1, 3)
    # The share of each picture that shows lit surfaces.
    d = picture_rays(cameras, up, 20, 12)
    through = d.shape[1]
    eye, d = np.repeat(eyes, through, axis=0), d.reshape(-1, 3)
    t, normal = first_seen(rays, eye, d)
    hit = np.flatnonzero(np.isfinite(t))
    shows = np.zeros(len(d), bool)
    shows[hit] = lit.holds(eye[hit] + d[hit] * t[hit, None], normal[hit])
    fill = shows.reshape(-1, through).sum(axis=1) / through
    # The part of the scene, and of the mobile, that is in the picture.
    points, normals, weight = seen
    every, n = np.concatenate([points, shown]), len(points)
    to = every - eyes[:, None]
    distance = length(to)
    at = np.abs(in_frames(cameras, up, every))
    visible = np.maximum(at[..., 0], at[..., 1]) < 1
    of, row = np.nonzero(visible)
    reached, _ = first_seen(rays, eyes[of], unit(to[of, row]))
    visible[of, row] = reached > (1 - AT_PLACE) * distance[of, row]
    # A surface counts whole from a cosine of 0.2 on: at right angles to the view it shows nothing.
    facing = np.clip(-dot(unit(to[:, :n]), normals) / 0.2, 0.0, 1.0)
    # The scene's share in the picture has weight 2.0, the picture's share that shows the scene 1.
    score = fill + 2.0 * (visible[:, :n] * facing * weight).sum(axis=1)
    if not len(shown):
        return score
    reach = float(length(np.ptp(shown, axis=0))) / np.maximum(np.median(distance[:, n:], axis=1), 1e-12)
    return score + (1.2 + np.minimum(reach, 0.4)) * visible[:, n:].mean(axis=1)


def first_seen(rays: Rays, eye, d) -> tuple[np.ndarray, np.ndarray]:
    """Return distance (n,) and normal (n, 3) of the first visible surface from eyes (n, 3) along d (n, 3).

    Back faces of one-sided surfaces are not drawn.
    """
    at, result, normals = np.zeros(len(d)), np.full(len(d), np.inf), np.zeros((len(d), 3))
    going = np.arange(len(d))
    for _ in range(BOUNCES):
        t, face = rays.hits(eye[going] + d[going] * at[going, None], d[going])
        at[going] += t
        hit = face >= 0
        turned = dot(rays.surfaces.normals[face], d[going]) > 0
        back = hit & turned & ~rays.surfaces.two_sided[face]
        seen = hit & ~back
        result[going[seen]] = at[going[seen]]
        normals[going[seen]] = rays.surfaces.normals[face[seen]] * np.where(turned[seen], -1.0, 1.0)[:, None]
        going = going[back]
        if not len(going):
            break
        at[going] += rays.lifts(face[back])[:, 0]
    result[going] = at[going]  # behind so many backs: taken as hidden there
    return result, normals


def _with_its_ends(box: Box, rays: Rays) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners (3,), (3,) of the box, extended by parts that reach out of it a little, such as horns."""
    # parts that reach farther than 0.12 of the size out of the lit box, such as ground, may be cut off
    reach = 0.12 * box.size
    low = np.where(box.low - rays.low < reach, np.minimum(box.low, rays.low), box.low)
    high = np.where(rays.high - box.high < reach, np.maximum(box.high, rays.high), box.high)
    return low, high


def _distance(low: np.ndarray, high: np.ndarray, d, up) -> float:
    """Return how far from the middle along d [m] a camera must be to have the whole box in its frame."""
    off = corners_of(low, high) - (low + high) / 2
    forward, right, above = axes(d, np.zeros(3), up)
    half = np.tan(np.radians(OUTSIDE_FOV) / 2) * 0.96  # 0.96 of the frame that a scene seen from outside fills
    wanted = np.maximum(np.abs(off @ right) / ASPECT, np.abs(off @ above)) / half - off @ forward
    return float(wanted.max())


def _raised(level: np.ndarray, up: np.ndarray, elevation: float) -> np.ndarray:
    """Return a horizontal direction raised by an elevation [degrees]."""
    e = np.radians(elevation)
    return np.cos(e) * level + np.sin(e) * up
