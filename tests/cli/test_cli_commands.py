"""Output of commands: paths, info, Ctrl+C, progress bar, names of any alphabet."""

import io
import sys
import warnings
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from app import __main__ as cli
from app.cli import progress
from app.cli.progress import Bar
from app.measure import atlas, scene_info
from app.measure.scene_info import material_lines
from gi_core.instruments import compile_ahead
from gi_core.model import Model
from gi_core.scene import Material, Mobile, PointLight, Scene
from gi_core.scene.types import Gloss
from tests.support.cli_support import FAST, FEW, one_line
from tests.support.mesh_writers import BOX, write_obj, write_room
from tests.support.scene_builders import box, grey, quad

# Commands -------------------------------------------------------------------------------------------


def test_render_prints_the_full_path(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["render", *FAST, "--out", "a.png", "--size", "64x48", "--pose", "pawn=0.3,0.05,0.2"]) == 0
    assert capsys.readouterr().out == f"{(tmp_path / 'a.png').resolve()}\n"
    assert Image.open(tmp_path / "a.png").text["pose pawn"].startswith("0.3,0.05,0.2,")


def test_measure_prints_a_surface_and_writes_it(capsys, tmp_path, monkeypatch):
    """The furnace: E = pi Le / (1 - rho) = 3.696 W/m2 in luminance, everywhere."""
    monkeypatch.chdir(tmp_path)
    keys = "position = [0.5, 0.5], size = [0.6, 0.6], height = 0.5, points = [2, 3], targets = { mean = 1 }"
    plane = ["--surface", f'name = "table", {keys}']
    assert cli.main(["measure", "furnace", *plane, "--error", "2", "--csv", "a.csv", "--lamp", "furnace=0.5"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "table              0.6 x 0.6 m, 0.5 m above the floor, 2 x 3 points"
    mean, _, error, unit, *target = lines[1].split()[1:]
    assert " ".join(target) == "at least 1 W/m²: pass"
    assert abs(float(mean) - 3.696 / 2) < 0.02 and 0 < float(error) < 0.02 and unit == "W/m²"
    assert [line.split()[0] for line in lines[2:6]] == ["minimum", "maximum", "uniformity", "diversity"]
    assert lines[7:9] == ["Irradiance [W/m²]", "  z \\ x [m]     0.35     0.65"]
    assert [line for line in lines if line.startswith("probe")][0].startswith('probe "floor"')
    table = (tmp_path / "a.csv").read_text().splitlines()
    assert sum(row.startswith("surface point,") for row in table) == 6
    assert sum(row.startswith("probe,") for row in table) == 2


def test_measure_reads_the_pins_and_the_plane_of_a_saved_scene(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plane = '[[surface]]\nname = "desk"\nposition = [0.5, 0.5]\nsize = [0.2, 0.2]\nheight = 0.5\npoints = [1, 1]\n'
    pin = '[[pins]]\nname = "lid"\nobject = "cube"\nposition = [0, 0.1, 0]\nnormal = [0, 1, 0]\n'
    (tmp_path / "a.toml").write_text(f'scene = "furnace"\n{plane}{pin}')
    assert cli.main(["measure", "a.toml", "--error", "5"]) == 0
    out = capsys.readouterr().out
    assert "0.5 m above the floor, 1 x 1 points" in out and 'pin "lid"' in out
    assert "by lamp" not in out and cli.main(["measure", "a.toml", "--error", "5", "--shares"]) == 0
    lines = capsys.readouterr().out.splitlines()
    floor = lines.index("   by lamp")  # of the first probe; the cube is in the dark
    assert lines[floor - 1].startswith('probe "floor"') and lines[-1].split() == ["pin", '"lid"', "0", "W/m²"]
    assert lines[floor + 1].split() == ["furnace", "100.0", "±", "0.0", "%"]
    (tmp_path / "a.toml").write_text(f'scene = "furnace"\n{plane}{pin.replace("cube", "chair")}')
    assert cli.main(["measure", "a.toml"]) == 2
    assert (
        one_line(capsys.readouterr().err)
        == 'gi-viewer: the pin "lid" lies on "chair", which this scene does not have\n'
    )


def test_measure_refuses_a_bad_table_before_the_work(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for file, reason in (("a.txt", "--csv must name a .csv file, got a.txt"), ("b/a.csv", "a folder that exists")):
        assert cli.main(["measure", "cornell", "--csv", file]) == 2
        assert reason in one_line(capsys.readouterr().err)
    for keys, reason in (
        ("0,0,1", "must be keys of [[surface]] such as"), ("height = 1", 'name is missing; write name = "..."'),
        ('name = "a", targets = { mean = -1 }', "mean must be a finite number > 0"),
        ('name = "a", on = "b", tilt = 3', "the surface has the tilt of the face it lies on; leave out tilt, or on"),
    ):  # fmt: skip
        assert cli.main(["measure", "cornell", "--surface", keys]) == 2
        assert reason in capsys.readouterr().err
    assert cli.main(["measure", "cornell", "--surface", 'name = "a", on = "pawm"']) == 3
    assert "on must be a mobile or a material of the static part, got 'pawm'; did you mean 'pawn'?" in (
        one_line(capsys.readouterr().err)
    )


def test_the_reference_has_the_levels_of_the_lamps(capsys, tmp_path, monkeypatch):
    """At one noise, the same paths; their light is proportional to the lamp's level."""
    monkeypatch.setenv("GI_VIEWER_REFERENCE_DIR", str(tmp_path))
    light = []
    for lamp in ([], ["--lamp", "furnace=0.25"]):
        assert cli.main(["reference", "furnace", "--error", "30", *lamp]) == 0
        [line] = [s for s in capsys.readouterr().out.splitlines() if s.startswith("mean irradiance")]
        light.append([float(c) for c in line.removeprefix("mean irradiance: ").removesuffix(" W/m2").split(", ")])
    assert light[1] == pytest.approx([0.25 * c for c in light[0]], rel=1e-4) and min(light[0]) > 1
    assert cli.main(["reference", "furnace", "--lamp", "sun=2"]) == 3
    assert "no lamp is called 'sun'; there is \"furnace\"" in one_line(capsys.readouterr().err)


def test_info_lists_contents_and_reasons(capsys, estimator):
    assert cli.main(["info", *FEW, "--radius", "0.02"]) == 0
    text = capsys.readouterr().out
    assert "Python threads over kernels that release the GIL" in text
    for part in ("triangles", 'mobile "pawn"', 'light "lamp"', "absorbed", "kernel cache", "threads", estimator):
        assert part in text
    assert "0.02 m: as given" in text and "2,000: as given" in text and "warning" not in text


def test_info_prints_the_power_of_lamps_whose_watts_are_known(capsys, tmp_path):
    shapes = '[{ type = "room", name = "lamp", size = [4, 2.5, 3], max_edge = 1 }]'
    (tmp_path / "room.toml").write_text(
        f"shape = {shapes}\nwatts = {{ lamp = 12 }}\nmaterials.lamp.emission = [1, 1, 1]\n"
    )
    assert cli.main(["info", str(tmp_path / "room.toml"), "--photons", "2000"]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("power")]
    assert line.split(maxsplit=1)[1] == "12 W, 1 W/m² of 12 m² floor"


def test_info_lists_materials_by_area_and_counts_the_rest(capsys, tmp_path):
    """Sixteen squares of increasing size, each with another material; the largest two share a name."""
    lines, library = ["mtllib sheets.mtl"], []
    for k in range(16):
        side, name = 1.0 + k, f"m{min(k, 14)}"
        corners = [(0, 0), (side, 0), (side, side), (0, side)]
        lines += [*(f"v {x + 40 * k} 0 {-z}" for x, z in corners), f"usemtl {name}", "f -4 -3 -2 -1"]
        library.append(f"newmtl {name}\nKd 0.{k + 10} 0.2 0.3\n" + ("Ke 5 6 7\n" if k == 10 else ""))
    (tmp_path / "sheets.obj").write_text("\n".join(lines))
    (tmp_path / "sheets.mtl").write_text("".join(library))
    (tmp_path / "sheets.toml").write_text('[static]\nmesh = "sheets.obj"\n[materials.m3]\ntwo_sided = false\n')
    assert cli.main(["info", str(tmp_path / "sheets.toml"), "--photons", "2000", "--radius", "1"]) == 0
    lines = capsys.readouterr().out.splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("materials "))
    table = lines[first + 1 : first + 14]
    assert [line.split('"')[1] for line in table[:12]] == [f"m{k}" for k in range(14, 2, -1)]
    assert table[0].split()[1:] == ["(0.25,", "0.2,", "0.3)", "4", "32.2", "%", "two-sided"]  # (15^2 + 16^2) / 1496
    assert "emits (5, 6, 7)" in table[4] and sum("emits" in line for line in table) == 1
    assert table[11].endswith("one-sided") and "0.13" in table[11]
    assert table[12] == 'and 3 more on 0.936 % of the area: "m2", "m1", "m0"'


def test_info_lists_materials_of_one_name_by_object():
    """A grey floor and a red box, each of a file that calls its material "Material"."""
    red = Mobile("chair", box((0, 0, 0), (1, 1, 1))._replace(face_material=np.ones(12, np.int32)))
    materials = Material("Material", (0.5,) * 3), Material("Material", (0.8, 0.1, 0.1))
    scene = Scene(quad((0, 0, 0), (0, 0, 4), (4, 0, 0), (2, 2)), materials, (red,))
    lines = [line.split() for line in material_lines(scene, Model(scene))]
    assert [line[:4] for line in lines[1:]] == [
        ['"Material"', "(0.5,", "0.5,", "0.5)"],
        ['"chair:', 'Material"', "(0.8,", "0.1,"],
    ]


def test_info_warns_when_most_light_escapes(capsys, monkeypatch):
    floor = quad((-1, 0, -1), (0, 0, 2), (2, 0, 0), (4, 4))
    scene = Scene(floor, (grey(0.5),), lights=(PointLight("bulb", (0, 5, 0), (1, 1, 1)),))
    monkeypatch.setattr(scene_info, "open_scene", lambda s: replace(scene, name="desert"))
    assert cli.main(["info", "--photons", "20000"]) == 0
    text = capsys.readouterr().out
    assert "% of the light leaves the scene" in text and 'light "bulb"' in text and " 1 W, point" in text


def test_info_gives_no_advice_about_added_lights(capsys, tmp_path):
    """A peg in the open, without a light: most light of the default lights misses it, and they cannot be turned."""
    write_obj(tmp_path / "peg.obj", BOX * (0.1, 1.0, 0.1))
    assert cli.main(["info", str(tmp_path / "peg.obj"), "--photons", "2000"]) == 0
    text = capsys.readouterr().out
    assert "note: no light in the file: a lamp" in text and "warning" not in text
    assert float(text.partition("truncated")[0].rpartition("absorbed, ")[2].split(" %")[0]) > 80  # and yet escaped


def test_extra_words_and_mistyped_names_get_a_suggestion(capsys, tmp_path):
    write_obj(tmp_path / "kitchen.obj")
    for words, message in (
        (["boil", "room.glb"], "there is no command boil; there are render, bake, bench"),
        (["render", "room.glb", "chair.glb"], "only one scene; write --mobile FILE to add a mobile"),
        (["cornell", "chair.glb"], "only one scene; write --mobile FILE to add a mobile"),
    ):
        assert cli.main(words) == 2
        assert message in one_line(capsys.readouterr().err)
    assert cli.main(["info", str(tmp_path / "kichen.obj")]) == 3
    assert "there is no such scene file; did you mean kitchen.obj? shipped" in one_line(capsys.readouterr().err)


def test_ctrl_c_ends_quietly(capsys, monkeypatch):
    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(scene_info, "open_scene", interrupted)
    assert cli.main(["info"]) == 130
    assert one_line(capsys.readouterr().err) == "gi-viewer: stopped\n"


class _TtyStream(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_the_progress_bar_draws_on_terminals_only_and_cleans_up():
    for stream, drawn in ((_TtyStream(), True), (io.StringIO(), False)):
        with Bar(stream) as bar:
            bar("tracing", 0.5)
        text = stream.getvalue()
        assert ("tracing" in text and " 50 %" in text and text.endswith("\r")) is drawn and (drawn or text == "")


@pytest.mark.parametrize(("stream", "said"), [(_TtyStream(), False), (io.StringIO(), True)])
def test_compiling_says_so_where_no_bar_is_shown(monkeypatch, stream, said):
    """Of each kind of surfaces that the scene has."""
    compiled = []
    monkeypatch.setattr(compile_ahead, "is_warm", lambda rays, kind: False)
    monkeypatch.setattr(compile_ahead, "compile_kernels", lambda rays, kind: compiled.append(kind) or iter(()))
    progress.compile_kernels(Bar(stream), None, Scene(None, (Material("steel", gloss=Gloss()),)))
    assert compiled == ["diffuse", "gloss"]
    assert stream.getvalue().startswith("gi-viewer: compiling kernels, once per machine") is said


def test_warnings_of_libraries_stay_off_the_terminal(monkeypatch, capsys):
    def warning(_):
        warnings.warn("a library's word", stacklevel=1)
        return ["contents"]

    monkeypatch.setattr(sys, "warnoptions", [])
    monkeypatch.setattr(scene_info, "info", warning)
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        assert cli.main(["info"]) == 0
    assert capsys.readouterr() == ("contents\n", "")


def test_names_with_spaces_and_letters_of_any_alphabet(tmp_path, capsys):
    """Of folder, scene, library of materials, mobile and picture."""
    folder = tmp_path / "Räume & Möbel"
    folder.mkdir()
    write_room(folder)
    room, pot = folder / "Zimmer №1 – größer.obj", folder / "чайник 壶.obj"
    (folder / "room.obj").rename(room)
    (folder / "cube.obj").rename(pot)
    small = ["--photons", "500", "--max-edge", "0.5"]
    assert cli.main(["info", str(room), "--mobile", str(pot), *small]) == 0
    said = capsys.readouterr().out
    assert "Zimmer №1 – größer" in said and 'mobile "чайник 壶"' in said
    picture = folder / "Bild ä.png"
    small += ["--pose", "чайник 壶=0.5,0.2,0.5", "--size", "320x200"]
    assert cli.main(["render", str(room), "--mobile", str(pot), *small, "--out", str(picture)]) == 0
    assert picture.stat().st_size > 1000


def test_atlas_is_written_to_out(capsys, tmp_path, monkeypatch):
    from app.measure.atlas import row

    found = row.AtlasRow("a", "a", "0", 0.0, row.Number(0.0))
    monkeypatch.setattr(atlas.atlas, "__defaults__", ({"Chapter": (lambda: [found],)},))
    monkeypatch.setattr(atlas, "compile_kernels", lambda bar: None)
    assert cli.main(["atlas", "--out", str(tmp_path)]) == 0
    assert str(tmp_path / "index.html") in capsys.readouterr().out
