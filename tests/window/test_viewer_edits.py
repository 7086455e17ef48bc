"""Edits in the window: the old picture stays, the new light equals that of a scene built so, and undo goes back."""

from dataclasses import replace

import numpy as np
import pytest
from imgui_bundle import imgui

from app.cli import saved_scene
from app.settings import Settings
from app.window import dialogs
from app.window.actions.objects import SHAPES, insert, shape_of
from app.window.panel import material
from app.window.panel import widgets as ui
from gi_core.files.edits import Duplicate, Finish, Freeze, Insert, Promote, Remove, edited
from gi_core.scene import Pose
from gi_core.scene.types import Paint, Texture
from gi_core.solver import Solver, photons_of
from tests.support import viewer_support as support
from tests.support.mesh_writers import BOX, BOX_FACES, write_glb
from tests.support.scene_builders import furnace_scene
from tests.support.viewer_hand import BLOCK_FRONT, errors, in_window

AWAY = Pose((0.7, 0.4, 0.6))
RED = (0.8, 0.1, 0.1)


def change(hand, viewer, do) -> None:
    """Do something that edits the scene, and wait for the light of the edited one."""
    before = viewer.session
    do()
    hand.wait(lambda: viewer.session is not before and viewer.session.asked is None and viewer.reload.coming is None)
    hand.wait_for_light()


def imgui_mouse() -> tuple[float, float]:
    return imgui.get_io().mouse_pos.x, imgui.get_io().mouse_pos.y


def built(session, scene=support.room) -> np.ndarray:
    """Return irradiance of a new solver of the edited scene, with the session's settings, levels and poses."""
    s = session.settings
    given = {"photons": s.photons, "radius": s.radius, "neighbours": s.neighbours, "light": "photons"}
    solver = Solver(edited(scene(), s.edits), **given)
    solver.set_lamps({name: level for name, level in s.levels(()).items() if name in solver.lamps.names})
    solver.move_all(session.poses)
    solver.solve()
    return solver.irradiance


@in_window()
def test_a_colour_is_edited_undone_and_done_again(hand, viewer):
    first = viewer.session
    first.begin_drag()
    first.move({"block": AWAY})
    first.end_drag()
    hand.wait_for_light()
    plain = first.irradiance
    viewer._do(("refinish", "white", "", (("reflectance", RED),)))
    hand.wait(lambda: viewer.reload.coming is not None)
    assert viewer.session is first, "the old picture stays"
    hand.wait(lambda: viewer.session is not first)
    hand.wait_for_light()
    now = viewer.session
    assert now.settings.edits == (Finish("white", (("reflectance", RED),)),) and now.poses == {"block": AWAY}
    assert np.array_equal(now.irradiance, built(now))
    traced = photons_of(now.light._solver).traced
    assert 0 < traced < now.settings.photons, "photons that met white alone"
    assert viewer.log.last.text == "edited: material white" and viewer.files.has_changed(now)

    change(hand, viewer, lambda: viewer._do("undo"))
    assert viewer.session.settings.edits == () and np.array_equal(viewer.session.irradiance, plain)
    viewer._do("undo")  # of the move
    hand.wait_for_light()
    assert viewer.session.poses["block"] == support.room().mobiles[0].pose
    viewer._do("redo")
    change(hand, viewer, lambda: viewer._do("redo"))
    assert np.array_equal(viewer.session.irradiance, now.irradiance)


