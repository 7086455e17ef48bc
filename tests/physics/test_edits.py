"""Edits of a scene: each equals a solver built so from the start, bit for bit, and retraces only photons it touched.

Lights added, changed and removed; `test_edits.py` compares each such edit with a new solver.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gi_core.bsdf.ggx import further_albedo
from gi_core.discs import region
from gi_core.estimators import ESTIMATORS
from gi_core.files.completion import DEFAULT_LAMP, lit_by_stand_ins
from gi_core.files.edits import (
    Darken,
    Duplicate,
    EditError,
    Finish,
    Freeze,
    Insert,
    Light,
    Promote,
    Remove,
    Versions,
    edited,
    piece_at,
    removed_lamps,
    with_edit,
)
from gi_core.files.edits import Daylight as ChangeDaylight
from gi_core.files.finishing import finish_of, is_textured, parts_of
from gi_core.files.load import load_scene
from gi_core.geometry.receivers import NONE
from gi_core.lights.daylight import daylit
from gi_core.model import Model
from gi_core.scene.errors import SceneError
from gi_core.scene.pose import axis_angle
from gi_core.scene.types import (
    Daylight,
    LampLevel,
    LightScene,
    Material,
    Mesh,
    Mobile,
    Paint,
    PointLight,
    Pose,
    Scene,
    SkyLight,
    Texture,
)
from gi_core.solver import Solver, edited_solver, photons_of
from tests.support.mesh_writers import BOX, BOX_FACES, write_glb
from tests.support.photometry import luminaire
from tests.support.scene_builders import box, complete, merge, quad, solve, sphere

GIVEN = {"photons": 6000, "radius": 0.15, "neighbours": 6, "seed": 5}
TURNED = Pose((0.4, 0.6, 0.2), axis_angle((0, 0, 1), 30))


def textured_box() -> Mesh:
    """A box whose lower half is plain wall, and whose upper half is crate under a texture."""
    low, high = box((-0.12, -0.12, 0), (0.12, 0.12, 0.12), 1, 0), box((-0.12, -0.12, 0.12), (0.12, 0.12, 0.24), 1, 3)
    mesh, image = merge(low, high), Texture(np.arange(48, 240, 4, dtype=np.uint8).reshape(4, 4, 3))
    upper = mesh.face_material == 3
    uv = np.broadcast_to(np.array([[0, 0], [1, 0], [1, 1]], np.float32), (len(upper), 3, 2))
    colour = np.where(upper[:, None, None], 1.0, np.array([0.8, 0.6, 0.4])) * np.ones((1, 3, 1))
    return mesh._replace(paint=Paint((image,), np.where(upper, 0, -1).astype(np.int32), uv, colour.astype(np.float32)))


def room(lights=None) -> Scene:
    """A room with a screen and a crate that stand still, and two mobiles: a box of two parts, a ball."""
    materials = (
        Material("wall", (0.8, 0.6, 0.4)),
        Material("lamp", (0.5, 0.5, 0.5), (3.0, 2.0, 1.0)),
        Material("screen", (0.3, 0.7, 0.6), two_sided=True),
        Material("crate", (0.6, 0.5, 0.2)),
    )
    static = merge(
        box((0, 0, 0), (1, 1, 1), 3, 0, inward=True),
        quad((0.3, 0.3, 0.99), (0, 0.4, 0), (0.4, 0, 0), (1, 1), 1),
        quad((0.1, 0.5, 0.1), (0, 0, 0.4), (0.3, 0, 0), (2, 2), 2),
        box((0.7, 0.7, 0.0), (0.9, 0.9, 0.2), 2, 3),
    )
    mobiles = (
        Mobile("box", textured_box(), Pose((0.6, 0.4, 0.0))),
        Mobile("ball", sphere((0, 0, 0), 0.15, 1, 2), Pose((0.3, 0.7, 0.4))),
    )
    given_lights = (PointLight("bulb", (0.8, 0.2, 0.7), (0.5, 0.5, 2.0)), luminaire("spot", (0.4, 0.3, 0.6)))
    return Scene(static, materials, mobiles, given_lights if lights is None else lights, up=(0, 0, 1), name="room")


def solved(scene: Scene, **changes) -> Solver:
    return solve(scene, **GIVEN | changes)


def photons_that_meet(solver: Solver, faces: np.ndarray) -> int:
    """Return how many photons of a solver meet one of the faces (F,) bool of the static part, path by path."""
    paths = photons_of(solver).subset(solver.photons)[0]
    sides = (paths.side[a:b] for a, b in zip(paths.offsets[:-1], paths.offsets[1:], strict=True))
    return sum(bool(faces[path[path != NONE] >> 1].any()) for path in sides)


CRATE = (0.8, 0.8, 0.21)
HIGHER = Light("bulb", (("position", (0.7, 0.3, 0.5)),))
PANEL = Light(
    "panel",
    (
        ("type", "panel"), ("position", (0.2, 0.8, 0.9)), ("direction", (0.2, 0.0, -1.0)), ("flux", (0.6, 0.6, 0.3)),
        ("size", (0.1, 0.2)),
    ),
)  # fmt: skip
CONE = ("type", "cone"), ("radius", 0.1), ("height", 0.2), ("max_edge", 0.2)
EDITS = {
    "material": Finish("screen", (("reflectance", (0.9, 0.1, 0.2)),)),
    "mobile": Finish("ball", (("reflectance", (0.1, 0.8, 0.2)),)),
    "metal": Finish("screen", (("reflectance", (0.9, 0.6, 0.2)), ("metallic", 1.0), ("roughness", 0.4))),
    "varnish": Finish("ball", (("reflectance", (0.1, 0.8, 0.2)), ("roughness", 0.5), ("ior", 1.6))),
    "model": Finish("box", (("brdf", "ward"), ("kd", 0.2), ("ax", 0.4), ("scale", True))),
    "mixture": Finish(
        "box",
        (
            (
                "brdf",
                (
                    (("model", "oren_nayar"), ("factor", 0.7), ("rho", (0.4, 0.2, 0.1))),
                    (("model", "phong"), ("ks", 0.2)),
                ),
            ),
            ("scale", True),
        ),
    ),
    "part": Finish("box", (("reflectance", (0.2, 0.2, 0.9)),), part="wall"),
    "glaze": Finish("box", (("roughness", 0.3),), part="crate"),
    "shared": Finish("wall", (("reflectance", (0.1, 0.5, 0.2)),)),
    "duplicate": Duplicate("ball 2", "ball", Pose((0.8, 0.3, 0.3))),
    "shape": Insert("cone", pose=Pose((0.7, 0.3, 0.2)), shape=CONE),
    "remove": Remove("box"),
    "promote": Promote("crate", CRATE),
    "freeze": Freeze("box", TURNED),
    "light moved": HIGHER,
    "light turned": Light("spot", (("direction", (1.0, 0.2, -0.1)), ("size", (0.05, 0.1)))),
    "light added": PANEL,
    "light copied": Light("spot 2", (("position", (0.7, 0.6, 0.8)),), of="spot"),
    "lights removed": Darken("bulb"),
    "faces darkened": Darken("lamp"),
}


OTHER_ESTIMATORS = [name for name in ESTIMATORS if name != "tangent_plane"]
EDITED = [(kind, "tangent_plane") for kind in EDITS] + list(zip(EDITS, OTHER_ESTIMATORS * len(EDITS), strict=False))


@pytest.mark.parametrize(("kind", "estimator"), EDITED)
def test_an_edited_solver_equals_a_new_one(kind, estimator):
    solver = solved(room(), estimator=estimator)
    solver.move("ball", TURNED)
    scene = edited(solver.scene, [EDITS[kind]])
    other = edited_solver(solver, scene)
    lights_alone = isinstance(EDITS[kind], Light) or kind == "lights removed"
    assert (other.surfaces is solver.surfaces) == lights_alone, "geometry is prepared again only where it may differ"
    other.solve()
    new = solved(scene, estimator=estimator)
    new.move_all({name: pose for name, pose in solver.poses.items() if name in new.poses})
    assert np.array_equal(other.irradiance, new.irradiance)
    assert np.array_equal(other.irradiance, other.from_scratch())
    assert np.array_equal(other.drawn(other.irradiance).irradiance, new.drawn(new.irradiance).irradiance)
    for name, flux in new.frame.fates.items():
        assert np.array_equal(other.frame.fates[name], flux)
    other.move_all({name: Pose((0.5, 0.5, 0.3)) for name in other.model.names})
    new.move_all({name: Pose((0.5, 0.5, 0.3)) for name in other.model.names})
    assert np.array_equal(other.irradiance, new.irradiance)


def test_an_hour_of_daylight_equals_a_new_solver():
    """Night has no sun and no sky, so the lamps differ too."""
    place = Daylight((40.4, -3.7), "2026-03-21", 9.0, 1.0)
    scene = daylit(room(), place, "room")
    solver = solved(scene)
    for hour in (15.0, 2.0, 9.0):
        solver = complete(edited_solver(solver, edited(solver.scene, [ChangeDaylight((("hour", hour),))])))
        new = solved(daylit(room(), place._replace(hour=hour), "room"))
        assert np.array_equal(solver.irradiance, new.irradiance) and solver.lamps.names == new.lamps.names
        assert ("sun" in new.lamps.names) == (hour > 6)


def test_a_colour_retraces_the_photons_that_met_it_and_no_others():
    solver = solved(room())
    faces = solver.scene.static.face_material == 2
    expected = photons_that_meet(solver, faces)
    assert 0.02 * GIVEN["photons"] < expected < 0.4 * GIVEN["photons"]
    other = complete(edited_solver(solver, edited(room(), [EDITS["material"]])))
    assert photons_of(other).traced == expected
    assert not np.array_equal(other.irradiance, solver.irradiance)
    # More photons than were known are traced as ever.
    more = edited_solver(solver, edited(room(), [EDITS["material"]]))
    more.configure(photons=9000)
    more.solve()
    assert photons_of(more).traced == expected + 3000
    assert np.array_equal(more.irradiance, solved(edited(room(), [EDITS["material"]]), photons=9000).irradiance)


def taller(scene: Scene) -> Scene:
    """Return the scene with another ball of the same triangles and receivers."""
    boxed, ball = scene.mobiles
    mesh = ball.mesh._replace(vertices=ball.mesh.vertices * [1.0, 1.0, 1.2])
    return replace(scene, mobiles=(boxed, ball._replace(mesh=mesh)))


@pytest.mark.parametrize(
    "change, new",
    [
        (lambda scene: edited(scene, [EDITS["material"]]), []),
        (lambda scene: edited(scene, [EDITS["duplicate"]]), []),
        (lambda scene: edited(scene, [EDITS["promote"]]), ["", "crate"]),
        (taller, ["ball"]),
    ],
)
def test_an_edit_keeps_regions_of_the_shapes_that_stay(change, new, monkeypatch):
    """Their rays took half of an edit's time. Names and numbers of triangles do not make a shape: a copy has one."""
    solver, measured, measure = solved(room()), [], region._measured

    def counted(model, o, radius):
        measured.append(["", *model.names][o])
        return measure(model, o, radius)

    monkeypatch.setattr(region, "_measured", counted)
    other = complete(edited_solver(solver, change(room())))
    assert sorted(measured) == sorted(new)
    assert np.array_equal(other.irradiance, solved(change(room())).irradiance)
    discs, before = (
        other.frame.background.estimate.searches[0].discs,
        solver.frame.background.estimate.searches[0].discs,
    )
    assert discs.regions.row is not before.regions.row, "frames write to them"


