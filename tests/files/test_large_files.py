"""A mesh of 250,000 triangles: it loads completely, and its light is correct."""

import numpy as np
import pytest

from gi_core.files.load import load_scene
from gi_core.geometry.error import luminance
from tests.support.mesh_writers import gltf_lights, write_glb
from tests.support.scene_builders import solve

SIDE, ROWS = 10.0, 354  # [m], vertices per row: 2 x 353^2 triangles
SUN = {"type": "directional", "intensity": 100.0}


@pytest.mark.slow
def test_many_triangles_load_and_light(tmp_path):
    """Black hills under an upright sun: they absorb the sun's 100 lx on 100 m2, closed form.

    No hill shades another from straight above, so each vertex gets 100 lx times the cosine of its slope.
    """
    ticks = np.linspace(-SIDE / 2, SIDE / 2, ROWS)
    x, z = np.meshgrid(ticks, ticks, indexing="ij")
    vertices = np.stack([x, 0.3 * np.sin(2 * x) * np.cos(3 * z), z], axis=-1).reshape(-1, 3)
    rows = np.arange(ROWS * ROWS).reshape(ROWS, ROWS)
    a, b, c, d = (k.reshape(-1) for k in (rows[:-1, :-1], rows[:-1, 1:], rows[1:, 1:], rows[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    half, black = np.sqrt(0.5), {"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]}}
    lights = gltf_lights((SUN, {"rotation": [-half, 0, 0, half]}))  # -z turned down
    write_glb(tmp_path / "hills.glb", vertices, faces, material=black, **lights)

    scene = load_scene(str(tmp_path / "hills.glb"))
    assert len(scene.static.faces) == len(faces) == 2 * 353**2
    solver = solve(scene, photons=16_384, radius=0.4, control=False)

    assert luminance(solver.frame.fates["absorbed"]) == pytest.approx(100.0 * SIDE**2, rel=0.02)
    r = solver.receivers
    assert len(r.areas) == ROWS * ROWS and np.isfinite(solver.irradiance).all()
    inside = np.abs(r.positions[:, [0, 2]]).max(axis=1) < SIDE / 2 - 0.5
    found = luminance(solver.irradiance)[inside]
    expected = 100.0 * r.normals[inside, 1]
    assert np.average(np.abs(found - expected)) < 0.1 * expected.mean()
