"""Boundary of a scene's files: its own folder and below; nothing outside, no device, unless the user allows it."""

import json
import os

import pytest

from app import __main__ as cli
from gi_core.files.formats.boundary import Boundary
from gi_core.files.formats.mesh_file import read_mesh_file
from gi_core.files.load import load_scene
from gi_core.scene import SceneError
from tests.support.mesh_writers import QUAD, QUAD_FACES, SCENE, write_obj, write_room, write_scene

OUTSIDE = "lies outside the folder of the scene"


@pytest.fixture
def inner(tmp_path):
    """A folder inside a folder that holds a room."""
    write_room(tmp_path)
    folder = tmp_path / "scene"
    folder.mkdir()
    return folder


def spellings(folder, name):
    """Ways to name a file in the folder above: relative, absolute, through a link."""
    link = folder / f"link{os.path.splitext(name)[1]}"
    link.symlink_to(folder.parent / name)
    (folder / "x").mkdir(exist_ok=True)
    return [f"../{name}", str(folder.parent / name), f"./x/../../{name}", link.name]


def test_boundary(tmp_path):
    inside = Boundary(tmp_path)
    assert inside.holds(tmp_path / "a") and inside.holds(tmp_path / "b" / ".." / "a") and inside.holds(tmp_path)
    for path in (tmp_path / "..", tmp_path.parent, f"{tmp_path}x", tmp_path / "a" / ".." / ".." / "b", "/etc/passwd"):
        assert not inside.holds(path), path
        assert Boundary(tmp_path, open=True).holds(path)
    assert not inside.holds(tmp_path / "zero\0byte")
    assert not inside.file(tmp_path) and not inside.file(tmp_path / ("x" * 5000))


def test_meshes_of_a_scene_file(inner):
    for mesh in spellings(inner, "room.obj"):
        file = inner / "s.toml"
        file.write_text(f"[static]\nmesh = {json.dumps(mesh)}\n")
        with pytest.raises(SceneError, match=OUTSIDE):
            load_scene(file)
        assert len(load_scene(file, allow_outside=True).static.faces) >= 14
    write_scene(inner, SCENE.replace('mesh = "cube.obj"', 'mesh = "../cube.obj"'))
    with pytest.raises(SceneError, match=f'mobile "cube": cube.obj: {OUTSIDE}'):
        load_scene(inner / "scene.toml")


def test_boundary_is_the_folder_of_the_named_file(inner):
    """A mesh in a subfolder may name any file in the scene's folder; alone, only files in its own folder."""
    (inner.parent / "s.toml").write_text('[static]\nmesh = "scene/room.obj"\n')
    (inner / "room.obj").write_text((inner.parent / "room.obj").read_text().replace("room.mtl", "../room.mtl"))
    assert any(max(m.emission) > 0 for m in load_scene(inner.parent / "s.toml").materials)
    alone = read_mesh_file(inner / "room.obj")
    assert not any(max(m.emission) > 0 for m in alone.materials)
    assert [n for n in alone.notes if OUTSIDE in n and "../room.mtl" in n]
    # A mobile on the command line has been named by the user: its own folder counts.
    cube = inner.parent / "cube.obj"
    cube.write_text("mtllib cube.mtl\n" + cube.read_text().replace("f ", "usemtl red\nf ", 1))
    (inner.parent / "cube.mtl").write_text("newmtl red\nKd 0.5 0 0\n")
    write_room(inner)
    scene = load_scene(inner / "room.obj", mobiles=[cube], max_edge=1.0)
    assert (0.5, 0.0, 0.0) in [m.reflectance for m in scene.materials]


def test_material_libraries(inner):
    for name in spellings(inner, "room.mtl"):
        file = inner / "a.obj"
        file.write_text((inner.parent / "room.obj").read_text().replace("room.mtl", name))
        assert not any(max(m.emission) > 0 for m in read_mesh_file(file).materials), name
        opened = read_mesh_file(file, boundary=Boundary(inner, open=True))
        assert any(max(m.emission) > 0 for m in opened.materials), name


def test_buffers(inner):
    (inner.parent / "q.bin").write_bytes(QUAD.astype("<f4").tobytes() + QUAD_FACES.astype("<u4").tobytes())
    for uri in spellings(inner, "q.bin"):
        file = write_gltf(inner / "a.gltf", uri)
        with pytest.raises(SceneError, match=f"its buffer .* {OUTSIDE}"):
            read_mesh_file(file)
        assert len(read_mesh_file(file, boundary=Boundary(inner, open=True)).mesh.faces) == 2


