"""The command line: codes, one-line errors, nothing heavy before it is needed."""

import argparse
import subprocess
import sys
import tomllib
import types
from pathlib import Path

import pytest

from app import __main__ as cli
from app.cli.options import settings_of
from app.commands import render as render_command
from app.settings import LampLevel, Settings, open_scene
from gi_core.instruments import compile_ahead
from tests.support.cli_support import FAST, FEW, one_line

ROOT = Path(__file__).resolve().parents[2]
HEAVY = ("numpy", "numba", "scipy", "trimesh", "embreex", "moderngl", "glfw", "imgui_bundle", "PIL")


def settings(*arguments: str) -> Settings:
    return settings_of(cli.parse(list(arguments)))


def test_a_list_of_numbers_may_begin_with_a_negative_one():
    """argparse takes -2,1 for an option; a room around the origin needs such numbers."""
    assert settings("render", "--camera", "-2,1.5,.5,-.1,0,0,40").camera == ((-2.0, 1.5, 0.5), (-0.1, 0.0, 0.0), 40.0)
    with pytest.raises(SystemExit):
        cli.parse(["render", "-x"])


@pytest.fixture
def no_window(monkeypatch):
    from app.window import window

    monkeypatch.setattr(window, "why_no_window", lambda: "no GL 3.3: install libgl1.")


# Nothing heavy --------------------------------------------------------------------------------------


def test_help_and_version_import_nothing_heavy():
    words = [["--help"], ["--version"], *([c, "--help"] for c in cli.COMMANDS), ["--size", "0"]]
    code = f"import sys; from app.__main__ import main; codes = [main(w) for w in {words!r}]\n"
    code += f"print(codes, [name for name in {HEAVY!r} if name in sys.modules], file=sys.stderr)"
    ran = subprocess.run([sys.executable, "-c", code], cwd=ROOT, text=True, capture_output=True, timeout=60)
    assert ran.stderr.splitlines()[-1] == f"{[*[0] * (len(words) - 1), 2]} []"


def test_version_equals_the_project_version(capsys):
    wanted = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert cli.main(["--version"]) == 0 and capsys.readouterr().out == f"gi-viewer {wanted}\n"


# Arguments ------------------------------------------------------------------------------------------


LAMPS = LampLevel("lamp", 0.5), LampLevel("red=lamp", 1.0, (1.0, 0.5, 0.0))
LIGHT = ("estimator", "photons", "radius", "neighbours", "control", "search", "rays", "seed")
PICTURE = ("size", "exposure", "white_balance", "tone_map", "show", "cull")
OPTIONS = {  # per command: the fields of Settings that it reads besides the scene's
    "": {*LIGHT, "lamps", "border_correction", "textbook", "light", "gloss", "budget", *PICTURE},
    "render": {*LIGHT, "lamps", "border_correction", "textbook", "light", "gloss", *PICTURE},
    "bake": {*LIGHT, "lamps", "border_correction", "textbook", "light", "white_balance"},
    "bench": {*LIGHT, "lamps", "border_correction", "textbook", "light", "gloss"},
    "chart": {*LIGHT, "lamps", "exposure"},
    "info": {*LIGHT, "lamps", "exposure"},
    "reference": {"lamps", "rays", "seed"},
}
WORDS = {
    "estimator": ("--estimator impact_count", "impact_count"),
    "photons": ("--photons 1e5", 100_000),
    "radius": ("--radius 0.02", 0.02),
    "neighbours": ("--neighbours 30", 30),
    "control": ("--no-control", False),
    "border_correction": ("--no-border-correction", False),
    "textbook": ("--textbook", True),
    "search": ("--search brute_force", "brute_force"),
    "light": ("--light best", "best"),
    "gloss": ("--gloss list", "list"),
    "lamps": ("--lamp lamp=0.5 --lamp red=lamp=1,0.5,0", LAMPS),
    "rays": ("--rays bvh", "bvh"),
    "seed": ("--seed 7", 7),
    "size": ("--size 64x48", (64, 48)),
    "exposure": ("--exposure -1.5", -1.5),
    "white_balance": ("--no-white-balance", False),
    "tone_map": ("--tone-map clip", "clip"),
    "show": ("--show irradiance", "irradiance"),
    "cull": ("--no-cull", False),
    "budget": ("--budget 8", 8.0),
}


