"""The window on an X display: all other tests draw without a screen."""

import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from tests.support.viewer_support import ROOT


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
    server.wait()


@pytest.mark.gl
def test_the_window_shows_a_scene(display, tmp_path):
    display |= {"XDG_CONFIG_HOME": str(tmp_path / "config"), "GI_VIEWER_REFERENCE_DIR": str(tmp_path / "references")}
    words = "furnace --photons 2000 --light photons --size 640x480 --no-fallback --screenshot".split()
    command = [sys.executable, "-m", "app", *words, str(tmp_path / "window.png")]
    subprocess.run(command, env=display, cwd=ROOT, timeout=300, check=True)
    with Image.open(tmp_path / "window.png") as picture:
        assert len(np.unique(np.asarray(picture)[..., :3].reshape(-1, 3), axis=0)) > 200
