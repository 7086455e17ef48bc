"""Bits of traced light: those of the committed digests, and of diffuse surfaces beside glossy ones."""

import json
from dataclasses import replace

import numpy as np
import pytest

from gi_core.files.load import load_scene
from gi_core.scene.types import Gloss, Material, Mobile, Pose
from studies.traced_bits import FILE, PHOTONS, RADIUS, SCENES, digest, traced_bits
from tests.support.scene_builders import box, solve

KEPT = json.loads(FILE.read_text(encoding="utf-8"))


def test_every_scene_has_digests():
    assert set(KEPT) == set(SCENES)


@pytest.mark.parametrize("name", SCENES)
def test_paths_fates_and_sums_have_the_bits_they_had(name):
    bits = traced_bits(name)
    inputs = next(bits)
    if inputs != ("inputs", KEPT[name]["inputs"]):
        pytest.skip("the scene, or this machine's sines, are not those of tests/physics/traced_bits.json")
    assert dict([inputs, *bits]) == KEPT[name], "if this is meant, run: python -m studies.traced_bits --write"


def test_digests_tell_values_types_and_shapes_apart():
    a = np.arange(6.0)
    kinds = [(a,), (a.astype(np.float32),), (a.reshape(2, 3),), ((a, 1),), ((a, 2),), (a + 2.0**-50,)]
    assert len({digest(*kind) for kind in kinds}) == len(kinds)
    assert digest(a.reshape(2, 3)) == digest(np.asfortranarray(a.reshape(2, 3)))


@pytest.mark.parametrize("name", ["cornell", "gallery"])
def test_diffuse_surfaces_have_the_same_bits_beside_glossy_ones(name):
    """A glossy mobile far from all light brings in the kernels of gloss; diffuse faces keep their arithmetic."""
    scene = load_scene(name)
    materials = *scene.materials, Material("satin", (0.3,) * 3, gloss=Gloss(alpha=0.3))
    remote = Mobile("remote", box((0, 0, 0), (0.01, 0.01, 0.01), 1, len(scene.materials)), Pose((0.0, 90.0, 0.0)))
    light = []
    for beside in (scene, replace(scene, materials=materials, mobiles=(*scene.mobiles, remote))):
        solver = solve(beside, photons=PHOTONS, radius=RADIUS, threads=1)
        paths, _ = solver.frame.store.subset(PHOTONS)
        irradiance = solver.irradiance[solver.surfaces.receiver_range(0)]
        light.append((paths, solver.frame.store.fates, irradiance))
        glossy = solver.surfaces.lobe.shape[0] > 0 and not np.isnan(solver.surfaces.lobe[:, 4]).all()
        assert glossy == (beside is not scene)
    assert digest(light[0]) == digest(light[1])