@in_window()
def test_a_held_slider_is_followed_and_undone_as_one_step(hand, viewer, monkeypatch):
    """The value being opened is let finish, the newest comes next, those in between are dropped."""
    monkeypatch.setattr(type(viewer), "holds_field", True)
    values = [(("reflectance", (0.1 * k, 0.5, 0.3)),) for k in range(1, 7)]
    shown: list[tuple] = []
    plain, first = viewer.session.irradiance, viewer.session
    viewer._do(("refinish", "white", "", values[0]))
    hand.wait(lambda: viewer.reload.coming is not None)
    coming = viewer.reload.coming
    for value in values[1:-1]:
        viewer._do(("refinish", "white", "", value))
        hand.ctx.yield_()
        shown.append(viewer.session.settings.edits)
        assert viewer.session.finish_of("white", True).values == value, "the panel shows the newest value"
    hand.wait(lambda: viewer.session is not first)
    assert viewer.session is coming, "a newer value does not start the opening again"
    viewer._do(("refinish", "white", "", values[-1]))
    hand.wait(lambda: viewer.session.asked is None and viewer.reload.coming is None)
    hand.wait_for_light()
    assert viewer.session.settings.edits == (Finish("white", values[-1]),)
    assert np.array_equal(viewer.session.irradiance, built(viewer.session))
    change(hand, viewer, lambda: viewer._do("undo"))
    assert viewer.session.settings.edits == () and np.array_equal(viewer.session.irradiance, plain)
    change(hand, viewer, lambda: viewer._do("redo"))
    assert viewer.session.settings.edits == (Finish("white", values[-1]),)
    assert set(shown) <= {(), (Finish("white", values[0]),)}


@in_window()
def test_an_edit_that_changes_nothing_is_no_step_of_undo(hand, viewer):
    """A press on a slider's knob may change a value by less than it is rounded to."""
    change(hand, viewer, lambda: viewer._do(("refinish", "white", "", (("reflectance", RED),))))
    edits, asked = viewer.session.edits, viewer.session.asked
    viewer._do(("refinish", "white", "", (("reflectance", RED),)))
    assert viewer.session.asked is asked
    viewer._do(("refinish", "white", "", (("reflectance", (0.2, 0.4, 0.6)),)))
    hand.wait(lambda: viewer.session.asked is None and viewer.reload.coming is None)
    change(hand, viewer, lambda: viewer._do("undo"))
    assert viewer.session.settings.edits in ((), edits)


@in_window()
def test_objects_are_copied_removed_frozen_and_made_movable(hand, viewer):
    viewer.viewport.select(("block",))
    change(hand, viewer, lambda: viewer._do("duplicate"))
    assert list(viewer.session.poses) == ["block", "block 2"]
    (low, high), (low2, high2) = viewer.session.box_of(("block",)), viewer.session.box_of(("block 2",))
    assert ((high < low2) | (high2 < low)).any() and (low2 > 0).all() and (high2 < 1).all(), "beside, in the room"
    assert viewer.viewport.selection == ("block 2",), "the copy is selected"
    assert np.array_equal(viewer.session.irradiance, built(viewer.session))
    viewer.session.move({"block": Pose((0.3, 0.12, 0.3))})
    hand.wait_for_light()

    viewer.viewport.select(("block",))
    change(hand, viewer, lambda: viewer._do("freeze"))
    assert list(viewer.session.poses) == ["block 2"]
    assert viewer.session.settings.edits[-1] == Freeze("block", Pose((0.3, 0.12, 0.3)))
    assert np.array_equal(viewer.session.irradiance, built(viewer.session))

    at = hand.at((0.3, 0.24, 0.3))
    hand.ctx.mouse_move_to_pos(at)
    hand.ctx.mouse_click(0)
    hand.wait(lambda: viewer.viewport.clicked is not None)
    change(hand, viewer, lambda: viewer._do("promote"))
    assert list(viewer.session.poses) == ["block 2", "white"]
    assert viewer.session.poses["white"].position == pytest.approx((0.3, 0.0, 0.3), abs=1e-6)

    viewer.viewport.select(("block 2",))
    change(hand, viewer, lambda: viewer._do("remove"))
    assert list(viewer.session.poses) == ["white"]
    for names in (["block 2", "white"], ["block 2"], ["block", "block 2"]):
        change(hand, viewer, lambda: viewer._do("undo"))
        assert list(viewer.session.poses) == names
    assert viewer.session.poses["block"] == Pose((0.3, 0.12, 0.3)), "as it was before it was frozen"


@in_window(light="best")
def test_a_copy_appears_in_gathered_light(hand, viewer, rough_light):
    """Light of the static part without mobiles is kept by edits that leave that part as it is."""
    light = viewer.session.light._solver.frame_light
    static = light.static
    hand.wait(
        lambda: (
            static.gathered is not None
            and static.gathered.state is not None
            and viewer.session.light._solver.frame_light.is_gathered
        )
    )
    hand.wait(lambda: static.gathered.state.rounds > 1)
    first = viewer.session
    viewer.viewport.select(("block",))
    viewer._do("duplicate")
    hand.wait(lambda: viewer.session is not first)
    assert viewer.session.light._solver.frame_light.static.gathered.state.rounds > 1


