"""Rules for every scene, read from a file or built from arrays, checked before anything is traced."""

from __future__ import annotations

import numpy as np

from gi_core.base.vectors import box
from gi_core.bsdf.models import Lobe
from gi_core.scene.errors import SceneError, nearest, shown
from gi_core.scene.pose import as_pose
from gi_core.scene.rules import (
    BELOW_ONE,
    BIGGEST,
    DIRECTION,
    FLAG,
    INDEX,
    LENGTH,
    LEVEL,
    NUMBER,
    PLACE,
    REFLECTANCE,
    SHARE,
    SHARES,
    STRENGTH,
    TEXT,
    TINIEST,
    Rule,
    is_array,
    is_direction,
    number,
    one_of,
    vector,
)
from gi_core.scene.types import (
    OVERCAST_SKY,
    SUNLESS_SKIES,
    UGR,
    CalculationSurface,
    Camera,
    Daylight,
    Defaults,
    DirectionalLight,
    Gloss,
    KeyFrames,
    LampLevel,
    Light,
    Material,
    Mesh,
    Pane,
    PhotometricLight,
    PointLight,
    Probe,
    Scene,
    SkyLight,
    SpotLight,
)


def is_brdf(value) -> bool:
    """Return whether a value is a linear combination of lobes."""
    return isinstance(value, tuple) and all(isinstance(lobe, Lobe) for lobe in value)


UNIT = 1.001  # of a component of a unit vector, with rounding
EXTENTS = 1e-6, 1e9  # [m]: beyond them float32 geometry goes wrong
DEGREES = number("of degrees from 0 to 90", 0, 90)
OPENING = number("of degrees > 0 and <= 90", TINIEST, 90)
CLOSEST = 1e-3  # degrees between angles of a table
GAMMAS = Rule("two or more degrees that increase, from 0 to 180", lambda values: _increase(values, 180))
PLANES = Rule(
    "degrees that increase, from 0 at first to 360 at last",
    lambda values: _increase(values, 360) and values[0] == 0 and values[-1] == 360,
)
SIZE = vector(
    "two numbers of metres > 0, or 0 and 0",
    lambda values: is_array(values, (2,), 0) and (min(values) >= TINIEST or max(values) == 0),
    2,
)
FIELDS: dict[type, dict[str, Rule]] = {
    Gloss: {"f0": SHARES, "alpha": SHARE, "f90": SHARE},
    Pane: {"transmittance": SHARES, "ior": INDEX},
    Material: {
        "reflectance": REFLECTANCE, "emission": STRENGTH, "two_sided": FLAG, "scaled": FLAG, "grain": DIRECTION,
        "brdf": Rule("a tuple of lobes, see gi_core.bsdf.models", is_brdf),
        "varied": Rule("None: gi_core.files.formats.classes makes materials of it", lambda value: value is None),
    },
    PointLight: {"position": PLACE, "flux": STRENGTH},
    SpotLight: {
        "position": PLACE, "direction": DIRECTION, "intensity": STRENGTH,
        "inner_degrees": DEGREES, "outer_degrees": OPENING,
    },
    PhotometricLight: {
        "position": PLACE, "direction": DIRECTION, "c0": DIRECTION, "flux": STRENGTH,
        "gammas_degrees": GAMMAS, "planes_degrees": PLANES, "size": SIZE,
    },
    DirectionalLight: {"direction": DIRECTION, "irradiance": STRENGTH, "disc_degrees": DEGREES},
    SkyLight: {
        "radiance": STRENGTH,
        "cie": Rule("a whole number from 1 to 16", lambda value: type(value) is int and 1 <= value <= OVERCAST_SKY),
        "sun": DIRECTION._replace(holds=lambda value: value is None or is_direction(value)),
    },
    Probe: {"position": PLACE, "normal": DIRECTION},
    Camera: {"position": PLACE, "target": PLACE, "vertical_fov_degrees": NUMBER},
    Defaults: {"estimator": TEXT, "exposure": NUMBER, "radius": LENGTH, "scene_size": LENGTH},
    Scene: {
        "up": DIRECTION, "units": one_of(("radiometric", "photometric")),
        "daylight": Rule("None or a Daylight", lambda value: value is None or isinstance(value, Daylight)),
        "surfaces": Rule("a tuple of CalculationSurface", lambda value: all(map(_is_surface, value))),
    },
}  # fmt: skip


def strength_of(light: Light) -> str:
    """Return the field of a light whose colour and power scale it."""
    return next(name for name, rule in FIELDS[type(light)].items() if rule is STRENGTH)


def _is_surface(value) -> bool:
    return isinstance(value, CalculationSurface)


