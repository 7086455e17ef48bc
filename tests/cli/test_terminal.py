"""Text from files reaches the terminal as printable lines of its encoding; a closed pipe ends a command."""

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest

from app import __main__ as program
from app.cli.progress import Bar
from app.measure import scene_info
from app.session.log import Log
from gi_core.scene.errors import SceneError
from tests.support.mesh_writers import SCENE, write_scene

ROOT = Path(__file__).resolve().parents[2]
HOSTILE = "\x1b]0;title\x07\x1b[2J\x9b1m\x7f\r\x85\u202eright\u2028note: forged"
SAID = r"\x1b]0;title\x07\x1b[2J\x9b1m\x7f\r\x85\u202eright\u2028note: forged"
SMALL = ("--photons", "500", "--max-edge", "0.5")


def hostile_scene(folder: Path) -> Path:
    """Write a scene with terminal commands in title and names, in TOML's escapes."""
    name = "".join(f"\\u{ord(c):04x}" if not c.isalnum() else c for c in HOSTILE)
    lamp = f'[[light]]\ntype = "point"\nname = "{name}"\nposition = [0.5, 0.5, 0.5]\nflux = [1, 1, 1]\n'
    probe = f'[[probe]]\nname = "{name}"\nposition = [0.5, 0.5, 0.5]\nnormal = [0, 1, 0]\n'
    text = SCENE.replace('"test"', f'"{name}\\nnote: forged"').replace('"cube"', f'"{name}"')
    return write_scene(folder, text + lamp + probe)


def run(*arguments: str, **others) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, "-m", "app", *arguments], cwd=ROOT, capture_output=True, timeout=300, check=False, **others
    )


def test_names_of_a_file_are_printable_lines(tmp_path, capsys):
    scene = str(hostile_scene(tmp_path))
    assert program.main(["info", scene, *SMALL]) == 0
    said = capsys.readouterr().out
    assert said.replace("\n", "").isprintable()
    assert said.count(SAID) == 5  # title, mobile, its material, light, probe
    assert not any(line.startswith("note: forged") for line in said.splitlines())


@pytest.mark.parametrize("command", [("bench", "--frames", "2"), ("render", "--size", "32x20")])
def test_every_command_prints_printable_lines(command, tmp_path, capsys):
    scene = hostile_scene(tmp_path)
    scene = scene.rename(scene.with_name("\x1b[2J\x9b.toml"))
    out = tmp_path / "\x1b]0;a\x07.png"
    words = [command[0], str(scene), *command[1:], "--photons", "2000", "--max-edge", "0.5"]
    assert program.main([*words, "--out", str(out)] if command[0] == "render" else words) == 0
    captured = capsys.readouterr()
    assert captured.out and (captured.out + captured.err).replace("\n", "").isprintable()


def test_errors_and_logs_are_printable_lines(capsys):
    assert program.main(["render", "--out", HOSTILE]) == 2
    assert program.main([HOSTILE, f"--{HOSTILE}"]) == 2
    assert program.main(["info", f"no{HOSTILE}.toml"]) == 3
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 3 and said.replace("\n", "").isprintable()
    log = Log()
    log.error("reload", OSError(f"a\nb{HOSTILE}"))
    assert log.last.text.isprintable() and str(SceneError(HOSTILE)).isprintable()


def test_a_traceback_is_printable(monkeypatch, capsys):
    """The error of a failed task at rest names files, too."""

    def failing(_):
        try:
            raise OSError(HOSTILE)
        except OSError as problem:
            Log().failure("reference", problem)
        return ["end"]

    monkeypatch.setattr(scene_info, "info", failing)
    assert program.main(["info"]) == 0
    captured = capsys.readouterr()
    assert "Traceback" in captured.err and captured.err.replace("\n", "").isprintable()
    assert captured.out == "end\n"


@pytest.mark.parametrize("environment", [{"PYTHONIOENCODING": "ascii"}, {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0",
                                          "PYTHONUTF8": "0"}])  # fmt: skip
def test_letters_outside_the_encoding_are_escaped(environment, tmp_path):
    folder = tmp_path / "Möbel 壶"
    folder.mkdir()
    environment = {**os.environ, **environment}
    scene = write_scene(folder, SCENE.replace('"cube"', '"\\u58f6"'))
    done = run("info", str(scene), *SMALL, env=environment)
    assert done.returncode == 0 and rb'mobile "\u58f6"' in done.stdout
    done = run("info", str(scene.with_name("壶.toml")), env=environment)
    assert done.returncode == 3 and len(done.stderr.splitlines()) == 1 and done.stderr.isascii()


def test_undecodable_file_name_is_escaped(capsys):
    assert program.main(["info", "a\udcff.toml"]) == 3
    assert r"a\udcff.toml" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGPIPE")
@pytest.mark.parametrize(
    ("arguments", "codes"),
    [
        (("info", "cornell", "--photons", "100"), {141}),
        (("--version",), {141}),
        (("--help",), {0, 141}),  # argparse ignores a pipe that closes while it writes, not one at the last flush
        (("info", "nowhere"), {141}),
    ],
)
def test_closed_pipe_ends_a_command_quietly(arguments, codes):
    reading, writing = os.pipe()
    os.close(reading)
    fails = arguments[-1] == "nowhere"  # then stderr has no reader
    streams = (
        {"stdout": subprocess.PIPE, "stderr": writing} if fails else {"stdout": writing, "stderr": subprocess.PIPE}
    )
    done = subprocess.run([sys.executable, "-m", "app", *arguments], cwd=ROOT, timeout=300, check=False, **streams)
    os.close(writing)
    assert done.returncode in codes and not done.stdout and not done.stderr


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="Linux's full device")
def test_full_disk_is_reported_in_one_line():
    with open("/dev/full", "wb") as full:
        done = subprocess.run([sys.executable, "-m", "app", "--version"], cwd=ROOT, stdout=full, stderr=subprocess.PIPE)
    assert done.returncode == 2
    assert done.stderr.decode().splitlines() == ["gi-viewer: [Errno 28] No space left on device"]


def test_missing_streams_are_left_missing(monkeypatch):
    """Windows gives a program without a console none."""
    monkeypatch.setattr(sys, "stdout", None)
    monkeypatch.setattr(sys, "stderr", None)
    assert program.main(["info", "nowhere"]) == 3


def test_the_bar_is_drawn_on_the_guarded_stream(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)

    def drawing(_):
        with Bar() as bar:
            bar(f"a{HOSTILE}", 0.5)
        return []

    monkeypatch.setattr(scene_info, "info", drawing)
    assert program.main(["info"]) == 0
    said = terminal.getvalue()
    assert said.endswith("\r") and "\x1b" not in said and "\x9b" not in said
