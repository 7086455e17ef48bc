"""`render --still` beside Mitsuba 3, at the same rays and exposure, and by how much they differ.

    python -m studies.mitsuba_stills cornell tree --sheet docs/mitsuba.webp

It needs Mitsuba beside this program: pip install ".[dev]" mitsuba, and LLVM, named by DRJIT_LIBLLVM_PATH: 14 aborts, 22
works. Both have the scene as loaded but for a list of what Mitsuba's paths lack: gloss and models of reflection that
differ, luminaires by measured intensity, spots, panes before lights. The sun is parallel light in both. Rays are those
of our picture, past the backs that it does not draw. Pixels with lamps or sky do not count. The noise of Mitsuba's
picture is half of the l1 difference between its halves.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import mitsuba as mi
import numpy as np
from PIL import Image

from app.draw.shot import Shot, layers
from app.draw.tonemap import to_display
from app.draw.visible import pixel_rays
from app.rest.scheduler import gather
from app.settings import Settings, make_solver, open_scene
from gi_core.base.vectors import dot
from gi_core.geometry.error import luminance
from gi_core.geometry.texture_filter import MOST_REFLECTANCE, srgb_to_linear
from gi_core.lights.sky import sky_of
from gi_core.model import Model
from gi_core.rays.all_objects import nearest_in_world
from gi_core.scene.types import DirectionalLight, Pane, PointLight, Scene, SkyLight


def plain(scene: Scene) -> tuple[Scene, list[str]]:
    """Return a scene of what both have, and the names of what it leaves out."""
    left, materials, lights = [], [], []
    for m in scene.materials:
        left += [f"{kind} {m.name}" for kind, has in (("gloss of", m.gloss or m.brdf), ("pane", m.pane)) if has]
        materials.append(m._replace(gloss=None, brdf=(), pane=m.pane and Pane(ior=1.0)))
    for light in scene.lights:
        if isinstance(light, DirectionalLight):
            lights.append(light._replace(disc_degrees=0.0))
        elif isinstance(light, PointLight | SkyLight):
            lights.append(light)
        else:
            left.append(light.name)
    return replace(scene, materials=tuple(materials), lights=tuple(lights)), left


def described(scene: Scene, model: Model, at, folder: Path, models: Mapping[str, dict] = MappingProxyType({})) -> dict:
    """Return a plain scene for Mitsuba, in the coordinates of its model. models: of materials by name."""
    out: dict[str, Any] = {"type": "scene"}
    s, receivers = model.surfaces, model.object_receivers
    for o, mesh in enumerate((scene.static, *(m.mesh for m in scene.mobiles))):
        rows, R = s.face_range(o), at.rotation[o]
        places = s.vertices[o][s.faces[o]] @ R.T + at.position[o]
        normals = receivers.normals[s.corner_front[rows]] @ R.T
        paint, n = s.paint[o], len(places)
        texture, uv = np.full(n, -1), np.zeros((n, 3, 2), np.float32)
        colour = s.reflectance[rows].copy()
        if paint is not None:
            texture, uv = paint.face_texture, paint.corner_uv
            colour[texture >= 0] = paint.corner_colour.mean(axis=1)[texture >= 0]
        ids = np.stack([s.two_sided[rows], s.pane[rows], texture, mesh.face_material], axis=1)
        keys = np.concatenate([np.round(colour, 3), s.emission[rows], ids], axis=1)
        kinds, of = np.unique(keys, axis=0, return_inverse=True)
        for k, kind in enumerate(kinds):
            if kind[7] >= 0:
                continue
            some = of.reshape(-1) == k
            shape: dict[str, Any] = {"type": "ply", "filename": str(folder / f"{o}-{k}.ply")}
            _write(shape["filename"], places[some], normals[some], uv[some])
            image = paint.textures[int(kind[8])] if paint is not None and kind[8] >= 0 else None
            bsdf = _bsdf(kind[:3], image, bool(kind[6]))
            shape["bsdf"] = models.get(scene.materials[int(kind[9])].name, bsdf)
            if kind[3:6].any():
                shape["emitter"] = {"type": "area", "radiance": rgb(kind[3:6])}
            out[f"object {o} part {k}"] = shape
    for light in scene.lights:
        if isinstance(light, PointLight):
            intensity, place = np.array(light.flux) / (4 * math.pi), np.array(light.position) - model.origins[0]
            out[light.name] = {"type": "point", "position": place.tolist(), "intensity": rgb(intensity)}
        elif isinstance(light, DirectionalLight):
            out[light.name] = {"type": "directional", "direction": list(light.direction),
                               "irradiance": rgb(light.irradiance)}  # fmt: skip
    if any(isinstance(light, SkyLight) for light in scene.lights):
        rows = 512
        polar, turn = ((np.arange(n) + 0.5) * math.pi / rows for n in (rows, 2 * rows))
        x, z = (np.outer(np.sin(polar), f(turn)) for f in (np.sin, np.cos))
        ways = np.stack([x, np.broadcast_to(np.cos(polar)[:, None], x.shape), -z], axis=2)
        seen = sky_of(scene).seen(ways.reshape(-1, 3)).reshape(ways.shape)
        out["sky"] = {"type": "envmap", "bitmap": mi.Bitmap(seen.astype(np.float32))}
    return out


def _write(path: str, places: np.ndarray, normals: np.ndarray, uv: np.ndarray) -> None:
    """Write triangles (n, 3, 3) without shared corners."""
    mesh = mi.Mesh("part", 3 * len(places), len(places), has_vertex_normals=True, has_vertex_texcoords=True)
    fields = mi.traverse(mesh)
    for name, values in ("positions", places), ("normals", normals), ("texcoords", uv):
        fields[f"vertex_{name}"] = np.ravel(values).astype(np.float32)
    fields["faces"] = np.arange(3 * len(places), dtype=np.uint32)
    fields.update()
    mesh.write_ply(path)


def _bsdf(colour: np.ndarray, image, two_sided: bool) -> dict[str, Any]:
    reflectance = rgb(colour)
    if image is not None:
        pixels = image.pixels / 255 if image.linear else srgb_to_linear(image.pixels / 255)
        pixels = np.minimum(pixels * colour, MOST_REFLECTANCE).astype(np.float32)
        reflectance = {"type": "bitmap", "bitmap": mi.Bitmap(pixels), "raw": True, "wrap_mode": image.wrap[0]}
    base = {"type": "diffuse", "reflectance": reflectance}
    return {"type": "twosided", "bsdf": base} if two_sided else base


def rgb(colour) -> dict[str, Any]:
    return {"type": "rgb", "value": [float(c) for c in colour]}


def drawn_rays(shot: Shot, at) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return origins and directions (n, 3) of a picture's rays past backs, and the face (n,) that each hits, or -1."""
    model, (origins, ways) = shot.solver.model, pixel_rays(shot.view, 0, shot.view.height)
    s, step, surfaces = model.surfaces, 1e-5 * model.world.size, 8  # past a back; looked through at most
    object_of = np.repeat(np.arange(s.objects), np.diff(s.first_face))
    origins, ways = origins.astype(float), ways.astype(float)
    faces, left = np.full(len(ways), -1), np.arange(len(ways))
    for _ in range(surfaces):
        limits = np.full(len(left), np.float32(np.inf))
        t, face = nearest_in_world(model.accelerator.opaque, at, origins[left], ways[left], limits)
        left, t, face = left[face >= 0], t[face >= 0], face[face >= 0]
        normals = np.einsum("nij,nj->ni", at.rotation[object_of[face]], s.normals[face])
        back = (dot(normals, ways[left]) > 0) & ~s.two_sided[face]
        faces[left[~back]] = face[~back]
        left, t = left[back], t[back]
        origins[left] += (t[:, None] + step) * ways[left]
    return origins, ways, faces


