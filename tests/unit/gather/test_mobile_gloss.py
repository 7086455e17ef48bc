"""Directions of the light on mobiles by the paths of a frame."""

from dataclasses import replace

import numpy as np
import pytest

from gi_core.base.random_numbers import basis
from gi_core.frames.light_setting import LIST, QUADTREE
from gi_core.gather import mobile
from gi_core.gather.candidates import CANDIDATES, unoccluded
from gi_core.gather.interleaved_mean import CHANCE, KINDS, average_neighbours
from gi_core.gather.mobile import MobileGather
from gi_core.gather.mobile_gloss import ROOM as ROOM_OF_RAYS
from gi_core.gather.mobile_gloss import DirectLight, PathLight
from gi_core.geometry.surfaces import glossy_receivers
from gi_core.gloss.hemisphere import CELLS, GRAZING, cell_of, even_light
from gi_core.gloss.sharp import is_sharp
from gi_core.model import Model
from gi_core.scene.pose import axis_angle
from gi_core.scene.types import Gloss, Material, Mobile, PointLight, Pose, Scene
from tests.physics.test_gloss import GIVEN, ROOM
from tests.support.scene_builders import box, merge, quad, solve, sphere

MOVED = {"ball": Pose((0.55, 0.5, 0.3), axis_angle((0, 1, 1), 30.0))}
AWAY = np.zeros((1, CELLS, 6), np.float32)  # resting light


def of_paths(paths: int, scene: Scene = ROOM, poses=MOVED, threads: int = 1, E: float = 0.5):
    """Return gather, its irradiance, and receivers that have cells, among those of mobiles."""
    model = Model(scene, threads=threads)
    gather = MobileGather(model, 7)
    at = model.transforms({**model.start_poses(), **poses})
    found = gather.irradiance(at, np.full((model.first_probe, 3), E), paths)
    rows = glossy_receivers(model.surfaces, besides=is_sharp(model.surfaces))
    return gather, found, rows[rows >= gather.first] - gather.first


def cells_of(light: PathLight, rows: np.ndarray, threads: int = 1) -> np.ndarray:
    out = np.full((len(rows), CELLS, 6), np.nan, np.float32)
    light.write_cells(rows, np.zeros(len(rows), np.int64), AWAY, out, threads)
    return out


def frame_of(normal: np.ndarray) -> np.ndarray:
    return np.concatenate([basis(*normal), normal]).reshape(3, 3)


def of_stratum(d: DirectLight, r: int, e: int, paths: int, normal: np.ndarray) -> list[tuple]:
    """Return direction in the object's space and light of the candidates that ray e of receiver r stands for."""
    of, found = d.candidates, np.empty(len(d.candidates.face))
    unoccluded(of, np.uint64(0), d.positions[r], d.rotation @ normal, d.lights, found)
    most = min(len(of.pick) * CANDIDATES, max(len(of.pick), ROOM_OF_RAYS))  # while there is room
    assert most / 2 < len(of.face) <= most
    size, rays = len(of.face) // len(of.pick), []
    for c in range(d.stratum[e] * size, (d.stratum[e] + 1) * size):
        way = of.point[:, c] - d.positions[r]
        light = of.colour[:, c] * (paths * found[c] / len(of.face))
        rays.append((way / np.linalg.norm(way) @ d.rotation, light))
    return rays


