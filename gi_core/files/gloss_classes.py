"""Gloss that a texture varies becomes materials: triangles of alike roughness, metallic and metal colour share one.

Kernels and pictures know one lobe per material, and each sharp one costs taps, an albedo and a draw call. A texture
therefore becomes at most MOST classes per material and mesh (docs/decisions/038). A class has the means of its
triangles, weighted by area, so that its gloss and its diffuse light reflect what theirs would together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gi_core.files.formats.metallic_roughness import is_diffuse, metallic_roughness
from gi_core.geometry.surfaces import face_normals
from gi_core.geometry.texture_filter import mean_colours
from gi_core.scene.types import Material, Mesh, Scene

MOST = 16  # classes per material and mesh
ALIKE = 0.02  # standard deviation of roughness, metallic and metal colour below which a class is not divided


def with_gloss_classes(scene: Scene) -> Scene:
    """Return a scene whose varied materials are materials with gloss, named alike."""
    if all(m.varied is None for m in scene.materials):
        return scene
    out = list(scene.materials)
    static = _classed(scene.static, scene.materials, out)
    mobiles = tuple(m._replace(mesh=_classed(m.mesh, scene.materials, out)) for m in scene.mobiles)
    worn = [m if m.varied is None else _with_gloss(m, *_means(m), np.array(m.reflectance)) for m in out]
    return replace(scene, static=static, mobiles=mobiles, materials=tuple(worn))


def _classed(mesh: Mesh, given: Sequence[Material], out: list[Material]) -> Mesh:
    """Return a mesh whose faces have materials of classes; they replace those of `given` in `out`, or are appended."""
    varied = [k for k in np.unique(mesh.face_material) if given[k].varied is not None]
    if not varied:
        return mesh._replace(finish=None)
    finish, base, areas = mesh.finish, _base_colours(mesh, given), np.maximum(face_normals(mesh)[1], 1e-300)
    seen = None if finish is None else mean_colours(finish)[:, 1:]
    material, diffuse = mesh.face_material.copy(), np.ones(len(mesh.faces))
    for k in varied:
        m, rows = given[k], np.flatnonzero(mesh.face_material == k)
        means = np.tile(_means(m), (len(rows), 1))
        if finish is not None and seen is not None:
            placed = finish.face_texture[rows] >= 0
            means[placed] = seen[rows[placed]] * m.varied.factors
        of = classes(np.c_[means, means[:, 1:] * base[rows]], areas[rows])
        for c in range(of.max() + 1):
            some = rows[of == c]
            share = areas[some] / areas[some].sum()
            roughness, metallic = share @ means[of == c]
            metal = share @ (means[of == c, 1:] * base[some]) / max(metallic, 1e-12)
            worn = _with_gloss(m, roughness, metallic, metal)
            if out[k].varied is None:
                material[some] = len(out)
                out.append(worn)
            else:
                out[k] = worn
            diffuse[some] = max(worn.reflectance) / max(*m.reflectance, 1e-12)
    paint, flat = mesh.paint, mesh.face_reflectance
    if paint is not None:
        paint = paint._replace(corner_colour=paint.corner_colour * diffuse[:, None, None].astype(np.float32))
    flat = None if flat is None else flat * diffuse[:, None]
    return mesh._replace(face_material=material, face_reflectance=flat, paint=paint, finish=None)


def classes(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return classes (n,) int64 of values (n, d): at most MOST, those of the largest summed variance divided first.

    A class is divided at its mean along the axis in which it varies most, until all deviate by less than ALIKE.
    """
    out = np.zeros(len(values), np.int64)
    spread = [_variance(values, weights)]
    while len(spread) < MOST:
        total = [weights[out == c].sum() * v.sum() if v.max() > ALIKE**2 else 0.0 for c, v in enumerate(spread)]
        c = int(np.argmax(total))
        if total[c] == 0:
            break
        rows, axis = np.flatnonzero(out == c), int(np.argmax(spread[c]))
        along = values[rows, axis]
        out[rows[along > weights[rows] @ along / weights[rows].sum()]] = len(spread)
        spread[c] = _variance(values[out == c], weights[out == c])
        spread.append(_variance(values[out == len(spread)], weights[out == len(spread)]))
    return out


def _variance(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    share = weights / weights.sum()
    return share @ (values - share @ values) ** 2


def _means(material: Material) -> tuple[float, float]:
    """Return the mean roughness and metallic of a varied material."""
    v = material.varied
    return v.factors[0] * v.mean[0], v.factors[1] * v.mean[1]


def _base_colours(mesh: Mesh, materials: Sequence[Material]) -> np.ndarray:
    """Return the mean base colour (F, 3) of faces."""
    if mesh.face_reflectance is not None:
        return mesh.face_reflectance
    if mesh.paint is not None:
        return mean_colours(mesh.paint)
    return np.array([m.reflectance for m in materials], np.float64)[mesh.face_material]


def _with_gloss(material: Material, roughness: float, metallic: float, metal: np.ndarray) -> Material:
    v = material.varied
    if is_diffuse(metallic, roughness, v.f90):
        return material._replace(varied=None)
    return metallic_roughness(material, float(metallic), float(roughness), np.array(v.f0), v.f90, metal)