@pytest.mark.parametrize("kind", ["mobile", "duplicate", "remove"])
def test_edits_of_mobiles_trace_no_photon(kind):
    other = complete(edited_solver(solved(room()), edited(room(), [EDITS[kind]])))
    assert photons_of(other).traced == 0 and other.frame.photons == GIVEN["photons"]


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize("kind", ["mobile", "metal", "duplicate", "remove"])
def test_edits_of_mobiles_estimate_no_photon_again(kind, estimator, monkeypatch):
    """A stranger's room took 15 s until all its photons were back. Both scenes go on separately."""
    solver = solved(room(), estimator=estimator)
    scene, added = edited(room(), [EDITS[kind]]), []
    other = edited_solver(solver, scene)
    add = ESTIMATORS[estimator].add_background
    monkeypatch.setattr(ESTIMATORS[estimator], "add_background", lambda *given: added.append(1) or add(*given))
    pictures = [other.frame.photons for step in other.solve_steps() if step.picture]
    if kind == "metal":
        assert added, "its screen is part of the static part"
        return
    assert pictures == [GIVEN["photons"]] and not added
    for s, of in ((solver, room()), (other, scene)):
        s.configure(photons=9000)
        s.solve()
        s.move("ball", TURNED)
        new = solved(of, estimator=estimator, photons=9000)
        new.move("ball", TURNED)
        assert np.array_equal(s.irradiance, new.irradiance) and np.array_equal(s.irradiance, s.from_scratch())
    few = edited_solver(solver, scene)
    few.configure(photons=3000)
    few.solve()
    new = solved(scene, estimator=estimator, photons=3000)
    new.move_all({name: pose for name, pose in few.poses.items()})
    assert np.array_equal(few.irradiance, new.irradiance)