@in_window()
def test_a_mesh_dropped_on_the_picture_stands_there(hand, viewer, folder, monkeypatch):
    monkeypatch.setattr(dialogs, "has_native", lambda: False)
    thing = write_glb(folder / "thing.glb", BOX * 0.1, BOX_FACES)
    assert [dialogs.fits(name, dialogs.MESHES) for name in (str(thing), "a.OBJ", "room.toml")] == [True, True, False]
    place = (0.25, 0.0, 0.75)
    hand.ctx.mouse_move_to_pos(hand.at(place))
    hand.ctx.yield_(2)
    change(hand, viewer, lambda: viewer.reload.dropped.append(str(thing)))
    session = viewer.session
    assert list(session.poses) == ["block", "thing"]
    assert session.poses["thing"].position == pytest.approx(place, abs=0.01)
    assert session.model.vertices_at(2, session.poses)[:, 1].min() == pytest.approx(0, abs=1e-3)

    viewer._do("insert")
    hand.wait(lambda: viewer.files.dialog.is_open)
    hand.ctx.set_ref("//Insert an object###File")
    hand.ctx.item_input_value("##path", str(thing))
    hand.wait(lambda: viewer.session is not session)
    hand.wait_for_light()
    assert list(viewer.session.poses) == ["block", "thing", "thing 2"]


@in_window()
def test_a_shape_is_inserted_where_one_clicked(hand, viewer):
    place = (0.25, 0.0, 0.75)
    hand.click(place)
    hand.wait(lambda: viewer.viewport.clicked is not None)
    change(hand, viewer, lambda: viewer._do("insert cone"))
    session = viewer.session
    assert list(session.poses) == ["block", "cone"]
    vertices = session.model.vertices_at(2, session.poses)
    assert vertices[:, 1].min() == pytest.approx(0, abs=1e-3) and np.ptp(vertices[:, 1]) == pytest.approx(0.1)
    assert session.poses["cone"].position == pytest.approx(place, abs=0.02)


@pytest.mark.parametrize("kind", SHAPES)
def test_the_window_inserts_shapes_that_are(kind):
    scene = edited(furnace_scene(), [Insert(kind, pose=Pose(), shape=shape_of(kind, 0.5))])
    heights = scene.mobiles[-1].mesh.vertices @ scene.up
    assert heights.max() == pytest.approx(0.5) and heights.min() == 0


@in_window()
def test_inserted_objects_stand_clear_of_others(hand, viewer, folder):
    """They were put into objects that had been moved, and into what a file was dropped beside."""
    thing = str(write_glb(folder / "thing.glb", BOX * 0.1, BOX_FACES))

    def meet(session) -> bool:
        low, high = map(np.array, zip(*(session.box_of((name,)) for name in session.poses), strict=True))
        others = ~np.eye(len(low), dtype=bool)
        touch = ((low[:, None] < high) & (high[:, None] > low)).all(axis=2)
        return bool((touch & others).any() or (low[1:] < -1e-6).any() or (high[1:] > 1 + 1e-6).any())

    viewer.session.move({"block": Pose((0.5, 0.121, 0.5))})
    hand.wait_for_light()
    for k in range(4):  # where one looks is the block
        change(hand, viewer, lambda: insert(viewer, thing))
        session = viewer.session
        assert len(session.poses) == 2 + k and not meet(session)
    at = [np.array(session.poses[name].position) for name in session.poses]
    assert all(np.abs(p[[0, 2]] - 0.5).max() < 0.45 for p in at[1:]), "near the point looked at"
    change(hand, viewer, lambda: insert(viewer, thing, np.array((0.5, 0.0, 0.63))))  # dropped beside the block
    session = viewer.session
    assert not meet(session) and session.poses["thing 5"].position != (0.5, 0.0, 0.63)
    poses = session.poses
    viewer.files.save(session, viewer.viewport, str(folder / "saved.toml"))
    saved = dict(saved_scene.read(str(folder / "saved.toml")).poses)
    assert all(saved[name][:3] == pytest.approx(poses[name].position) for name in poses if name != "block")
    viewer._do("reset poses")
    assert {n: p for n, p in session.poses.items() if n != "block"} == {n: p for n, p in poses.items() if n != "block"}
    for _ in range(2):
        viewer._do("undo")
        hand.wait(lambda: viewer.reload.coming is None and viewer.session.asked is None)
    assert len(viewer.session.poses) == 5
    change(hand, viewer, lambda: viewer._do("redo"))
    assert not meet(viewer.session) and viewer.session.poses["thing 5"] == poses["thing 5"]


