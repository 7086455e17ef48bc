"""Spheres of a glTF file, metallic by roughness, beside Mitsuba 3's own models `principled` and `blendbsdf`.

    python -m studies.mitsuba_grid --out docs/metal-rough.png

It needs an environment with this program and Mitsuba: pip install ".[dev]" mitsuba. The file is loaded as any other.
`laws` compares values of both for the same directions, `pictures` renders both and compares spheres.

`principled` has the same distribution and Schlick's F of metal; its masking is separable, the F of its plastic is
Fresnel's, and its base is Disney's. `blendbsdf` mixes `roughconductor` of indices (1 + sqrt(F0)) / (1 - sqrt(F0)) with
`roughplastic` by metallic.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import mitsuba as mi
import numpy as np

from app.draw.camera import from_camera
from app.draw.picture_files import write_png
from app.draw.shot import Shot, layers
from app.draw.tonemap import meter, to_display
from app.rest.scheduler import gather
from app.settings import Settings, make_solver, open_scene
from gi_core.bsdf import ggx
from gi_core.files.load import load_scene
from gi_core.geometry.surfaces import flatten
from gi_core.scene.types import Camera
from scenes.glb import Part, glb_bytes, material
from studies.mitsuba_stills import described, drawn_rays, rgb, theirs
from tests.support.scene_builders import box, quad, sphere

METALLIC, ROUGHNESS = (0.0, 0.25, 0.5, 0.75, 1.0), (0.1, 0.4, 0.55, 0.7, 0.85, 1.0)
BASE, WALL, RADIANCE = (0.8, 0.45, 0.2), 0.7, 6.0
LOW, HIGH = (-1.7, 0.0, -0.7), (1.7, 2.4, 4.2)  # of the room [m]
RADIUS, APART = 0.15, (0.6, 0.36)  # of spheres [m]
LAMP = (-1.0, 0.4), (1.0, 2.4)  # x and z, at the ceiling
CAMERA = Camera((0.0, 1.2, 4.1), (0.0, 1.17, 0.0), 32.0)
SIZE = 600, 460
ANGLES, DRAWS = (10, 35, 60, 75), 512  # of incidence [degrees], and directions for each
GLTF_IOR = 1.5


class Cell(NamedTuple):
    """A sphere's surface as loaded."""

    metallic: float
    roughness: float
    lobe: np.ndarray  # (5,), see Surfaces; nan: diffuse
    rho: np.ndarray  # (3,) of the base


def name_of(metallic: float, roughness: float) -> str:
    return f"{metallic:g} {roughness:g}"


def centre_of(column: int, row: int) -> tuple[float, float, float]:
    return APART[0] * (column - 2), 0.27 + APART[1] * row, 0.0


def grid() -> bytes:
    """Return the glTF file: spheres, metallic from left to right, roughness from below, in a room with a lamp."""
    materials = [material("wall", (WALL,) * 3), material("lamp", (0, 0, 0), (RADIANCE,) * 3)]
    room = box(LOW, HIGH, 12, 0, inward=True)
    (x, z), (X, Z) = LAMP
    lamp = quad((x, HIGH[1] - 1e-3, z), (X - x, 0, 0), (0, 0, Z - z), (6, 6))
    parts = [Part("wall", room.vertices, room.faces), Part("lamp", lamp.vertices, lamp.faces)]
    for i, m in enumerate(METALLIC):
        for j, r in enumerate(ROUGHNESS):
            described = material(name_of(m, r), BASE)
            described["pbrMetallicRoughness"] |= {"metallicFactor": m, "roughnessFactor": r}
            materials.append(described)
            ball = sphere(centre_of(i, j), RADIUS, 3)
            parts.append(Part(name_of(m, r), ball.vertices, ball.faces))
    return glb_bytes(parts, materials)


def cells_of(file: Path) -> list[Cell]:
    """Return the surfaces of the spheres of grid(), as the program loads them."""
    scene = load_scene(file, max_edge=np.inf)
    surfaces, _ = flatten(scene, with_receivers=False)
    first = {scene.materials[k].name: f for f, k in reversed(list(enumerate(scene.static.face_material)))}
    faces = [(m, r, first[name_of(m, r)]) for r in ROUGHNESS for m in METALLIC]
    return [Cell(m, r, surfaces.lobe[f], surfaces.reflectance[f]) for m, r, f in faces]


