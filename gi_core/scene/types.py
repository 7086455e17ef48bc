"""Records of a scene: meshes, materials, lights, mobiles, poses, probes, surfaces to calculate, camera.

Everything here can be built from numpy arrays; `load_scene` builds the same objects from files.
Units: metres, watts, radians unless a name says degrees; colours are linear Rec. 709 RGB.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:  # settings have some of these records, and the command line waits for no numpy
    import numpy as np

    from gi_core.bsdf.models import Lobe


def part_named(mobile: str, material: str) -> str:
    """Return the part of a mobile whose faces have a material."""
    return material.removeprefix(f"{mobile}: ")


def material_named(mobile: str, part: str) -> str:
    """Return the name of a material that a part has alone; without a part, the whole mobile."""
    return f"{mobile}: {part}" if part else mobile


class Gloss(NamedTuple):
    """GGX microfacets over a diffuse base, see `gi_core.bsdf.ggx`."""

    f0: tuple[float, float, float] = (0.04, 0.04, 0.04)  # reflected share of light along the normal, each in [0, 1]
    alpha: float = 0.25  # roughness in [0, 1]; below 0.001 a mirror
    f90: float = 1.0  # reflected share of grazing light, in [0, 1]


class Pane(NamedTuple):
    """Thin clear glass, in place of reflectance and gloss: light goes straight on or is reflected as by a mirror."""

    transmittance: tuple[float, float, float] = (1.0, 1.0, 1.0)  # internal, one way along the normal, each in [0, 1]
    ior: float = 1.5  # index of refraction, >= 1


class VariedFinish(NamedTuple):
    """Gloss by the textures of `Mesh.finish`. The end of loading replaces it by materials with gloss.

    The part that is no metal has F0 = specular x min(f0, 1) and F90 = specular.
    """

    roughness: float  # like the next three, a factor of its texture
    metallic: float
    f0: tuple[float, float, float]  # >= 0
    specular: float
    means: tuple[float, ...]  # (8,) of textures in the order of Finish, for faces without coordinates; 1: none
    matte: float  # roughness from which gloss that is no metal's is left out


class Material(NamedTuple):
    """A surface: a diffuse base, with or without gloss, or a model of reflection. Emission leaves the front only."""

    name: str
    reflectance: tuple[float, float, float] = (0.7, 0.7, 0.7)  # rho of the diffuse base, each in [0, 1)
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)  # Le, radiance [W/m2/sr], each >= 0
    two_sided: bool = False  # the back reflects and receives too
    gloss: Gloss | None = None  # None: diffuse
    brdf: tuple[Lobe, ...] = ()  # linear combination of models, in place of reflectance and gloss
    scaled: bool = False  # a model that reflects more light than arrives is darkened there; False: it is refused
    grain: tuple[float, float, float] = (1.0, 0.0, 0.0)  # tangent of anisotropic models, in the object's space
    varied: VariedFinish | None = None  # while a file is loaded: reflectance is the base colour
    pane: Pane | None = None  # None: opaque

    def as_pane(self, pane: Pane) -> Material:
        """Return a pane of this name."""
        return Material(self.name, (0.0, 0.0, 0.0), two_sided=True, pane=pane)


HALF = 128  # of Texture.cover


@dataclass(frozen=True, eq=False, repr=False)
class Texture:
    """An image that colours a surface: its first row lies along v = 0, its first column along u = 0."""

    pixels: np.ndarray  # (h, w, 3) uint8, sRGB unless `linear`
    wrap: tuple[str, str] = ("repeat", "repeat")  # beyond 0..1 in u and in v: each "repeat", "mirror" or "clamp"
    nearest: bool = False  # near by, texels are squares instead of running into each other
    cover: np.ndarray | None = None  # (h, w) uint8: the surface is there from HALF on; None: everywhere
    linear: bool = False  # pixels are linear values, not sRGB

    def __repr__(self) -> str:
        return f"<Texture of {self.pixels.shape[1]} x {self.pixels.shape[0]} texels>"


class Paint(NamedTuple):
    """Colours that vary within a face: rho at a point is the corner colour there times its texture there."""

    textures: tuple[Texture, ...]
    face_texture: np.ndarray  # (F,) int32 into textures, -1: none
    corner_uv: np.ndarray  # (F, 3, 2) float32
    corner_colour: np.ndarray  # (F, 3, 3) float32, linear, each in [0, 1]

    def __repr__(self) -> str:
        return f"<Paint of {len(self.face_texture):,} triangles, {len(self.textures)} textures>"


class Finish(NamedTuple):
    """Textures of gloss, while a file is loaded; None: no face has one."""

    roughness: Paint | None = None  # green
    metallic: Paint | None = None  # blue
    specular: Paint | None = None  # factor of F0, and by its largest channel of F90
    tint: Paint | None = None  # factor of F0 alone


class Mesh(NamedTuple):
    """Triangles. The front of a face is the side of (v1-v0) x (v2-v0)."""

    vertices: np.ndarray  # (V, 3) float64 [m]
    faces: np.ndarray  # (F, 3) int32, into vertices
    face_material: np.ndarray  # (F,) int32, into Scene.materials
    corner_normals: np.ndarray | None = None  # (F, 3, 3) float64 unit; None: from crease angles
    face_reflectance: np.ndarray | None = None  # (F, 3) float64; None: the paint's mean, else the material's
    paint: Paint | None = None  # None: each face of one colour
    finish: Finish | None = None  # while a file is loaded: textures of varied materials

    def __repr__(self) -> str:
        return f"<Mesh of {len(self.faces):,} triangles, {len(self.vertices):,} vertices>"


class Pose(NamedTuple):
    """A rigid object-to-world transform: rotate about the object's origin, then translate."""

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m]
    quaternion: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)  # (w, x, y, z), unit