def twin(light: PathLight, i: int) -> np.ndarray:
    """Return the cells of a receiver, ray by ray."""
    by_path = light.bounced
    paths, own = by_path.directions.shape[2], frame_of(by_path.normals[i])
    rays, seen = [], set()
    for k in range(by_path.near.first[i], by_path.near.first[i + 1]):
        j = by_path.near.of[k]
        if by_path.kinds[j] in seen:
            continue
        seen.add(by_path.kinds[j])
        c = max(by_path.close[i], by_path.close[j])
        share = 1 / (1 + CHANCE * paths * (by_path.near.apart[k] * c * c + by_path.near.turned[k]))
        towards = by_path.directions[by_path.kinds[j]].T @ frame_of(by_path.normals[j])
        rays += [(share, d, v) for d, v in zip(towards, by_path.light[j].T, strict=True)]
    total = sum({id(share): share for share, *_ in rays}.values())
    for d in light.direct:
        if d.start <= i < d.start + len(d.positions):
            r = i - d.start
            for e in d.ray[d.first[r] : d.first[r + 1]]:
                if d.stratum[e] < 0:
                    rays.append((total, d.direction[e] @ d.rotation, d.value[e]))
                else:
                    rays += [(total, *ray) for ray in of_stratum(d, r, e, paths, by_path.normals[i])]
    sums = np.zeros((CELLS, 7))
    for share, d, v in rays:
        local = own @ d
        flux = share * np.asarray(v, np.float64)
        weight = flux.sum() / np.sqrt(max(local[2], GRAZING))
        sums[cell_of(*local)] += np.concatenate([flux, weight * d, [weight]])
    out = np.zeros((CELLS, 6))
    out[:, :3] = sums[:, :3] / np.maximum(sums[:, :3].sum(axis=0), 1e-300)
    size = np.maximum(np.linalg.norm(sums[:, 3:6], axis=1), sums[:, 6])
    out[:, 3:] = sums[:, 3:6] / np.maximum(size, 1e-300)[:, None]
    return out


@pytest.mark.parametrize("paths", [8, 24, 128])  # fewer paths than are added at a time, and more
def test_cells_are_the_sums_of_lamps_and_of_the_nearest_bounces_of_each_kind(paths):
    fine = ROOM.mobiles[1]._replace(mesh=sphere((0, 0, 0), 0.15, 3, 4))
    gather, _, rows = of_paths(paths, replace(ROOM, mobiles=(ROOM.mobiles[0], fine)))
    light = gather.path_light
    by_path = light.bounced
    cells = cells_of(light, rows)
    kinds = [
        by_path.kinds[by_path.near.of[a:b]]
        for a, b in zip(by_path.near.first[:-1], by_path.near.first[1:], strict=True)
    ]
    assert max(len(set(k)) for k in kinds) == KINDS < max(len(k) for k in kinds)
    assert sum(len(d.direction) for d in light.direct) > 100
    for r in range(0, len(rows), 9):
        expected = twin(light, rows[r])
        off = np.abs(cells[r] - expected).max(axis=1)
        # A direction on a border may lie in either cell: in float32 or float64.
        assert np.median(off) < 1e-5 and (off > 1e-3).sum() <= 2, (r, off)


def test_paths_add_up_to_the_irradiance_of_the_frame():
    """Lamps of a receiver, and bounces averaged over its neighbours: with those that hit other mobiles."""
    gather, found, rows = of_paths(32)
    light = gather.path_light
    by_path = light.bounced
    direct = np.zeros_like(found)
    for d in light.direct:
        for r in range(len(d.first) - 1):
            direct[d.start + r] = d.value[d.ray[d.first[r] : d.first[r + 1]]].sum(axis=0) / 32
    mean = np.zeros_like(found)
    mean[rows] = by_path.light[rows].sum(axis=2, dtype=np.float64) / 32
    average = average_neighbours(by_path.near, by_path.close, np.full(len(mean), 32), mean, 1)
    assert (average[rows] > 0).mean() > 0.7 and (direct[rows] > 0).mean() > 0.2
    np.testing.assert_allclose((direct + average)[rows], found[rows], rtol=5e-3, atol=5e-3)


def test_single_bounces_are_those_of_glossy_mobiles(monkeypatch):
    """Receivers of other mobiles have more than P bounces, for which there is no room."""
    met, real = [], mobile.add_exchanged
    monkeypatch.setattr(mobile, "add_exchanged", lambda *given: met.append(given[0]) or real(*given))
    gather, _, rows = of_paths(32)
    (exchange,) = met
    glossy = np.isin(exchange.row, rows)
    assert gather._bounces(32).max() > 32 and glossy.any() and not glossy.all()
    assert (exchange.path[~glossy] == -1).all()
    assert (exchange.path[glossy] >= 0).all() and (exchange.path[glossy] < 32).all()


def test_threads_leave_the_bits_of_cells():
    one, two = (of_paths(16, threads=n) for n in (1, 2))
    assert np.array_equal(cells_of(one[0].path_light, one[2]), cells_of(two[0].path_light, two[2], 2))