def principled(metallic: float, roughness: float) -> dict[str, Any]:
    """Return Mitsuba's model of these parameters; `specular` 0.5 is an index of 1.5."""
    return {"type": "principled", "base_color": rgb(BASE), "metallic": metallic, "roughness": roughness,
            "specular": 0.5}  # fmt: skip


def blend(metallic: float, roughness: float) -> dict[str, Any]:
    """Return a metal and a plastic of Mitsuba, mixed by metallic."""
    f0, alpha = np.sqrt(np.array(BASE)), max(roughness**2, 1e-3)
    metal = {"type": "roughconductor", "distribution": "ggx", "alpha": alpha, "eta": rgb((1 + f0) / (1 - f0)),
             "k": rgb((0.0, 0.0, 0.0))}  # fmt: skip
    plastic = {"type": "roughplastic", "distribution": "ggx", "alpha": alpha, "int_ior": GLTF_IOR,
               "diffuse_reflectance": rgb(BASE), "nonlinear": False}  # fmt: skip
    return {"type": "blendbsdf", "weight": metallic, "plastic": plastic, "metal": metal}


MODELS = {"principled": principled, "blendbsdf": blend}


def directions(cell: Cell, angle: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return i (3,), directions o (n, 3) and 1 / density (n,): half drawn from the lobe, half by the cosine."""
    i = np.array([np.sin(np.radians(angle)), 0.0, np.cos(np.radians(angle))])
    alpha = max(cell.roughness**2, 0.01)
    lobe = np.array([1.0, 1.0, 1.0, 1.0, alpha])
    table, black = ggx.albedos(), np.zeros(3)
    u = (np.arange(DRAWS)[:, None] * (0.7548776662466927, 0.5698402909980532) + 0.5) % 1  # a rank-1 lattice
    o = np.array([ggx.sample(table, lobe, black, *i, *pair, 0.0) for pair in u[::2]])
    flat, turn = np.sqrt(u[1::2, 0]), 2 * np.pi * u[1::2, 1]
    o = np.concatenate([o, np.stack([flat * np.cos(turn), flat * np.sin(turn), np.sqrt(1 - u[1::2, 0])], axis=1)])
    o = o[o[:, 2] > 1e-4]
    gloss = np.array([ggx.pdf(table, lobe, black, *i, *way) for way in o])
    return i, o, 1 / (0.5 * gloss + 0.5 * o[:, 2] / np.pi) / DRAWS


def ours(cell: Cell, i: np.ndarray, o: np.ndarray, separable: bool = False) -> np.ndarray:
    """Return f (n, 3) [1/sr]. separable: with the masking of each direction alone, and metal that reflects once."""
    if np.isnan(cell.lobe[4]):
        return np.tile(cell.rho / np.pi, (len(o), 1))
    table = ggx.albedos()
    f = np.array([ggx.value(table, cell.lobe, cell.rho, *i, *way) for way in o])
    if separable:
        bare = cell.lobe.copy()
        base = np.array([_base(table, bare, cell.rho, i, way) for way in o])
        a, b = (_smith(cell.lobe[4], cos) for cos in (i[2], o[:, 2]))
        f = (base if cell.metallic < 1 else 0) + (f - base) * ((1 + a + b) / ((1 + a) * (1 + b)))[:, None]
    return f


def _smith(alpha: float, cos):
    return 0.5 * (np.sqrt(1 + alpha**2 * (1 / np.square(cos) - 1)) - 1)


def _base(table, lobe, rho, i, o) -> np.ndarray:
    mean = ggx.passed(table, lobe, -1.0)
    return rho * (ggx.passed(table, lobe, i[2]) * ggx.passed(table, lobe, o[2]) / (np.pi * max(mean, 1e-9) ** 2))


def law_of(bsdf, i: np.ndarray, o: np.ndarray) -> np.ndarray:
    """Return Mitsuba's f (n, 3) [1/sr]; its eval() carries the cosine of o."""
    interaction, context = mi.SurfaceInteraction3f(), mi.BSDFContext()
    interaction.wi = mi.Vector3f(*i)
    seen = np.array([[float(c) for c in bsdf.eval(context, interaction, mi.Vector3f(*way))] for way in o])
    return seen / o[:, 2:]


class Law(NamedTuple):
    """Our law over Mitsuba's, at all ANGLES together."""

    apart: float  # integral of |difference| over that of Mitsuba's reflected light
    ratio: float  # of reflected light
    separable: float  # `apart` with separable masking of ours


def law(cell: Cell, model: str) -> Law:
    """Compare a cell with a model of Mitsuba."""
    bsdf, sums = mi.load_dict(MODELS[model](cell.metallic, cell.roughness)), np.zeros(4)
    for angle in ANGLES:
        i, o, share = directions(cell, angle)
        weight = (share * o[:, 2])[:, None]
        given, found, alike = law_of(bsdf, i, o), ours(cell, i, o), ours(cell, i, o, True)
        sums += [(weight * part).sum() for part in (given, found, np.abs(found - given), np.abs(alike - given))]
    return Law(sums[2] / sums[0], sums[1] / sums[0], sums[3] / sums[0])


def laws(file: Path) -> None:
    """Print a table of each model: the difference of each cell in percent, and the ratio of reflected light."""
    cells = cells_of(file)
    for model in MODELS:
        print(f"{model}: |difference| [%] (with separable masking, metal reflecting once), ratio of reflected light")
        print("| roughness | " + " | ".join(f"metallic {m:g}" for m in METALLIC) + " |")
        for r in ROUGHNESS:
            row = [law(cell, model) for cell in cells if cell.roughness == r]
            text = " | ".join(f"{100 * k.apart:.1f} ({100 * k.separable:.1f}), {k.ratio:.2f}" for k in row)
            print(f"| {r:g} | {text} |", flush=True)


def pictures(file: Path, photons: int, seconds: float, samples: int, out: Path) -> None:
    """Render both; print the mean radiance of each sphere over Mitsuba's, and write the pictures side by side."""
    settings = Settings(scene=str(file), photons=photons, size=SIZE)
    solver = make_solver(open_scene(settings), settings)
    solver.solve()
    gather(solver, seconds, lambda *progress: None)
    shot = Shot(solver, settings)
    shot.camera = from_camera(CAMERA, solver.scene.up, shot.camera.bounds)
    found, at = np.asarray(layers(shot).colour, np.float64), solver.model.transforms(solver.poses)
    *rays, faces = drawn_rays(shot, at)
    models = {name_of(m, r): principled(m, r) for m in METALLIC for r in ROUGHNESS}
    mi.set_variant("llvm_ad_rgb")
    with tempfile.TemporaryDirectory() as folder:
        scene = mi.load_dict(described(solver.scene, solver.model, at, Path(folder), models))
    given = theirs(scene, shot, rays, samples // 4, 0)
    shown = solver.scene.static.face_material[faces].reshape(*SIZE[::-1], -1)
    names = [m.name for m in solver.scene.materials]
    exposure = meter(given.reshape(-1, 3))
    print("mean radiance of spheres over Mitsuba's principled, l1 over pixels [%]")
    for r in ROUGHNESS:
        row = []
        for m in METALLIC:
            inside = (shown == names.index(name_of(m, r))).all(axis=2)
            a, b = found[inside], given[inside]
            row.append(f"{a.sum() / b.sum():.2f}, {100 * np.abs(a - b).sum() / b.sum():.0f}")
        print(f"| {r:g} | {' | '.join(row)} |")
    both = [to_display(p, exposure) for p in (found, given)]
    write_png(out, np.concatenate(both, axis=1), {})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--photons", type=int, default=500_000)
    parser.add_argument("--seconds", type=float, default=60.0, help="of gathering")
    parser.add_argument("--samples", type=int, default=128, help="per pixel of Mitsuba")
    parser.add_argument("--out", type=Path, metavar="FILE.png", help="pictures too")
    given = parser.parse_args()
    print(f"Mitsuba {mi.__version__}")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "grid.glb"
        file.write_bytes(grid())
        laws(file)
        if given.out:
            pictures(file, given.photons, given.seconds, given.samples, given.out)


mi.set_variant("scalar_rgb")
if __name__ == "__main__":
    main()