@pytest.mark.parametrize("command", OPTIONS)
def test_every_command_has_a_scene_and_only_options_it_reads(command, capsys):
    scene = "x.toml --mobile a.glb --mobile b.glb --max-edge 0.1 --up z --units photometric --allow-outside"
    scene += " --pose chair=-1,2,3 --pose lamp=a=0,0,0,1,0,0,0"
    s = settings(*command.split(), *scene.split())
    assert (s.scene, s.mobiles, s.max_edge, s.up, s.allow_outside) == ("x.toml", ("a.glb", "b.glb"), 0.1, "z", True)
    assert s.units == "photometric" and open_scene(Settings("cornell", units=s.units)).units == "photometric"
    assert s.poses == (("chair", (-1, 2, 3)), ("lamp=a", (0, 0, 0, 1, 0, 0, 0)))
    for field, (words, value) in WORDS.items():
        if (command, field) == ("bake", "exposure"):
            continue  # that of its colours, in no setting: tests/cli/test_bake.py
        if field in OPTIONS[command]:
            assert getattr(settings(*command.split(), *words.split()), field) == value
        else:
            assert cli.main([*command.split(), *words.split()]) == 2
            assert "unrecognized" in capsys.readouterr().err


@pytest.mark.parametrize("command", OPTIONS)
def test_help_shows_options_by_group(command, capsys):
    assert cli.main([*command.split(), "--help"]) == 0
    text = capsys.readouterr().out
    assert all(f"\n{title}:\n" in text for title in ("scene", "light"))
    assert command or all(f"gi-viewer {name}" in text for name in cli.COMMANDS)


def test_defaults_leave_the_choice_to_scene_and_program():
    """The budget is the viewer's, and may be off."""
    assert (settings().budget, settings("--budget", "0").budget, settings("--budget", "33.3").budget) == (16, 0, 33.3)
    assert settings() == Settings()
    assert settings("render", "tree", "--size", "64x48") == Settings("tree", size=(64, 48))


@pytest.mark.parametrize(
    "bad",
    [
        "--photons 0", "--photons 1.5", "--photons many", "--photons nan", "--radius -1", "--radius inf",
        "--neighbours 0", "--seed -1", "--exposure nan", "--lamp x", "--lamp x=-1", "--lamp x=1,2", "--lamp =1",
        "--pose x=1,2", "--pose 1,2,3", "--pose x=1,2,nan", "--size 100", "--size 0x5", "--size -3x5",
        "--tone-map sepia", "--up w", "--budget -1", "--budget nan", "render --budget 16", "bench --budget 16",
        "--screenshot a.jpg", "--screenshot no/such/folder/a.png", "--nonsense", "a b",
    ],
)  # fmt: skip
def test_bad_usage_is_code_2(bad, capsys):
    assert cli.main(bad.split()) == 2
    assert one_line(capsys.readouterr().err).startswith("gi-viewer")


@pytest.mark.parametrize(
    ("typed", "meant"),
    [("--photon 10 --radios 2", "--radius"), ("rendr tree", "render"), ("bench --jsn a.json", "--json")],
)
def test_mistyped_option_gets_a_suggestion(typed, meant, capsys):
    assert cli.main(typed.split()) == 2
    said = one_line(capsys.readouterr().err)
    assert f"did you mean {meant}?" in said and "--help" in said
    assert cli.main(["--bogus"]) == 2  # taken for --neighbours: their dashes are alike
    assert "did you mean" not in one_line(capsys.readouterr().err)


def test_mistyped_scene_gets_a_suggestion(capsys):
    """Spaces of a name are shown: the sentence suggested the name that it refused, both written with one space."""
    assert cli.main(["info", "cornel"]) == 3
    assert "did you mean cornell?" in one_line(capsys.readouterr().err)
    assert cli.main(["info", "zzz"]) == 3
    assert "did you mean" not in one_line(capsys.readouterr().err)
    assert cli.main(["info", "office", "--lamp", "desk lamp  middle=0.5"]) == 3
    said = one_line(capsys.readouterr().err)
    assert "no lamp is called 'desk lamp  middle'; did you mean 'desk lamp middle'?" in said


