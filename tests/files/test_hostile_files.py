"""Damaged and malicious files: each becomes a scene or one sentence. Findings of the fuzzer stay here for ever.

`studies/fuzz.py` searches for more. Some hundred of its mutations run here, and each former crash by name. Files
written by grammar load, or are refused in one sentence that names the file; `studies/grammar.py` runs more.
"""

import json
import os
import random
import struct
import subprocess
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gi_core.files.formats.boundary import LIMITS, Boundary
from gi_core.files.formats.mesh_file import read_mesh_file
from gi_core.files.formats.photometry_file import read_photometry
from gi_core.files.formats.toml_file import read_scene_file
from gi_core.files.load import load_scene
from gi_core.scene import SceneError
from gi_core.scene.errors import SENTENCE, one_line
from tests.support import bombs
from tests.support.fuzz_mutations import mutate, seeds, surroundings
from tests.support.grammar.cases import KINDS, case, write
from tests.support.mesh_writers import BOX_FACES, ROOM, SCENE, write_obj, write_scene, write_textured_room

SEEDS = seeds()


def read(path):
    """Read a file without completing it to a scene; return its error, or None."""
    try:
        match path.suffix:
            case ".toml":
                read_scene_file(path, str(path))
            case ".ies" | ".ldt":
                read_photometry(path, str(path), Boundary(path.parent))
            case _:
                read_mesh_file(path)
    except SceneError as error:
        assert path.name in str(error) and str(error).isprintable() and len(str(error)) <= SENTENCE
        return str(error)
    return None


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("fuzz")
    surroundings(path)
    return path


@settings(max_examples=150)
@given(kind=st.sampled_from([k for k in SEEDS if k != "mtl"]), seed=st.integers(0, 1 << 30))
def test_mutated_files_end_in_a_mesh_or_a_sentence(folder, kind, seed):
    rng = random.Random(seed)
    path = folder / f"case.{kind}"
    path.write_bytes(mutate(rng, kind, rng.choice(SEEDS[kind]), rng.choice(SEEDS[kind])))
    read(path)


@settings(max_examples=150)
@given(kind=st.sampled_from(["toml", "obj", "glb", "gltf", "ply", "stl", "ies", "ldt"]), data=st.binary(max_size=300))
def test_any_bytes_at_all(folder, kind, data):
    path = folder / f"bytes.{kind}"
    path.write_bytes(data)
    read(path)


@settings(max_examples=100)
@given(data=st.data())
def test_a_file_cut_short_anywhere(folder, data):
    kind = data.draw(st.sampled_from([k for k in SEEDS if k != "mtl"]))
    whole = data.draw(st.sampled_from(SEEDS[kind]))
    path = folder / f"short.{kind}"
    path.write_bytes(whole[: data.draw(st.integers(0, len(whole)))])
    read(path)


def test_brackets_nested_thousands_deep(tmp_path):
    toml, gltf = tmp_path / "a.toml", tmp_path / "a.gltf"
    toml.write_text("x = " + "[" * 5000)
    gltf.write_text("[" * 100_000)
    assert "must not nest brackets hundreds deep" in read(toml)
    assert "the glTF is damaged (RecursionError" in read(gltf)


def test_a_number_of_thousands_of_digits(tmp_path):
    (tmp_path / "a.toml").write_text(f"title = {'9' * 5000}")
    assert "must be TOML" in read(tmp_path / "a.toml")
    (tmp_path / "a.obj").write_text(f"v {'9' * 5000} 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 {'9' * 5000}\n")
    assert "is not OBJ" in read(tmp_path / "a.obj")


@pytest.mark.parametrize("document", [[], {"asset": []}, {"asset": {"version": "2.0"}, "extensionsUsed": 3}])
def test_gltf_root_of_wrong_type(tmp_path, document):
    (tmp_path / "a.gltf").write_text(json.dumps(document))
    assert read(tmp_path / "a.gltf")


def test_colours_out_of_range(tmp_path):
    write_obj(tmp_path / "a.obj", before="mtllib a.mtl\nusemtl m", library="newmtl m\nKe 1e99 1 1\n")
    said = 'a.obj: material "m": its emission must be from 0 to 1e+15 in each channel, got [1e+99, 1.0, 1.0]; correct'
    assert said in read(tmp_path / "a.obj")


@pytest.mark.parametrize("far", ["1e200", "1e30", "-1e16"])
def test_vertices_out_of_range(tmp_path, far):
    (tmp_path / "a.obj").write_text(f"v {far} 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert "vertices must be numbers up to 1e+15" in read(tmp_path / "a.obj")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("stray", ["inf", "nan", "1e300"])
def test_unused_vertex_may_have_any_value(tmp_path, stray):
    """Weld cells used to grow with the box of the stray vertex: all vertices became one."""
    write_obj(tmp_path / "a.obj")
    plain = read_mesh_file(tmp_path / "a.obj").mesh
    write_obj(tmp_path / "a.obj", before=f"v 5 {stray} 5", faces=BOX_FACES + 1)
    mesh = read_mesh_file(tmp_path / "a.obj").mesh
    assert np.array_equal(mesh.vertices, plain.vertices) and np.array_equal(mesh.faces, plain.faces)


@pytest.mark.filterwarnings("error")
def test_normals_and_texture_coordinates_out_of_range(tmp_path):
    write_textured_room(tmp_path)
    text = ROOM.replace("vt 1 0", "vt 1e308 -1e308\nvn 1e200 1e300 nan").replace(
        "4/4 3/3 2/2 1/1", "4/4/1 3/3/1 2/2/1 1/1/1"
    )
    (tmp_path / "a.obj").write_text(text)
    mesh = read_mesh_file(tmp_path / "a.obj").mesh
    assert np.isfinite(mesh.paint.corner_uv).all()
    assert mesh.corner_normals is None or np.isfinite(mesh.corner_normals).all()


def test_a_library_of_a_name_too_long(tmp_path):
    write_obj(tmp_path / "a.obj", before="mtllib " + "x" * 5000)
    assert read(tmp_path / "a.obj") is None


def test_faces_with_missing_vertices(tmp_path):
    head = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    )
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    for wrong in (3, -(1 << 31), (1 << 31) - 1):
        body = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0) + struct.pack("<B3i", 3, 0, 1, wrong)
        (tmp_path / "a.ply").write_bytes(head.encode() + body)
        assert read(tmp_path / "a.ply")