@in_window(problems=None)
def test_an_edit_that_fails_takes_no_other_with_it(hand, viewer):
    """A colour is being prepared when a mesh that does not exist is inserted; the colour comes, undo leaves it out."""
    red = Finish("white", (("reflectance", RED),))
    first = viewer.session
    viewer._do(("refinish", "white", "", red.material))
    hand.wait(lambda: viewer.reload.coming is not None)
    insert(viewer, "gone.glb")
    hand.wait(lambda: viewer.session is not first)
    assert viewer.session.settings.edits == viewer.session.edits == (red,)
    assert any("gone.glb: there is no such file" in e.text for e in viewer.log.entries)
    change(hand, viewer, lambda: viewer._do("undo"))
    assert viewer.session.settings.edits == ()
    change(hand, viewer, lambda: viewer._do("redo"))
    assert viewer.session.settings.edits == (red,)


@in_window()
def test_a_scene_saved_while_edits_are_prepared_has_them(hand, viewer, folder):
    """Also the poses: an object that a pending edit removes has none, else the file could not be opened."""
    red = Finish("white", (("reflectance", RED),))
    viewer.session.move({"block": AWAY})
    hand.wait_for_light()
    viewer._do(("refinish", "white", "", red.material))
    hand.wait(lambda: viewer.reload.coming is not None)
    viewer.files.save(viewer.session, viewer.viewport, str(folder / "a.toml"))
    viewer.viewport.select(("block",))
    viewer._do("remove")
    assert viewer.session.settings.edits == ()
    viewer.files.save(viewer.session, viewer.viewport, str(folder / "b.toml"))
    first, second = (saved_scene.read(str(folder / name)) for name in ("a.toml", "b.toml"))
    assert first.edits == (red,) and dict(first.poses)["block"] == (*AWAY.position, *AWAY.quaternion)
    assert second.edits == (red, Remove("block")) and second.poses == ()


@pytest.mark.parametrize("begun", [True, False])
@in_window()
def test_a_reload_while_an_edit_is_prepared_keeps_it(hand, viewer, begun):
    """A file that changes on disk reloads the scene at any time; the edit may just have been asked for."""

    def edit_and_reload() -> None:
        viewer._do(("refinish", "white", "", (("reflectance", RED),)))
        if begun:
            hand.wait(lambda: viewer.reload.coming is not None)
        viewer._do("reload")

    change(hand, viewer, edit_and_reload)
    session = viewer.session
    assert session.settings.edits == session.edits == (Finish("white", (("reflectance", RED),)),)
    assert np.array_equal(session.light._solver.from_scratch(), built(session))
    change(hand, viewer, session.undo)
    assert viewer.session.settings.edits == ()


@in_window()
def test_a_mesh_is_inserted_by_its_full_path(hand, viewer, folder):
    """A path is typed relative to the working folder; the saved scene names it relative to its own."""
    (folder / "st").mkdir()
    write_glb(folder / "st" / "thing.glb", BOX * 0.1, BOX_FACES)
    change(hand, viewer, lambda: insert(viewer, "st/thing.glb"))
    assert viewer.session.edits[0].file == str(folder / "st" / "thing.glb")
    assert viewer.viewport.selection == ("thing",), "the new object is selected"
    viewer.files.save(viewer.session, viewer.viewport, str(folder / "saved.toml"))
    assert 'file = "st/thing.glb"' in (folder / "saved.toml").read_text()
    assert saved_scene.read(str(folder / "saved.toml")).edits[0].file == str(folder / "st" / "thing.glb")