def write_gltf(path, uri):
    document = {
        "asset": {"version": "2.0"},
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 24}],
        "buffers": [{"byteLength": 72, "uri": uri}],
    }
    path.write_text(json.dumps(document))
    return path


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_file_may_change_between_question_and_reading(tmp_path, monkeypatch):
    """Another process puts a pipe in its place, or writes on."""
    boundary = Boundary(tmp_path)
    os.mkfifo(tmp_path / "a.obj")
    monkeypatch.setattr(os.path, "isfile", lambda path: True)
    with pytest.raises(SceneError, match="there is no such file"):
        boundary.read(tmp_path / "a.obj", "a.obj")
    (tmp_path / "b.obj").write_bytes(b"12345")
    state = os.stat(tmp_path / "b.obj")
    monkeypatch.setattr(os, "fstat", lambda number: os.stat_result((*state[:6], 3, *state[7:])))
    with pytest.raises(SceneError, match="the file grows while it is read"):
        boundary.read(tmp_path / "b.obj", "b.obj")


@pytest.mark.skipif(os.open not in os.supports_dir_fd, reason="links need a privilege, and files no folder")
@pytest.mark.parametrize("swapped", ["a.mtl", "b"])
def test_a_link_that_takes_a_name_meanwhile_is_not_followed(swapped, inner, monkeypatch):
    """Another process puts it in place of a file, or of a folder, once the path has been checked."""
    for folder in (inner, inner.parent):
        (folder / "b").mkdir()
        for file in (folder / "a.mtl", folder / "b" / "a.mtl"):
            file.write_text(folder.name)
    path = inner / ("a.mtl" if swapped == "a.mtl" else "b/a.mtl")
    boundary, resolve = Boundary(inner), os.path.realpath
    assert boundary.read(path, "a").decode() == inner.name

    def swap(of):
        real = resolve(of)
        (inner / swapped).rename(inner / "before")
        (inner / swapped).symlink_to(inner.parent / swapped)
        return real

    monkeypatch.setattr(os.path, "realpath", swap)
    with pytest.raises(SceneError, match="a: "):
        boundary.read(path, "a")
    assert path.read_text() == inner.parent.name, "though it could be read"


def test_the_file_that_the_user_names_may_be_a_link_elsewhere(inner):
    (inner / "link.obj").symlink_to(inner.parent / "cube.obj")
    (inner / "link.toml").symlink_to(write_scene(inner.parent, SCENE))
    assert len(read_mesh_file(inner / "link.obj").mesh.faces) == 12
    write_room(inner)  # files are named relative to the link
    assert load_scene(inner / "link.toml").mobiles


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_or_a_device_is_not_read(tmp_path):
    """Reading one may never end."""
    for name in ("q.bin", "room.mtl", "pipe.obj"):
        os.mkfifo(tmp_path / name)
    with pytest.raises(SceneError, match="there is no such file"):
        read_mesh_file(write_gltf(tmp_path / "a.gltf", "q.bin"))
    with pytest.raises(SceneError, match="there is no such file"):
        read_mesh_file(write_gltf(tmp_path / "a.gltf", "/dev/zero"), boundary=Boundary(tmp_path, open=True))
    with pytest.raises(SceneError, match="there is no such file"):
        read_mesh_file(tmp_path / "pipe.obj")
    write_obj(tmp_path / "a.obj", before="mtllib room.mtl")
    assert any("room.mtl not found" in n for n in read_mesh_file(tmp_path / "a.obj").notes)


def test_a_ply_opens_no_other_file(tmp_path, monkeypatch):
    """Its comment names a texture, which is not used: a pipe of that name would never end."""
    head = "ply\nformat ascii 1.0\ncomment TextureFile {}\nelement vertex 3\nproperty float x\nproperty float y\n"
    head += "property float z\nproperty float s\nproperty float t\nelement face 1\n"
    head += "property list uchar int vertex_indices\nend_header\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n"
    (tmp_path / "inner").mkdir()
    for folder in (tmp_path, tmp_path / "inner"):
        (folder / "wood.png").write_bytes(b"GIF89a")
    opened = []
    monkeypatch.setattr("trimesh.resolvers.FilePathResolver.get", lambda _, name: opened.append(name) or b"")
    for name in ("wood.png", "../wood.png", str(tmp_path / "wood.png"), "/etc/passwd"):
        (tmp_path / "inner" / "a.ply").write_text(head.format(name))
        assert len(read_mesh_file(tmp_path / "inner" / "a.ply").mesh.faces) == 1
    assert not opened


def test_command_line(inner, capsys):
    (inner / "s.toml").write_text('[static]\nmesh = "../room.obj"\n')
    quick = ["info", str(inner / "s.toml"), "--photons", "100", "--radius", "0.1"]
    assert cli.main(quick) == cli.Exit.SCENE
    assert capsys.readouterr().err.count("\n") == 1
    assert cli.main([*quick, "--allow-outside"]) == 0
