"""Compiling every kernel before it is needed, so that nothing compiles while a user waits.

`python -m gi_core.instruments.compile_ahead [--rays NAME] [--surfaces KIND]` compiles in a separate process, for one
structure of rays and one kind of surfaces. The window stays responsive and finds the kernels in the disk cache. A stamp
in the cache folder marks these sources as compiled.

With a second core, another process takes the steps in reverse order. Each kernel is compiled by the process that
reaches it first; the other reads it from the cache. With `--beside-look` the other process is that of a first look: the
kernels of its light come first, from the last one on.
"""

from __future__ import annotations

import functools
import itertools
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from gi_core.base import random_numbers
from gi_core.base.jit import cache_folder
from gi_core.base.kernel_cache import KernelCache
from gi_core.base.nearest_points import count_within, nearest
from gi_core.base.threads import available_cores
from gi_core.bsdf.models import lobe
from gi_core.discs.search import SEARCHES
from gi_core.display import edges, fine_points, vertex_light
from gi_core.display.first_look import first_looks
from gi_core.estimators import CHEAPEST, DEFAULT, ESTIMATORS
from gi_core.files.completion.pilot import Rays, useful_box
from gi_core.files.completion.refinement import refined
from gi_core.frames.frame_gloss import GatheredGloss
from gi_core.frames.light_setting import PATHS
from gi_core.gather.candidates import add_reflected
from gi_core.gather.denoise import denoise
from gi_core.gather.direct_light import DirectLight
from gi_core.gather.mobile import MobileGather
from gi_core.gather.path_tracer import last_kernels_first
from gi_core.gather.reference import ReferenceRounds, take_in
from gi_core.geometry.mesh_neighbours import neighbours
from gi_core.geometry.texture_filter import footprints, lookup
from gi_core.gloss.light import gloss_radiance
from gi_core.gloss.lobe_rays import LobeViews, arriving, draw_lobe, gloss_alone, highlights
from gi_core.instruments import child
from gi_core.lights.next_event import room_for_shadows
from gi_core.model import Model
from gi_core.rays.structures import checked
from gi_core.retrace.cuts import current_segments
from gi_core.scene.types import Gloss, Material, Mesh, Mobile, Paint, Pane, PointLight, Pose, Scene, Texture
from gi_core.solver import Solver, edited_solver

FROM_BEHIND, BESIDE_LOOK, RAYS, OF = "--from-behind", "--beside-look", "--rays", "--surfaces"
OPAQUE = DIFFUSE, GLOSS, TABLES = "diffuse", "gloss", "tables"
GLAZED = "-panes"
SURFACES = *OPAQUE, *(kind + GLAZED for kind in OPAQUE)
STAMP = "complete"
STEPS = 40  # of light at rest: each of its kernels has run by then
# Bytes of compiled kernels that a kind adds to the cache folder: the end of the progress bar.
CODE = {DIFFUSE: 11.1e6, GLOSS: 3.6e6, TABLES: 4.0e6}
CODE |= {DIFFUSE + GLAZED: 2.4e6, GLOSS + GLAZED: 6.0e6, TABLES + GLAZED: 6.4e6}
# Upright at a corner of the floor: mobile and floor shorten regions of each other.
TOUCHING = Pose((1.0, 0.95, 0.45), (0.5**0.5, 0.5**0.5, 0.0, 0.0))


class Meter:
    """Share of the kernels compiled since it was made, by any process."""

    def __init__(self, surfaces: str) -> None:
        self._before, self._code = _code_size(), CODE[surfaces]

    @property
    def fraction(self) -> float | None:
        """Fraction of the work that is done, 0 .. 1; None: unknown, as kernels of other processes are measured too."""
        fraction = (_code_size() - self._before) / self._code
        return fraction if fraction < 1 else None


def _code_size() -> int:
    """Return the bytes of compiled kernels in the cache folder."""
    return sum(path.stat().st_size for path in cache_folder().rglob("*.nbc"))


