"""Time from a lamp's slider to its picture: `python -m studies.dimming office --max-edge 0.105 --picture`.

Levels alternate, so that no frame is one that was computed before. CPU seconds count all threads. --picture adds the
window's part: the snapshot, colours of vertices, and their upload to an offscreen OpenGL 3.3 context.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable

from app.settings import Settings, make_solver, open_scene
from gi_core.solver import Solver

FRAMES, BUDGET = 40, 0.016  # [s] per frame, of the window


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", nargs="?", default="gallery")
    parser.add_argument("--max-edge", type=float)
    parser.add_argument("--light", default="photons", choices=("photons", "best"))
    parser.add_argument("--photons", type=int, help="a frame's cost does not depend on them")
    parser.add_argument("--picture", action="store_true")
    given = parser.parse_args()
    settings = Settings(scene=given.scene, max_edge=given.max_edge, light=given.light, photons=given.photons)
    solver = make_solver(open_scene(settings), settings)
    solver.solve()
    show = picture_of(solver) if given.picture else lambda: None
    names, found = solver.lamps.names, {}
    for k in range(FRAMES):
        begun, cpu = time.perf_counter(), time.process_time()
        paths = solver.size_within(BUDGET)[1] if given.light == "best" else None
        odd = (k + k // len(names)) % 2  # each lamp alternates
        solver.set_lamps({names[k % len(names)]: 0.9 - 0.6 * odd}, paths)
        light, of_light = time.perf_counter(), time.process_time()
        show()
        shown, of_all = time.perf_counter(), time.process_time()
        stages = {"whole": shown - begun, "CPU": of_all - cpu, "light": light - begun, "CPU of light": of_light - cpu}
        for stage, seconds in {**stages, **solver.frame.timings}.items():
            found.setdefault(stage, []).append(seconds)
    print(f"{given.scene}: {len(solver.irradiance):,} receivers, {len(names)} lamps, {solver.frame.photons:,} photons")
    for stage, seconds in found.items():
        print(f"  {stage:12} median {1e3 * statistics.median(seconds):6.2f} ms, least {1e3 * min(seconds):6.2f} ms")


def picture_of(solver: Solver) -> Callable[[], None]:
    """Return a function that uploads the light of a frame as the window does."""
    import moderngl

    from app.draw.draw_mesh import dimmed, meshes_of
    from app.draw.renderer import Renderer
    from app.draw.vertex_colours import weights
    from app.rest.scheduler import RestWork
    from app.session.snapshot import snapshot_of
    from app.window.view_content import Side, paint

    meshes = meshes_of(solver.model)
    ctx = moderngl.create_standalone_context(require=330, backend="egl")  # type: ignore[arg-type]
    renderer, work = Renderer(ctx, 1), RestWork(solver, time.perf_counter)
    renderer.set_scene(meshes)

    def show() -> None:
        snapshot = snapshot_of(solver, work)
        lit, side = dimmed(meshes, snapshot.levels), Side("", *snapshot.drawn)
        renderer.dim(lit)
        for o, mesh in enumerate(lit):
            renderer.set_colours(o, *paint(mesh, side, None, True), 0, weights(mesh, side.weights))
            renderer.set_irradiance(o, side.irradiance)
        ctx.finish()

    return show


if __name__ == "__main__":
    main()