def parts_of(scene: Scene) -> list[str]:
    """Return the parts that a surface may lie on: names of mobiles, and of materials of the static part."""
    used = np.unique(scene.static.face_material).tolist()
    return list(dict.fromkeys([*(m.name for m in scene.mobiles), *(scene.materials[k].name for k in used)]))


def check_surface(where: str, surface: CalculationSurface, scene: Scene) -> None:
    """Raise SceneError unless the scene has the quantity that a surface measures, and the part it lies on."""
    if surface.quantity == UGR and scene.units != "photometric":
        raise SceneError(
            f'{where}: surface "{surface.name}": UGR needs luminances in cd/m2, got units = "{scene.units}"; '
            'write units = "photometric" and light in lumens'
        )
    if surface.quantity == UGR and (unfit := [name for name, _ in surface.targets if name != "maximum"]):
        raise SceneError(
            f'{where}: surface "{surface.name}": a target of UGR is its maximum, got {shown(unfit[0])}; '
            "write targets = { maximum = 19 }"
        )
    if surface.quantity != UGR and surface.views != 1:
        raise SceneError(
            f'{where}: surface "{surface.name}": views are those of UGR, got quantity = "{surface.quantity}"; '
            "leave out views"
        )
    parts = parts_of(scene)
    if surface.on and surface.on not in parts:
        rule = "on must be a mobile or a material of the static part"
        raise SceneError(
            f'{where}: surface "{surface.name}": {rule}, got {shown(surface.on)}; {nearest(surface.on, parts)}'
        )


def check_lamp(where: str, name: str, scene: Scene) -> None:
    """Raise SceneError, with the nearest name, unless a light or an emissive material has a name."""
    if name not in (lamps := lamps_of(scene)):
        raise SceneError(f"{where}: no lamp is called {shown(name)}; {nearest(name, sorted(lamps))}")


def lamps_of(scene: Scene) -> set[str]:
    """Return the names of all lights and emissive materials."""
    return {light.name for light in scene.lights} | {m.name for m in scene.materials if max(m.emission) > 0}


def check_scene(scene: Scene) -> None:
    """Raise SceneError, one sentence, for the first broken rule."""
    title = TEXT.check("the name of a scene", scene.name)
    check_fields(title, scene)
    for material in scene.materials:
        for name in ("gloss", "pane"):
            if (part := getattr(material, name)) is not None:
                check_fields(f"{_named(title, 'material', material)}: {name}", part)
        if material.pane is not None and (max(material.emission) > 0 or material.gloss or material.brdf):
            where = _named(title, "material", material)
            raise SceneError(f"{where}: a pane has no emission, gloss or brdf; remove them, or the pane")
    for kind, records in (("material", scene.materials), ("light", scene.lights), ("probe", scene.probes)):
        for record in records:
            check_fields(_named(title, kind, record), record)
    if scene.camera is not None:
        check_fields(f"{title}: camera", scene.camera)
    check_fields(f"{title}: defaults", scene.defaults)
    for light_scene in scene.light_scenes:
        where = _named(title, "light scene", light_scene)
        for lamp, level, colour, on in (LampLevel(*state) for state in light_scene.levels):
            check_lamp(where, lamp, scene)
            LEVEL.check(f"{where}: lamp {shown(lamp)}: level", level)
            STRENGTH.check(f"{where}: lamp {shown(lamp)}: colour", colour)
            FLAG.check(f"{where}: lamp {shown(lamp)}: on", on)
    _check_mesh(f"{title}: the static part", scene.static, len(scene.materials))
    for mobile in scene.mobiles:
        where = _named(title, "mobile", mobile)
        _check_mesh(where, mobile.mesh, len(scene.materials))
        as_pose(mobile.pose, where)
        if mobile.path is not None:
            _check_path(where, mobile.path)
        for k in np.unique(mobile.mesh.face_material):
            if max(scene.materials[k].emission) > 0:
                raise SceneError(
                    f'{where}: material "{scene.materials[k].name}" emits light, but lights must stand still: '
                    "give it a material without emission, or make it static"
                )


def _named(scene: str, kind: str, record) -> str:
    return f'{scene}: {kind} "{TEXT.check(f"{scene}: the name of a {kind}", record.name)}"'


def check_size(where: str, mesh: Mesh) -> None:
    """Raise SceneError for a mesh whose faces are smaller or larger than EXTENTS."""
    low, high = box(np.asarray(mesh.vertices)[np.reshape(mesh.faces, -1)]) if len(mesh.faces) else (0, 1)
    extent = float(np.max(high - low))
    if not EXTENTS[0] <= extent <= EXTENTS[1]:
        raise SceneError(f"{where} must be {EXTENTS[0]:g} to {EXTENTS[1]:g} m large, got {extent:.3g}; write a scale")