def test_a_sky_that_must_reach_a_new_mobile_is_traced_again():
    """Sky photons start on a sphere that covers all mobiles: a copy far outside moves them all."""
    sky = room(lights=(SkyLight("sky", (1.0, 1.0, 1.0)),))
    scene = edited(sky, [Duplicate("far", "ball", Pose((4.0, 0.0, 0.0)))])
    other = complete(edited_solver(solved(sky), scene))
    assert photons_of(other).traced == GIVEN["photons"]
    assert np.array_equal(other.irradiance, solved(scene).irradiance)


step = st.one_of(
    st.builds(
        lambda name, colour, gloss: Finish(name, (("reflectance", colour), *gloss)),
        st.sampled_from(["wall", "screen", "crate", "lamp"]),
        st.sampled_from([(0.1,) * 3, (0.9, 0.5, 0.0)]),
        st.sampled_from([(), (("roughness", 0.4),), (("metallic", 1.0), ("roughness", 0.3))]),
    ),
    st.builds(
        lambda part, values: Finish("box", values, part=part),
        st.sampled_from(["wall", "crate"]),
        st.sampled_from(
            [
                (),
                (("roughness", 0.4),),
                (("metallic", 0.6), ("roughness", 0.3)),
                (("reflectance", (0.9, 0.5, 0.1)),),
                (("brdf", "ward"), ("kd", 0.2), ("scale", True)),
            ]
        ),
    ),
    st.builds(lambda n, x: Duplicate(f"copy {n}", "ball", Pose((x, 0.4, 0.4))), st.integers(0, 9), st.floats(0.2, 0.8)),
    st.sampled_from(
        [
            Remove("box"),
            Promote("crate", CRATE),
            Freeze("box", TURNED),
            Finish("ball", (("reflectance", (0.3, 0.3, 0.9)),)),
            PANEL,
            Darken("bulb"),
            Darken("lamp"),
            Light("panel 2", (("direction", (0.0, 1.0, -1.0)),), of="panel"),
        ]
    ),
    st.builds(
        lambda name, place: Light(name, (("position", place),)),
        st.sampled_from(["bulb", "spot", "panel"]),
        st.sampled_from([(0.2, 0.2, 0.5), (0.6, 0.6, 0.8)]),
    ),
)
moves = st.builds(lambda x, y: Pose((x, y, 0.1)), st.floats(0.2, 0.8), st.floats(0.2, 0.8))


