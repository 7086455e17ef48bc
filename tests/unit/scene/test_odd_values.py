"""Odd values of every public parameter: refused in one sentence, or a finite picture."""

from dataclasses import replace

import numpy as np
import pytest

from gi_core.scene import SceneError
from gi_core.scene.pose import as_pose
from gi_core.scene.types import (
    Camera,
    Defaults,
    DirectionalLight,
    KeyFrames,
    PointLight,
    Pose,
    Probe,
    Scene,
    SkyLight,
    SpotLight,
)
from gi_core.solver import Solver
from tests.support.scene_builders import box_mobile, grey, plane_scene, solve

pytestmark = pytest.mark.slow

NAN, INF = float("nan"), float("inf")
HUGE = 10**400  # no float holds it
LONG = 10**5000  # repr() refuses it
NEVER = ["1", "x", b"1", NAN, INF, -INF, 1e308, -1e308, 1e300, 1e16, HUGE, LONG, [], {}, [1, 2], np.array([1.0, 2]), 1j]
PERHAPS = [
    True, np.bool_(True), 1e14, 1e-14, 1e-16, 1e-300, 5e-324, -0.0, 0, -1.0, 2.5, np.float32(0.5), np.int64(3),
    np.array(1.0), np.longdouble(0.5), np.uint8(1),
]  # fmt: skip
MOBILE = box_mobile(size=0.3)._replace(pose=Pose((0, 0, 0.3)))
LAMPS = (
    PointLight("point", (0, 0, 1), (1, 1, 1)),
    SpotLight("spot", (0, 0, 1), (0, 0, -1), (1, 1, 1), 20, 40),
    DirectionalLight("sun", (0.1, 0.2, -1), (1, 1, 1)),
    SkyLight("sky", (1, 1, 1)),
)
FLAGS = ("two_sided", "control", "border_correction", "textbook", "subset_only")


def plane(**changes) -> Scene:
    return replace(plane_scene(LAMPS[0], reflectance=0.3, divisions=2, mobiles=(MOBILE,)), **changes)


def within(good, bad):
    """Yield a value in place of a good one: alone, and as one component of a vector or as all."""
    yield bad
    if isinstance(good, tuple) and good:
        yield (bad, *good[1:])
        yield (bad,) * len(good)


def solved(scene: Scene, **settings) -> np.ndarray:
    solver = Solver(scene, **{"photons": 200, "radius": 0.1, **settings})
    if solver.photons > 1000:
        solver.configure(photons=200)
    solver.solve()
    for name in solver.poses:
        solver.move(name, Pose((0.1, 0, 0.4)))
    return solver.irradiance


def refused(make, where: str) -> bool:
    """Return whether a value is refused, in one sentence that begins with `where`; else there is finite light."""
    try:
        light = make()
    except SceneError as problem:
        text = str(problem)
        assert text.startswith(where) and text.isprintable(), text
        return True
    assert np.isfinite(light).all() and (light >= 0).all()
    return False


RECORDS = [
    *((lamp, lambda lamp: plane(lights=(lamp,))) for lamp in LAMPS),
    (grey(0.5), lambda m: plane(materials=(m,), mobiles=())),
    (Probe("probe", (0.1, 0.1, 0.5), (0, 0, 1)), lambda p: plane(probes=(p,))),
    (Camera((0, -3, 1), (0, 0, 0)), lambda c: plane(camera=c)),
]


@pytest.mark.parametrize(
    ("record", "scene", "field"), [(r, s, f) for r, s in RECORDS for f in r._fields], ids=lambda x: str(x)[:20]
)
def test_fields_of_records(record, scene, field):
    good = getattr(record, field)
    for bad in NEVER:
        for value in within(good, bad):
            is_text = field == "name" and isinstance(value, str)
            assert refused(lambda v=value: solved(scene(record._replace(**{field: v}))), "plane: ") != is_text
    for odd in PERHAPS:
        for value in within(good, odd):
            no = refused(lambda v=value: solved(scene(record._replace(**{field: v}))), "plane: ")
            assert no or field != "two_sided" or isinstance(value, bool | np.bool_)


@pytest.mark.parametrize("field", ["name", "up", "units"])
def test_fields_of_scenes(field):
    for bad in [*NEVER, *PERHAPS]:
        for value in within(getattr(plane(), field), bad):
            no = refused(lambda v=value: solved(plane(lights=LAMPS[3:], **{field: v})), "")
            assert no or field == "up" or isinstance(value, str)


