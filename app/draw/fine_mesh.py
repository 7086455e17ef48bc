"""Draw meshes with fine points (`gi_core.display.fine_points`) as further draw vertices."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from app.draw.draw_mesh import DrawMesh, GlossVertices, quads_of
from gi_core.display.fine_points import Cuts, FineLight, FinePoints, fine_points
from gi_core.frames.first_frame import EARLY_PATHS
from gi_core.gather.estimate import Source
from gi_core.solver import Solver


def takes_fine_points(solver: Solver) -> bool:
    """Return whether the static part's light is sharp along borders of direct light.

    Whole paths are, and radiosity of EARLY_PATHS.
    """
    light = solver.frame_light
    if not light.is_gathered or light.static.is_early(EARLY_PATHS):
        return False
    return light.static.best.source in (Source.RADIOSITY, Source.WHOLE_PATHS)


def fine_light(solver: Solver, points: FinePoints) -> FineLight:
    """Return the light of points in a solver's frame.

    Frames light mobiles by other points on lamps: until paths do, borders of both would differ by black teeth.
    """
    model, at = solver.model, solver.model.transforms(solver.poses)
    by_paths = solver.frame_light.gathered_at(at)
    sharp = () if by_paths is None else model.surfaces.object_of(by_paths.rows[by_paths.used])
    return points.at(at, solver.levels, {*range(1, model.surfaces.objects)}.difference(sharp))


def fine_points_of(solver: Solver, meshes: Sequence[DrawMesh]) -> Iterator[FinePoints]:
    """Yield the fine points of a solver's poses, more each time; none where its light or its lamps suit none.

    Draw vertices are further ids, numbered through all meshes.
    """
    model = solver.model
    if not takes_fine_points(solver):
        return iter(())
    first = np.cumsum([0, *(len(mesh.positions) for mesh in meshes)])
    corners = np.concatenate([mesh.triangles + k for mesh, k in zip(meshes, first, strict=False)])
    return fine_points(model, solver.seed, model.transforms(solver.poses), corners[:, :, None])


def fine_meshes(meshes: Sequence[DrawMesh], points: FinePoints) -> tuple[DrawMesh, ...]:
    """Return the meshes of all objects with each face in the pieces that fine points cut it into."""
    counts, cuts = [len(mesh.positions) for mesh in meshes], points.pairs[0]
    first = np.cumsum([0, *(len(mesh.triangles) for mesh in meshes)])
    of = np.concatenate([np.repeat(np.arange(len(meshes)), counts), np.empty(len(cuts.shares), np.int64)])
    cuts.fill(sum(counts), of[:, None])
    number, out = np.empty(len(of), np.int64), []  # of a vertex in the mesh of its object
    for o, mesh in enumerate(meshes):
        own, new = np.flatnonzero(of == o), of[sum(counts) :] == o
        number[own] = np.arange(len(own))
        rows = np.flatnonzero((points.source >= first[o]) & (points.source < first[o + 1]))
        corners, source = points.ids[rows], points.source[rows] - first[o]
        corners[..., 2] = number[corners[..., 2]]
        pairs = Cuts(number[cuts.ends[new]], cuts.shares[new])
        out.append(_fine_mesh(mesh, pairs, corners, source) if new.any() else mesh)
    return tuple(out)


def _fine_mesh(mesh: DrawMesh, pairs: Cuts, corners: np.ndarray, source: np.ndarray) -> DrawMesh:
    """Return the mesh of an object in pieces of its faces `source` (f,), whose corners (f, 3, 3) have ids as of points.

    The last one is the draw vertex. A new vertex takes values between its two ends, and the directions of light of the
    first one.
    """
    ids = corners[..., 2]
    count, corner = len(mesh.positions) + len(pairs.shares), mesh.triangles[source, 0]

    def between(values: np.ndarray | None) -> np.ndarray | None:
        if values is None:
            return None
        out = np.concatenate([values, np.empty((len(pairs.shares), values.shape[1]))])
        pairs.fill(len(values), out)
        return out.astype(values.dtype)

    def of_face(values: np.ndarray | None) -> np.ndarray | None:
        """Return values (D, ...) that are equal at all corners of a face."""
        if values is None:
            return None
        out = np.empty((count, *values.shape[1:]), values.dtype)
        out[ids] = values[corner][:, None]
        return out

    def at_corners(k: int) -> np.ndarray:
        out = np.empty(count, np.int32)
        out[ids] = corners[..., k]
        return out

    gloss = mesh.gloss
    if gloss is not None:
        receivers = np.concatenate([gloss.receivers, np.empty((len(pairs.shares), 2), np.int32)])
        pairs.fill(len(gloss.receivers), receivers)
        gloss = GlossVertices(
            of_face(gloss.lobe), receivers, between(gloss.normal), between(gloss.tangent), gloss.tables
        )
    triangles, uv = ids.astype(np.int32), between(mesh.uv)
    emission = of_face(mesh.emission)
    positions = between(mesh.positions)
    whole = np.bincount(source, minlength=len(mesh.triangles))[source] == 1
    if mesh.reflector is not None:
        whole &= mesh.reflector[source] < 0
    return mesh._replace(
        positions=positions,
        triangles=triangles,
        front=at_corners(0),
        back=at_corners(1),
        reflectance=between(mesh.reflectance),
        emission=emission,
        texture=of_face(mesh.texture),
        uv=uv,
        texel=between(mesh.texel),
        lamp=of_face(mesh.lamp),
        pane=of_face(mesh.pane),
        gloss=gloss,
        reflector=None if mesh.reflector is None else mesh.reflector[source],
        quads=quads_of(positions, triangles, uv, whole),
        source=source.astype(np.int32),
        glowing=np.flatnonzero(emission.any(axis=1)),
    )