@settings(max_examples=12)
@given(st.lists(st.tuples(step, moves), min_size=1, max_size=4), st.sampled_from(["best", "photons"]))
def test_any_history_of_edits_and_moves_equals_a_new_solver(history, light):
    scene, solver = room(), solved(room(), photons=300, light=light)
    for edit, pose in history:
        try:
            scene = edited(scene, [edit])
        except SceneError:
            continue  # the mobile is gone, or has that name already
        solver = complete(edited_solver(solver, scene))
        solver.move("ball", pose)
        assert np.array_equal(solver.irradiance, solver.from_scratch())
        assert (solver.irradiance >= 0).all() and np.isfinite(solver.irradiance).all()
    new = Solver(scene, **GIVEN | {"photons": 300, "light": light})
    new.move_all(solver.poses)
    new.solve()
    assert np.array_equal(solver.irradiance, new.irradiance)


def test_a_promoted_piece_looks_as_before_and_freezes_back():
    scene = room()
    piece = piece_at(scene.static, CRATE)
    assert np.array_equal(piece, scene.static.face_material == 3)
    promoted = edited(scene, [Promote("crate", CRATE)])
    (*_, crate) = promoted.mobiles
    assert len(promoted.static.faces) + len(crate.mesh.faces) == len(scene.static.faces)
    assert crate.mesh.vertices[:, 2].min() == 0 and crate.pose.position == pytest.approx((0.8, 0.8, 0.0))
    back = edited(promoted, [Freeze("crate", crate.pose)])
    assert [m.name for m in back.mobiles] == ["box", "ball"]

    def triangles(s: Scene) -> np.ndarray:
        corners = s.static.vertices[s.static.faces].reshape(-1, 9)
        return np.sort(np.round(np.c_[corners, s.static.face_material], 9), axis=0)

    assert np.allclose(triangles(back), triangles(scene))


def test_settings_stay():
    solver = solved(room(), light="best", gloss="list", subset_only=True, search="brute_force")
    other = edited_solver(solver, edited(room(), [EDITS["material"]]))
    assert other.setting == solver.setting and other.light == "best" and other.photons == solver.photons
    chosen = other.frame_light.setting
    assert chosen.gloss == "list" and chosen.subset_only


def test_levels_of_lamps_stay():
    solver = solved(room())
    solver.set_lamps({"bulb": 0.5, "lamp": 0.25})
    other = edited_solver(solver, edited(room(), [EDITS["material"]]))
    assert np.array_equal(other.levels, solver.levels)


def test_a_mobile_from_a_file_is_that_of_a_scene_loaded_with_it(tmp_path):
    """Only its place may differ: it is found after the walls have been split."""
    thing = write_glb(tmp_path / "thing.glb", BOX * 0.05, BOX_FACES)
    scene = load_scene("cornell")
    inserted = edited(scene, [Insert("thing", str(thing))])
    loaded = load_scene("cornell", mobiles=[thing])
    a, b = inserted.mobiles[-1], loaded.mobiles[-1]
    assert a.name == b.name == "thing" and a.pose.position[1] == pytest.approx(b.pose.position[1], abs=1e-6)
    assert np.array_equal(a.mesh.vertices, b.mesh.vertices) and np.array_equal(a.mesh.faces, b.mesh.faces)
    placed = edited(scene, [Insert("thing", str(thing), TURNED)]).mobiles[-1]
    assert placed.pose == TURNED


