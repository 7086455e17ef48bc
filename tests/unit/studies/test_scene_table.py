"""The table of scenes (`studies.scene_table`): files found, comments kept, files that do not load."""

import pytest
from PIL import Image

from studies import scene_table
from tests.support.mesh_writers import write_room

FEW = ["--photons=5000", "--size=320x200"]


def test_folders_files_shipped_scenes_and_mobiles_become_cases(tmp_path):
    (tmp_path / "a").mkdir()
    write_room(tmp_path / "a")
    found = scene_table.cases([str(tmp_path), "cornell", f"{tmp_path}/a/room.obj+{tmp_path}/a/cube.obj"])
    assert [name for name, _ in found] == ["a/cube.obj", "a/room.obj", "cornell", "a/room.obj+a/cube.obj"]


@pytest.mark.slow
def test_rows_and_written_comments_are_kept(tmp_path):
    """One file that loads, one that does not; the second time neither is opened again."""
    write_room(tmp_path)
    (tmp_path / "bad.glb").write_text("no")
    out = tmp_path / "rows"
    out.mkdir()
    rows = [scene_table._child(str(tmp_path / f), f, out, 300, FEW) for f in ("room.obj", "bad.glb")]
    good, bad = rows
    assert good["file"] == 14 and good["drawn"] > 14 and not good["nan"] and good["stages"]["ready"] > 0
    assert (out / "room.obj.png").stat().st_size > 1000
    assert good["stages"]["gathered"] > good["stages"]["ready"]
    assert Image.open(out / "room.obj.gathered.png").text["static_light"].startswith("gathered")
    assert "must hold glTF JSON" in bad["refused"]
    (tmp_path / "room.obj").unlink()
    assert scene_table._child(str(tmp_path / "room.obj"), "room.obj", out, 300, []) == good

    document = tmp_path / "tried.md"
    document.write_text(f"before\n{scene_table.BEGIN}\n{scene_table.END}\nafter\n")
    scene_table.write_table(document, rows)
    text = document.read_text()
    assert text.count("not looked at yet") == 2 and "refused" in text
    document.write_text(text.replace("not looked at yet", "good", 1))
    scene_table.write_table(document, rows[::-1])
    text = document.read_text()
    assert text.startswith("before\n") and text.endswith("after\n")
    assert [line.rsplit("| ", 1)[1] for line in text.splitlines() if "room.obj" in line] == ["good |"]
    assert text.count("not looked at yet") == 1