class KeyFrames(NamedTuple):
    """A path that a mobile follows: position linear, rotation by slerp between the keys."""

    times: np.ndarray  # (K,) float64 [s], increasing
    positions: np.ndarray  # (K, 3) float64 [m]
    quaternions: np.ndarray  # (K, 4) float64 unit (w, x, y, z)

    def __repr__(self) -> str:
        import numpy as np

        return f"<KeyFrames: {np.size(self.times)} keys>"  # it describes bad values too


class Mobile(NamedTuple):
    """A rigid object that moves. Its mesh is in object space, any scale already baked in."""

    name: str
    mesh: Mesh
    pose: Pose = Pose()
    path: KeyFrames | None = None


class PointLight(NamedTuple):
    """Radiates equally in all directions."""

    name: str
    position: tuple[float, float, float]
    flux: tuple[float, float, float]  # Phi [W]


class SpotLight(NamedTuple):
    """A cone: intensity is full inside `inner`, falls smoothly to 0 at `outer`."""

    name: str
    position: tuple[float, float, float]
    direction: tuple[float, float, float]  # where it shines, any length > 0
    intensity: tuple[float, float, float]  # I on the axis [W/sr]
    inner_degrees: float  # half angles, 0 <= inner <= outer <= 90
    outer_degrees: float


class PhotometricLight(NamedTuple):
    """A luminaire by its measured intensity in each direction, bilinear between planes and angles (type C, CIE 121).

    It radiates from a point, or evenly from a rectangle that nothing hits; `size` 0: a point.
    """

    name: str
    position: tuple[float, float, float]
    direction: tuple[float, float, float]  # of gamma = 0, any length > 0
    c0: tuple[float, float, float]  # direction in the plane C0, any length > 0, not along `direction`
    flux: tuple[float, float, float]  # Phi [W]
    gammas_degrees: np.ndarray  # (T,) float64, increasing, from 0 to 180; no light beyond the first and the last
    planes_degrees: np.ndarray  # (P,) float64, increasing, from 0 to 360
    intensity: np.ndarray  # (P, T) float64, >= 0, of any unit: `flux` scales it
    size: tuple[float, float] = (0.0, 0.0)  # of the rectangle along C0 and C90 [m]
    watts: float = 0.0  # [W] of its file; 0: unknown


SUN_DEGREES = 0.53  # angular diameter of the sun: 0.524 to 0.542 in a year


class DirectionalLight(NamedTuple):
    """Light from a distant disc of even radiance: the sun."""

    name: str
    direction: tuple[float, float, float]  # where it shines, any length > 0
    irradiance: tuple[float, float, float]  # E on a plane facing it [W/m2]
    disc_degrees: float = SUN_DEGREES  # angular diameter of the disc; 0: parallel light


UNIFORM_SKY, CLEAR_SKY, OVERCAST_SKY = 5, 12, 16
SUNLESS_SKIES = 1, 3, UNIFORM_SKY, OVERCAST_SKY  # types that do not depend on the sun


class SkyLight(NamedTuple):
    """A dome above the plane normal to `up`, see `gi_core.lights.sky`."""

    name: str
    radiance: tuple[float, float, float]  # L [W/m2/sr]; a horizontal plane in the open gets pi L
    cie: int = UNIFORM_SKY  # type by ISO 15469, 1 to 15; 16: its traditional overcast sky
    sun: tuple[float, float, float] | None = None  # direction to the sun; None: the type has none


class Daylight(NamedTuple):
    """A clear sky by place, date and hour, of which `gi_core.lights.daylight` makes a sun and a sky."""

    place: tuple[float, float]  # latitude and longitude [degrees], north and east positive
    date: str  # as "2026-03-21"
    hour: float  # of the clock, 0 to 24
    utc_offset: float  # hours that the clock is ahead of UTC
    turbidity: float = 3.0  # of Linke
    north: tuple[float, float, float] | None = None  # not along `up`; None: that of gi_core.base.vectors.frame_of
    sky: int = CLEAR_SKY  # type by ISO 15469, as of SkyLight


PlacedLight = PointLight | SpotLight | PhotometricLight
DistantLight = DirectionalLight | SkyLight
Light = PlacedLight | DistantLight