def surfaces_of(scene: Scene) -> str:
    """Return the kind of surfaces, one of SURFACES, that the kernels for a scene must know."""
    glazed = GLAZED if any(m.pane for m in scene.materials) else ""
    if any(m.brdf for m in scene.materials):
        return TABLES + glazed
    return (GLOSS if any(m.gloss for m in scene.materials) else DIFFUSE) + glazed


def _stamp(rays: str | None, surfaces: str) -> Path:
    return cache_folder() / f"{STAMP}-{checked(rays)}-{surfaces}"


def is_warm(rays: str | None = None, surfaces: str = DIFFUSE) -> bool:
    """Return whether the kernels for one structure of rays and one kind of surfaces are in the disk cache."""
    return _stamp(rays, surfaces).is_file()


def compile_kernels(
    rays: str | None = None, surfaces: str = DIFFUSE, beside_look: bool = False
) -> Iterator[tuple[str, float]]:
    """Run a tiny scene through every kernel; yield the name of each step and the fraction done before it.

    beside_look: a process compiles the kernels of a first look, and then steps in reverse order; help it first.
    """
    meter = Meter(surfaces)
    with nullcontext() if beside_look else _from_behind(rays, surfaces):
        if beside_look:
            yield "first look", 0.0
            _light_backwards(_tiny_scene(surfaces), rays)
        for name, run in _parts(rays, surfaces):
            yield name.replace("_", " "), meter.fraction or 0.0
            run()
    with suppress(OSError):
        if not KernelCache.ended:
            _stamp(rays, surfaces).touch()
    yield "ready", 1.0


def _parts(rays: str | None, surfaces: str = DIFFUSE) -> list[tuple[str, Callable[[], None]]]:
    """Return name and function of each step, in any order."""
    scene = _tiny_scene(surfaces)
    tiny = functools.cache(functools.partial(_trace, scene, rays))  # a solver compiles as soon as it is made
    parts: list[tuple[str, Callable[[], None]]] = [("photon tracing", tiny)]
    parts += [("frames", lambda: record(_with_second(scene), rays))]
    parts += [(name, lambda name=name: _estimate(tiny(), estimator=name)) for name in ESTIMATORS]
    parts += [(name, lambda name=name: _estimate(tiny(), estimator=DEFAULT, search=name)) for name in SEARCHES]
    parts += [("loading", _prepare)]
    if not surfaces.startswith(DIFFUSE):
        parts += [("gloss", lambda: _shine(tiny()))]
    return [*parts, ("reference", functools.partial(_gather, scene, rays))]


@contextmanager
def _from_behind(rays: str | None, surfaces: str) -> Iterator[None]:
    """Run the steps in reverse order in another process meanwhile, if there is a second core."""
    if available_cores() == 1:
        yield
        return
    options = FROM_BEHIND, RAYS, checked(rays), OF, surfaces
    output = dict.fromkeys(("stdout", "stderr"), subprocess.DEVNULL)
    process = child.start("gi_core.instruments.compile_ahead", *options, **output)
    try:
        yield
    finally:
        process.kill()
        process.wait()
        process.stdin.close()


def compile_backwards(rays: str | None, surfaces: str) -> None:
    """Run the steps in reverse order."""
    for _, run in reversed(_parts(rays, surfaces)):
        run()


def record(scene: Scene, rays: str | None) -> Solver:
    """Take the steps of a session through a scene with mobiles, by public functions alone; return its solver.

    They are a first look, photons, frames, light at rest, and an edit that removes textures. Each kernel that they call
    is compiled, so a new one needs no line here.
    """
    model = Model(scene, rays=rays)
    next(first_looks(scene, model, np.ones((len(model.emitters.lamps.names), 3)), 1.0, 0))
    # 2^14 photons are enough for direct light and for subsets.
    solver = Solver(scene, photons=1 << 14, radius=0.3, light="best", rays=rays)
    _live(solver)
    other = edited_solver(solver, replace(scene, static=scene.static._replace(paint=None)))
    _live(other)
    return other


