"""Saved scenes and copied commands open with the same settings and the same light, bit for bit."""

import os
import shlex
import shutil
import sys
import tracemalloc
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from app import __main__ as cli
from app.cli import saved_scene
from app.cli.options import settings_of
from app.session.reload import settings_for
from app.settings import OPTIONS, LampLevel, Pin, Settings, make_solver, open_scene
from gi_core.files.edits import Insert, Light
from gi_core.files.find import shipped_scenes
from gi_core.scene import CalculationSurface, Camera, Pose, SceneError
from gi_core.scene.pose import as_pose, axis_angle
from tests.support.document_examples import bring
from tests.support.mesh_writers import BOX, BOX_FACES, write_glb, write_textured_room
from tests.support.photometry import write_ies
from tests.support.scene_builders import complete

TURNED = as_pose(Pose((0.21, 0.1, 0.13), axis_angle((0.3, 1.0, -0.2), 37.0)))
CAMERA = Camera((1.1, 1.3, 0.123456789012345), (0.2, 0.1, 0.3), 41.7)
SETTINGS = Settings(
    photons=1_500, radius=0.0712345678901, exposure=-1.0 / 3, light="photons", control=False, seed=7, budget=33.0,
    tone_map="clip", white_balance=False, show="illuminance", illuminance_range=(0.1, 1000 / 3), neighbours=31,
)  # fmt: skip


def parsed(*words: str) -> Settings:
    return settings_of(cli.parse(list(words)))


def light_of(settings: Settings) -> np.ndarray:
    solver = complete(make_solver(open_scene(settings), settings))
    return solver.irradiance


