"""Linear layers of a picture by ray casting: radiance, irradiance, albedo, coverage."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from app.draw import raycast, visible
from app.draw.diagonals import along_light
from app.draw.shot import Shot
from app.draw.vertex_colours import colours


class Layers(NamedTuple):
    """Means over pixels; 0 where nothing is seen, and on the backs of one-sided faces."""

    colour: np.ndarray  # (h, w, 3) float32, radiance [W/m2/sr], without exposure and white balance
    irradiance: np.ndarray  # (h, w, 3) float32 [W/m2]
    albedo: np.ndarray  # (h, w, 3) float32, reflectance with textures
    coverage: np.ndarray  # (h, w, 1) float32, 0 .. 1


def layers(shot: Shot, progress: Callable[[float], None] = lambda fraction: None) -> Layers:
    """Return the layers of a shot, at the size of its settings."""
    solver, meshes, (width, height) = shot.solver, shot.meshes, shot.settings.size
    model, drawn = solver.model, solver.drawn(solver.irradiance)
    at, eye = model.transforms(solver.poses), shot.camera.relative_to(model.origins[0])
    by_vertex = [shot.weights(o) for o in range(len(meshes))]
    lit_by = [colours(mesh, drawn.irradiance) for mesh in meshes]
    world = visible.place([along_light(m, *c, w) for m, c, w in zip(meshes, lit_by, by_vertex, strict=True)], at)
    radiance = raycast.both_sides(lit_by, by_vertex)
    above = raycast.above_textures(meshes, shot.gloss(), by_vertex)
    sharp, faces = shot.sharp(), shot.light_faces()
    white = raycast.both_sides([colours(mesh, drawn.irradiance, False) for mesh in meshes], by_vertex)
    bare = raycast.both_sides([(mesh.reflectance, mesh.reflectance) for mesh in meshes], [None] * len(meshes))
    steps = raycast.pixel_steps(eye, height) if world.textures else None
    dark = world._replace(emission=np.zeros_like(world.emission))
    out = Layers(*(np.zeros((height, width, k), np.float32) for k in (3, 3, 3, 1)))

    def draw(strip: visible.Strip) -> None:
        hit = np.flatnonzero(strip.face >= 0)
        seen = strip.seen(hit)
        light, facing = raycast.seen_radiance(world, *radiance, *seen, steps, strip.eye)
        if above is not None:
            light = light + raycast.gloss_seen(world, *radiance, strip, hit, above, sharp, light)
        E = math.pi * raycast.seen_radiance(world, *white, *seen, None, strip.eye)[0]
        rho = raycast.seen_radiance(dark, *bare, *seen, steps, strip.eye)[0]
        lit = (facing | ~world.one_sided[seen[0]])[:, None]
        rays, bright = faces.seen(strip, world)
        for layer, values in zip(out, (light * lit, E * lit, rho * lit, np.ones((len(hit), 1))), strict=True):
            of_rays = np.zeros((len(strip.face), values.shape[1]))
            of_rays[hit] = values
            of_rays[rays] = bright if layer is out.colour else float(layer is out.coverage)
            layer[strip.rows] = strip.resolved(of_rays)

    visible.draw_strips(draw, model.accelerator, at, world, eye, (width, height), shot.settings.cull, progress)
    return out
