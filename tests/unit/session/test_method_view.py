"""The method made visible: the segments drawn are those of the estimate, the colours those of the frame.

The picture of a hemisphere: outlines of cells and contours of the lobe on the unit disc. The hemisphere over a glossy
receiver.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from app.session import method_view as mv
from app.session.method_view import MOST_DRAWN, hemisphere_view
from app.window import method_marks
from gi_core.estimators import ESTIMATORS
from gi_core.files.load import load_scene
from gi_core.gloss.hemisphere import CELLS, cell_of, direction_of, directions, disc_of
from gi_core.gloss.sharp import is_sharp
from gi_core.photons.flux_sums import NOT_ADDITIVE
from gi_core.photons.paths import ADDED, KEPT, REMOVED
from gi_core.scene import Pose
from gi_core.solver import Solver
from tests.support.scene_builders import solve
from tests.support.viewer_support import room

PARTS = mv.MethodParts(paths=True, receiver=-1, recomputed=True)


def solved(**options) -> Solver:
    return solve(room(12), photons=20_000, radius=0.1, **options)


def places(solver: Solver, *points) -> list[int]:
    """Return the static receivers nearest to points."""
    p = solver.receivers.positions[solver.surfaces.receiver_range(0)]
    return [int(((p - point) ** 2).sum(axis=1).argmin()) for point in points]


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize("textbook", [False, True])
def test_what_counts_is_what_the_estimator_has_counted(estimator, textbook):
    """Background = kept + removed; the frame's sums = kept + added.

    The k nearest hits of the frame and of the background differ, so removed hits of a photon map are some of these.
    """
    if textbook and estimator != "photon_map":
        pytest.skip("of photon_map alone")
    solver = solved(control=False, estimator=estimator, textbook=textbook, neighbours=30)
    solver.move("block", Pose((0.5, 0.25, 0.5)))
    background = solver.frame.background.estimate.background(solver.frame.photons)[0]
    on_block = solver.surfaces.receiver_range(1).start
    points = (0.5, 0.0, 0.5), (0.3, 0.0, 0.4), (0.0, 0.5, 0.5), (0.5, 0.5, 0.0)
    cut, static = 0, places(solver, *points)
    for receiver in [*static, *range(on_block, on_block + 3)]:
        found = mv.method_view(solver, mv.MethodParts(receiver=receiver)).counted
        kept, removed, added = found.flux
        assert found.photons == solver.frame.photons
        resting = background[receiver] if receiver < on_block else np.zeros(3)
        if estimator != "photon_map" and receiver < on_block:
            assert kept + removed == pytest.approx(resting, rel=1e-12)
        touched = solver.frame.evaluated.changed[receiver >> 3]
        now = solver.frame.evaluated.sums[receiver] if touched else background[receiver]
        assert kept + added == pytest.approx(now, rel=1e-12)
        assert len(found.drawn.kind) == sum(min(n, MOST_DRAWN) for n in found.counts)
        cut += found.counts[REMOVED] + found.counts[ADDED]
    assert cut > 100, "the block stands over the floor"


def test_artifact_control_is_part_of_the_rule():
    """At walls, on the block and beside it, a part of the disc counts, and its outline is the divisor."""
    solver = solved()
    solver.move("block", Pose((0.5, 0.1, 0.5)))
    evaluated, whole = solver.frame.evaluated, np.pi * 0.1**2
    background = solver.frame.background.estimate.background(solver.frame.photons)[0]
    near = places(solver, (0.0, 0.0, 0.5), (0.05, 0.0, 0.05), (1.0, 0.5, 0.97), (0.5, 0.98, 0.0))
    on_block = np.arange(solver.surfaces.receiver_range(1).start, len(evaluated.area))
    on_block = on_block[(evaluated.area[on_block] < 0.99 * whole) & (evaluated.area[on_block] > 0)]
    under = np.flatnonzero(evaluated.new_flux[:, 0] == NOT_ADDITIVE)  # regions that the block shortens
    under = under[evaluated.area[under] > 0]
    assert len(on_block) > 5 and len(under) > 5
    for receiver in [*near, *on_block[:6].tolist(), *under[:6].tolist()]:
        found = mv.method_view(solver, mv.MethodParts(receiver=receiver)).counted
        area = evaluated.area[receiver]
        assert "artifact control" in found.about and area < 0.99 * whole
        touched = evaluated.changed[receiver >> 3]
        now = evaluated.sums[receiver] if touched else background[receiver]
        kept, _, added = found.flux
        assert kept + added == pytest.approx(now, rel=1e-12)
        a, b = found.outline[:, 0] - found.position, found.outline[:, 1] - found.position
        assert np.linalg.norm(np.cross(a, b), axis=1).sum() / 2 == pytest.approx(area, rel=0.01)


def test_segments_end_on_curved_mobiles():
    """Some cross a disc behind their new end on the mobile: the pawn's discs lie within its surface."""
    solver = solve(load_scene("cornell"), photons=20_000, radius=0.03)
    pose = solver.poses["pawn"]
    solver.move("pawn", pose._replace(position=tuple(np.add(pose.position, (0.02, 0.0, 0.01)))))
    evaluated = solver.frame.evaluated
    for receiver in range(solver.surfaces.receiver_range(1).start, len(evaluated.area), 60):
        kept, _, added = mv.method_view(solver, mv.MethodParts(receiver=receiver)).counted.flux
        assert (kept + added).tolist() == evaluated.sums[receiver].tolist()