def test_an_inserted_shape_is_that_of_a_scene_file(tmp_path):
    (tmp_path / "a.toml").write_text(
        'shape = [{ type = "room", size = [1, 1, 1] }, '
        '{ type = "cone", radius = 0.1, height = 0.2, name = "cone", mobile = true }]\n'
    )
    scene = load_scene(tmp_path / "a.toml")
    inserted = edited(edited(scene, [Remove("cone")]), [Insert("cone", shape=CONE[:3])])
    a, b = inserted.mobiles[-1], scene.mobiles[-1]
    assert a.name == b.name == "cone" and a.pose.position[1] == pytest.approx(b.pose.position[1], abs=1e-6)
    assert all(np.array_equal(x, y) for x, y in ((a.mesh[k], b.mesh[k]) for k in (0, 1, 3)))
    assert len(inserted.files) == len(scene.files)


def test_edits_begin_at_the_last_version_that_they_share(tmp_path):
    thing = write_glb(tmp_path / "thing.glb", BOX * 0.05, BOX_FACES)
    insert, there = Insert("thing", str(thing), TURNED), EDITS["duplicate"]
    both = Versions({0: room()}).after([insert, there])
    thing.unlink()  # it is not read again
    for edits in ([insert], [insert, EDITS["remove"]], [insert, there, HIGHER], [insert, there]):
        versions = both.after(edits)
        assert versions.edits == tuple(edits) and set(versions.scenes) == set(range(len(edits) + 1))
        assert versions.scenes[1] is both.scenes[1]
    assert both.after([insert, there]).last is both.last
    assert both.after([]).last is both.scenes[0]
    assert [m.name for m in both.after([insert, EDITS["remove"]]).last.mobiles] == ["ball", "thing"]

    # Old versions are dropped; edits that share no other begin at the first.
    lights = [HIGHER._replace(light=(("position", (0.7, 0.3, 0.1 * k)),)) for k in range(1, 6)]
    many = Versions({0: room()}).after(lights)
    assert set(many.scenes) == {0, 3, 4, 5}
    fewer = many.after(lights[:2])
    assert set(fewer.scenes) == {0, 1, 2}
    assert next(light for light in fewer.last.lights if light.name == "bulb").position == (0.7, 0.3, 0.2)
    with pytest.raises(EditError, match=r"there is no such file") as problem:
        both.after([there, insert])
    assert problem.value.number == 1


@pytest.mark.parametrize(
    ("edit", "rule"),
    [
        (Finish("chair", (("reflectance", (0.1, 0.1, 0.1)),)),
         'no mobile or material is called \'chair\'; there is "box", "ball", "wall"'),
        (Finish("wall", (("reflectance", (0.1, 1.0, 0.1)),)),
         "the material of 'wall': reflectance must be three numbers in [0, 1)"),
        (Finish("ball", (("brdf", "wrad"),)), "unknown reflection model 'wrad'"),
        (Finish("ball", (("brdf", "ward"), ("gloss", 0.2))), "the material of 'ball'"),
        (Finish("ball", (("emission", (1.0, 1.0, 1.0)),)), "the material of 'ball'"),
        (Finish("box", (("roughness", 0.3),), part="leg"),
         "mobile 'box' has no part 'leg'; there is \"wall\", \"crate\""),
        (Finish("chair", (), part="leg"), 'no mobile is called \'chair\'; there is "box", "ball"'),
        (Remove("chair"), 'no mobile is called \'chair\'; there is "box", "ball"'),
        (Duplicate("box", "ball", Pose()), "a new mobile must have a name of its own, got 'box'"),
        (Duplicate("b", "ball", Pose(quaternion=(2, 0, 0, 0))),
         "the quaternion (w, x, y, z) of a pose must have length 1"),
        (Promote("lamp", (0.5, 0.5, 0.99)), 'its material "lamp" emits light, and lamps must stand still'),
        (Insert("x", "nothing.glb"), "nothing.glb: there is no such file"),
        (Insert("x", shape=(("type", "ball"),)), "shape 'x': type must be one of \"room\""),
        (Insert("x", shape=(("type", "sphere"), ("radius", 0.0))), "shape 'x': radius must be a finite number > 0"),
        (Insert("x", shape=(("type", "sphere"), ("radius", 1.0), ("mobile", True))), "unknown key 'mobile'"),
        (Light("globe", ()), 'no light is called \'globe\'; there is "bulb", "spot"'),
        (Light("bulb", (("size", (1, 1)),)), "light 'bulb': unknown key 'size'"),
        (Light("bulb", (("position", (0, 0)),)), "light 'bulb': position must be three finite numbers"),
        (Light("x", (("type", "lamp"),)), 'light \'x\': type must be one of "point", "spot", "panel"'),
        (Light("x", (("type", "photometric"),), "no.ies"), "no.ies: there is no such file"),
        (Darken("globe"), "remove a lamp: no lamp is called 'globe'"),
    ],
)  # fmt: skip
def test_mistakes(edit, rule):
    with pytest.raises(SceneError) as caught:
        edited(room(), [edit])
    assert rule in str(caught.value)