@pytest.mark.parametrize("field", Defaults._fields)
def test_fields_of_defaults(field):
    for value in [*NEVER, *PERHAPS]:
        scene = plane(defaults=Defaults(**{field: value}))
        unset = {"photons": None, field: None} if field in ("photons", "radius", "neighbours") else {}
        no = refused(lambda s=scene, u=unset: solved(s, **u), "plane: defaults: ")
        assert no or not any(value is v for v in NEVER) or (field == "estimator" and isinstance(value, str))


@pytest.mark.parametrize("part", ["static", "mobile"])
@pytest.mark.parametrize("field", ["vertices", "faces", "face_material", "corner_normals", "face_reflectance"])
def test_arrays_of_meshes(part, field):
    mesh = plane().static if part == "static" else MOBILE.mesh
    good = {"corner_normals": np.zeros((len(mesh.faces), 3, 3)) + [0, 0, 1.0]}.get(field, getattr(mesh, field))
    good = np.full((len(mesh.faces), 3), 0.5) if good is None else good

    def scene(values):
        changed = mesh._replace(**{field: values})
        return plane(static=changed) if part == "static" else plane(mobiles=(MOBILE._replace(mesh=changed),))

    for bad in [*NEVER, True, 2.5]:
        assert refused(lambda v=bad: solved(scene(v)), "plane: ")
        if np.ndim(bad) == 0 and not isinstance(bad, dict):
            mixed = good.astype(object)
            mixed[0] = bad
            values = np.array(mixed.tolist(), object if bad in (HUGE, LONG) else None)
            assert refused(lambda v=values: solved(scene(v)), "plane: ") or bad in (True, 2.5)
    assert not refused(lambda: solved(scene(good)), "")
    for wrong in (good[:, None], good.astype(str), good.astype(bool), good[..., None].repeat(2, -1), good.tolist()):
        assert refused(lambda v=wrong: solved(scene(v)), "plane: ")
    assert refused(lambda: solved(scene(good[:-1])), "plane: ")
    for factor in (1e-300, 1e-310, 5e-324, 1e-30, 1e30, 1e300):
        assert field != "vertices" or refused(lambda f=factor: solved(scene(good * f)), "plane: ")


@pytest.mark.parametrize("part", ["position", "quaternion"])
def test_poses(part):
    for bad in [*NEVER, *PERHAPS]:
        for value in within(getattr(Pose(), part), bad):
            pose = Pose((0, 0, 1))._replace(**{part: value})
            start = plane(mobiles=(MOBILE._replace(pose=pose),), lights=LAMPS[3:])
            no = refused(lambda s=start: solved(s), "plane: ")
            solver = solve(plane(), photons=200, radius=0.1)
            before, light = solver.poses, solver.irradiance
            moved = refused(lambda s=solver, p=pose: s.move("box", p) or s.irradiance, 'plane: mobile "box": ')
            assert no or not moved
            assert not moved or (solver.poses is before and solver.irradiance is light)
            assert moved or not any(bad is v for v in NEVER)


@pytest.mark.parametrize("pose", [*NEVER, *PERHAPS, None, np.eye(3), np.eye(4) * 1e300, np.eye(4).astype(str),
                                  np.full((4, 4), NAN), [[1, 2], [3]]], ids=lambda x: str(type(x)))  # fmt: skip
def test_what_is_no_pose(pose):
    with pytest.raises(SceneError, match="a pose is|poses must be rigid"):
        as_pose(pose, "here")
    assert refused(lambda: solved(plane(mobiles=(MOBILE._replace(pose=pose),))), "plane: ")


def test_paths():
    def scene(**changes):
        path = KeyFrames(np.arange(2.0), np.zeros((2, 3)), np.tile([1.0, 0, 0, 0], (2, 1)))._replace(**changes)
        return plane(mobiles=(MOBILE._replace(path=path),))

    assert not refused(lambda: solved(scene()), "")
    for field in KeyFrames._fields:
        for value in [*NEVER, *PERHAPS, np.zeros((2, 2)), np.full(2, NAN), [1.0, 0.0], [0.0, 0.0], [[1], [2, 3]]]:
            no = refused(lambda f=field, v=value: solved(scene(**{f: v})), 'plane: mobile "box": ')
            assert no or (field == "times" and isinstance(value, np.ndarray))


SETTINGS = ("photons", "radius", "neighbours", "seed", "threads", "light", "estimator", "search", *FLAGS[1:])