def test_the_outline_is_the_area_that_the_flux_is_divided_by():
    """A circle of the radius, of the k-th hit, or the faces around."""
    for estimator in ESTIMATORS:
        solver = solved(control=False, estimator=estimator, neighbours=30)
        (receiver,) = places(solver, (0.3, 0.0, 0.4))
        found = mv.method_view(solver, mv.MethodParts(receiver=receiver)).counted
        assert solver.frame.evaluated.changed[receiver >> 3]
        area = solver.frame.evaluated.area[receiver]
        a, b = found.outline[:, 0] - found.position, found.outline[:, 1] - found.position
        # Edges of a face at the receiver itself span nothing.
        assert np.linalg.norm(np.cross(a, b), axis=1).sum() / 2 == pytest.approx(area, rel=0.01), estimator
        assert ("hits" in found.about) == (estimator != "tangent_plane")


@pytest.mark.parametrize("border_correction", [False, True])
def test_the_circle_of_a_photon_map_is_that_of_all_photons_of_the_picture(border_correction, monkeypatch):
    """Where fewer are searched; and the frame's, after a change of settings that is not yet in the picture."""
    solver = solved(estimator="photon_map", neighbours=30, border_correction=border_correction)
    monkeypatch.setattr(mv, "MOST_SEARCHED_PHOTONS", 5_000)
    on_block = solver.surfaces.receiver_range(1).start
    receivers = [*places(solver, (0.3, 0.0, 0.4), (0.0, 0.5, 0.5), (0.0, 0.0, 0.5)), on_block]

    def outlines() -> list[float]:
        found = [mv.method_view(solver, mv.MethodParts(receiver=receiver)).counted for receiver in receivers]
        assert all(c.photons == 5_000 and "of the picture's 20,000 photons" in c.about for c in found)
        return [float(np.linalg.norm(c.outline[0, 0] - c.position)) for c in found]

    share = solver.model.covered_share[receivers] if border_correction else 1.0
    radii = np.sqrt(solver.frame.evaluated.area[receivers] / (np.pi * share))
    assert radii.min() < 0.09 and outlines() == pytest.approx(radii.tolist())
    solver.configure(radius=0.02, border_correction=not border_correction)
    assert outlines() == pytest.approx(radii.tolist())
    monkeypatch.undo()
    kept, _, added = mv.method_view(solver, mv.MethodParts(receiver=receivers[0])).counted.counts
    assert kept + added == 29


def test_a_mobiles_disc_moves_with_it():
    solver = solved()
    first = solver.surfaces.receiver_range(1).start
    before = mv.method_view(solver, mv.MethodParts(receiver=first)).counted
    pose = solver.poses["block"]
    solver.move("block", pose._replace(position=(0.6, 0.3, 0.5)))
    after = mv.method_view(solver, mv.MethodParts(receiver=first)).counted
    assert after.position - before.position == pytest.approx(np.subtract((0.6, 0.3, 0.5), pose.position))


def test_paths_break_where_objects_cut_them():
    solver = solved()
    strokes = mv.method_view(solver, PARTS).paths
    kept, removed, added = (strokes.ends[strokes.kind == kind] for kind in (KEPT, REMOVED, ADDED))
    assert min(len(kept), len(removed), len(added)) > 20
    low, high = np.array((0.38, 0.18, 0.38)) - 1e-3, np.array((0.62, 0.42, 0.62)) + 1e-3
    at_block = ((removed[:, 0] > low) & (removed[:, 0] < high)).all(axis=1)
    assert at_block.any(), "suffixes begin on the block"
    ends = kept[:, 1]
    for start in removed[at_block, 0]:
        assert np.sqrt(((ends - start) ** 2).sum(axis=1)).min() < 5e-3, "where the kept part ends"
    inside = (strokes.ends > -1e-3).all() and (strokes.ends < 1.001).all()
    assert inside and strokes.hits.any()