def test_a_static_part_of_one_piece_stays():
    scene = replace(room(), static=box((0, 0, 0), (1, 1, 1), 3, 0, inward=True))
    with pytest.raises(SceneError, match="the whole static part hangs together there"):
        edited(scene, [Promote("all", (0.5, 0.5, 0.0))])


def test_a_finish_is_read_back():
    """`finish_of` returns what an edit has given: model and parameters, for mobiles and the static part."""
    for name in ("metal", "varnish", "model"):
        edit = EDITS[name]
        scene = edited(room(), [edit])
        found = dict(finish_of(scene, Model(scene).surfaces, edit.name, of_static=name == "metal"))
        for key, value in edit.material:
            if key in ("brdf", "scale"):
                assert found[key] == value
            else:
                assert np.allclose(found[key], value, rtol=1e-6)


def test_a_linear_combination_is_read_back_with_factors():
    """The panel showed the first model alone, and the next edit left out the others."""
    scene = edited(room(), [EDITS["mixture"]])
    found = finish_of(scene, Model(scene).surfaces, "box", of_static=False)
    first, second = map(dict, dict(found)["brdf"])
    assert hash(found), "requests of the panel are members of a set"
    assert (first["model"], first["factor"], first["rho"]) == ("oren_nayar", 0.7, (0.4, 0.2, 0.1))
    assert (second["model"], second["factor"], second["ks"]) == ("phong", 1.0, (0.2, 0.2, 0.2))
    again = (("brdf", (tuple((first | {"factor": 0.5}).items()), tuple(second.items()))), ("scale", True))
    box = edited(scene, [Finish("box", again)]).materials[-1]
    assert [lobe.factor for lobe in box.brdf] == [0.5, 1.0] and box.scaled


def test_a_metal_has_further_reflections_alone_where_faces_have_colours():
    """A mesh with colours per face kept them under the metal that an edit, or a scene file, made of it."""
    rho = np.full((len(room().static.faces), 3), 0.7)
    scene = replace(room(), static=room().static._replace(face_reflectance=rho))
    scene = edited(scene, [EDITS["metal"]])
    screen = np.array([m.name == "screen" for m in scene.materials])[scene.static.face_material]
    surfaces = Model(scene).surfaces
    of = surfaces.face_range(0)
    assert screen.any()
    assert surfaces.reflectance[of][screen] == pytest.approx(further_albedo(surfaces.lobe[of][screen]))


def colours_of(scene: Scene, part: str) -> np.ndarray:
    """Return the reflectance (n, 3) of the faces of a part of the box."""
    surfaces, mesh = Model(scene).surfaces, scene.mobiles[0].mesh
    rows = np.array([m.name.removeprefix("box: ") == part for m in scene.materials])[mesh.face_material]
    return surfaces.reflectance[surfaces.face_range(1)][rows]


def test_a_part_alone_is_edited():
    """The other part of the object keeps colour and texture; so do walls of the same material."""
    scene = edited(room(), [EDITS["part"]])
    assert colours_of(scene, "wall") == pytest.approx(np.full((12, 3), (0.2, 0.2, 0.9)))
    assert np.array_equal(colours_of(scene, "crate"), colours_of(room(), "crate"))
    assert np.array_equal(scene.mobiles[0].mesh.paint.face_texture, room().mobiles[0].mesh.paint.face_texture)
    static = Model(scene).surfaces.face_range(0)
    assert np.array_equal(Model(scene).surfaces.reflectance[static], Model(room()).surfaces.reflectance[static])
    assert parts_of(scene, "box") == parts_of(room(), "box") == ("wall", "crate")
    again = edited(scene, [EDITS["part"]._replace(material=(("reflectance", (0.5, 0.1, 0.1)),))])
    assert colours_of(again, "wall") == pytest.approx(np.full((12, 3), (0.5, 0.1, 0.1)))


