"""The documentation is correct: examples run, tables are complete, quoted messages are the program's."""

import importlib
import inspect
import re
import shlex
from pathlib import Path

import pytest

from app import __main__ as cli
from gi_core import defaults
from gi_core.files import completion
from gi_core.files.completion import refinement
from gi_core.files.find import shipped_scenes
from gi_core.files.formats import mesh_file
from gi_core.files.formats.shapes import OF_ROOM, SHAPES
from gi_core.files.load import MOST_RECEIVERS, load_scene
from gi_core.geometry import receivers
from gi_core.scene import SceneError
from tests.support.document_examples import ROOT, bring, commands, enter, prose, run, work_through

DOCUMENTS = [
    "docs/your-own-room.md",
    "docs/scene-format.md",
    "docs/api.md",
    "docs/chart.md",
    "docs/export.md",
    "README.md",
]


@pytest.mark.parametrize("document", DOCUMENTS)
def test_every_example_runs(document, monkeypatch, tmp_path):
    assert work_through(document, monkeypatch, tmp_path) >= 1


PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub writes them."""
    titles = re.findall(r"^#+ (.*)$", prose(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def test_every_link_between_pages_leads_somewhere():
    dead = []
    for page in PAGES:
        for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
            name, _, anchor = link.partition("#")
            target = (page.parent / name).resolve() if name else page
            if not link.startswith("http") and (not target.exists() or (anchor and anchor not in anchors(target))):
                dead.append(f"{page.relative_to(ROOT)}: {link}")
    assert dead == []


def test_pages_that_the_code_names_exist():
    code = [p for folder in ("app", "gi_core", "studies", "tests") for p in (ROOT / folder).rglob("*.py")]
    named = {name for path in code for name in re.findall(r"\bdocs/[\w/-]+\.md", path.read_text(encoding="utf-8"))}
    assert named and [name for name in named if not (ROOT / name).exists()] == []


IN_TEXT = {  # each command outside of the blocks, and where it stands first
    shlex.join(words): (words, path)
    for path in reversed(PAGES)
    for words in reversed(commands(prose(path)))
    if words != ["NAME"]  # an attribute of OpenEXR files
}


def options(line: str) -> set[str]:
    words, _ = IN_TEXT[line]
    return {words[0], *(w for w in words if w.startswith("--"))}


@pytest.mark.parametrize("line", [a for a in IN_TEXT if not any(options(a) < options(b) for b in IN_TEXT)])
def test_every_command_in_the_text_runs(line, monkeypatch, tmp_path):
    """Or another one with all of its options."""
    words, path = IN_TEXT[line]
    enter(monkeypatch, tmp_path)
    assert run(words) == 0, f"{path.relative_to(ROOT)}: gi-viewer {line}"


def test_every_command_in_the_text_names_a_scene_that_is():
    named = [cli.parse(words).scene for words, _ in IN_TEXT.values() if not {"--help", "atlas"} & set(words)]
    assert {name for name in named if not Path(name).suffix} <= {*shipped_scenes()}


def test_the_design_lists_every_package():
    text = section(ROOT / "docs" / "design.md", "Flow")
    listed = re.findall(r"^    ((?:gi_core|app)/[\w/]*(?:\.py)?)", text, re.MULTILINE)
    packages = {
        f"{p.parent.relative_to(ROOT).as_posix()}/"
        for top in ("gi_core", "app")
        for p in (ROOT / top).rglob("__init__.py")
    }
    assert packages - {"gi_core/", "app/"} == {name for name in listed if name.endswith("/")}
    assert [name for name in listed if not (ROOT / name).exists()] == []


# Scene format -----------------------------------------------------------------------------------------

FORMAT = ROOT / "docs" / "scene-format.md"
UNKNOWN = {  # section: a scene with an unknown key in that table, so that the error lists all known ones
    "At the top of the file": "____ = 1",
    "[static]": "static = { ____ = 1 }",
    "[[shape]]": "shape = [{ type = 'box', ____ = 1 }]",
    "[[mobile]]": "mobile = [{ ____ = 1 }]",
    "[mobile.path]": 'mobile = [{ name = "m", mesh = "room.obj", path = { ____ = 1 } }]',
    'type = "point"': 'light = [{ type = "point", ____ = 1 }]',
    'type = "spot"': 'light = [{ type = "spot", ____ = 1 }]',
    'type = "directional"': 'light = [{ type = "directional", ____ = 1 }]',
    'type = "sky"': 'light = [{ type = "sky", ____ = 1 }]',
    "[daylight]": "daylight = { ____ = 1 }",
    "[materials.NAME]": "materials.wall = { ____ = 1 }",
    "[camera]": "camera = { ____ = 1 }",
    "[[probe]]": "probe = [{ ____ = 1 }]",
    "[defaults]": "defaults = { ____ = 1 }",
}


def section(path: Path, title: str) -> str:
    """Return the text under a heading, up to the next one."""
    found = re.search(rf"^##+ {re.escape(title)}$(.*?)(?=^#|\Z)", path.read_text(encoding="utf-8"), re.M | re.S)
    assert found, f"{path.name} has no section {title!r}"
    return found[1]


def complaint(line: str) -> str:
    """Return the error of loading room.toml, which has one line of TOML and a mesh."""
    mesh = "" if line.startswith(("static", "#")) else 'static.mesh = "room.obj"\n'
    Path("room.toml").write_text(f"{line}\n{mesh}")
    with pytest.raises(SceneError) as caught:
        load_scene("room.toml")
    return str(caught.value)


@pytest.mark.parametrize("title", UNKNOWN)
def test_table_has_exactly_the_keys_of_the_program(title, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    bring("room.obj")
    sentence = complaint(UNKNOWN[title])
    known = re.search(r"unknown key '____'; there is (.*)", sentence)
    assert known, sentence
    rows = re.findall(r"^\| `(\w+)` \|", section(FORMAT, title), re.MULTILINE)
    assert sorted(rows) == sorted(re.findall(r'"(\w+)"', known[1]))


def test_each_type_of_shape_has_its_keys():
    rows = dict(re.findall(r"^\| `\"(\w+)\"` \| (.*) \|$", section(FORMAT, "[[shape]]"), re.MULTILINE))
    keys = {kind: {*schema} | ({*OF_ROOM} if kind == "room" else set()) for kind, (_, schema) in SHAPES.items()}
    assert {kind: {*re.findall(r"`(\w+)`", row)} for kind, row in rows.items()} == keys


def test_every_sentence_about_a_mistake_is_the_programs(monkeypatch, tmp_path):
    """Those of the document, and further ones that only this test needs."""
    monkeypatch.chdir(tmp_path)
    bring("room.obj, a.ies")
    more = ROOT / "tests" / "support" / "scene_mistakes.txt"
    text = section(FORMAT, "When something is wrong") + more.read_text(encoding="utf-8")
    mistakes = re.findall(r"^\| `([^`]+)` \| `(.+)` \|$", text, re.MULTILINE)
    meshes = re.findall(r"^\| `([\w.]+)`, [^|]+ \| `(.+)` \|$", text, re.MULTILINE)
    assert len(mistakes) > 140 and len(meshes) > 6
    assert len(mistakes) + len(meshes) == text.count("\n| `")
    for name, sentence in meshes:
        bring(name)
        mistakes.append((f'static = {{ mesh = "{name}" }}', sentence))
    for line, sentence in mistakes:
        said = complaint(line)
        if sentence.endswith("..."):  # the rest is the words of a library
            said = said[: len(sentence) - 3] + "..."
        assert said == sentence, line


def test_numbers_in_the_text_are_those_of_the_program():
    text = " ".join(FORMAT.read_text(encoding="utf-8").split())
    for sentence in (
        f"some {MOST_RECEIVERS:,} receivers",
        f"reflectances above {mesh_file.MOST_REFLECTANCE:g} ",
        f"at less than {receivers.CREASE_DEGREES:g} degrees",
        f"noise of {100 * defaults.LEAST_NOISE:g} %, at most {defaults.MOST_PHOTONS:,} or as many as",
        f"as many as {defaults.MOST_SECONDS:g} s on two cores allow",
        f"| at most {100 * defaults.RADIUS_SHARE:g} % of the scene size, less on uneven surfaces |",
        f"on a disc of that radius, {defaults.NEIGHBOURS} to {defaults.MOST_NEIGHBOURS:,} |",
        f"longer than {one_over(completion.LARGEST_MOBILE)} of the scene "
        f"or shorter than {one_over(completion.SMALLEST_MOBILE)} of it",
        f"split to {one_over(refinement.COARSEST)} of their length",
    ):
        assert sentence in text


def one_over(share: float) -> str:
    return f"1/{1 / share:g}"


def test_every_shipped_scene_is_in_the_readme():
    text = section(ROOT / "README.md", "Commands")
    assert [name for name in shipped_scenes() if f"`{name}`" not in text] == []


# Interface --------------------------------------------------------------------------------------------

PUBLIC = ("gi_core.scene", "gi_core.files.load", "gi_core.files.find", "gi_core.solver", "gi_core.gather.reference")


@pytest.mark.parametrize("module", PUBLIC)
def test_every_public_name_has_a_docstring(module):
    """The reference is generated from them (`just docs`)."""
    loaded = importlib.import_module(module)
    names = getattr(loaded, "__all__", None) or [
        name
        for name, thing in vars(loaded).items()
        if not name.startswith("_") and getattr(thing, "__module__", None) == module and callable(thing)
    ]
    assert names
    for name in names:
        thing = getattr(loaded, name)
        if not inspect.isclass(thing) and not inspect.isfunction(thing):
            continue
        own = (inspect.getdoc(thing) or "").strip()
        assert own and not own.startswith(f"{name}("), f"{module}.{name} has no docstring"
        for member, value in vars(thing).items() if inspect.isclass(thing) else ():
            if inspect.isfunction(value) and not member.startswith("_"):
                assert inspect.getdoc(value), f"{module}.{name}.{member} has no docstring"
