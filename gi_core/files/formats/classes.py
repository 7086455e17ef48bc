"""Values that a texture varies over triangles become few classes, as materials hold one value each.

Kernels and pictures know one lobe per material, and each sharp one costs taps, an albedo and a draw call. A texture of
gloss therefore becomes at most MOST_CLASSES classes per material and mesh (metal-and-plastic.md). A class has the means
of its triangles, weighted by area, so its gloss and its diffuse light reflect as much as theirs do together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gi_core.base.vectors import cross, length
from gi_core.files.formats.file_parts import CHANNELS
from gi_core.files.formats.metallic_roughness import is_diffuse, metallic_roughness
from gi_core.geometry.mesh_parts import with_meshes, with_scaled_colours
from gi_core.geometry.surfaces import face_normals
from gi_core.geometry.texture_filter import mean_colours
from gi_core.scene.pose import three
from gi_core.scene.types import Material, Mesh, Paint, Scene, Texture

MOST_CLASSES = 16  # classes per material and mesh
ALIKE = 0.02  # standard deviation of roughness, metallic, metal colour or emission below which a class is not divided


def lamps_of_texture(
    materials: list[Material], material: int, corners: np.ndarray, texture: Texture, uv: np.ndarray
) -> np.ndarray:
    """Return a material (F,) for each face of one whose emission a texture scales; new ones are appended, named alike.

    corners (F, 3, 3) [m], uv (F, 3, 2): each face emits the mean of its texels, faces of a class the mean over their
    area. `materials[material]` has the emission without the texture.
    """
    faces = len(corners)
    paint = Paint((texture,), np.zeros(faces, np.int32), uv.astype(np.float32), np.ones((faces, 3, 3), np.float32))
    shares = mean_colours(paint, 1.0)
    area = length(cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])) + 1e-300
    of, own = classes(shares, area), materials[material]
    out = np.empty(faces, np.int64)
    for c in range(of.max(initial=-1) + 1):
        rows = of == c
        share = area[rows] @ shares[rows] / area[rows].sum()
        out[rows] = len(materials)
        materials.append(own._replace(emission=three(share * np.array(own.emission))))
    return out


def classes(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return classes (n,) int64 of values (n, d): MOST_CLASSES at most, of the largest summed variance divided first.

    A class is divided at its mean along the axis in which it varies most, until all deviate by less than ALIKE.
    """
    out = np.zeros(len(values), np.int64)
    spread = [_variance(values, weights)]
    while len(spread) < MOST_CLASSES:
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


def with_gloss_classes(scene: Scene) -> Scene:
    """Return a scene whose varied materials are materials with gloss, named alike."""
    if all(m.varied is None for m in scene.materials):
        return scene
    out = list(scene.materials)
    scene = with_meshes(scene, lambda mesh: _classed(mesh, scene.materials, out))
    for k, m in enumerate(out):
        if m.varied is not None:
            out[k] = _mixed(m, np.ones(1), np.array([m.varied.means]), np.array([m.reflectance]))
    return replace(scene, materials=tuple(out))


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
    return with_scaled_colours(mesh, diffuse[:, None])._replace(face_material=material, finish=None)


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


def _differing(material: Material, texels: np.ndarray, base: np.ndarray) -> np.ndarray:
    """Return the values that classes differ in: roughness, metallic, colour of metal, textures of the other part."""
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