def test_colours_tell_what_the_frame_computed_again():
    solver = solved(control=False)
    static = solver.surfaces.receiver_range(0)
    solver.move("block", Pose((0.5, 0.3, 0.5)))
    found = mv.recomputed(solver)
    resting = solver.frame.background.irradiance(solver.frame.photons)
    differs = (solver.irradiance[static] != resting).any(axis=1)
    assert np.array_equal(found[static] == mv.CHANGED, differs) and 0.05 < differs.mean() < 1
    assert (found[static.stop :] == mv.ANEW).all()
    solver.move("block", Pose((0.5, 30.0, 0.5)))  # outside all light
    assert (mv.recomputed(solver)[static] == mv.BACKGROUND).all()
    solver.move("block", Pose((0.5, 0.3, 0.5)))
    solver.twin().move_all({"block": Pose((0.3, 0.6, 0.4))})  # overwrites the sums, as a measurement of errors does
    assert np.array_equal(mv.recomputed(solver), found), "key C showed nothing at rest, without a word"


def test_receivers_estimated_anew_are_told_from_those_with_changed_sums():
    solver = solved()
    solver.move("block", Pose((0.5, 0.08, 0.5)))  # it stands deep in discs on the floor
    found = mv.recomputed(solver)[solver.surfaces.receiver_range(0)]
    assert (found == mv.ANEW).sum() >= solver.frame.control_facts.stale > 0 and (found == mv.CHANGED).any()


def test_a_scene_without_objects_or_photons_has_kept_paths_or_nothing():
    solver = Solver(replace(room(4), mobiles=()), photons=500, radius=0.1)
    assert mv.method_view(solver, PARTS).paths is None
    solver.solve()
    view = mv.method_view(solver, PARTS._replace(receiver=0))
    assert set(view.paths.kind.tolist()) == {KEPT} and view.counted.counts[1:] == (0, 0)


GRID = method_marks.LOBE_GRID


def area(outline: np.ndarray) -> float:
    (x, y), (u, v) = outline.T, np.roll(outline, -1, axis=0).T
    return 0.5 * float((x * v - u * y).sum())


def test_cells_have_equal_areas_and_lie_where_their_directions_do():
    outlines = method_marks._cell_outlines()
    assert len(outlines) == CELLS
    sizes = np.abs([area(outline) for outline in outlines])
    np.testing.assert_allclose(sizes, math.pi / CELLS, rtol=0.02)  # arcs are drawn as chords
    assert sizes.sum() == pytest.approx(math.pi, rel=0.01)
    for cell, outline in enumerate(outlines):
        x, y = outline.mean(axis=0)
        r = math.hypot(x, y)  # z = 1 - r^2 on the disc of equal areas
        flat = math.sqrt(2 - r * r)
        assert cell_of(flat * x, flat * y, 1 - r * r) == cell


def test_the_grid_of_the_lobe_lies_on_the_disc():
    a, b = method_marks._grid().T
    for k in range(0, len(a), 37):
        x, y, z = direction_of(a[k], b[k])
        r = np.hypot(*disc_of(np.array([[x, y, z]]))[0])
        assert z == pytest.approx(1 - r * r, abs=1e-12) and math.hypot(x, y) == pytest.approx(r * math.sqrt(2 - r * r))


def test_contours_lie_on_their_level():
    """Of a cone about a point: a circle about it, closed."""
    square = method_marks._grid()
    disc, middle, radius = disc_of(directions(square)), np.array([0.2, -0.1]), 0.4
    values = -np.linalg.norm(disc - middle, axis=1)
    ends = method_marks._contour(values.reshape(GRID, GRID), disc.reshape(GRID, GRID, 2), -radius)
    np.testing.assert_allclose(np.linalg.norm(ends - middle, axis=1), radius, atol=4e-3)
    lengths = np.linalg.norm(ends[::2] - ends[1::2], axis=1)
    assert lengths.sum() == pytest.approx(2 * math.pi * radius, rel=0.01)
    assert len(method_marks._contour(values.reshape(GRID, GRID), disc.reshape(GRID, GRID, 2), 1.0)) == 0


def test_receivers_that_a_reflection_shows_have_no_light_by_direction():
    """Their cells are even, whatever arrives."""
    solver = solve(load_scene("showroom"), photons=4096)
    s, rows = solver.surfaces, solver.frame.gloss.rows
    corners = np.concatenate([c[is_sharp(s)].ravel() for c in (s.corner_front, s.corner_back)])
    by_probe, none = np.isin(rows, corners), (np.zeros((0, 2, 3)), np.zeros(0, np.int64))

    for reflected in (True, False):
        views = [hemisphere_view(solver, int(r), *none) for r in rows[by_probe == reflected][::200]]
        assert views and all(v.reflected is reflected for v in views)
        assert any(v.cells[:, :3].any() for v in views) is not reflected
