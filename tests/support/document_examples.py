"""Run the examples of a document in order, in a separate folder.

Python blocks share a namespace. A TOML block begins with `# NAME.toml`, or `# added to NAME.toml` to extend that file,
and must load. Lines that start with `gi-viewer`, and calls in sentences, run in full, on a small room for each shipped
scene. A comment `<!-- files: a.glb, b.obj -->` names files that the reader already has.
"""

import re
import shlex
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from app import __main__ as cli
from app.commands.render import STILLS
from gi_core.files import load
from gi_core.files.find import find_scene, shipped_scenes
from gi_core.model import Model
from gi_core.scene import SceneError
from tests.support.mesh_writers import BOX, BOX_FACES, gltf_lights, write_glb
from tests.support.photometry import write_ies
from tests.support.small_scale import small_room, small_work

ROOT = Path(__file__).resolve().parents[2]


SMALLER = {  # values of options that an example gives, where they only make it larger
    "--size": "60x40", "--frames": "2", "--photons": "2000", "--points": "30", "--error": "30", "--seconds": "0.1",
    "--light-map": "128", "--scale": "2", "--max-edge": "0.5",
}  # fmt: skip
STANDS_FOR = {"SCENE": "cornell", "N": "2000", "R": "0.1", "DIR": "out", "COMMAND": "info"}  # names in the text
OUTPUTS = ("--out", "--json", "--csv", "--screenshot")
SHIPPED = shipped_scenes()
COMMAND = re.compile(r"^(?:    )?(gi-viewer(?:[ ].*)?)$|`(gi-viewer [^`\n]*)`", re.MULTILINE)


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


def enter(monkeypatch, folder: Path) -> None:
    """Work in `folder`, in small, where no window opens."""
    from app.window import window

    monkeypatch.chdir(folder)
    monkeypatch.setenv("GI_VIEWER_REFERENCE_DIR", str(folder / "reference"))
    monkeypatch.setattr(window, "why_no_window", lambda: "tests have no window")
    small_work(monkeypatch)


def work_through(document: str, monkeypatch, folder: Path) -> int:
    """Run a document's examples in `folder`; return the number of blocks run."""
    enter(monkeypatch, folder)
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
        load.load_scene(file)
    except SceneError as error:
        pytest.fail(f"{where}: {error}")


def commands(text: str) -> list[list[str]]:
    """Return the arguments of each line that calls gi-viewer, and of each call between backticks in a sentence."""
    calls = (line or inline for line, inline in COMMAND.findall(text.replace("\\\n", " ")))
    words = (shlex.split(call, comments=True)[1:] for call in calls)
    return [[STANDS_FOR.get(w, w) for w in call] for call in words]


def prose(path: Path) -> str:
    """Return the text of a Markdown file without its fenced blocks."""
    return re.sub(r"^```.*?^```[ ]*$", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)


def run(arguments: list[str]) -> int:
    """Run a command with smaller numbers, shipped scenes in small; its output files must exist afterwards."""
    if "--help" in arguments:
        with pytest.raises(SystemExit) as stop:
            cli.parse(arguments)
        return stop.value.code
    if arguments == ["atlas"]:
        arguments = ["atlas", "--out", "atlas"]
    small = [SMALLER.get(before, word) for before, word in zip(["", *arguments], arguments, strict=False)]
    for before, word in zip(["", *small], small, strict=False):
        if Path(word).suffix in (".toml", ".glb", ".obj") and before not in OUTPUTS and not Path(word).exists():
            bring(word)
    lamps = [w.partition("=")[0] for o, w in zip(small, small[1:], strict=False) if o == "--lamp"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(load, "find_scene", lambda name: stand_in(name, lamps) if name in SHIPPED else find_scene(name))
        code = cli.main(small)
    for option in OUTPUTS:
        if option in small:
            file = Path(small[small.index(option) + 1])
            if option == "--out" and "--frames" in small and file.suffix in STILLS:
                file = file.with_stem(f"{file.stem}.0001")
            assert file.stat().st_size > 0
    return code


def stand_in(name: str, lamps: list[str]) -> Path:
    """Write a small room in place of a shipped scene, with lamps that it must have too; return the file."""
    missing = set(lamps) - set(lamps_of(name)) if lamps else set()
    assert not missing, f"{name} has no lamp called {missing}"
    place = 'type = "point"\nposition = [0.5, 0.8, 0.5]\nflux = [9, 9, 9]\n'
    file = small_room(Path(), f"{name}.toml")
    file.write_text(file.read_text() + "".join(f'[[light]]\nname = "{lamp}"\n{place}' for lamp in lamps))
    return file


@cache
def lamps_of(name: str) -> tuple[str, ...]:
    return Model(load.load_scene(find_scene(name))).emitters.lamps.names


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


def write_rooms() -> None:
    """Write room.obj, 4 x 2.5 x 3 m with a lamp, and stool.obj."""
    reflectances = {"wall": 0.7, "wood": 0.4, "lamp": 0}
    library = "".join(f"newmtl {name}\nKd {rho} {rho} {rho}\n" for name, rho in reflectances.items())
    Path("room.mtl").write_text(f"{library}Ke 1500 1500 1500\n")
    lamp = BOX * [0.8, 0.02, 0.8] + [1.6, 2.45, 1.1]
    boxes = {"room": [("wall", BOX * [4, 2.5, 3], -1), ("lamp", lamp, 1)], "stool": [("wood", BOX * 0.5 - 0.25, 1)]}
    for name, parts in boxes.items():
        lines = ["mtllib room.mtl"]
        for material, corners, step in parts:
            lines += [f"usemtl {material}", *(f"v {x} {y} {z}" for x, y, z in corners)]
            lines += ["f " + " ".join(map(str, face - 8)) for face in BOX_FACES[:, ::step]]
        Path(f"{name}.obj").write_text("\n".join(lines) + "\n")


def bring(names: str) -> None:
    """Write the named files with small contents."""
    for name in re.split(r",\s*", names):
        path = Path(name)
        if name in ("room.obj", "stool.obj"):
            write_rooms()
        elif name in FILES:
            path.write_text(FILES[name])
        elif path.suffix == ".glb" and name.startswith("room"):
            lights = gltf_lights(({"type": "point", "intensity": 5}, {"translation": [0.5, 0.8, 0.5]}))
            grey = {"doubleSided": True, "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1]}}
            write_glb(path, BOX, BOX_FACES, material=grey, **lights)  # in a white room paths are long
        elif path.suffix == ".toml":
            small_room(Path(), name)
        elif path.suffix == ".ies":
            write_ies(path, [0.0, 45.0, 90.0], [0.0], np.array([[900.0, 500.0, 0.0]]))
        elif path.suffix == ".glb":
            write_glb(path, BOX * 0.2, BOX_FACES)
        else:
            pytest.fail(f"no test knows how to write {name}")
