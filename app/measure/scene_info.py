"""`gi-viewer info`: contents of a scene, default settings with reasons, versions of the program and its libraries."""

from __future__ import annotations

import math
import sys
from importlib import metadata

import numpy as np

from app.cli.progress import opened, warnings_of
from app.cli.version import version
from app.rest.surface_grid import level_of
from app.settings import Settings, make_solver, open_scene
from gi_core import defaults
from gi_core.base.jit import cache_folder
from gi_core.estimators import CHEAPEST, DEFAULT, ESTIMATORS
from gi_core.files.find import shipped_scenes
from gi_core.geometry.error import luminance
from gi_core.gloss.reflectors import BY_CELLS, PLANAR, PROBE, Ways, ways
from gi_core.lights.daylight import sun_of
from gi_core.lights.power import power_of
from gi_core.model import Model
from gi_core.rays.structures import STRUCTURES
from gi_core.scene.types import material_named, part_named
from gi_core.scene.validate import strength_of
from gi_core.solver import Solver

HEAD = ("materials", "diffuse reflectance", "triangles", "area", "")
LIBRARIES = ("numpy", "numba", "embreex", "trimesh", "moderngl", "glfw", "imgui-bundle")


def info(settings: Settings) -> list[str]:
    """Return the lines to print. Raises SceneError, UsageError."""
    with opened(settings, open_scene) as (bar, scene):
        solver = make_solver(scene, settings)
        chosen = settings.with_method_of(solver)
        bar("tracing", 0.5)
        # 20_000 photons: the escaped share has an error of a third of a percent
        solver.configure(estimator=CHEAPEST, photons=min(20_000, chosen.photons))
        solver.solve()
        estimator = settings.estimator or scene.defaults.estimator or DEFAULT
        rows = [
            *_contents(scene, solver),
            *_lights(scene, solver, settings),
            *_choices(settings, chosen, estimator, solver),
        ]
        rows.append(("rays", _rays(solver)))
    notes = [f"note: {note}" for note in scene.notes]
    notes += [f"warning: {text}" for text in warnings_of(solver).values()]
    materials = material_lines(scene, solver.model)
    return [*_aligned(rows), "", *materials, "", *notes, *[""] * bool(notes), *_aligned(_machine(solver))]


def _rays(solver: Solver) -> str:
    used = solver.model.accelerator.rays
    names = ", ".join(name for name in STRUCTURES if name != used)
    return f"traced by {used}; there are also {names}"


def _contents(scene, solver: Solver) -> list[tuple[str, str]]:
    s = solver.surfaces
    low, high = solver.chosen.low, solver.chosen.high
    rows = [
        ("scene", scene.name),
        ("triangles", f"{int(s.first_face[-1]):,}"),
        ("receivers", f"{len(solver.irradiance):,} (two-sided surfaces have two, probes one)"),
        ("scene size", _size(solver)),
        ("  box", f"{_place(low, solver)} to {_place(high, solver)}"),
        ("up", triple(scene.up)),
    ]
    for o, m in enumerate(scene.mobiles, 1):
        faces, path = s.first_face[o + 1] - s.first_face[o], "follows a path" if m.path is not None else "no path"
        rows.append((f'mobile "{m.name}"', f"{faces:,} triangles at {_place(m.pose.position, solver)}, {path}"))
    if not scene.mobiles:
        rows.append(("mobiles", "none: add one with --mobile FILE"))
    if scene.probes:
        rows.append(("probes", ", ".join(p.name for p in scene.probes)))
    return rows


def _size(solver: Solver) -> str:
    if solver.scene.defaults.scene_size is not None:
        return f"{solver.scene_size:.4g} m (the scene file's)"
    return f"{solver.scene_size:.4g} m (longest side of the box of 98 % of the light's hits)"


def _flux(flux: np.ndarray, unit: str) -> str:
    """Return a flux (3,) as its luminance, which the window shows too, and its channels where they differ."""
    whole = float(luminance(flux))
    number = f"{whole:.4g}" if whole < 1e4 else f"{whole:,.0f}"
    return f"{number} {unit}" + (f", RGB {triple(flux)}" if np.ptp(flux) > 1e-3 * flux.max() else "")