@in_window(problems=None)
def test_an_edit_that_fails_leaves_the_scene(hand, viewer, folder):
    session = viewer.session
    hand.ctx.mouse_move_to_pos(hand.at(BLOCK_FRONT))
    hand.ctx.yield_(2)
    viewer.reload.dropped.append("gone.glb")
    hand.wait(lambda: errors(viewer))
    assert viewer.session is session and session.edits == ()
    said = errors(viewer)[-1]
    assert said.startswith("editing: ") and said.endswith("gone.glb: there is no such file")
    assert viewer.reload.problem == "", "the scene itself has none: Scene shows none"
    viewer._do("undo")
    hand.ctx.yield_(2)
    assert viewer.log.last.text == "nothing to undo"


@pytest.mark.parametrize(
    "surface, parts, expected",
    [
        ("steel 3", ("steel",), 'steel 3, material "steel"'),  # the third piece of steel that was made movable
        ("chair", ("seat", "legs"), "chair"),  # a combo box below names its parts
        ("wall", (), "wall"),
    ],
)
def test_the_panel_names_a_material_as_its_file_does(surface, parts, expected):
    assert material.title(surface, parts) == expected


@in_window()
def test_the_panel_edits_the_material_of_the_clicked_wall(hand, viewer, few_kernels):
    """Its colour, then its model and a parameter of that, each in light equal to that of a scene built so."""
    hand.click((0.0, 0.5, 0.5))
    hand.wait(lambda: viewer.viewport.clicked is not None)
    assert viewer.viewport.surface == "red"
    assert viewer.viewport.finish.values == (("reflectance", pytest.approx((0.6, 0.06, 0.05))),)
    hand.panel("Objects", opened="Material")
    change(hand, viewer, lambda: hand.ctx.item_input_value("**/##reflectance/##X", 0.25))
    (edit,) = viewer.session.settings.edits
    assert edit == Finish("red", (("reflectance", pytest.approx((0.25, 0.06, 0.05))),))
    change(hand, viewer, lambda: hand.ctx.combo_click("##Model/Metal-rough"))
    change(hand, viewer, lambda: hand.ctx.item_input_value("**/##Metallic", 1.0))
    (edit,) = viewer.session.settings.edits
    assert dict(edit.material) == {
        "reflectance": pytest.approx((0.25, 0.06, 0.05)), "metallic": 1.0, "roughness": 0.3, "ior": 1.5,
    }  # fmt: skip
    assert viewer.viewport.finish.values == edit.material
    slider = "**/##Roughness"
    steps: list[float] = []
    logged = viewer.log.last
    hand.ctx.mouse_move(slider)
    hand.ctx.mouse_down(0)
    x, y = imgui_mouse()
    for k in (10, 20, 30):
        hand.move((x + k, y))
        before = viewer.session
        hand.wait(lambda: viewer.reload.coming is not None or viewer.session is not before)  # noqa: B023
        assert viewer.reload.progress is None, "the button stays"
        hand.wait(lambda: viewer.session is not before)  # noqa: B023
        steps.append(dict(viewer.session.settings.edits[-1].material)["roughness"])
    assert viewer.log.last is logged
    hand.ctx.mouse_up(0)
    hand.wait(lambda: viewer.log.last is not logged)
    assert viewer.log.last.text == "edited: material red"
    hand.wait_for_light()
    assert steps == sorted(set(steps)) and len(steps) == 3, "the light follows while the slider is held"
    change(hand, viewer, lambda: viewer._do("undo"))
    (edit,) = viewer.session.settings.edits
    assert dict(edit.material)["roughness"] == 0.3, "one drag is one step of undo"
    assert viewer.session.light.snapshot.gloss is not None
    assert np.array_equal(viewer.session.irradiance, built(viewer.session))
    change(hand, viewer, lambda: hand.ctx.combo_click("##Model/Ward"))
    (edit,) = viewer.session.settings.edits
    assert dict(edit.material)["brdf"] == "ward" and dict(edit.material)["kd"] == pytest.approx((0.25, 0.06, 0.05))