class LampLevel(NamedTuple):
    """State of a lamp: its light is that of the scene file times `level` and `colour`, or none while it is off."""

    name: str
    level: float = 1.0
    colour: tuple[float, float, float] = (1.0, 1.0, 1.0)
    on: bool = True


class LightScene(NamedTuple):
    """A named set of levels of lamps, see `gi_core.lights.lamps`; lamps that it does not name are at level 1."""

    name: str
    levels: tuple[LampLevel, ...]


class Probe(NamedTuple):
    """A named point with a normal whose irradiance is measured."""

    name: str
    position: tuple[float, float, float]
    normal: tuple[float, float, float]


class CalculationSurface(NamedTuple):
    """A named grid of points whose illuminance is measured, see `app.rest.calculation_surface`.

    It lies in the room, at a height above the floor. With `on` it lies on the top of a mobile, or of the faces of a
    material of the static part.
    """

    name: str
    on: str = ""
    position: tuple[float, float] | None = None  # [m] of its middle along the two horizontal axes; None: the room's
    size: tuple[float, float] | None = None  # [m]; None: the room's
    height: float | None = None  # [m] above the floor, or in front of the part that it lies on; None: of desks, or 0
    tilt: float = 0.0  # degrees from facing up, towards its first side
    turn: float = 0.0  # degrees round the vertical through its middle, from the first axis towards the second
    margin: float | None = None  # [m] left out along its sides; None: 0.5 in a room, else 0
    points: tuple[int, int] | None = None  # along the two sides; None: by EN 12464-1
    targets: tuple[tuple[str, float], ...] = ()  # by name of TARGETS, in their order
    quantity: str = "illuminance"  # one of QUANTITIES
    views: int = 1  # of UGR: directions that eyes look in, evenly round the vertical, the first along the first side


MOST_GRID_POINTS = 100  # along a side of a surface
ILLUMINANCE, CYLINDRICAL, DAYLIGHT_FACTOR, UGR = QUANTITIES = (
    "illuminance", "cylindrical illuminance", "daylight factor", "UGR"
)  # fmt: skip
TARGETS = "mean", "minimum", "maximum", "U0", "Ud"  # numbers of a surface


class Camera(NamedTuple):
    """A view: eye and target [m], and the vertical field of view."""

    position: tuple[float, float, float]
    target: tuple[float, float, float]
    vertical_fov_degrees: float = 45.0


class Defaults(NamedTuple):
    """Settings that a scene file recommends; None: `gi_core.defaults.choose` decides."""

    photons: int | None = None
    radius: float | None = None  # disc radius [m]
    neighbours: int | None = None
    estimator: str | None = None
    exposure: float | None = None  # [EV]; None: metered
    scene_size: float | None = None  # [m], unit of relative defaults; None: from a pilot trace


class Units(NamedTuple):
    """Names and units of light on and from a surface: photometric for `units = "photometric"`, else radiometric."""

    on_surface: str  # quantity per area
    per_area: str
    from_surface: str  # quantity per area and solid angle
    per_solid_angle: str
    flux: str


RADIOMETRIC = Units("Irradiance", "W/m²", "radiance", "W/m²/sr", "W")
PHOTOMETRIC = Units("Illuminance", "lx", "luminance", "cd/m²", "lm")
UNITS = {"radiometric": RADIOMETRIC, "photometric": PHOTOMETRIC}  # by `Scene.units`


@dataclass(frozen=True, repr=False)
class Scene:
    """A static part, one or more rigid mobiles, static lights. Area lights are emissive faces."""

    static: Mesh
    materials: tuple[Material, ...]
    mobiles: tuple[Mobile, ...] = ()
    lights: tuple[Light, ...] = ()
    probes: tuple[Probe, ...] = ()
    camera: Camera | None = None
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)
    units: str = "radiometric"  # or "photometric": labels change, arithmetic does not
    name: str = "scene"
    defaults: Defaults = Defaults()
    notes: tuple[str, ...] = field(default=())  # one line per change or assumption of loading
    light_scenes: tuple[LightScene, ...] = ()
    files: tuple[tuple[str, ...], ...] = ()  # absolute paths: a file that was named, and those that it names
    daylight: Daylight | None = None  # of which the lights "sun" and "sky" are
    surfaces: tuple[CalculationSurface, ...] = ()
    watts: tuple[tuple[str, float], ...] = ()  # [W] at level 1 by lamp, before those of files
    maintenance_factor: float = 1.0  # of the light of electric lamps on surfaces
    hold: bool = False  # lamps are dimmed to hold the targets of surfaces

    def __repr__(self) -> str:
        lamps = len(self.lights) + sum(any(m.emission) for m in self.materials)
        counts = f"{len(self.static.faces):,} triangles, {lamps} lamp" + "s" * (lamps != 1)
        return f'<Scene "{self.name}": {counts}, {", ".join(m.name for m in self.mobiles) or "no mobiles"}>'