def _lights(scene, solver: Solver, settings: Settings) -> list[tuple[str, str]]:
    """Return a row per material that emits and per other light."""
    unit = "lm" if scene.units == "photometric" else "W"
    emitters = solver.model.emitters
    area = emitters.face >= 0
    material = scene.static.face_material[emitters.face[area]]
    rows = []
    for k in np.unique(material):
        faces = material == k
        flux = emitters.flux[area][faces].sum(axis=0)
        text = f"{_flux(flux, unit)}, from {int(faces.sum()):,} triangles"
        rows.append((f'light "{scene.materials[k].name}"', text))
    named = [light for light in scene.lights if max(getattr(light, strength_of(light))) > 0]
    for light, flux in zip(named, emitters.flux[~area], strict=True):
        kind = type(light).__name__.removesuffix("Light").lower()
        rows.append((f'light "{light.name}"', f"{_flux(flux, unit)}, {kind}"))
    if (day := scene.daylight) is not None:
        time = f"{day.date} {day.hour:g} h, UTC{day.utc_offset:+g}"
        rows.append(("daylight", f"{time}, at {triple(day.place)}: sun {sun_of(day)}"))
    watts = power_of(emitters, scene, solver.levels, settings.watts, level_of(solver.model).area)
    if watts.of_lamp:
        rows.append(("power", watts.text()))
    if not rows:
        rows.append(("lights", "none: the picture is black; give a material emission, or add a light"))
    fates = {name: float(luminance(flux)) for name, flux in solver.frame.fates.items()}
    if fates["emitted"] > 0:
        shares = (f"{100 * fates[name] / fates['emitted']:.1f} % {name}" for name in fates if name != "emitted")
        rows.append(("of that flux", ", ".join(shares)))
    return rows


def _choices(asked: Settings, chosen: Settings, estimator: str, solver: Solver) -> list[tuple[str, str]]:
    file = solver.scene.defaults
    rules = {
        "photons": f"enough for noise of {100 * defaults.LEAST_NOISE:g} %, at most {defaults.MOST_PHOTONS:,}"
        f" or as many as {defaults.MOST_SECONDS:g} s on two cores allow",
        "radius": f"at most {100 * defaults.RADIUS_SHARE:g} % of the scene size, less on uneven surfaces",
        "neighbours": "the hits on a disc of that radius, 50 to 1,000 (photon_map alone uses it)",
    }
    texts = {
        "photons": f"{chosen.photons:,}",
        "radius": f"{chosen.radius:.4g} m",
        "neighbours": f"{chosen.neighbours}",
    }

    def reason(name: str, rule: str) -> str:
        if getattr(asked, name) is not None:
            return "as given"
        return "the scene file's" if getattr(file, name) is not None else rule

    names = ", ".join(name for name in ESTIMATORS if name != estimator)
    rows = [("estimator", f"{estimator}: {reason('estimator', 'the default')}; there are also {names}")]
    rows += [(name, f"{texts[name]}: {reason(name, rule)}") for name, rule in rules.items()]
    exposure = file.exposure if asked.exposure is None else asked.exposure
    value = "metered" if exposure is None else f"{exposure:+.2f} EV"
    rows.append(("exposure", f"{value}: {reason('exposure', 'the median in view becomes mid-grey')}"))
    return rows


def _machine(solver: Solver) -> list[tuple[str, str]]:
    versions = ", ".join(f"{name} {_version_of(name)}" for name in LIBRARIES)
    return [
        ("gi-viewer", f"{version()}, Python {sys.version.split()[0]} on {sys.platform}"),
        ("threads", f"{solver.model.threads}: Python threads over kernels that release the GIL, not numba's own"),
        ("libraries", versions),
        ("kernel cache", str(cache_folder())),
        ("shipped scenes", ", ".join(shipped_scenes())),
    ]