@pytest.mark.parametrize("faces", ["property list uchar int vertex_indices\nend_header\n0.5 7", "end_header"])
def test_faces_that_are_no_lists_of_corners(tmp_path, faces):
    """Rows as long as half a corner were sought for ever; without a list, StopIteration was raised."""
    head = "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\n"
    (tmp_path / "a.ply").write_text(f"{head}element face 1\n{faces}\n")
    assert "has no triangles" in (read(tmp_path / "a.ply") or "")


def test_trimesh_stays_silent(tmp_path, capfd):
    """Messages of trimesh must not appear beside our sentence."""
    (tmp_path / "a.stl").write_bytes(b"solid x\n facet normal nonsense\n" + b"\xff" * 200)
    assert read(tmp_path / "a.stl")
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("count", [LIMITS["elements without data"] + 1, 1 << 40, 1 << 63, 10**30])
def test_accessor_without_data_is_refused_before_allocation(tmp_path, count):
    document = {
        "asset": {"version": "2.0"},
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"componentType": 5126, "count": count, "type": "VEC3"}],
    }
    (tmp_path / "a.gltf").write_text(json.dumps(document))
    assert "a scene must have no more than" in read(tmp_path / "a.gltf")


def test_accessor_longer_than_its_buffer(tmp_path):
    path = bombs.gltf(tmp_path, 4, [0, 1, 2], stored=True)
    whole, (positions, order) = json.loads(path.read_text()), json.loads(path.read_text())["accessors"]
    assert read(path) is None
    for key, value in (("count", 1 << 50), ("byteOffset", 1 << 50), ("byteOffset", -4)):
        path.write_text(json.dumps(whole | {"accessors": [positions | {key: value}, order]}))
        assert read(path)


@pytest.mark.parametrize("kind", ["ply", "stl"])
def test_header_with_billions_of_elements(tmp_path, kind):
    """Refused with no more memory than the file has."""
    if kind == "ply":
        data = (
            b"ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n"
            + bytes(12)
        )
    else:
        data = bytes(80) + struct.pack("<I", 4_000_000_000) + bytes(50)
    (tmp_path / f"a.{kind}").write_bytes(data)
    tracemalloc.start()
    assert read(tmp_path / f"a.{kind}")
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 50e6


def test_out_of_memory_is_one_sentence(tmp_path, monkeypatch):
    def full(*_):
        raise MemoryError

    monkeypatch.setattr("gi_core.files.load.complete", full)
    with pytest.raises(SceneError, match="scene.toml: the scene does not fit into memory"):
        load_scene(write_scene(tmp_path))


def test_sentences_and_notes_are_printable_lines(tmp_path):
    """A name in a file may contain terminal commands, or a megabyte."""
    assert one_line("a\x1b[2Jb\nc") == r"a\x1b[2Jb c"
    assert one_line(" a  b \n\t c\r\nd ") == "a  b c d"
    long = one_line("front " + "x" * 10_000 + " back")
    assert len(long) <= SENTENCE and long.startswith("front") and long.endswith("back")
    file = tmp_path / "scene.toml"
    file.write_text(SCENE.replace('"cube"', r'"\u001b[2J"').replace("position = [0.3, 0.0, 0.3]", "position = 3"))
    assert "\x1b" not in read(file)
    write_obj(tmp_path / "a.obj", before="usemtl \x1b[2Jred\n")
    assert all(n.isprintable() for n in read_mesh_file(tmp_path / "a.obj").notes)


def test_nothing_in_a_file_is_executed(tmp_path, monkeypatch):
    """A name that looks like a command stays a name."""

    def never(*arguments, **_):
        raise AssertionError(arguments)

    for module, name in ((os, "system"), (subprocess, "Popen"), (os, "popen")):
        monkeypatch.setattr(module, name, never)
    monkeypatch.setattr("builtins.eval", never)
    write_obj(tmp_path / "a.obj", before="mtllib $(touch x).mtl\nusemtl `touch x`\n")
    assert read(tmp_path / "a.obj") is None
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.obj"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", range(len(KINDS)), ids=KINDS)
def test_files_by_grammar(tmp_path, kind):
    for seed in range(kind, 24 * len(KINDS), len(KINDS)):
        path = write(tmp_path / str(seed), seed)
        try:
            load_scene(path, max_edge=float("inf"))
        except SceneError as error:
            text = str(error)
            assert path.name in text and text.isprintable() and len(text) <= SENTENCE, seed
            # A valid file loads.
            assert case(seed)[2] > 0, text
