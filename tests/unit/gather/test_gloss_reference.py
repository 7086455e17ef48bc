"""The reference of gloss: closed forms, and the sum of parts against whole paths."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gi_core.bsdf.models import lobe
from gi_core.gather.gloss_reference import gloss_views, reference_gloss
from gi_core.gather.path_ends import starts
from gi_core.gather.path_tracer import PathTracer
from gi_core.gather.reference import reference_irradiance
from gi_core.gloss.lobe_rays import LobeViews, draw_lobe, gloss_alone
from gi_core.gloss.sharp import sharp_lobe
from gi_core.model import Model
from gi_core.scene.types import Gloss, Material, Mobile, PointLight, Pose, Scene
from tests.support.scene_builders import box, merge, quad, sphere

SATIN = Gloss((0.6, 0.5, 0.3), 0.3, 0.8)
MATERIALS = {
    "GGX": Material("ball", (0.3, 0.2, 0.1), gloss=SATIN),
    "ward": Material("ball", brdf=(lobe("ward", {"kd": 0.2, "ks": 0.4, "ax": 0.2, "ay": 0.3}),), scaled=True),
}


def views_of(model: Model, eye, count: int):
    """Return views of receivers of the first mobile that face an eye (3,), their rows, and the transforms."""
    s, at = model.surfaces, model.transforms(model.start_poses())
    faces = np.arange(s.first_face[1], s.first_face[2])
    rows, first = np.unique(s.corner_front[faces], return_index=True)
    face = faces[first // 3]
    views = gloss_views(model, at, rows, face, np.array(eye, np.float64))
    up = np.flatnonzero((views.to_eye * views.normals).sum(axis=1) > 0.3)
    some = up[np.linspace(0, len(up) - 1, count).astype(int)]
    return type(views)(*(a[some] for a in views)), rows[some], at


@pytest.mark.parametrize("name", MATERIALS)
def test_in_a_furnace_gloss_has_the_radiance_of_its_albedo(name):
    """Black walls of radiance 0.5: a ball reflects 0.5 times the directional albedo of its gloss."""
    materials = (Material("wall", (0, 0, 0), (0.5, 0.5, 0.5)), MATERIALS[name]._replace(name="ball"))
    ball = Mobile("ball", sphere((0, 0, 0), 0.3, 3, 1))
    model = Model(Scene(box((-1, -1, -1), (1, 1, 1), 2, 0, inward=True), materials, (ball,), name="furnace"))
    views, _, at = views_of(model, (0, -0.9, 0), 12)
    lights = model.lights_at(model.emitters.lamps.full())
    mean, error = reference_gloss(model, at, lights, views, 512, 1)
    s = model.surfaces
    vectors = (np.repeat(a, 4096, axis=0) for a in (views.to_eye, views.normals, views.tangents))
    lobes = LobeViews.of_lobes(gloss_alone(s.lobe[views.face], s.tables), np.repeat(np.arange(12), 4096), *vectors)
    numbers = np.random.default_rng(3).random((len(lobes.of), 3))
    albedo = draw_lobe(lobes, numbers)[1].reshape(-1, 4096, 3).mean(axis=1)
    np.testing.assert_allclose(mean, 0.5 * albedo, atol=4 * error.max(), rtol=0.01)
    assert error.max() < 0.02 * mean.max()
    assert sharp_lobe(s.lobe[views.face[0]], s.tables) is None, "cells carry it"


def test_gloss_and_diffuse_light_together_are_the_light_of_whole_paths():
    """Paths that begin at the ball with all of its material, a lamp, a light without a surface and two bounces."""
    materials = (
        Material("wall", (0.7, 0.6, 0.5)),
        Material("lamp", (0.5, 0.5, 0.5), (9.0, 8.0, 7.0)),
        MATERIALS["GGX"],
    )
    static = merge(
        box((-1, -1, 0), (1, 1, 2), 3, 0, inward=True), quad((-0.3, -0.3, 1.99), (0, 0.6, 0), (0.6, 0, 0), (2, 2), 1)
    )
    ball = Mobile("ball", sphere((0, 0, 0), 0.3, 3, 2), Pose((0.2, 0.1, 0.7)))
    bulb = PointLight("bulb", (-0.8, -0.8, 1.7), (0.5, 0.5, 2.0))
    scene = Scene(static, materials, (ball,), (bulb,), name="room")
    model = Model(scene)
    views, rows, at = views_of(model, (0.1, -0.9, 1.2), 24)
    lights = model.lights_at(model.emitters.lamps.full())
    gloss, error = reference_gloss(model, at, lights, views, 4096, 1)
    E, error_E = reference_irradiance(scene, views.positions, views.normals, 4096, 2, model=model)
    rho = model.surfaces.reflectance[views.face] / math.pi
    together, noise = gloss + rho * E, error + rho * error_E

    paths, n = 8192, len(rows)
    position, normal, face, to_eye = (
        np.repeat(a, paths, axis=0) for a in (views.positions, views.normals, views.face, views.to_eye)
    )
    ends = starts(np.arange(n * paths), np.arange(n * paths), position, normal)
    ends = ends._replace(face=face.astype(np.int32), arrival=to_eye.copy())
    total = np.zeros((n * paths, lights.channels))
    PathTracer(model, at, lights, 7).follow(ends, total)
    L = total.reshape(n, paths, -1)[..., :3] / math.pi
    mean, error_L = L.mean(axis=1), L.std(axis=1) / math.sqrt(paths)
    off = (together - mean) / np.hypot(noise, error_L)
    assert np.abs(off).max() < 5 and abs(off.mean()) < 0.5
    assert together.sum() == pytest.approx(mean.sum(), rel=0.01)
    assert 0.15 < gloss.sum() / together.sum() < 0.9, "both count"