def _version_of(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "missing"


def _aligned(rows: list[tuple[str, str]]) -> list[str]:
    width = max(len(name) for name, _ in rows) + 2
    return [name.ljust(width) + text for name, text in rows]


def material_lines(scene, model: Model) -> list[str]:
    """Return a table of materials by area, one name per line, and one line for the rest.

    Those of a mobile are named after it: its file may use a name of another file.
    """
    s = model.surfaces
    meshes = (scene.static, *(m.mesh for m in scene.mobiles))
    every = zip(s.faces, s.paint, strict=True)
    textured = np.concatenate([np.zeros(len(f), bool) if p is None else p.face_texture >= 0 for f, p in every])
    # Loading copies materials to change their sides: copies of one name share a line.
    numbers: dict[str, int] = {}
    number = np.concatenate([_numbered(mesh, scene, o, numbers) for o, mesh in enumerate(meshes)])
    names = list(numbers)
    whole = max(float(s.areas.sum()), 1e-300)
    gloss = ways(model)
    rows = []
    for k in np.unique(number):
        faces = np.flatnonzero(number == k)
        area = float(s.areas[faces].sum())
        rho = (s.reflectance[faces] * s.areas[faces, None]).sum(axis=0) / max(area, 1e-300)
        cells = f'"{names[k]}"', triple(np.round(rho, 3)), f"{len(faces):,}", f"{100 * area / whole:.3g} %"
        kind = _kind(s.two_sided[faces], textured[faces], s.emission[faces]) + _gloss(
            Ways(*(a[faces] for a in gloss)), s.areas[faces]
        )
        rows.append((area, names[k], (*cells, kind), not np.isnan(gloss.noise[faces]).all()))
    rows.sort(key=lambda row: -row[0])
    listed = [place < 12 or row[3] for place, row in enumerate(rows)]  # 12 have a line each, besides all with gloss
    shown = [HEAD, *(row[2] for row, line in zip(rows, listed, strict=True) if line)]
    widths = [max(len(row[k]) for row in shown) + 2 for k in range(len(HEAD))]
    lines = ["".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in shown]
    rest = [row for row, line in zip(rows, listed, strict=True) if not line]
    if rest:
        share = 100 * sum(row[0] for row in rest) / whole
        named = ", ".join(f'"{row[1]}"' for row in rest)
        lines.append(f"and {len(rest)} more on {share:.3g} % of the area: {named}")
    return lines


def _numbered(mesh, scene, o: int, numbers: dict[str, int]) -> np.ndarray:
    """Return a number (F,) per face of object o by the name of its material; `numbers` of all names is added to."""
    mobile = scene.mobiles[o - 1].name if o else ""
    of_material = np.zeros(len(scene.materials), np.int64)
    for k in np.unique(mesh.face_material):
        name = scene.materials[k].name
        name = material_named(mobile, part_named(mobile, name)) if o else name
        of_material[k] = numbers.setdefault(name, len(numbers))
    return of_material[mesh.face_material]


def _kind(two_sided: np.ndarray, textured: np.ndarray, emission: np.ndarray) -> str:
    """Return sides, texture and emission of the faces of a material, in words."""
    words = [" and ".join("two-sided" if k else "one-sided" for k in np.unique(two_sided))]
    if textured.any():
        words.append("mean of its texture" if textured.all() else "partly textured")
    if emission.any():
        words.append(f"emits {triple(emission.max(axis=0))}")
    return ", ".join(words)


def _gloss(of: Ways, areas: np.ndarray) -> str:
    """Return the way in which pictures show the gloss of a material, and its noise factor; "" for diffuse ones.

    A probe has the share of rays that it serves, as a mean by area.
    """
    glossy, by_probe = ~np.isnan(of.noise), ~np.isnan(of.seen)
    if not glossy.any():
        return ""
    names = " and ".join(name for name in (PLANAR, PROBE, BY_CELLS) if (of.way[glossy] == name).any())
    seen = (
        f"; probes show {100 * np.average(of.seen[by_probe], weights=areas[by_probe]):.0f} %" if by_probe.any() else ""
    )
    return f", gloss by {names} (noise factor {of.noise[glossy].max():.2g}{seen})"


def _place(values, solver) -> str:
    """Return coordinates in brackets, to four digits of the scene's size."""
    digits = 4 - math.ceil(math.log10(solver.scene_size))
    return "(" + ", ".join(f"{v + 0.0:.15g}" for v in np.round(np.asarray(values, np.float64), digits)) + ")"


def triple(values) -> str:
    """Return three numbers in brackets, to four digits."""
    return "(" + ", ".join(f"{v + 0.0:.4g}" for v in values) + ")"  # + 0.0: no "-0"
