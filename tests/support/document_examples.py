"""Run the examples of a document in order, in a separate folder.

Python blocks share a namespace. A TOML block begins with `# NAME.toml`, or `# added to NAME.toml` to extend that file,
and must load. In shell blocks the lines that start with `gi-viewer` run, with few photons and pixels. A comment
`<!-- files: a.glb, b.obj -->` names files that the reader already has.
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from app import __main__ as cli
from app.commands.render import STILLS
from gi_core.files.load import load_scene
from gi_core.scene import SceneError
from tests.support.mesh_writers import BOX, BOX_FACES, write_glb
from tests.support.photometry import write_ies
from tests.support.small_charts import small_charts

ROOT = Path(__file__).resolve().parents[2]
ROOM = ROOT / "docs" / "your-own-room.md"


# Options that keep examples small; --estimator only where the example leaves it open.
SMALL = "--max-edge 0.5".split()
PHOTONS = "--photons 2000".split()
OF_COMMAND = {"view": [*PHOTONS, "--size", "64x40"], "render": [*PHOTONS, "--size", "64x40"], "bench": PHOTONS,
              "bake": PHOTONS,
              "info": PHOTONS, "tune": PHOTONS, "reference": ["--error", "30"],
              "chart": [*PHOTONS, "--quick", "--frames", "2", "--points", "50"]}  # fmt: skip
FRAMES = ["--frames", "2"]
TEXELS = ["--light-map", "128"]
CHEAPEST = ["--estimator", "impact_count"]
CHOOSE_THEMSELVES = ("reference", "tune")  # commands without --estimator


class Block(NamedTuple):
    """A fenced block, or a comment that names files."""

    language: str  # "files" for the comment
    line: int  # of its first line of text
    text: str


def blocks(path: Path) -> list[Block]:
    """Return the fenced blocks of a Markdown file and its comments about files, in order."""
    pattern = r"^```(\w*)[^\n]*\n(.*?)^```[ ]*$|^<!-- files: (.*?) -->$"
    text = path.read_text(encoding="utf-8")
    found = []
    for match in re.finditer(pattern, text, re.MULTILINE | re.DOTALL):
        line = text[: match.start()].count("\n") + 1
        if match[3] is not None:
            found.append(Block("files", line, match[3]))
        else:
            found.append(Block(match[1], line + 1, match[2]))
    return found


def work_through(document: str, monkeypatch, folder: Path) -> int:
    """Run a document's examples in `folder`; return the number of blocks run."""
    from app.window import window

    monkeypatch.chdir(folder)
    monkeypatch.setenv("GI_VIEWER_REFERENCE_DIR", str(folder / "reference"))
    monkeypatch.setattr(window, "why_no_window", lambda: "tests have no window")
    small_charts(monkeypatch)
    names: dict = {"__name__": document}
    done = 0
    for block in blocks(ROOT / document):
        where = f"{document}:{block.line}"
        if block.language == "files":
            bring(block.text)
        elif block.language == "python":
            # Blank lines in front: a traceback then has the line of the document.
            exec(compile("\n" * (block.line - 1) + block.text, str(ROOT / document), "exec"), names)
        elif block.language == "toml":
            load_toml(block.text, where)
        elif block.language == "sh":
            for command in commands(block.text):
                assert run(command) == 0, f"{where}: {command}"
        done += block.language in ("python", "toml", "sh")
    return done


def load_toml(text: str, where: str) -> None:
    """Write a block to the file that its first line names, and load that."""
    first = re.match(r"# (added to )?([\w-]+\.toml)\n", text)
    assert first, f"{where}: a scene must begin with `# NAME.toml` or `# added to NAME.toml`"
    file = Path(first[2])
    file.write_text((file.read_text() if first[1] else "") + text)
    try:
        load_scene(file)
    except SceneError as error:
        pytest.fail(f"{where}: {error}")


def commands(text: str) -> list[list[str]]:
    """Return the arguments of each line that calls gi-viewer."""
    lines = text.replace("\\\n", " ").splitlines()
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("gi-viewer")]


def run(arguments: list[str]) -> int:
    """Run a command on a small scale; its output files must exist afterwards."""
    name = arguments[0] if arguments and arguments[0] in cli.COMMANDS else "view"
    more = [*SMALL, *OF_COMMAND[name]]  # the last one counts where an option is given twice
    more += FRAMES if "--frames" in arguments else []
    more += TEXELS if "--light-map" in arguments else []
    more += CHEAPEST if "--estimator" not in arguments and name not in CHOOSE_THEMSELVES else []
    code = cli.main([*arguments, *more])
    for option in ("--out", "--json", "--screenshot"):
        if option in arguments:
            file = Path(arguments[arguments.index(option) + 1])
            if option == "--out" and "--frames" in arguments and file.suffix in STILLS:
                file = file.with_stem(f"{file.stem}.0001")
            assert file.stat().st_size > 0
    return code


FILES = {
    "empty.obj": "v 0 0 0\n",
    "flat.obj": "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n",
    "nan.obj": "v 0 0 0\nv 1 nan 0\nv 1 1 0\nf 1 2 3\n",
    "short.obj": "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 9\n",
    "text.gltf": "once upon a time",
    "zeros.gltf": '{"asset": {"version": "2.0"}, "nodes": [{"mesh": 0}], "meshes": [{"primitives": [{"attributes":'
    ' {"POSITION": 0}}]}], "accessors": [{"componentType": 5126, "count": 99999999, "type": "VEC3"}]}',
    "draco.gltf": '{"asset": {"version": "2.0"}, "extensionsUsed": ["KHR_draco_mesh_compression"]}',
}


def bring(names: str) -> None:
    """Write the named files with small contents."""
    for name in re.split(r",\s*", names):
        path = Path(name)
        if name in ("room.obj", "stool.obj"):
            exec(next(b.text for b in blocks(ROOM) if b.language == "python"), {})  # writes both
        elif name in FILES:
            path.write_text(FILES[name])
        elif path.suffix == ".glb" and name.startswith("room"):
            node = {"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [0.5, 0.8, 0.5]}
            lights = {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 5}]}}
            write_glb(path, BOX, BOX_FACES, material={"doubleSided": True}, nodes=[node], extensions=lights)
        elif path.suffix == ".ies":
            write_ies(path, [0.0, 45.0, 90.0], [0.0], np.array([[900.0, 500.0, 0.0]]))
        elif path.suffix == ".glb":
            write_glb(path, BOX * 0.2, BOX_FACES)
        else:
            pytest.fail(f"no test knows how to write {name}")