def theirs(scene, shot: Shot, rays: tuple[np.ndarray, np.ndarray], samples: int, seed: int) -> np.ndarray:
    """Return the radiance (h, w, 3) of paths along the rays of a picture."""
    origins, ways = rays
    integrator, total = mi.load_dict({"type": "path", "max_depth": 64, "rr_depth": 6}), np.zeros((len(ways), 3))
    along = mi.RayDifferential3f(mi.Point3f(origins.T.astype(np.float32)), mi.Vector3f(ways.T.astype(np.float32)))
    for k in range(samples):
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed + k, len(ways))
        total += np.array(integrator.sample(scene, sampler, along)[0]).T
    return total.reshape(shot.view.height, shot.view.width, -1, 3).mean(axis=2) / samples


def compare(name: str, size: tuple[int, int], seconds: float, samples: int) -> np.ndarray:
    """Print a row of the table; return our picture and Mitsuba's side by side."""
    settings = Settings(scene=name, size=size, white_balance=False)
    scene, left = plain(open_scene(settings))
    solver = make_solver(scene, settings)
    solver.solve()
    gather(solver, seconds, lambda *progress: None)
    shot = Shot(solver, settings, 0)
    shot.refine()
    at = solver.model.transforms(solver.poses)
    *rays, faces = drawn_rays(shot, at)
    with tempfile.TemporaryDirectory() as folder:
        loaded = mi.load_dict(described(scene, solver.model, at, Path(folder)))
    halves = [theirs(loaded, shot, rays, samples // 2, seed) for seed in (0, 1 << 20)]
    ours, other = np.asarray(layers(shot).colour, float), (halves[0] + halves[1]) / 2
    counts = (faces >= 0) & ~solver.model.surfaces.emission[faces].any(axis=1)
    on = counts.reshape(*size[::-1], -1).all(axis=2)
    other[(faces < 0).reshape(*size[::-1], -1).any(axis=2)] = 0.0  # layers leave out the sky
    a, b, noise = (luminance(p)[on] for p in (ours, other, (halves[0] - halves[1]) / 2))
    cells = [100 * np.abs(a - b).sum() / b.sum(), 100 * np.abs(noise).sum() / b.sum(), a.sum() / b.sum()]
    cells.insert(2, math.sqrt(max(cells[0] ** 2 - cells[1] ** 2, 0.0)))
    row = "| {} | {:.1f} % | {:.1f} % | {:.1f} % | {:.3f} | {} |"
    print(row.format(name, *cells, ", ".join(left) or "-"), flush=True)
    return np.concatenate([to_display(p, shot.exposure) for p in (ours, other)], axis=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="+")
    parser.add_argument("--sheet", type=Path, metavar="FILE.webp")
    parser.add_argument("--seconds", type=float, default=20.0, help="of gathering")
    parser.add_argument("--samples", type=int, default=32, help="of Mitsuba per ray, four rays per pixel")
    parser.add_argument("--width", type=int, default=320)
    a = parser.parse_args()
    print("| scene | l1 | Mitsuba's noise | beyond it | mean over Mitsuba's | left out in both |")
    print("|---|---|---|---|---|---|")
    pairs = [compare(name, (a.width, a.width * 5 // 8), a.seconds, a.samples) for name in a.scene]
    if a.sheet:
        Image.fromarray(np.concatenate(pairs)).save(a.sheet, quality=80)


if __name__ == "__main__":
    mi.set_variant("llvm_ad_rgb")
    main()