def _live(solver: Solver) -> None:
    """Solve; move, turn and dim before and after light at rest; draw."""
    _run(solver.solve_steps())
    name = solver.model.names[0]
    for steps in solver.gather_steps, solver.gather_pose_steps:
        for pose in Pose((0.0, 0.0, 0.4)), TOUCHING:
            solver.move(name, pose)
            solver.move_all({name: pose._replace(position=(0.1, 0.0, 0.4))}, solver.frame.subsets[0], PATHS[0])
        solver.set_lamps({solver.lamps.names[0]: 0.5})
        _run(itertools.islice(steps(), STEPS))
    solver.drawn(solver.irradiance)
    solver.from_scratch()


def _run(steps: Iterator) -> None:
    for _ in steps:
        pass


def _trace(scene: Scene, rays: str | None) -> Solver:
    solver = Solver(scene, CHEAPEST, photons=64, radius=0.1, neighbours=4, rays=rays)
    solver.solve()
    _see_texture()
    vertex_light.compile_kernels()
    fine_points.compile_kernels()
    edges.compile_kernels()
    return solver


def _shine(solver: Solver) -> None:
    """Compile the evaluation of gloss, and the gathering of its directions at rest."""
    gathered = GatheredGloss(solver.model, 0, solver.frame_light.gloss.source)
    at, irradiance = solver.model.transforms(solver.poses), solver.irradiance
    gathered.gather(solver.frame.background, at, solver.levels, irradiance, np.arange(len(irradiance)))
    cells, one, narrow = solver.frame.gloss.directions(), np.ones((1, 3)), np.ones((1, 3), np.float32)
    tables = solver.surfaces.tables
    light = cells, np.zeros(1, np.int32), one, narrow, narrow, np.ones((1, 5), np.float32), narrow, tables
    gloss_radiance(*light, np.zeros(3), np.empty((1, 3)))
    views, delta = LobeViews.of_lobes(gloss_alone(np.ones((1, 5)), tables), 0, one, one, one), solver.model.lights.delta
    draw_lobe(views, one)
    highlights(views, arriving(solver.model.accelerator, at, one, one, np.zeros(1), delta, 1.0), delta.value)


def _prepare() -> None:
    """Compile the kernels of scene completion and of default settings."""
    scene = _tiny_scene()
    rays = Rays(scene)
    refined(scene, rays, useful_box(scene, rays), 1000)
    points = scene.static.vertices
    nearest(points, points, 2)
    count_within(points, points, 1.0)


def _estimate(solver: Solver, **setting) -> None:
    """Compile an estimator, or a search over the discs of one, and the parts of it that the window shows."""
    solver.configure(**setting)
    solver.solve()
    solver.move("mobile", TOUCHING)
    if setting["estimator"] == DEFAULT:
        at = solver.model.transforms(solver.poses)
        segments, _ = current_segments(solver.model, at, 0, 0, 1)
        solver.frame.background.estimate.crossing(0, segments, at)