def test_equal_radiance_from_everywhere_is_even_light():
    """Black walls of radiance 1: each cell of a satin ball has the light of its solid angle, by lamps and bounces."""
    materials = Material("wall", (0, 0, 0), (1, 1, 1)), Material("satin", (0, 0, 0), gloss=Gloss(alpha=0.3))
    ball = Mobile("ball", sphere((0, 0, 0), 0.3, 2, 1))
    scene = Scene(box((-1, -1, -1), (1, 1, 1), 4, 0, inward=True), materials, (ball,), up=(0, 0, 1), name="furnace")
    gather, found, rows = of_paths(256, scene, {"ball": Pose((0.1, 0.2, 0.0))}, E=0.0)
    np.testing.assert_allclose(found[rows], np.pi, rtol=0.1)
    cells, even = cells_of(gather.path_light, rows), even_light()
    np.testing.assert_allclose(cells[:, :, :3].sum(axis=1), 1, atol=1e-5)
    np.testing.assert_allclose(cells[:, :, :3].mean(axis=0), even[:, :3], atol=0.15 * even[:, 0].max())
    length = np.linalg.norm(cells[:, :, 3:], axis=2)
    assert length.max() < 1 + 1e-5 and length[length > 0].min() > 0.8


def test_a_lamp_lights_the_cell_that_it_stands_in():
    """A point light over a black room: the cell of its direction alone has light, at each receiver that sees it."""
    materials = Material("wall", (0, 0, 0)), Material("satin", (0, 0, 0), gloss=Gloss(alpha=0.3))
    lamp = np.array([0.3, 0.2, 0.9])
    lights = (PointLight("bulb", tuple(lamp), (1.0, 1.0, 1.0)),)
    static = merge(
        box((-1, -1, -1), (1, 1, 1), 1, 0, inward=True), quad((0, 0, -0.9), (0.1, 0, 0), (0, 0.1, 0), (1, 1), 0)
    )
    ball = Mobile("ball", sphere((0, 0, 0), 0.3, 2, 1))
    scene = Scene(static, materials, (ball,), lights, up=(0, 0, 1), name="lamp")
    pose = Pose((0.1, -0.2, 0.1), axis_angle((0, 1, 1), 50.0))
    gather, found, rows = of_paths(8, scene, {"ball": pose}, E=0.0)
    light, lit = gather.path_light, np.flatnonzero(found[rows].any(axis=1))
    assert 0.2 * len(rows) < len(lit) < len(rows)
    cells, to = cells_of(light, rows), (lamp - np.array(pose.position)) @ light.direct[0].rotation
    for r in lit:
        towards = to - gather._positions[rows[r]]
        towards /= np.linalg.norm(towards)
        cell = cell_of(*(frame_of(light.bounced.normals[rows[r]]) @ towards))
        assert cells[r, cell, 0] == pytest.approx(1.0)
        np.testing.assert_allclose(cells[r, cell, 3:], towards, atol=1e-5)


def test_frames_take_no_photons_for_gloss_on_mobiles_unless_rays_are_kept():
    """Photons near mobiles are not looked for; lists of rays are those of photons, also of a frame that had none."""
    solver = solve(ROOM, **GIVEN, light="best")
    solver.move_all(MOVED)
    assert solver.frame.change.near_mobiles == () and solver.frame.gloss.tree is None
    first = solver.surfaces.receiver_range(0).stop
    cells = solver.frame.gloss.directions().cells[solver.frame.gloss.owners >= first]
    solver.configure(gloss=LIST)
    solver.solve()
    photons = solve(ROOM, **GIVEN, light="photons", gloss=LIST)
    photons.move_all(MOVED)
    kept, expected = solver.frame.gloss.tree, photons.frame.gloss.tree
    assert np.array_equal(kept.offsets, expected.offsets) and np.array_equal(kept.rays, expected.rays)
    assert np.array_equal(solver.frame.gloss.directions().cells, photons.frame.gloss.directions().cells)
    solver.configure(gloss=QUADTREE)
    solver.solve()
    assert np.array_equal(solver.frame.gloss.directions().cells[solver.frame.gloss.owners >= first], cells)