def test_a_picture_without_a_name_replaces_none(capsys, tmp_path, monkeypatch):
    """The second render replaced the first one's picture."""
    monkeypatch.chdir(tmp_path)
    command = ["render", *FAST, "--size", "32x24"]
    for name in ("gi-viewer.png", "gi-viewer-001.png", "gi-viewer-002.png"):
        before = {p: p.read_bytes() for p in tmp_path.iterdir()}
        assert cli.main(command) == 0
        said = capsys.readouterr()
        assert Path(said.out.strip()) == (tmp_path / name).resolve() and said.err == ""
        assert {p: p.read_bytes() for p in before} == before and len(list(tmp_path.iterdir())) == len(before) + 1
    assert cli.main([*command, "--out", "gi-viewer.png"]) == 0 and capsys.readouterr().err == ""
    for name in ("gi-viewer.0001.png", "gi-viewer-001.0001.png"):
        assert cli.main([*command, "--frames", "1"]) == 0
        assert Path(capsys.readouterr().out.strip()) == (tmp_path / name).resolve()
    assert len(list(tmp_path.iterdir())) == 5


def test_an_unknown_estimator_is_refused_with_the_names_there_are(capsys, estimator):
    assert cli.main(["info", *FEW, "--estimator", "guess"]) == 2
    assert estimator in one_line(capsys.readouterr().err)


# Scenes that cannot be used -------------------------------------------------------------------------


@pytest.mark.parametrize("command", [c.split() for c in OPTIONS])
def test_missing_scene_exits_with_3_and_one_line(command, capsys, tmp_path, monkeypatch, no_window):
    monkeypatch.chdir(tmp_path)
    assert cli.main([*command, "nowhere.glb"]) == 3
    captured = capsys.readouterr()
    assert "nowhere.glb" in one_line(captured.err) and captured.out == ""


@pytest.mark.parametrize(
    "words", ["info cornell --lamp lmap=0.5", "render cornell --lamp lmap=1", "measure cornell --watts lmap=5"]
)
def test_a_mistyped_lamp_is_refused_before_kernels_compile(capsys, monkeypatch, words):
    monkeypatch.setattr("app.cli.progress.compile_kernels", lambda *of: pytest.fail("compiles"))
    assert cli.main(words.split()) == 3
    assert "no lamp is called 'lmap'; did you mean 'lamp'?" in one_line(capsys.readouterr().err)


def test_unknown_mobile_and_non_rigid_pose_exit_with_3(capsys):
    assert cli.main(["info", *FEW, "--pose", "nobody=0,0,0"]) == 3
    assert '"nobody"' in one_line(capsys.readouterr().err)
    assert cli.main(["info", *FEW, "--pose", "pawn=0,0,0,2,0,0,0"]) == 3
    assert "length 1" in one_line(capsys.readouterr().err)


# No window ------------------------------------------------------------------------------------------


def test_without_a_window_the_picture_goes_to_a_file(capsys, tmp_path, monkeypatch, no_window):
    monkeypatch.chdir(tmp_path)
    said = []  # by the time the work begins
    render = render_command.render
    monkeypatch.setattr(render_command, "render", lambda *a: (said.append(capsys.readouterr()), render(*a))[1])
    assert cli.main([*FAST, "--size", "64x48"]) == 0
    out = capsys.readouterr().out
    picture = tmp_path / "gi-viewer.png"
    assert picture.is_file() and str(picture.resolve()) in out
    assert "install libgl1" in one_line(said[0].err) and said[0].out == ""
    first = picture.read_bytes()
    assert cli.main([*FAST, "--size", "32x24"]) == 0
    assert str((tmp_path / "gi-viewer-001.png").resolve()) in capsys.readouterr().out
    assert picture.read_bytes() == first


def test_no_window_without_fallback_exits_with_4(capsys, tmp_path, monkeypatch, no_window):
    monkeypatch.chdir(tmp_path)
    assert cli.main([*FAST, "--no-fallback"]) == 4
    assert "install libgl1" in one_line(capsys.readouterr().err) and not list(tmp_path.iterdir())