def test_a_texture_stays_until_a_reflectance_replaces_it():
    scene = edited(room(), [EDITS["glaze"]])
    assert is_textured(scene, "box", False, "crate") and not is_textured(scene, "box", False, "wall")
    before, after = room().mobiles[0].mesh, scene.mobiles[0].mesh
    assert np.array_equal(after.paint.corner_colour, before.paint.corner_colour)
    assert dict(finish_of(scene, Model(scene).surfaces, "box", False, "crate"))["roughness"] == pytest.approx(0.3)
    assert dict(finish_of(scene, Model(scene).surfaces, "box", False, "wall")).keys() == {"reflectance"}
    matte = edited(scene, [EDITS["glaze"]._replace(material=())])
    assert np.array_equal(colours_of(matte, "crate"), colours_of(room(), "crate"))
    red = edited(scene, [EDITS["glaze"]._replace(material=(("reflectance", (0.8, 0.1, 0.1)), ("roughness", 0.3)))])
    assert not is_textured(red, "box", False, "crate")


def test_metal_takes_light_from_a_texture_and_gives_it_back():
    """0.6 of the light meets the metal, so the base has about 0.4 of its colours; without metal it has all of them."""
    metal = edited(room(), [EDITS["glaze"]._replace(material=(("metallic", 0.6), ("roughness", 0.3)))])
    paint, plain = metal.mobiles[0].mesh.paint, room().mobiles[0].mesh.paint
    upper = plain.face_texture >= 0
    assert paint.face_texture[upper].min() == 0 and is_textured(metal, "box", False, "crate")
    share = paint.corner_colour[upper] / plain.corner_colour[upper]
    assert (share > 0.3).all() and (share < 0.5).all()
    found = dict(finish_of(metal, Model(metal).surfaces, "box", False, "crate"))
    assert found["metallic"] == pytest.approx(0.6, abs=1e-3)
    back = edited(metal, [EDITS["glaze"]])
    assert back.mobiles[0].mesh.paint.corner_colour[upper] == pytest.approx(plain.corner_colour[upper], abs=1e-3)
    pure = edited(room(), [EDITS["glaze"]._replace(material=(("metallic", 1.0), ("roughness", 0.3)))])
    flat = edited(pure, [EDITS["glaze"]])
    mean = colours_of(room(), "crate").mean(axis=0)
    assert flat.mobiles[0].mesh.paint.corner_colour[upper] == pytest.approx(np.tile(mean, (12, 3, 1)), abs=0.01)


def test_a_mobile_of_the_name_of_a_static_material_is_edited_apart():
    """A piece made movable has the name of its material, which walls may share."""
    scene = edited(room(), [Promote("wall", CRATE)])
    walls = Finish("wall", (("reflectance", (0.1, 0.2, 0.3)),))
    piece = Finish("wall", (("reflectance", (0.9, 0.1, 0.1)),), part="crate")
    scene = edited(scene, [walls, piece])
    surfaces = Model(scene).surfaces
    static = surfaces.reflectance[surfaces.face_range(0)][scene.static.face_material == 0]
    assert static == pytest.approx(np.full(static.shape, (0.1, 0.2, 0.3)))
    moved = surfaces.reflectance[surfaces.face_range(3)]
    assert moved == pytest.approx(np.full(moved.shape, (0.9, 0.1, 0.1)))


@pytest.mark.parametrize("same_file", [True, False], ids=["one file", "two files"])
def test_an_edit_of_the_static_part_leaves_mobiles_alone(same_file):
    """A mobile's material may have the name of a static one: it is that one, or another file's."""
    scene = room()
    if not same_file:
        wall = next(k for k, m in enumerate(scene.materials) if m.name == "wall")
        box = scene.mobiles[0].mesh
        other = np.where(box.face_material == wall, len(scene.materials), box.face_material).astype(np.int32)
        mobiles = (scene.mobiles[0]._replace(mesh=box._replace(face_material=other)), *scene.mobiles[1:])
        scene = replace(scene, materials=(*scene.materials, scene.materials[wall]), mobiles=mobiles)
    before = Model(scene).surfaces
    after = Model(edited(scene, [EDITS["shared"]])).surfaces
    for o in range(1, 3):
        faces = before.face_range(o)
        assert np.array_equal(after.reflectance[faces], before.reflectance[faces])
    static = before.face_range(0)
    changed = after.reflectance[static][(after.reflectance[static] != before.reflectance[static]).any(axis=1)]
    assert len(changed) and changed == pytest.approx(np.full(changed.shape, (0.1, 0.5, 0.2)))


def test_a_finish_takes_the_place_of_an_earlier_one():
    wall, crate, copy = EDITS["part"], EDITS["glaze"], EDITS["duplicate"]
    later = wall._replace(material=(("reflectance", (0.5, 0.1, 0.1)),))
    assert with_edit([wall, crate], later) == (crate, later)
    assert with_edit([wall, copy], later) == (wall, copy, later), "a copy may show the earlier one"
    static = Finish("wall", (("reflectance", (0.1, 0.2, 0.3)),))
    assert with_edit([wall, static], later) == (wall, static, later)


