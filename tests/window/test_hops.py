"""The modules between a pose and its pixels are within their bound."""

import subprocess
import sys

import pytest

from studies import ratchet

pytestmark = [pytest.mark.gl, pytest.mark.slow]


def test_modules_from_pose_to_pixel_are_within_their_bound():
    """In a process of its own: the profile sees all that runs. Few photons take the same path."""
    few = "from studies import hops; hops.PHOTONS = 4096; hops.main()"
    ran = subprocess.run([sys.executable, "-c", few], cwd=ratchet.ROOT, text=True, capture_output=True, timeout=300)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    counts = dict(line.split(": ") for line in ran.stdout.splitlines() if " modules without the panel" in line)
    assert int(counts["frame"].split()[0]) > int(counts["path"].split()[0]) > 20
    assert int(counts["path"].split()[0]) <= ratchet.bounds()[ratchet.HOPS], ran.stdout
