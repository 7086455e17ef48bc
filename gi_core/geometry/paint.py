"""Paint of joined meshes, some with textures and some without."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from gi_core.scene.types import Finish, Material, Mesh, Paint


def plain_paint(mesh: Mesh, materials: Sequence[Material]) -> Paint:
    """Return untextured paint equivalent to the mesh's face reflectances or materials."""
    colour = mesh.face_reflectance
    if colour is None:
        colour = np.array([m.reflectance for m in materials], np.float64).reshape(-1, 3)[mesh.face_material]
    return _untextured(np.repeat(colour.astype(np.float32)[:, None], 3, axis=1))


def _untextured(corners: np.ndarray) -> Paint:
    n = len(corners)
    return Paint((), np.full(n, -1, np.int32), np.zeros((n, 3, 2), np.float32), corners)


def join_paints(meshes: Sequence[Mesh], materials: Sequence[Material]) -> Paint | None:
    """Return the paint of the concatenated faces of several meshes; None if none is painted.

    The face materials of all meshes index `materials`.
    """
    if all(m.paint is None for m in meshes):
        return None
    return _joined([m.paint or plain_paint(m, materials) for m in meshes])


def join_finishes(meshes: Sequence[Mesh]) -> Finish | None:
    """Return the textures of gloss of the concatenated faces of several meshes; None if none has any."""
    if all(m.finish is None for m in meshes):
        return None
    white = [np.ones((len(m.faces), 3, 3), np.float32) for m in meshes]
    layers = []
    for paints in zip(*(m.finish or Finish() for m in meshes), strict=True):
        textured = any(p is not None for p in paints)
        layers.append(_joined([p or _untextured(w) for p, w in zip(paints, white, strict=True)]) if textured else None)
    return Finish(*layers)


def each_layer(finish: Finish | None, change: Callable[[Paint], Paint]) -> Finish | None:
    """Return textures of gloss with every paint changed."""
    return None if finish is None else Finish(*(None if p is None else change(p) for p in finish))


def _joined(paints: list[Paint]) -> Paint:
    first = np.cumsum([0, *(len(p.textures) for p in paints)])
    moved = [np.where(p.face_texture < 0, -1, p.face_texture + k) for p, k in zip(paints, first, strict=False)]
    return Paint(
        tuple(t for p in paints for t in p.textures),
        np.concatenate(moved).astype(np.int32),
        np.concatenate([p.corner_uv for p in paints]),
        np.concatenate([p.corner_colour for p in paints]),
    )


def rows_of(paint: Paint, faces: np.ndarray) -> Paint:
    """Return the paint of the given faces."""
    columns = (paint.face_texture, paint.corner_uv, paint.corner_colour)
    return Paint(paint.textures, *(c[faces] for c in columns))
