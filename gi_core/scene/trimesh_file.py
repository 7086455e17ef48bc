"""PLY and STL, through trimesh."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np

from gi_core.scene.errors import SceneError
from gi_core.scene.file_parts import FileParts, Part
from gi_core.scene.texture_levels import srgb_to_linear
from gi_core.scene.types import Material

# What trimesh thinks of a file would stand on the terminal beside our own sentence.
logging.getLogger("trimesh").addHandler(logging.NullHandler())


def read_with_trimesh(path: Path, where: str) -> FileParts:
    """Read triangles and colours; a file has one material, called like the file. Raises SceneError."""
    import trimesh

    try:
        mesh = trimesh.load(path, process=False, force="mesh")
    except Exception as error:  # trimesh raises whatever its parsers stumble over
        # Of a file that is neither text nor binary trimesh wants to guess the encoding, with what may be missing.
        why = "damaged" if isinstance(error, ImportError) else error
        raise SceneError(f"{where}: not a readable {path.suffix[1:].upper()} file: {why}") from None
    faces = np.asarray(getattr(mesh, "faces", ()), np.int64).reshape(-1, 3)
    vertices = np.asarray(getattr(mesh, "vertices", ()), np.float64).reshape(-1, 3)
    if len(faces) and not (0 <= faces.min() and faces.max() < len(vertices)):
        raise SceneError(
            f"{where}: faces must name vertices 0 to {len(vertices) - 1}, got {faces.min()} to {faces.max()}"
        )
    colours = None
    if len(faces) and mesh.visual.kind == "face":
        colours = srgb_to_linear(np.asarray(mesh.visual.face_colors)[:, None, :3] / 255.0).repeat(3, axis=1)
    elif len(faces) and mesh.visual.kind == "vertex":
        colours = srgb_to_linear(np.asarray(mesh.visual.vertex_colors)[:, :3] / 255.0)[faces]
    part = Part(vertices, faces, np.zeros(len(faces), np.int64), None, colours)
    return FileParts([part], [Material(path.stem, two_sided=True)], [], None, "z", [])
