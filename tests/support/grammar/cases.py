"""Cases: one scene file with all that it names, per seed."""

import os
from pathlib import Path

from tests.support.grammar.choices import Files, Grammar
from tests.support.grammar.gltf import gltf
from tests.support.grammar.obj import obj
from tests.support.grammar.ply import ply
from tests.support.grammar.toml import toml

KINDS = ("toml", "obj", "ply", "glb", "gltf")
ODDITIES = (0.0, 0.01, 0.04, 0.2)


def case(seed: int) -> tuple[str, Files, float]:
    """The file to open, all files beside it, and the oddity of one seed; the kinds follow each other."""
    oddity = ODDITIES[seed // len(KINDS) % len(ODDITIES)]
    g, kind, files = Grammar(seed, oddity), KINDS[seed % len(KINDS)], {}
    if kind in ("glb", "gltf"):
        return gltf(g, files, "case", kind == "glb"), files, oddity
    return {"toml": toml, "obj": obj, "ply": ply}[kind](g, files, "case"), files, oddity


def write(folder: Path, seed: int) -> Path:
    """Write the files of one seed, and those that odd names lead to; return the file to open."""
    folder.mkdir()
    name, files, _ = case(seed)
    (folder / "folder").mkdir()
    os.mkfifo(folder / "pipe")
    (folder / "loop").symlink_to("loop")
    for file, body in files.items():
        (folder / file).write_bytes(body)
    return folder / name