@pytest.mark.parametrize("scene", shipped_scenes())
def test_a_shipped_scene_opens_as_it_was_saved(scene, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    here = saved_scene.with_view(replace(SETTINGS, scene=scene), {"pawn": TURNED}, CAMERA)
    saved_scene.write(tmp_path / "mine.toml", here)
    assert parsed("mine.toml") == replace(here, document="mine.toml")
    assert parsed(*shlex.split(saved_scene.command_line(here))[1:]) == here


@pytest.mark.parametrize("scene", ["cornell", "furnace"])
def test_the_light_of_a_saved_scene_has_the_same_bits(scene, tmp_path):
    settings = replace(SETTINGS, scene=scene)
    scene_before = open_scene(settings)
    solver = complete(make_solver(scene_before, settings))
    poses = {m.name: TURNED for m in scene_before.mobiles}
    solver.move_all(poses)
    saved_scene.write(tmp_path / "a.toml", saved_scene.with_view(settings, solver.poses, CAMERA))
    again = parsed(str(tmp_path / "a.toml"))
    assert np.array_equal(light_of(again), solver.irradiance)
    assert open_scene(again).camera == CAMERA


def test_levels_of_lamps_are_saved(tmp_path):
    lamps = LampLevel("lamp", 0.7, (1.0, 0.9, 1 / 3)), LampLevel("sun", 0.3), LampLevel("sky", on=False)
    here = saved_scene.with_view(replace(SETTINGS, lamps=lamps, solo="sun"), {}, CAMERA)
    alone = here.without_solo(("lamp", "sun", "sky", "bulb"))
    assert alone.levels(()) == {"lamp": (0, 0, 0), "sun": (0.3,) * 3, "sky": (0, 0, 0), "bulb": (0, 0, 0)}
    here = here.with_light_scene("evening", ("lamp", "sun", "sky"))
    for settings in (replace(here, solo=""), alone):
        saved_scene.write(tmp_path / "a.toml", settings)
        again = parsed(str(tmp_path / "a.toml"))
        assert (again.lamps, again.light_scenes) == (settings.lamps, settings.light_scenes)
        assert parsed(*shlex.split(saved_scene.command_line(settings))[1:]).levels(()) == settings.levels(())


def test_a_lamp_that_is_off_keeps_its_level_and_colour(tmp_path):
    """The file held three zeros, which opened as a lamp that is on at 0 %."""
    lamps = LampLevel("a bulb", 0.4, (1.0, 0.7, 0.4), on=False), LampLevel("sun", 0.3, on=False)
    others = LampLevel("lamp", 1.0, (1.0, 0.5, 0.25)), LampLevel("sky", 0.0), LampLevel("strip", on=False)
    given = replace(SETTINGS, lamps=(*lamps, *others), light_scenes=(('my "night"', lamps), ("all", ())))
    saved_scene.write(tmp_path / "a.toml", given)
    text = (tmp_path / "a.toml").read_text()
    assert '"a bulb" = { level = 0.4, colour = [1.0, 0.7, 0.4], on = false }\nsun = { level = 0.3, on = false }' in text
    assert "lamp = [1.0, 0.5, 0.25]\nsky = 0.0\nstrip = { level = 1.0, on = false }\n" in text
    again = parsed(str(tmp_path / "a.toml"))
    assert (again.lamps, again.light_scenes) == (given.lamps, given.light_scenes)


@pytest.mark.parametrize(
    "value, lamp",
    [
        ("0", LampLevel("bulb", 0.0)),
        ("[0.5, 0.5, 0.5]", LampLevel("bulb", 0.5)),
        ("[1, 0.5, 0]", LampLevel("bulb", 1.0, (1.0, 0.5, 0.0))),
        ("{ on = false }", LampLevel("bulb", on=False)),
        ("{ level = [0.5, 0.2, 0.1], on = false }", LampLevel("bulb", 1.0, (0.5, 0.2, 0.1), on=False)),
        ("{ level = 2, colour = [1, 0.5, 0] }", LampLevel("bulb", 2.0, (1.0, 0.5, 0.0))),
    ],
)
def test_a_lamp_has_several_spellings(value, lamp, tmp_path):
    (tmp_path / "a.toml").write_text(f'scene = "cornell"\n[lamps]\nbulb = {value}\n[light_scenes.a]\nbulb = {value}\n')
    found = saved_scene.read(str(tmp_path / "a.toml"))
    assert found.lamps == (lamp,) and found.light_scenes == (("a", (lamp,)),)


PINS = Pin("desk", (0.1, 0.2, 1 / 3), (0.0, 1.0, 0.0)), Pin('a "seat"', (0.0, 0.4, 0.0), (0.0, 0.0, -1.0), "pawn")
SURFACES = [
    (),
    (CalculationSurface("all"), CalculationSurface('the "top"', "pawn", margin=0.1, targets=(("mean", 1 / 3),))),
    (CalculationSurface("a, b", "", (0.1, -0.2), (1 / 3, 0.5), 0.75, 90.0, -30.0, 0.1, (7, 3), (("U0", 0.6),)),),
]


@pytest.mark.parametrize(
    "changes",
    [
        *({"isolines": i} for i in (None, (), (100.0, 1000 / 3))),
        *({"pins": PINS, "surfaces": s} for s in SURFACES),
    ],
)
def test_isolines_and_read_outs_are_saved(changes, tmp_path):
    here = saved_scene.with_view(replace(SETTINGS, **changes), {}, CAMERA)
    saved_scene.write(tmp_path / "a.toml", here)
    assert parsed(str(tmp_path / "a.toml")) == replace(here, document=str(tmp_path / "a.toml"))
    of_options = replace(here, pins=(), surfaces=here.surfaces or None)
    assert parsed(*shlex.split(saved_scene.command_line(here))[1:]) == of_options


def test_a_camera_without_fov_has_that_of_scene_files(tmp_path):
    (tmp_path / "a.toml").write_text('scene = "cornell"\n[camera]\nposition = [0, 1, 2]\ntarget = [0, 0, 0]\n')
    assert saved_scene.read(str(tmp_path / "a.toml")).camera == ((0.0, 1.0, 2.0), (0.0, 0.0, 0.0), 45.0)


def test_another_scene_has_its_own_light_scenes_and_read_outs(tmp_path):
    """Light scenes, pins and surfaces belong to a scene: nothing of the last one is kept."""
    kept = (("evening", (LampLevel("lamp", 0.5),)),)
    surfaces, pin = (CalculationSurface("a"),), Pin("a", (0, 0, 0), (0, 1, 0))
    given = replace(SETTINGS, light_scenes=kept, pins=(pin,), surfaces=surfaces)
    now = SimpleNamespace(settings=given, requests=SimpleNamespace(filled={}))
    other = settings_for(now, "tree", ())
    assert (other.light_scenes, other.pins, other.surfaces) == ((), (), None)
    saved_scene.write(tmp_path / "a.toml", given)
    now.settings = SETTINGS
    assert settings_for(now, str(tmp_path / "a.toml"), ()).light_scenes == kept


def test_a_strangers_files_open_with_the_same_bits_from_another_folder(tmp_path, monkeypatch):
    """A bare mesh is completed and refined as before; its mobile keeps its pose. Paths are the saved file's."""
    monkeypatch.chdir(tmp_path)
    bring("room.glb"), bring("chair.glb")
    settings = replace(SETTINGS, scene="room.glb", mobiles=("chair.glb",), radius=0.2, max_edge=0.4)
    pose = open_scene(settings).mobiles[0].pose
    moved = pose._replace(position=(pose.position[0] + 0.1, *pose.position[1:]))
    here = saved_scene.with_view(settings, {"chair": moved}, CAMERA)
    saved_scene.write(tmp_path / "a.toml", here)
    light = light_of(here)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    again = parsed("../a.toml")
    assert np.array_equal(light_of(again), light)
    assert replace(again, scene=Path(again.scene).name, mobiles=("chair.glb",), document="") == here


def test_options_override_a_saved_scene_even_with_a_default(tmp_path):
    saved_scene.write(tmp_path / "a.toml", replace(SETTINGS, poses=(("pawn", (0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0)),)))
    s = parsed("render", str(tmp_path / "a.toml"), "--tone-map", "aces", "--pose", "pawn=1,2,3", "--light", "best")
    assert (s.tone_map, s.light, s.photons) == ("aces", "best", 1_500)
    assert s.poses[-1] == ("pawn", (1.0, 2.0, 3.0)) and dict(s.poses)["pawn"] == (1.0, 2.0, 3.0)


def test_every_option_is_saved_or_names_a_reason():
    assert [name for name, row in OPTIONS.items() if not row.kept] == ["allow_outside", "size"]


BAD = {
    "scene = 3": "scene must be a text in quotes, not empty, got 3",
    "scne = 1": "unknown key 'scne'",
    "[settings]\nphotns = 5": "unknown key 'photns'",
    "[settings]\nphotons = -5": "photons must be a whole number in 1 .. 134217728, got -5",
    "[settings]\ncontrol = 1": "control must be true or false, got 1",
    '[settings]\nexposure = "bright"': "exposure must be a number, or a list of them, got 'bright'",
    '[settings]\ntone_map = "grey"': "tone_map must be one of agx, neutral, aces, ",
    "[settings]\nilluminance_range = [5, 1]": "illuminance_range must be LOW,HIGH",
    "[poses]\npawn = [1, 2]": "pawn must be 7 finite numbers",
    "lamps = 3": "[lamps] must be a table of keys, got 3",
    "poses = 3": "[poses] must be a table of keys, got 3",
    "[lamps]\nbulb = false": "bulb must be a number >= 0, three of them, or a table such as",
    "[lamps]\nbulb = [1, -1, 0]": "bulb must be three numbers >= 0 and <= 1e+15, got [1, -1, 0]",
    '[lamps]\nbulb = {level = "a"}': "lamp 'bulb': level must be a number >= 0, got 'a'",
    "[lamps]\nbulb = {off = true}": "lamp 'bulb': unknown key 'off'; there is",
    "[camera]\nposition = [0, 0, 0]\ntarget = [0, 0, 0]\nfov = 40": "target must differ from",
    'scene = "/etc/passwd"': "lies outside the folder of the saved scene",
    'scene = "../room.glb"': "lies outside the folder of the saved scene",
    'mobiles = ["../x.glb"]': "lies outside the folder of the saved scene",
    "[camera]\nposition = [0, 1]\ntarget = [0, 0, 0]": "[camera]: position must be three finite numbers of at most",
    "[camera]\nposition = [0, 1, 2]\ntarget = [0, 0, 0]\nfov = 180": "[camera]: fov must be a number > 0",
    '[[pins]]\nname = "a"\nposition = [0, 0]\nnormal = [0, 1, 0]': "[[pins]] 1: position must be three finite",
    '[[pins]]\nname = "a"\nposition = [0, 0, 0]\nnormal = [0, 0, 0]': "normal must be three numbers that are not",
    "[cameras.a]\nposition = [0, 0, 0]\ntarget = [0, 0, 0]\nfov = 40": "[cameras.a]: target must differ",
    "[cameras]\na = 1": "[cameras.a] must be a table of keys, got 1",
    '[[pins]]\nname = "a"\nplace = 1': "[[pins]] 1: unknown key 'place'",
    '[[edits]]\nkind = "insert"\nname = "a"': "edit 1: an object has a file or a shape; write one of them",
}


@pytest.mark.parametrize("text", BAD)
def test_a_bad_saved_scene_gets_one_sentence(text, tmp_path, capsys):
    (tmp_path / "bad.toml").write_text(text if text.startswith("scene") else f'scene = "cornell"\n{text}')
    with pytest.raises(SceneError) as caught:
        saved_scene.read(str(tmp_path / "bad.toml"))
    assert BAD[text] in str(caught.value) and "bad.toml" in str(caught.value) and "\n" not in str(caught.value)
    assert cli.main(["info", str(tmp_path / "bad.toml")]) == 3
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(
    "text, sentence",
    [
        (
            "[poses]\npwn = [0, 0, 0, 1, 0, 0, 0]",
            '[poses] names the mobile "pwn", but the mobiles of this scene are: pawn',
        ),
        (
            "[poses]\npawn = [0, 0, 0, 2, 0, 0, 0]",
            "[poses] pawn: the quaternion (w, x, y, z) of a pose must have length 1",
        ),
        ("[lamps]\nlmp = 1", "[lamps]: no lamp is called 'lmp'"),
    ],
)
def test_an_unknown_name_is_told_with_its_file_and_table(text, sentence, tmp_path):
    """The sentence blamed --pose, which was not given, or the scene."""
    (tmp_path / "a.toml").write_text(f'scene = "cornell"\n{text}\n')
    with pytest.raises(SceneError) as refused:
        open_scene(parsed(str(tmp_path / "a.toml")))
    assert f"a.toml: {sentence}" in str(refused.value)


def test_an_unknown_name_of_an_option_is_told_as_such(tmp_path):
    saved_scene.write(tmp_path / "a.toml", SETTINGS)
    with pytest.raises(SceneError, match='--pose names the mobile "nobody"'):
        open_scene(parsed(str(tmp_path / "a.toml"), "--pose", "nobody=1,2,3"))


def spread(tmp_path) -> tuple[Path, Settings]:
    """Return an empty folder for saved scenes, and settings of a scene whose files lie in three other folders."""
    folders = [tmp_path / name for name in ("rooms", "a/chairs", "b/chairs", "saved")]
    for folder in folders:
        folder.mkdir(parents=True)
    room, a, b, saved = folders
    write_textured_room(room)
    write_glb(a / "chair.glb", BOX * 0.1, BOX_FACES)
    write_glb(b / "chair.glb", BOX * 0.2, BOX_FACES)
    write_ies(a / "spot.ies", (0.0, 45.0, 90.0), (0.0,), np.array([[100.0, 60.0, 0.0]]))
    placed = (("type", "photometric"), ("position", (0.0, 1.5, 0.0)), ("direction", (0.0, -1.0, 0.0)))
    lamp = Light("spot", placed, str(a / "spot.ies"))
    edits = Insert("other chair", str(b / "chair.glb"), Pose((0.5, 0.0, 0.5))), lamp
    return saved, replace(
        SETTINGS, scene=str(room / "room.obj"), mobiles=(str(a / "chair.glb"),), edits=edits, units="photometric"
    )


def test_a_scene_is_saved_anywhere_with_copies_of_its_files(tmp_path, monkeypatch):
    """Room and luminaire lay in different folders, and the only folder that would do was the root of the disk."""
    saved, settings = spread(tmp_path)
    before = open_scene(settings)
    assert len(before.files) == 4 and len(before.files[0]) == 3, "the room with its library and texture"
    settings = saved_scene.with_view(settings, {m.name: m.pose for m in before.mobiles}, CAMERA)
    light = light_of(settings)
    made = saved_scene.write(saved / "kit.toml", settings, before.files)
    copies = sorted(str(file.relative_to(saved)) for file in saved.rglob("*") if file.is_file())
    assert sorted([*(str(file.relative_to(saved)) for file in made), "kit.toml"]) == copies
    chairs, other = "kit-files/chairs", "kit-files/chairs-2"
    rooms = [f"kit-files/rooms/{name}" for name in ("room.mtl", "room.obj", "wood.png")]
    assert copies == [f"{other}/chair.glb", f"{chairs}/chair.glb", f"{chairs}/spot.ies", *rooms, "kit.toml"]
    shutil.move(saved, tmp_path / "moved")
    for gone in ("rooms", "a", "b"):
        shutil.rmtree(tmp_path / gone)
    again = parsed(str(tmp_path / "moved" / "kit.toml"))
    assert not again.allow_outside and np.array_equal(light_of(again), light)
    assert open_scene(again).notes == before.notes

    # Files read again to save once more, and beside it under another name: no second copy, and one of its own.
    assert not saved_scene.write(tmp_path / "moved" / "kit.toml", again)
    assert len(list((tmp_path / "moved").rglob("*"))) == 4 + len(copies)
    (tmp_path / "else").mkdir()
    saved_scene.write(tmp_path / "else" / "a.toml", again)
    assert np.array_equal(light_of(parsed(str(tmp_path / "else" / "a.toml"))), light)


def test_copies_of_the_scene_saved_before_stay_whole(tmp_path):
    """A file that has changed gets a copy of its own; one that has gone keeps its copy."""
    saved, settings = spread(tmp_path)
    saved_scene.write(saved / "kit.toml", settings)
    first = (saved / "kit.toml").read_text()
    write_glb(tmp_path / "b/chairs/chair.glb", BOX * 0.3, BOX_FACES)
    (tmp_path / "rooms/room.obj").unlink()
    saved_scene.write(saved / "kit.toml", settings)
    second = (saved / "kit.toml").read_text()
    assert [line for line in second.splitlines() if line not in first] == ['file = "kit-files/chairs-3/chair.glb"']
    (saved / "old.toml").write_text(first)
    for name, size in (("old", 0.2), ("kit", 0.3)):
        mobile = next(m for m in open_scene(parsed(str(saved / f"{name}.toml"))).mobiles if m.name == "other chair")
        assert np.ptp(mobile.mesh.vertices, axis=0).max() == pytest.approx(size * np.ptp(BOX, axis=0).max())


def test_a_scene_that_cannot_be_saved_leaves_no_copies(tmp_path, monkeypatch):
    saved, settings = spread(tmp_path)
    (saved / "folder.toml").mkdir()
    for name in ("folder.toml", "not/there.toml"):
        with pytest.raises(OSError):
            saved_scene.write(saved / name, settings)
    assert [file.name for file in saved.rglob("*")] == ["folder.toml"]


def test_with_outside_files_allowed_nothing_is_copied(tmp_path):
    saved, settings = spread(tmp_path)
    saved_scene.write(saved / "kit.toml", replace(settings, allow_outside=True))
    assert [file.name for file in saved.iterdir()] == ["kit.toml"]
    with pytest.raises(SceneError, match="lies outside the folder of the saved scene; give --allow-outside"):
        parsed(str(saved / "kit.toml"))
    assert open_scene(parsed(str(saved / "kit.toml"), "--allow-outside")).mobiles


def test_a_save_keeps_mode_and_link_and_takes_the_longest_name(tmp_path):
    """A file of mode 640 became 644, a link a file beside its old target; 250 bytes were "File name too long"."""
    saved, settings = spread(tmp_path)
    kept = saved / "kept.toml"
    kept.write_text("old")
    kept.chmod(0o640)
    (tmp_path / "link.toml").symlink_to(kept)
    saved_scene.write(tmp_path / "link.toml", settings)
    assert (tmp_path / "link.toml").is_symlink() and kept.stat().st_mode & 0o777 == 0o640
    for name in (kept, tmp_path / "link.toml"):
        assert len(open_scene(parsed(str(name))).mobiles) == 2
    for name in ("a" * 245 + ".toml", "\u00e4" * 122 + "a.toml"):
        saved_scene.write(saved / name, settings)
        assert open_scene(parsed(str(saved / name))).mobiles
    assert not list(tmp_path.rglob("*.part"))


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are text elsewhere")
def test_names_that_are_no_text_are_saved(tmp_path):
    """A mobile of a file r\\xff.glb, or a lamp of half a character in glTF, ended each save in UnicodeEncodeError."""
    saved, settings = spread(tmp_path)
    mobiles = [os.fsdecode(os.fsencode(tmp_path / "rooms") + b"/r" + byte + b".glb") for byte in (b"\xff", b"\xfe")]
    for size, name in enumerate(mobiles, 1):
        write_glb(Path(name), BOX * 0.1 * size, BOX_FACES)
    glow = {"name": "lamp \ud800", "emissiveFactor": [1, 1, 1]}
    write_glb(tmp_path / "rooms/glow.glb", BOX * 3, BOX_FACES, material=glow)
    settings = replace(settings, scene=str(tmp_path / "rooms/glow.glb"), mobiles=tuple(mobiles), edits=(), units=None)
    scene = open_scene(settings)
    settings = replace(settings, lamps=(LampLevel("lamp \ufffd", 0.5),))
    for place in (saved, tmp_path / "rooms"):
        here = saved_scene.with_view(settings, {m.name: m.pose for m in scene.mobiles}, CAMERA)
        saved_scene.write(place / "kit.toml", here, scene.files)
        again = parsed(str(place / "kit.toml"))
        assert again.lamps == settings.lamps and again.poses == here.poses
        for a, b in zip(open_scene(again).mobiles, scene.mobiles, strict=True):
            assert a.name == b.name and np.array_equal(a.mesh.vertices, b.mesh.vertices) and a.pose == b.pose


def test_a_file_of_deep_keys_is_refused_before_it_is_parsed(tmp_path, capsys):
    """20 kB took 0.5 GB, as commands asked first whether it is a saved scene."""
    (tmp_path / "deep.toml").write_text(".".join(["a"] * 10_000) + " = 1")
    tracemalloc.start()
    assert cli.main(["info", str(tmp_path / "deep.toml")]) == 3
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 50e6 and "nest" in capsys.readouterr().err


def test_a_checked_pose_is_checked_without_change():
    rng = np.random.default_rng(1)
    for q in rng.normal(size=(500, 4)):
        pose = as_pose(Pose((0.1, 0.2, 0.3), tuple((q / np.linalg.norm(q)).tolist())))
        assert as_pose(pose) == pose
