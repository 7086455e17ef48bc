"""Files of a scene as commands leave them, and what commands say about the scene that they read."""

import io
import json
import struct
from pathlib import Path

import pytest

from app import __main__ as cli
from app.cli.writable import write_whole
from tests.support.cli_support import one_line
from tests.support.mesh_writers import BOX, BOX_FACES, write_glb, write_textured_room

QUICK = ["--photons", "2000", "--seconds", "0"]


@pytest.fixture
def room(tmp_path, monkeypatch) -> Path:
    """A floor with a texture under a lamp, in the working folder."""
    monkeypatch.chdir(tmp_path)
    write_textured_room(tmp_path)
    write_glb(Path("block.glb"), BOX * 0.1, BOX_FACES)
    return Path("room.obj")


@pytest.mark.parametrize(
    "command, out",
    [
        (["bake", "room.obj", "--mobile", "block.glb", *QUICK], "block.glb"),
        (["bake", "block.glb", *QUICK], "block.glb"),
        (["render", "room.obj", "--size", "64x48", *QUICK], "wood.png"),
        (["render", "room.obj", "--size", "64x48", *QUICK], "./../" + "{folder}/wood.png"),
    ],
)
def test_files_of_the_scene_stay_as_they_are(room, capsys, command, out):
    out = out.format(folder=Path.cwd().name)
    before = Path(out).read_bytes()
    assert cli.main([*command, "--out", out]) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert f"--out {Path(out)} is a file of the scene, which stays as it is; name another file" in one_line(said)
    assert Path(out).read_bytes() == before


def test_commands_say_what_they_added_and_missed(room, capsys):
    Path("wood.png").unlink()
    assert cli.main(["bake", "room.obj", *QUICK]) == 0
    assert "wood.png" in capsys.readouterr().err
    assert cli.main(["bake", "block.glb", "--out", "a.glb", *QUICK]) == 0
    assert "no light in the file" in capsys.readouterr().err


def test_faces_inside_out_are_named(room, capsys):
    turned = Path("room.obj").read_text().replace("f 4/4 3/3 2/2 1/1", "f 1/1 2/2 3/3 4/4")
    for corner in ("-1 0 -1", "1 0 -1", "1 0 1", "-1 0 1"):
        turned = turned.replace(f"v {corner}\n", f"v {corner.replace('1', '9')}\n")
    Path("room.obj").write_text(turned)
    Path("scene.toml").write_text('[static]\nmesh = ["room.obj"]\n[materials.floor]\ntwo_sided = false\n')
    assert cli.main(["info", "scene.toml", "--photons", "2000"]) == 0
    assert "of the light first meets backs of one-sided faces, which are black; turn" in capsys.readouterr().out


def test_a_baked_file_has_the_exposure_of_the_saved_scene(room):
    Path("saved.toml").write_text('scene = "room.obj"\n[settings]\nexposure = 3.5\n')
    notes = []
    for more in ([], ["--exposure", "-2"]):
        assert cli.main(["bake", "saved.toml", *QUICK, *more]) == 0
        glb = Path("gi-viewer.glb").read_bytes()
        notes.append(json.loads(glb[20 : 20 + struct.unpack_from("<I", glb, 12)[0]])["scenes"][0]["extras"])
    assert [n["picture_exposure"] for n in notes] == [3.5, 3.5] and notes[1]["exposure"] == -2 != notes[0]["exposure"]


def test_a_full_disk_is_named_with_the_file(tmp_path, monkeypatch):
    def full(self, data):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match="No space left") as error:
        write_whole(tmp_path / "a.glb", io.BytesIO(b"x").getvalue())
    assert str(tmp_path / "a.glb") in str(error.value)
