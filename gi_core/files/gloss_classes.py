"""Gloss that a texture varies becomes materials: triangles of alike roughness, metallic and metal colour share one.

Kernels and pictures know one lobe per material, and each sharp one costs taps, an albedo and a draw call. A texture
therefore becomes at most MOST classes per material and mesh (metal-and-plastic.md). A class has the means of its
triangles, weighted by area, so that its gloss and its diffuse light reflect what theirs would together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gi_core.files.formats.classes import classes
from gi_core.files.formats.file_parts import CHANNELS
from gi_core.files.formats.metallic_roughness import is_diffuse, metallic_roughness
from gi_core.geometry.surfaces import face_normals
from gi_core.geometry.texture_filter import mean_colours
from gi_core.scene.types import Material, Mesh, Scene


def with_gloss_classes(scene: Scene) -> Scene:
    """Return a scene whose varied materials are materials with gloss, named alike."""
    if all(m.varied is None for m in scene.materials):
        return scene
    out = list(scene.materials)
    static = _classed(scene.static, scene.materials, out)
    mobiles = tuple(m._replace(mesh=_classed(m.mesh, scene.materials, out)) for m in scene.mobiles)
    worn = [m if m.varied is None else _mixed(m, np.ones(1), _even(m, 1), np.array([m.reflectance])) for m in out]
    return replace(scene, static=static, mobiles=mobiles, materials=tuple(worn))


def _classed(mesh: Mesh, materials: Sequence[Material], out: list[Material]) -> Mesh:
    """Return a mesh whose faces have materials of classes; they replace those of `materials` in `out`, or join it."""
    varied = [k for k in np.unique(mesh.face_material) if materials[k].varied is not None]
    if not varied:
        return mesh._replace(finish=None)
    base, areas = base_colours(mesh, materials), np.maximum(face_normals(mesh)[1], 1e-300)
    texels = _texels(mesh, materials)
    material, diffuse = mesh.face_material.copy(), np.ones(len(mesh.faces))
    for k in varied:
        m, rows = materials[k], np.flatnonzero(mesh.face_material == k)
        of = classes(_differing(m, texels[rows], base[rows]), areas[rows])
        for c in range(of.max() + 1):
            of_class = rows[of == c]
            worn = _mixed(m, areas[of_class] / areas[of_class].sum(), texels[of_class], base[of_class])
            if out[k].varied is None:
                material[of_class] = len(out)
                out.append(worn)
            else:
                out[k] = worn
            diffuse[of_class] = max(worn.reflectance) / max(*m.reflectance, 1e-12)
    paint, flat = mesh.paint, mesh.face_reflectance
    if paint is not None:
        paint = paint._replace(corner_colour=paint.corner_colour * diffuse[:, None, None].astype(np.float32))
    flat = None if flat is None else flat * diffuse[:, None]
    return mesh._replace(face_material=material, face_reflectance=flat, paint=paint, finish=None)


def _texels(mesh: Mesh, materials: Sequence[Material]) -> np.ndarray:
    """Return the mean of the textures of gloss (F, 8) over each face, in the order of Finish; 1 without a texture."""
    out = np.ones((len(mesh.faces), sum(map(len, CHANNELS))))
    for k in np.unique(mesh.face_material):
        m, rows = materials[k], mesh.face_material == k
        if m.varied is not None:
            out[rows] = m.varied.means
    first = 0
    for paint, channels in zip(mesh.finish or (), CHANNELS, strict=False):
        last = first + len(channels)
        if paint is not None:
            placed = paint.face_texture >= 0
            out[placed, first:last] = mean_colours(paint, 1.0)[placed][:, channels]
        first = last
    return out


def _even(material: Material, faces: int) -> np.ndarray:
    return np.tile(material.varied.means, (faces, 1))


def _differing(material: Material, texels: np.ndarray, base: np.ndarray) -> np.ndarray:
    """Return what classes differ in: roughness, metallic, colour of metal, textures of the part that is no metal."""
    metallic = material.varied.metallic * texels[:, 1:2]
    rest = texels[:, 2:][:, np.ptp(texels[:, 2:], axis=0) > 0]
    return np.c_[material.varied.roughness * texels[:, :1], metallic, metallic * base, (1 - metallic) * rest]


def _mixed(material: Material, share: np.ndarray, texels: np.ndarray, base: np.ndarray) -> Material:
    """Return the gloss of n triangles together: share (n,) of their area, texels (n, 8), base colour (n, 3)."""
    v = material.varied
    roughness, metallic = v.roughness * (share @ texels[:, 0]), v.metallic * (share @ texels[:, 1])
    metal = share * v.metallic * texels[:, 1]
    rest = share - metal
    specular = v.specular * texels[:, 2:5]
    f0, f90 = specular * np.minimum(np.array(v.f0) * texels[:, 5:], 1), specular.max(axis=1)
    colour, f0, f90 = metal @ base / max(metal.sum(), 1e-12), *(rest @ x / max(rest.sum(), 1e-12) for x in (f0, f90))
    if is_diffuse(metallic, roughness, f90, v.matte):
        return material._replace(varied=None)
    metallic, roughness, f90 = (min(float(x), 1.0) for x in (metallic, roughness, f90))  # shares sum to 1 by rounding
    return metallic_roughness(material, metallic, roughness, f0, f90, colour)


def base_colours(mesh: Mesh, materials: Sequence[Material]) -> np.ndarray:
    """Return the mean base colour (F, 3) of faces."""
    if mesh.face_reflectance is not None:
        return mesh.face_reflectance
    if mesh.paint is not None:
        return mean_colours(mesh.paint)
    return np.array([m.reflectance for m in materials], np.float64)[mesh.face_material]