@in_window()
def test_models_are_added_to_a_material_and_removed(hand, viewer, few_kernels, folder):
    """A linear combination could be edited in the panel, but only a scene file could make one."""

    def models() -> list:
        (edit,) = viewer.session.settings.edits
        brdf = dict(edit.material)["brdf"]
        assert np.array_equal(viewer.session.irradiance, built(viewer.session))
        return [dict(part) for part in brdf] if isinstance(brdf, tuple) else [dict(edit.material)]

    plain = viewer.session.irradiance
    viewer.viewport.select(("block",))
    hand.panel("Objects", opened="Material")
    change(hand, viewer, lambda: hand.ctx.combo_click("##Add model/Ward"))
    diffuse, ward = models()
    assert diffuse == {"model": "perfect_diffuse", "factor": 1.0, "kd": pytest.approx((0.73,) * 3)}
    assert ward["model"] == "ward" and ward["factor"] == 1.0 and ward["kd"] == (0.0,) * 3
    change(hand, viewer, lambda: hand.ctx.item_input_value("$$1/##Factor", 0.25))
    assert models()[1]["factor"] == 0.25
    change(hand, viewer, lambda: hand.ctx.combo_click("##Add model/Perfect diffuse"))
    assert [part["model"] for part in models()] == ["perfect_diffuse", "ward", "perfect_diffuse"]
    assert models()[2]["kd"] == pytest.approx((0.27,) * 3), "more would be refused"
    saved_scene.write(folder / "saved.toml", viewer.session.settings)
    (read,), (edit,) = saved_scene.read(str(folder / "saved.toml")).edits, viewer.session.settings.edits
    assert dict(read.material) == dict(edit.material)
    change(hand, viewer, lambda: hand.ctx.item_click("$$0/remove"))
    assert [part["model"] for part in models()] == ["ward", "perfect_diffuse"]
    change(hand, viewer, lambda: hand.ctx.item_click("$$0/remove"))
    (one,) = models()
    assert one == {"brdf": "perfect_diffuse", "scale": True, "kd": pytest.approx((0.27,) * 3)}
    for count in (2, 3, 2, 2):
        change(hand, viewer, lambda: viewer._do("undo"))
        assert len(models()) == count
    change(hand, viewer, lambda: viewer._do("undo"))
    assert viewer.session.settings.edits == () and np.array_equal(viewer.session.irradiance, plain)
    change(hand, viewer, lambda: hand.ctx.combo_click("##Model/Metal-rough"))
    hand.ctx.yield_(2)
    assert hand.ctx.item_info("##Add model").item_flags & imgui.ItemFlags_.disabled


@in_window()
def test_a_model_that_is_darkened_says_so(hand, viewer, few_kernels, monkeypatch):
    """The choice of a model ticked the box without a word."""
    said, wrapped = [], ui.wrapped
    monkeypatch.setattr(ui, "wrapped", lambda text: (said.append(text), wrapped(text))[1])
    viewer.viewport.select(("block",))
    hand.panel("Objects", opened="Material")
    for model, darkened in (("EON", ""), ("GGX", "ggx reflects more light than arrives, at "), ("Diffuse", "")):
        change(hand, viewer, lambda: hand.ctx.combo_click(f"##Model/{model}"))  # noqa: B023
        said.clear()
        hand.ctx.yield_(2)
        reason = viewer.viewport.finish.darkened
        assert reason.startswith(darkened) and bool(darkened) == bool(reason)
        assert (material.DARKENED in said) == bool(darkened)


def two_part_room():
    """The room, whose block has a front of red under a texture."""
    scene = support.room()
    (block,) = scene.mobiles
    front = block.mesh.vertices[block.mesh.faces][:, :, 2].min(axis=1) > 0.11
    uv = np.broadcast_to(np.array([[0, 0], [1, 0], [1, 1]], np.float32), (len(front), 3, 2))
    image = Texture(np.arange(48, 240, 4, dtype=np.uint8).reshape(4, 4, 3))
    colour = np.where(front[:, None, None], 1.0, 0.73) * np.ones((1, 3, 3))
    mesh = block.mesh._replace(
        face_material=front.astype(np.int32),
        paint=Paint((image,), front.astype(np.int32) - 1, uv, colour.astype(np.float32)),
    )
    return replace(scene, mobiles=(block._replace(mesh=mesh),))


