"""scipy is not required: libraries that would use it must work without it."""

import subprocess
import sys
from pathlib import Path

import pytest
import trimesh

from tests.support.mesh_writers import BOX, BOX_FACES, write_glb, write_obj

ROOT = Path(__file__).resolve().parents[2]
CODE = """
import sys
sys.modules["scipy"] = None  # importing it fails
import pytest
from app.__main__ import main
for k, path in enumerate(sys.argv[1:]):
    estimator = ("tangent_plane", "photon_map", "impact_count")[k % 3]
    options = "--photons", "500", "--size", "16x12", "--estimator", estimator, "--out", path + ".png"
    assert main(["render", path, *options]) == 0, path
assert not [name for name in sys.modules if name.startswith("scipy.")]
"""


@pytest.mark.slow
def test_meshes_of_every_format_load_and_render(tmp_path):
    box = trimesh.Trimesh(BOX, BOX_FACES, face_colors=[[200, 100, 50, 255]] * len(BOX_FACES), process=False)
    paths = [write_glb(tmp_path / "box.glb", BOX, BOX_FACES), write_obj(tmp_path / "box.obj")]
    for name in ("box.ply", "box.stl"):
        box.export(tmp_path / name)
        paths.append(tmp_path / name)
    subprocess.run([sys.executable, "-c", CODE, *map(str, paths)], cwd=ROOT, check=True, timeout=600)
    assert all(path.with_name(path.name + ".png").is_file() for path in paths)
