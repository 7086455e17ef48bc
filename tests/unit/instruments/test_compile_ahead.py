"""Kernels are compiled before a user waits for one."""

import subprocess
import sys
from pathlib import Path

import pytest

from gi_core.discs.search import SEARCHES
from gi_core.instruments import compile_ahead

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("name", SEARCHES)
def test_the_warm_up_runs_every_search(name, monkeypatch):
    calls, made = [], SEARCHES[name]
    accumulate = made.accumulate

    def counted(self, *given):
        calls.append(len(given))
        return accumulate(self, *given)

    monkeypatch.setattr(made, "accumulate", counted)
    solver = compile_ahead._trace(compile_ahead._tiny_scene(), None)
    compile_ahead._estimate(solver, estimator=compile_ahead.DEFAULT, search=name)
    assert calls


HELPED = """
import numpy as np
from gi_core.base import random_numbers
from gi_core.display.first_look import first_looks
from gi_core.gather import denoise, path_ends, path_tracer, reference
from gi_core.geometry import mesh_neighbours
from gi_core.instruments import compile_ahead
from gi_core.lights import next_event
from gi_core.model import Model
from gi_core.rays import all_objects
from tests.support.viewer_support import room

kernels = [random_numbers.stratified, mesh_neighbours._join, mesh_neighbours._pack, reference.take_in, path_ends.arrive]
kernels += [path_tracer.scatter, next_event.add_lit, all_objects._occluded_by_any, denoise._average]
kernels += [denoise._pass]
compile_ahead._light_backwards(compile_ahead._tiny_scene(), None)
before = [k.signatures for k in kernels]
assert all(len(s) == 1 for s in before), before
model = Model(room())
next(first_looks(room(), model, np.ones((1, 3)), 1.0, 0))
assert [k.signatures for k in kernels] == before
"""


@pytest.mark.slow
def test_kernels_compiled_beside_a_first_look_are_those_that_it_needs():
    """In a process of its own: others may have loaded kernels for other types."""
    subprocess.run([sys.executable, "-c", HELPED], cwd=ROOT, check=True)


@pytest.mark.slow
@pytest.mark.parametrize("option", [compile_ahead.FROM_BEHIND, compile_ahead.BESIDE_LOOK])
def test_background_compiler_ends_with_its_parent(option):
    command = [sys.executable, "-m", "gi_core.instruments.compile_ahead", option]
    with subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE) as process:
        process.stdin.close()
        assert process.wait(timeout=60) == 0


SHONE = """
import numpy as np
from app.draw.bare_lights import bare_lights
from gi_core.gather import gloss_gather, mobile_gloss, path_ends, path_tracer
from gi_core.gloss import lobe_rays
from gi_core.instruments import compile_ahead
from gi_core.model import Model
from gi_core.solver import Solver
from tests.physics.test_gloss import GIVEN, ROOM
from tests.unit.gather.test_gloss_gather import gathered
from tests.window.test_highlights import LIGHTS, scene, shot_of

kernels = [gloss_gather._aim, gloss_gather._deposit, path_ends.arrive, path_tracer.scatter]
kernels += [mobile_gloss._order, mobile_gloss._write, path_ends.add_exchanged]
kernels += [lobe_rays._aim_at_lights, lobe_rays._add]
for surfaces in (compile_ahead.TABLES, compile_ahead.GLOSS):  # of the room, and of the plate under lights
    compile_ahead.record(compile_ahead._with_second(compile_ahead._tiny_scene(surfaces)), None)
    compile_ahead._shine(compile_ahead._trace(compile_ahead._tiny_scene(surfaces), None))
before = [k.signatures for k in kernels]
assert all(before), before
model = Model(ROOM)
gathered(model, np.ones((len(model.object_receivers.areas), 3)), rounds=1)
Solver(ROOM, **GIVEN, light="best").solve()
shot = shot_of(scene(LIGHTS["point"]), size=(16, 12))
assert bare_lights(shot.lit).strength[0].any()
shot.take()
assert [k.signatures for k in kernels] == before
"""


@pytest.mark.slow
def test_kernels_of_gathered_gloss_are_compiled_ahead():
    """They were compiled at the first rest or in the first frame, where a drag waited for them."""
    subprocess.run([sys.executable, "-c", SHONE], cwd=ROOT, check=True)


RECORDED = """
from dataclasses import replace
from gi_core.base.kernel_cache import KernelCache
from gi_core.instruments import compile_ahead
from gi_core.scene.types import Material, Pane, Pose
from gi_core.solver import Solver
from tests.support.scene_builders import merge, quad
from tests.support.viewer_support import room

bare = room()
glass = quad((0.2, 0.2, 0.9), (0.5, 0, 0), (0, 0.5, 0), (1, 1), len(bare.materials))
glazed = *bare.materials, Material("glass").as_pane(Pane())
glazed = replace(bare, static=merge(bare.static, glass), materials=glazed)
late, load = [], KernelCache.load_overload

def noted(self, signature, context):
    late.append((self._py_func.__qualname__, signature))
    return load(self, signature, context)

for walls, panes in ((bare, ""), (glazed, compile_ahead.GLAZED)):
    assert compile_ahead.surfaces_of(walls) == compile_ahead.DIFFUSE + panes
    KernelCache.load_overload = load
    compile_ahead.record(compile_ahead._with_second(compile_ahead._tiny_scene(compile_ahead.DIFFUSE + panes)), None)
    KernelCache.load_overload = noted  # called once per kernel and types, before it is compiled
    solver = Solver(walls, photons=20_000, light="best")
    list(solver.solve_steps())
    for steps in (solver.gather_steps(), solver.gather_pose_steps()):
        solver.move("block", Pose((0.4, 0.3, 0.5)))
        solver.move_all({"block": Pose((0.5, 0.2, 0.5))}, solver.frame.subsets[0], 8)
        list(zip(range(40), steps))
    assert not late, (panes, late)
"""


@pytest.mark.slow
def test_no_kernel_is_needed_first_by_a_drag_or_at_rest():
    """Some were compiled there: of direct light, regions and lamps, for arrays that the tiny scene never had."""
    subprocess.run([sys.executable, "-c", RECORDED], cwd=ROOT, check=True)