def check_fields(where: str, record) -> None:
    if type(record) not in FIELDS:
        kinds = ", ".join(kind.__name__ for kind in FIELDS)
        raise SceneError(f"{where} must be a {kinds}, got a {type(record).__name__}")
    for name, rule in FIELDS[type(record)].items():
        value = getattr(record, name)
        if not (value is None and type(record) is Defaults):
            rule.check(f"{where}: {name}", value)
    if isinstance(record, SpotLight) and record.inner_degrees > record.outer_degrees:
        raise SceneError(
            f"{where}: angles must be 0 <= inner_degrees <= outer_degrees <= 90, "
            f"got {record.inner_degrees!r} and {record.outer_degrees!r}"
        )
    if isinstance(record, SkyLight) and record.sun is None and record.cie not in SUNLESS_SKIES:
        raise SceneError(f"{where}: a sky of cie = {record.cie} needs the direction to the sun; write sun = [x, y, z]")
    if isinstance(record, PhotometricLight):
        _check_photometric(where, record)


def _increase(values, most: float) -> bool:
    good = isinstance(values, np.ndarray) and is_array(values, (None,), 0, most) and len(values) > 1
    return good and bool((np.diff(values) >= CLOSEST).all())


def _check_photometric(where: str, light: PhotometricLight) -> None:
    shape = len(light.planes_degrees), len(light.gammas_degrees)
    good = isinstance(light.intensity, np.ndarray) and is_array(light.intensity, shape, 0)
    if not (good and light.intensity.max() >= TINIEST):
        raise SceneError(
            f"{where}: intensity must be an array {shape} of numbers >= 0 that are not all 0, "
            f"got {_found(light.intensity)}"
        )
    axis, c0 = (v / np.abs(v).max() for v in (np.array(light.direction, float), np.array(light.c0, float)))
    if np.abs(np.cross(axis, c0)).max() < 1e-6:
        raise SceneError(f"{where}: c0 must not lie along direction, got {shown(light.c0)} for both")


def _check_mesh(where: str, mesh: Mesh, materials: int) -> None:
    """Check shapes, types and ranges of all arrays, and the size."""
    count, paint = np.shape(mesh.faces)[:1], mesh.paint

    def check(name: str, values, shape: tuple, low: float, high: float, kinds: str = "iuf") -> None:
        if not (isinstance(values, np.ndarray) and is_array(values, shape, low, high, kinds)):
            written = ", ".join("n" if n is None else str(n) for n in shape)
            what = f"of {'finite numbers' if 'f' in kinds else 'integers'} from {low:g} to {high:g}"
            raise SceneError(f"{where}: {name} must be an array ({written}) {what}, got {_found(values)}")

    check("vertices", mesh.vertices, (None, 3), -BIGGEST, BIGGEST)
    check("faces", mesh.faces, (None, 3), 0, len(mesh.vertices) - 1, "iu")
    check("face_material", mesh.face_material, count, 0, materials - 1, "iu")
    if mesh.corner_normals is not None:
        check("corner_normals", mesh.corner_normals, (*count, 3, 3), -UNIT, UNIT)
    if mesh.face_reflectance is not None:
        check("face_reflectance", mesh.face_reflectance, (*count, 3), 0, BELOW_ONE)
    if paint is not None:
        check("face_texture", paint.face_texture, count, -1, len(paint.textures) - 1, "iu")
        check("corner_uv", paint.corner_uv, (*count, 3, 2), -BIGGEST, BIGGEST)
        check("corner_colour", paint.corner_colour, (*count, 3, 3), 0, 1)
    check_size(where, mesh)


def _found(values) -> str:
    """Return type, shape and range of an array of numbers, else the value."""
    if not (isinstance(values, np.ndarray) and values.size and values.dtype.kind in "iuf"):
        return shown(values)
    return f"{values.dtype} {values.shape} from {values.min():g} to {values.max():g}"


def _check_path(where: str, path: KeyFrames) -> None:
    if not all(isinstance(values, np.ndarray) for values in path):
        raise SceneError(f"{where}: its path must consist of arrays, got {shown(path)}")
    keys = path.times.shape[:1]
    if not (keys > (0,) and is_array(path.times, keys) and (np.diff(path.times) > 0).all()):
        raise SceneError(f"{where}: the times of its path must be numbers that increase, got {shown(path.times)}")
    if not (is_array(path.positions, (*keys, 3)) and is_array(path.quaternions, (*keys, 4), -UNIT, UNIT)):
        raise SceneError(f"{where}: its path must have {keys[0]} positions and unit quaternions, got {shown(path)}")