def _tiny_scene(surfaces: str = DIFFUSE) -> Scene:
    """A floor of one kind of surfaces, a ceiling, one lamp per kind with a kernel, and a mobile that cuts light."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float64)
    quad = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    vertices = np.concatenate([corners, corners + [0, 0, 1]])
    faces = np.concatenate([quad, quad[:, ::-1] + 4]).astype(np.int32)
    uv = np.broadcast_to(np.array([[0, 0], [1, 0], [1, 1]], np.float32), (4, 3, 2))
    image = Texture(np.full((3, 3, 3), 128, np.uint8))
    paint = Paint((image,), np.zeros(4, np.int32), uv, np.ones((4, 3, 3), np.float32))
    static = Mesh(vertices, faces, np.array([0, 0, 1, 1], np.int32), paint=paint)
    mobile = Mobile("mobile", Mesh(0.5 * corners, quad, np.array([2, 2], np.int32)), Pose((0.0, 0.0, 0.5)))
    materials = (
        {
            DIFFUSE: Material("floor"),
            GLOSS: Material("floor", gloss=Gloss()),
            TABLES: Material("floor", brdf=(lobe("ward", {"ax": 0.4, "ay": 0.4}),)),  # cells carry it
        }[surfaces.removesuffix(GLAZED)],
        Material("lamp", emission=(1.0, 1.0, 1.0)),
        Material("leaf", two_sided=True),
    )
    if surfaces.endswith(GLAZED):
        corner = np.array([[-1, -1, 0.5], [-0.8, -1, 0.5], [-1, -0.8, 0.5]])
        faces = np.concatenate([faces, np.array([[8, 9, 10]], np.int32)])
        static = Mesh(np.concatenate([vertices, corner]), faces, np.array([0, 0, 1, 1, 3], np.int32))
        materials = *materials, Material("glass").as_pane(Pane())
    return Scene(static, materials, (mobile,), (PointLight("bulb", (0.0, 0.0, 0.9), (1.0, 1.0, 1.0)),), up=(0, 0, 1))


def _with_second(scene: Scene) -> Scene:
    """Return a scene with another mobile above the first one: a corner of two quadrilaterals, as discs have regions, of
    the floor's material."""
    (mobile,) = scene.mobiles
    low = mobile.mesh.vertices
    faces = np.array([[0, 1, 2], [0, 2, 3], [1, 0, 4], [1, 4, 5]], np.int32)
    corner = Mesh(np.concatenate([low, low[:2] + [0.0, 0.0, 0.5]]), faces, np.zeros(4, np.int32))
    return replace(scene, mobiles=(mobile, Mobile("above it", corner, Pose((0.0, 0.0, 0.7)))))


def _gather(scene: Scene, rays: str | None) -> None:
    """Compile the kernels of path gathering and denoising."""
    up = np.array([[0.0, 0.0, 1.0]])
    ReferenceRounds(scene, 0.1 * up, up, 0, model=Model(scene, rays=rays)).step()
    model = Model(_with_second(scene), rays=rays)
    at, direct = model.transforms(model.start_poses()), DirectLight(model, 0)
    dark = np.zeros((model.first_probe, 3))
    MobileGather(model, 0).irradiance(at, dark, 2, resting=dark)
    add_reflected(room_for_shadows(0), np.zeros(0, bool), *np.zeros((2, 0, 3)))  # no face is bright
    direct.measure()
    direct.blocked(at, model.emitters.lamps.full())
    _smooth()


def _smooth() -> None:
    """Smooth three receivers of one face."""
    denoise(*np.ones((2, 3, 3)), neighbours(np.array([[0, 1, 2]]), 3), 0, 1)


def _light_backwards(scene: Scene, rays: str | None) -> None:
    """Compile the kernels of a first look's light, from the last one on: its process begins with the first one."""
    neighbours(np.zeros((0, 3)), 0)  # that process needs these two before this one can help with the others
    random_numbers.stratified(0, 0, 0, 0, 0)
    plain = replace(scene, static=scene.static._replace(paint=None))
    model = Model(plain, rays=rays)  # its kernels come from that process
    none = np.zeros((0, 3))
    take_in(none[None], 1, np.zeros(0, np.int64), np.zeros(0, np.int32), none, none)
    last_kernels_first(model)
    _smooth()


def _see_texture() -> None:
    """Look up one texture pixel, as pictures without a window do."""
    corners, uv = np.eye(3, dtype=np.float32)[None], np.zeros((1, 3, 2), np.float32)
    one, ray = np.zeros(1), np.full((1, 3), 0.5, np.float32)
    seen = footprints(corners, uv, np.zeros(1, np.int64), one, one, np.zeros(3), ray, np.eye(3))
    lookup(Texture(np.full((3, 3, 3), 128, np.uint8)), *seen)


if __name__ == "__main__":
    chosen = sys.argv[sys.argv.index(RAYS) + 1] if RAYS in sys.argv else None
    kind = sys.argv[sys.argv.index(OF) + 1] if OF in sys.argv else DIFFUSE
    if FROM_BEHIND in sys.argv:
        child.prepare()
        compile_backwards(chosen, kind)
    else:
        if BESIDE_LOOK in sys.argv:
            child.prepare()
        for _ in compile_kernels(chosen, kind, BESIDE_LOOK in sys.argv):
            pass
