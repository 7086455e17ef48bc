"""Small files that ask for much end in one sentence, before the memory is taken; `studies/bombs.py` measures all."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from gi_core.files.formats.boundary import LIMITS, MOST_AT_VERTEX, MOST_KEY_PARTS
from gi_core.files.formats.toml_file import read_scene_file
from gi_core.files.load import load_scene
from gi_core.scene import SceneError
from tests.support import bombs
from tests.support.mesh_writers import SCENE, write_obj, write_room, write_scene

REFUSED = {
    "zeros_without_data": "1,000,000 elements without data",
    "zeros_a_hundred_times": "1,000,000 elements without data",
    "instances_of_a_mesh": "4,000,000 triangles",
    "vertices_without_faces": "12,000,000 vertices",
    "libraries_that_are_missing": "1,000 files",
    "mesh_named_by_many_objects": "1,000 objects",
    "polygon_of_repeated_corners": "4,000,000 triangles",
    "file_of_holes": "1,073,741,824 bytes in files",
    "key_of_many_dots": f"{MOST_KEY_PARTS} parts between dots",
    "header_of_many_dots": f"{MOST_KEY_PARTS} parts between dots",
    "lights_of_a_scene_file": "1,000 objects",
    "turns_of_many_mobiles": "100,000 key frames",
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_bomb_is_refused_in_one_sentence(tmp_path, name):
    path = bombs.ALL[name](tmp_path)
    tracemalloc.start()
    with pytest.raises(SceneError, match=f"bomb.* no more than {REFUSED[name]}"):
        load_scene(path)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 400e6


@pytest.mark.parametrize("what", ["nodes", "primitives", "triangles", "numbers", "values in JSON", "bytes in files"])
def test_each_amount_is_bounded(tmp_path, monkeypatch, what):
    path = bombs.gltf(tmp_path, 30, list(range(30)), nodes=10, stored=True)
    monkeypatch.setitem(LIMITS, what, 9)
    with pytest.raises(SceneError, match=f"bomb.gltf: a scene must have no more than 9 {what}, got"):
        load_scene(path)


def test_materials_are_bounded(tmp_path, monkeypatch):
    monkeypatch.setitem(LIMITS, "materials", 1)
    (tmp_path / "a.mtl").write_text("newmtl a\nnewmtl b\n")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\n")
    (tmp_path / "a.gltf").write_text('{"asset": {"version": "2.0"}, "materials": [{}, {}]}')
    for name in ("a.obj", "a.gltf"):
        with pytest.raises(SceneError, match="no more than 1 materials, got 2"):
            load_scene(tmp_path / name)


@pytest.mark.parametrize("kind", ["obj", "ply", "gltf"])
def test_a_polygon_of_too_many_corners(tmp_path, kind):
    """Its fan of slivers costs rays as much as all of its triangles."""
    n = MOST_AT_VERTEX + 3
    path, points = tmp_path / f"a.{kind}", np.random.default_rng(0).random((n, 3))
    if kind == "gltf":
        fan = np.stack([np.zeros(n - 2, int), np.arange(1, n - 1), np.arange(2, n)], axis=1)
        path = bombs.gltf(tmp_path, n, fan.reshape(-1).tolist(), stored=True)
    elif kind == "obj":
        lines = [*(f"v {x} {y} {z}" for x, y, z in points), "f " + " ".join(map(str, range(1, n + 1)))]
        path.write_text("\n".join(lines))
    else:
        head = f"ply\nformat ascii 1.0\nelement vertex {n}\nproperty float x\nproperty float y\nproperty float z\n"
        head += "element face 2\nproperty list int int vertex_indices\nend_header\n"
        lines = [*(f"{x} {y} {z}" for x, y, z in points), "3 0 1 2", " ".join(map(str, (n, *range(n))))]
        path.write_text(head + "\n".join(lines) + "\n")
    with pytest.raises(SceneError, match=f"{path.name}: a vertex must have no more than 10,000 triangles, got 10,00"):
        load_scene(path)


def test_a_file_is_read_once(tmp_path):
    """Objects of one mesh, and an OBJ that names its library often, cost one reading each."""
    write_scene(
        tmp_path, SCENE + '[[mobile]]\nname = "b"\nmesh = "cube.obj"\n[[mobile]]\nname = "c"\nmesh = "./cube.obj"\n'
    )
    (tmp_path / "room.obj").write_text("mtllib room.mtl\n" * 50 + (tmp_path / "room.obj").read_text())
    (read,) = load_scene(tmp_path / "scene.toml").files
    assert sorted(Path(file).name for file in read) == ["cube.obj", "room.mtl", "room.obj", "scene.toml"]


def test_triangles_are_counted_per_use_and_after_cuts(tmp_path, monkeypatch):
    write_room(tmp_path)
    monkeypatch.setitem(LIMITS, "triangles", 100)
    mobile = '[[mobile]]\nname = "{}"\nmesh = "cube.obj"\nposition = [0.3, 0, 0.3]\n'
    room = '[static]\nmesh = "room.obj"\n'
    for text in (room + "".join(map(mobile.format, range(8))), room + mobile.format("a") + "max_edge = 0.02\n"):
        (tmp_path / "a.toml").write_text(text)
        with pytest.raises(SceneError, match="a.toml: mobile .* no more than 100 triangles"):
            load_scene(tmp_path / "a.toml")


def test_an_image_is_decoded_once(tmp_path, monkeypatch):
    """Thousands of materials may share it."""
    (tmp_path / "a.png").write_bytes(bombs.png(4))
    library = "".join(f"newmtl m{i}\nKe 1 1 1\nmap_Ke a.png\nmap_d a.png\n" for i in range(50))
    write_obj(tmp_path / "a.obj", before="mtllib a.mtl\nusemtl m0", library=library)
    opened, real = [], Image.open
    monkeypatch.setattr(Image, "open", lambda *a, **k: opened.append(a) or real(*a, **k))
    load_scene(tmp_path / "a.obj", max_edge=1.0)
    assert len(opened) == 1


@pytest.mark.parametrize(
    "text", ["a = 1.5", 'a = "' + "a." * 200 + '"', "a = [" + "1.5, " * 500 + "]", "a = 1 # " + "x. " * 99]
)
def test_dots_that_are_no_keys(tmp_path, text):
    (tmp_path / "a.toml").write_text(text + "\n")
    with pytest.raises(SceneError, match="unknown key 'a'"):
        read_scene_file(tmp_path / "a.toml", "a.toml")


def test_a_whole_number_of_thousands_of_digits(tmp_path):
    """Python reads a hexadecimal one, but does not write it."""
    (tmp_path / "a.toml").write_text("title = 0x1" + "f" * 5000 + '\n[static]\nmesh = "room.obj"\n')
    with pytest.raises(SceneError, match="title must be a text in quotes, not empty, got a number of thousands"):
        read_scene_file(tmp_path / "a.toml", "a.toml")