@pytest.mark.parametrize(("edit", "lamp"), [(HIGHER, "bulb"), (EDITS["light turned"], "spot")])
def test_a_moved_light_retraces_its_own_photons_and_no_others(edit, lamp):
    solver = solved(room())
    photons = photons_of(solver).subset(GIVEN["photons"])[0].lamp
    own = int((photons == solver.lamps.names.index(lamp)).sum())
    assert 0 < own < 0.7 * GIVEN["photons"]
    other = complete(edited_solver(solver, edited(room(), [edit])))
    assert photons_of(other).traced == own
    assert not np.array_equal(other.irradiance, solver.irradiance)


def test_lights_are_added_changed_and_removed():
    scene = edited(room(), [PANEL, Light("panel", (("flux", (1.0, 2.0, 3.0)),)), Darken("bulb"), Darken("lamp")])
    spot, panel = scene.lights
    assert (spot.name, panel.name) == ("spot", "panel") and panel.flux == (1.0, 2.0, 3.0)
    assert panel.size == (0.1, 0.2) and panel.position == (0.2, 0.8, 0.9)
    assert not any(max(m.emission) for m in scene.materials)
    assert Solver(scene, photons=0).lamps.names == ("spot", "panel")


def test_of_lights_that_share_a_name_each_is_changed_by_its_number():
    lights = [PointLight("bulb", (x, 0.5, 0.5), (1.0, 1.0, 1.0)) for x in (0.2, 0.5, 0.8)]
    scene = room(lights=(*lights, PointLight("other", (0.5, 0.5, 0.9), (1.0, 1.0, 1.0))))
    second = Light("bulb", (("position", (0.5, 0.1, 0.5)),), number=2)
    assert [light.position[1] for light in edited(scene, [second]).lights] == [0.5, 0.1, 0.5, 0.5]
    rest = edited(scene, [Darken("bulb", 1), second]).lights
    assert [light.position[:2] for light in rest] == [(0.5, 0.5), (0.5, 0.1), (0.5, 0.5)]
    assert [light.name for light in edited(scene, [Darken("bulb")]).lights] == ["other"]
    with pytest.raises(SceneError, match="lamp 'bulb' has no light 4"):
        edited(scene, [Darken("bulb", 4)])


def test_changes_of_a_light_are_one_edit():
    there, later = Light("bulb", (("position", (0.5, 0.5, 0.9)),)), Light("bulb", (("flux", (2.0, 2.0, 2.0)),))
    both = Light("bulb", (("position", (0.7, 0.3, 0.5)), ("flux", (2.0, 2.0, 2.0))))
    edits = ()
    for edit in (there, EDITS["material"], HIGHER, later):
        edits = with_edit(edits, edit)
    assert edits == (EDITS["material"], both)
    assert with_edit((PANEL,), Light("panel", (("flux", (1.0,) * 3),)))[0].light[1] == PANEL.light[1]
    copy = Light("bulb 2", (), of="bulb")
    assert with_edit((there, copy), HIGHER) == (there, copy, HIGHER), "the copy is of the light before"
    assert with_edit((there, Darken("bulb")), PANEL) == (there, Darken("bulb"), PANEL)
    assert removed_lamps((Darken("bulb", 1),)) == set(), "others of that name are left"
    assert removed_lamps((Darken("bulb"), Darken("spot"), PANEL, Light("bulb", PANEL.light))) == {"spot"}


def test_the_plate_of_a_default_light_goes_with_it(tmp_path):
    """It would hang dark over the user's own lamps."""
    scene = load_scene(str(write_glb(tmp_path / "room.glb", 3 * BOX, BOX_FACES[:, ::-1])))
    own = Light("own", (("type", "point"), ("position", (0.1, 0.2, 0.3)), ("flux", (1.0, 1.0, 1.0))))
    lamps = {m.name for m in scene.materials if max(m.emission) > 0}
    assert lamps == {DEFAULT_LAMP} and lit_by_stand_ins(scene)
    lit = edited(scene, [own, Darken(DEFAULT_LAMP)])
    assert Solver(lit, photons=0).lamps.names == ("own",)
    of_plate = np.array([m.name == DEFAULT_LAMP for m in scene.materials])[scene.static.face_material]
    assert of_plate.any() and len(lit.static.faces) == len(scene.static.faces) - of_plate.sum()


def test_light_scenes_forget_a_removed_lamp():
    evening = LightScene("evening", (LampLevel("bulb", 0.5), LampLevel("spot", 0.2)))
    scene = edited(replace(room(), light_scenes=(evening,)), [Darken("bulb")])
    assert scene.light_scenes == (LightScene("evening", (LampLevel("spot", 0.2),)),)