@in_window(scene=two_part_room)
def test_the_panel_edits_the_part_that_was_clicked(hand, viewer, few_kernels, folder):
    """A texture stays under gloss, and the other part as it is; a reflectance replaces the texture."""

    def textured() -> int:
        (block,) = viewer.session.scene.mobiles
        return int((block.mesh.paint.face_texture >= 0).sum())

    hand.click((0.5, 0.415, 0.5))
    shown = viewer.viewport
    assert (shown.surface, shown.parts, shown.part, shown.finish.textured) == (
        "block",
        ("white", "red"),
        "white",
        False,
    )
    hand.click(BLOCK_FRONT)
    whole = textured()
    assert (shown.surface, shown.part, shown.finish.textured) == ("block", "red", True)
    assert viewer.viewport.readout().endswith("block, red")
    hand.panel("Objects", opened="Material")
    change(hand, viewer, lambda: hand.ctx.combo_click("##Model/Metal-rough"))
    (edit,) = viewer.session.settings.edits
    assert edit == Finish("block", (("metallic", 0.0), ("roughness", 0.3), ("ior", 1.5)), part="red")
    assert textured() == whole and shown.finish.textured and shown.part == "red"
    change(hand, viewer, lambda: hand.ctx.item_input_value("**/##Roughness", 0.2))
    (edit,) = viewer.session.settings.edits
    assert dict(edit.material)["roughness"] == pytest.approx(0.2) and textured() == whole
    change(hand, viewer, lambda: hand.ctx.item_input_value("**/##reflectance/##X", 0.25))
    (edit,) = viewer.session.settings.edits
    assert "reflectance" in dict(edit.material) and textured() == 0 and not shown.finish.textured
    hand.ctx.combo_click("##Part/white")
    hand.ctx.yield_(2)
    assert shown.part == "white" and dict(shown.finish.values)["reflectance"] == pytest.approx((0.73,) * 3)
    change(hand, viewer, lambda: hand.ctx.item_input_value("**/##reflectance/##X", 0.4))
    white = Finish("block", (("reflectance", pytest.approx((0.4, 0.73, 0.73))),), part="white")
    assert viewer.session.settings.edits == (edit, white)
    saved_scene.write(folder / "saved.toml", viewer.session.settings)
    assert saved_scene.read(str(folder / "saved.toml")).edits == viewer.session.settings.edits
    for edits in (1, 1, 1, 0):
        change(hand, viewer, lambda: viewer._do("undo"))
        assert len(viewer.session.settings.edits) == edits
    assert textured() == whole


def test_a_saved_scene_keeps_its_edits(folder):
    thing = write_glb(folder / "thing.glb", BOX * 0.1, BOX_FACES)
    edits = (
        Finish("wall", (("reflectance", (0.1, 0.25, 0.98)),)),
        Finish("pawn", (("metallic", 1.0), ("roughness", 0.25)), part="base"),
        Finish("ground", (("brdf", "ward"), ("ax", 0.3), ("ks", (0.3, 0.2, 0.1)), ("scale", True))),
        Finish("tall", (("brdf", ((("model", "phong"), ("ks", (0.3, 0.2, 0.1))), (("model", "ward"), ("kd", 0.5)))),)),
        Insert("thing", str(thing), AWAY),
        Insert("other", str(thing)),
        Insert("plate", shape=(("type", "extrusion"), ("outline", ((0, 0), (1, 0), (0, 1))), ("height", 0.5))),
        Duplicate("copy", "thing", Pose((0.1, 1 / 3, 0.3))),
        Promote("part", (0.3, 0.2, 1 / 7)),
        Freeze("copy", AWAY),
        Remove("other"),
    )
    saved_scene.write(folder / "saved.toml", Settings(scene="cornell", edits=edits))
    read = saved_scene.read(str(folder / "saved.toml")).edits
    assert [e._replace(file="") if isinstance(e, Insert) else e for e in read] == [
        e._replace(file="") if isinstance(e, Insert) else e for e in edits
    ]
    assert all(e.file.endswith("thing.glb") for e in read if isinstance(e, Insert) and not e.shape)