def test_with_a_window_the_viewer_gets_the_settings(monkeypatch):
    from app.window import window

    seen = []
    monkeypatch.setattr(window, "why_no_window", lambda: None)
    monkeypatch.setitem(
        sys.modules, "app.window.viewer", types.SimpleNamespace(run=lambda s, screenshot: seen.append(s) or 0)
    )
    assert cli.main([*FAST, "--exposure", "2"]) == 0
    assert seen == [Settings(photons=2000, exposure=2.0, light="photons")]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["render", "--exposure", "1e9"], "argument --exposure: must be -64 .. 64 stops, got 1e9"),
        (["render", "--exposure", "bright"], "argument --exposure: must be a number, got bright"),
        (["render", "--truth", "0"], "argument --truth: must be a whole number in 1 .. 65536, got 0"),
        (["render", "--photons", "many"], "argument --photons: must be a whole number in 1 .. 134217728, got many"),
        *(
            (["bake", "--light-map", n], f"--light-map: must be a whole number in 16 .. 8192, got {n}")
            for n in ("0", "15", "16.5", "99999", "inf", "large")
        ),
    ],
)
def test_values_out_of_range_get_a_sentence(words, message, capsys):
    assert cli.main([*words, "cornell"]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    "words, light",
    [
        ([], "best"),
        (["--light", "photons"], "photons"),
        (["--estimator", "photon_map"], "photons"),
        (["--estimator", "photon_map", "--light", "best"], "best"),
        (["render"], "best"),
        (["bench"], "photons"),
        (["bench", "--light", "best"], "best"),
    ],
)
def test_light_is_gathered_without_an_estimator_option(words, light):
    assert settings_of(cli.parse(words)).light_chosen == light


@pytest.mark.parametrize("name", ["estimator", "search", "rays"])
@pytest.mark.parametrize("command", [[], ["render"], ["chart"], ["info"]])
def test_unknown_names_are_refused_before_any_work(monkeypatch, capsys, command, name):
    from app.window import viewer, window

    def too_late(*_, **__):
        raise AssertionError("checked after the names")

    monkeypatch.setattr(compile_ahead, "compile_kernels", too_late)
    monkeypatch.setattr(window, "why_no_window", too_late)
    monkeypatch.setattr(viewer, "run", too_late)
    assert cli.main([*command, "no such file.glb", f"--{name}", "guess"]) == 2
    assert f"--{name} must be one of " in (line := one_line(capsys.readouterr().err)) and 'got "guess"' in line


@pytest.mark.parametrize(
    "words",
    [
        *(f"render --{o}" for o in ("frames 1e12", "rate 1e23", "scale 1e9", "photons 1e30")),
        *(f"render --{o}" for o in ("radius 1e300", "neighbours 1e9", "max-edge 1e-200", "exposure 1e300")),
        *(f"render --{o}" for o in ("seconds 1e300", "lamp a=1e30", "frames 0", "isolines 1e-320")),
        *(f"render --{o}" for o in ("pose a=1e300,0,0", "camera 1e200,0,0,0,0,0,40", "illuminance-range 0,5e-324")),
        "render --luminance-range 1e-300,1e300",
        *(f"{c} --error {e}" for c in ("reference", "measure", "bake") for e in ("1e-12", "1e9")),
        *("bench --frames 1e12", "bench --step 1e300", "chart --frames 1e9", "chart --points 1e12", "--budget 1e300"),
    ],
)
def test_every_number_has_bounds(words, capsys):
    """1e12 pictures filled the memory; ends of a scale below the least normal number ended in a traceback."""
    assert cli.main(words.split()) == 2
    assert f"{words.split()[-2]}: must be " in one_line(capsys.readouterr().err)


@pytest.mark.parametrize("command", ["view", *cli.COMMANDS])
def test_no_option_takes_a_number_that_nothing_can_hold(command):
    """A new option has bounds too."""
    readers = {a.option_strings[0]: a.type for a in cli._filled(cli.Parser(), command)._actions if a.type}
    for option, read in readers.items():
        for text in ("1e30", "1e30,2e30", "a=1e30", f"1x{10**30}", "a=0,0,1e30", "0,0,1e30,1,1,1,40", "0,0,1,1,1e30"):
            if read is not Path:
                with pytest.raises((argparse.ArgumentTypeError, ValueError)):
                    print(option, read(text))