@pytest.mark.parametrize("name", SETTINGS)
def test_settings(name):
    solver = solve(plane(), photons=200, radius=0.1)
    for value in [*NEVER, *PERHAPS]:
        wrong = name != "subset_only" and refused(lambda v=value: solved(plane(), **{name: v}), name)
        if name not in ("seed", "threads"):
            before = solver.setting, solver.photons, solver.light
            wrong = refused(lambda v=value: solver.configure(**{name: v}) or solver.irradiance, name)
            assert not wrong or (solver.setting, solver.photons, solver.light) == before
        assert wrong or not any(value is v for v in NEVER) or (name == "seed" and value == 1e16)
        assert wrong or name not in FLAGS or isinstance(value, bool | np.bool_)
        assert wrong or name in FLAGS or not isinstance(value, bool | np.bool_)


@pytest.mark.parametrize("name", ["photons", "paths", "name"])
def test_parts_of_moves(name):
    solver = solve(plane(), photons=200, radius=0.1)
    for value in [*NEVER, *PERHAPS, 5, -1, 4096.0, 4.0]:
        moves = {} if name == "name" else {name: value}
        to = value if name == "name" else "box"
        with pytest.raises(SceneError):
            solver.move_all({str(to): Pose()}, **moves) if moves else solver.move(to, Pose())


# -- the sentence ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: solved(plane(up=(0, 0, 1e-300))), "plane: up must be three numbers that are not all 0,"),
        (lambda: solved(plane(probes=(Probe("p", (0, 0, 1), (1e-300,) * 3),))), 'probe "p": normal must be three'),
        (lambda: solved(plane(lights=(LAMPS[2]._replace(direction=(0, 1e-300, 0)),))), "direction must be three"),
        (lambda: solved(plane(lights=(LAMPS[0]._replace(flux=(1e308, 0, 0)),))), "flux must be three numbers >= 0 and"),
        (lambda: as_pose(Pose(("x", 0, 0)), "here"), "here: a pose is three finite metres"),
        (lambda: as_pose(Pose((1e300, 0, 0)), "here"), "here: a pose is three finite metres"),
        (lambda: Solver(plane()).configure(textbook=7), "textbook must be true or false, got 7"),
        (lambda: Solver(plane()).configure(control="maybe"), "control must be true or false, got 'maybe'"),
        (lambda: Solver(plane()).configure(photons=True), "photons must be a whole number from 0 to"),
        (lambda: Solver(plane()).configure(radius=1e300), "radius must be a finite number > 0, from 1e-15 to 1e+15"),
        (lambda: Solver(plane()).configure(seed=LONG), "there is no setting 'seed'"),
        (lambda: Solver(plane(), seed=LONG), "seed must be a whole number from 0 to"),
    ],
)
def test_the_sentence_names_place_rule_and_value(make, message):
    with pytest.raises(SceneError) as problem:
        make()
    assert message in str(problem.value)


def far(by):
    mesh = plane().static
    return mesh._replace(vertices=mesh.vertices + by)


@pytest.mark.parametrize(
    "scene",
    [
        plane(static=far([1e7, 0, 0]), mobiles=(), lights=(LAMPS[0]._replace(position=(0, 0, 0)),)),
        plane(lights=(LAMPS[1]._replace(position=(0, 0, 1e7)),)),
        plane(mobiles=(MOBILE._replace(pose=Pose((1e7, 0, 0))),), lights=LAMPS[3:]),
        plane(static=plane().static._replace(vertices=np.vstack([plane().static.vertices, [1e7, 0, 0]]))),
    ],
    ids=["light at the origin", "lamp", "mobile under the sky", "unused vertex"],
)
def test_what_is_too_far_for_light_is_refused(scene):
    """All were black without a word."""
    with pytest.raises(SceneError, match=r"plane: .* reach over .*, more than 1000 times"):
        solved(scene)


@pytest.mark.parametrize("height", [3.0, 300.0, 2000.0])
def test_a_lamp_as_far_as_allowed_lights_exactly(height):
    degrees = float(np.degrees(np.arctan(2 / height)))
    lamp = SpotLight("s", (0, 0, height), (0, 0, -1), (height**2,) * 3, degrees, degrees)
    scene = plane(lights=(lamp,), mobiles=(), materials=(grey(0),))
    solver = solve(scene, photons=20_000, radius=0.2)
    below = np.abs(solver.receivers.positions[:, :2]).max(axis=1) == 0
    assert below.any() and abs(solver.irradiance[below].mean() - 1) < 0.06  # I / h^2; a disc takes 100 photons


def test_a_mobile_far_from_lamps_is_allowed():
    assert not refused(lambda: solved(plane(mobiles=(MOBILE._replace(pose=Pose((1e7, 0, 0))),))), "")
