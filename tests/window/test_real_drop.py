"""Files dropped by another program on a window of an X display (XDND)."""

import os
import shutil
import subprocess
import sys

import pytest

from tests.support.drop_target import FLOOR
from tests.support.mesh_writers import BOX, BOX_FACES, write_glb
from tests.support.viewer_support import ROOT

PATIENCE = 300.0  # s until a child that hangs is ended


@pytest.fixture
def display():
    """Start a virtual display; return the variables of its clients."""
    if shutil.which("Xvfb") is None:
        pytest.skip("no Xvfb")
    read, write = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write), "-screen", "0", "1024x768x24", "-nolisten", "tcp"],
        pass_fds=[write], stderr=subprocess.DEVNULL,
    )  # fmt: skip
    os.close(write)
    with os.fdopen(read) as file:
        number = file.readline().strip()
    if not number:
        server.wait()
        pytest.skip("Xvfb does not start")
    yield {**os.environ, "DISPLAY": f":{number}", "LIBGL_ALWAYS_SOFTWARE": "1"}
    server.terminate()
    try:
        server.wait(timeout=10)
    except subprocess.TimeoutExpired:  # with a client that was killed
        server.kill()
        server.wait()


@pytest.mark.gl
def test_a_mesh_becomes_an_object_where_it_falls_and_a_scene_opens_beside_the_picture(display, tmp_path):
    """The whole way: XDND messages, GLFW, the viewer's sleep between frames, the new object at that place."""
    display |= {"XDG_CONFIG_HOME": str(tmp_path / "config"), "GI_VIEWER_REFERENCE_DIR": str(tmp_path / "references")}
    thing = write_glb(tmp_path / "a thing.glb", BOX * 0.1, BOX_FACES)
    given = {"env": display, "cwd": ROOT, "text": True}
    viewer = subprocess.Popen([sys.executable, "-m", "tests.support.drop_target"], stdout=subprocess.PIPE, **given)

    def line(kind: str) -> list[str]:
        while (words := viewer.stdout.readline().split())[0] != kind:
            pass
        return words[1:]

    def drop(x: str, y: str) -> int:
        command = [sys.executable, "-m", "tests.support.xdnd", x, y, str(thing)]
        return subprocess.run(command, timeout=PATIENCE, **given).returncode

    try:
        x, y, _, beside, height = line("floor")
        assert line("object")[0] == "block"
        assert drop(beside, height) == 0
        assert line("opened") == str(thing).split(" ")
        assert drop(x, y) == 0
        *name, px, py, pz = line("object")
        assert " ".join(name) == "a thing"
        assert [float(n) for n in (px, py, pz)] == pytest.approx(FLOOR, abs=0.01)
    finally:
        viewer.kill()
        viewer.wait()
