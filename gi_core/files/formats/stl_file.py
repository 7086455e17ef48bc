"""STL, through trimesh."""

from __future__ import annotations

import io
import logging
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gi_core.files.formats.boundary import Boundary
from gi_core.files.formats.file_parts import FileParts
from gi_core.geometry.mesh_parts import untextured
from gi_core.geometry.texture_filter import srgb_to_linear
from gi_core.scene.errors import SceneError
from gi_core.scene.types import Material, Mesh

if TYPE_CHECKING:
    import trimesh

# Warnings of trimesh would appear on the terminal beside our own sentence.
logging.getLogger("trimesh").addHandler(logging.NullHandler())


def read_stl(path: Path, data: bytes, where: str, boundary: Boundary) -> FileParts:
    """Read triangles and colours; a file has one material, called like the file. Raises SceneError."""
    import trimesh

    boundary.take(where, "lines of text", data.count(b"\n"))
    try:
        # As a scene: to make one mesh of it trimesh copies it, which takes scipy where faces have colours.
        # The resolver serves no file: a PLY names its texture by any path.
        meshes = trimesh.load(io.BytesIO(data), "stl", resolver={}, process=False, force="scene").geometry.values()
    except Exception as error:  # trimesh passes on the errors of its parsers
        # For a file that is neither text nor binary, trimesh guesses the encoding, by a package that may be missing.
        why = "damaged" if isinstance(error, ImportError) else error
        raise SceneError(f"{where}: not a readable STL file: {why}; export it again, as triangles") from None
    parts = [_part(mesh, where, boundary) for mesh in meshes if isinstance(mesh, trimesh.Trimesh)]
    return FileParts(parts, [Material(path.stem, two_sided=True)], [], None, "z", [])


def _part(mesh: trimesh.Trimesh, where: str, boundary: Boundary) -> Mesh:
    faces, vertices = np.asarray(mesh.faces, np.int64), np.asarray(mesh.vertices, np.float64)
    boundary.take(where, "triangles", len(faces))
    boundary.take(where, "vertices", len(vertices))
    if len(faces) and not (0 <= faces.min() and faces.max() < len(vertices)):
        raise SceneError(
            f"{where}: faces must name vertices 0 to {len(vertices) - 1}, got {faces.min()} to {faces.max()}"
        )
    paint = None
    if len(faces) and mesh.visual.kind == "face":
        paint = untextured(srgb_to_linear(np.asarray(mesh.visual.face_colors)[:, None, :3] / 255.0).repeat(3, axis=1))
    elif len(faces) and mesh.visual.kind == "vertex":
        paint = untextured(srgb_to_linear(np.asarray(mesh.visual.vertex_colors)[:, :3] / 255.0)[faces])
    return Mesh(vertices, faces, np.zeros(len(faces), np.int64), paint=paint)
