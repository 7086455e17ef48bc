"""The store: a reference is loaded again for the same scene, poses and receivers only, after any interruption."""

import os
from dataclasses import replace

import numpy as np
import pytest

from app.measure.results import peak_rss_mb
from app.rest import reference_store
from app.rest.reference_store import ReferenceStore, StaticStore, reference_folder
from gi_core.frames.static_light import StaticLight
from gi_core.gather.direct_light import DirectLight
from gi_core.gather.static import Kept
from gi_core.model import Model
from gi_core.scene.types import Gloss, Pose
from tests.support import scene_builders as build
from tests.support.photometry import luminaire, uneven
from tests.support.scene_builders import solve

ROWS = np.arange(0, 60, 3)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv(reference_store.FOLDER_VARIABLE, str(tmp_path / "reference"))
    return tmp_path / "reference"


def store(scene, **more) -> ReferenceStore:
    return ReferenceStore(Model(scene), **{"rows": ROWS, **more})


def room(**more) -> ReferenceStore:
    return store(build.coloured_room((build.box_mobile(),)), **more)


def test_saved_reference_is_loaded(folder):
    s = room()
    assert reference_folder() == folder and s.load() is None
    *_, last = s.gather(0.2)
    assert 0 < last.noise <= 0.2 and last.fraction == 1
    again = room().load()
    assert all(np.array_equal(a, b) for a, b in zip(again, last.state, strict=True))
    assert len(list(folder.iterdir())) == 1  # no temporary file is left
    assert len(list(room().gather(0.2))) == 1  # nothing to do


def test_an_empty_variable_is_as_none(monkeypatch):
    """An empty path is the current folder: references would lie among its files."""
    monkeypatch.setenv(reference_store.FOLDER_VARIABLE, "")
    assert reference_folder().is_absolute() and reference_folder().name == "reference"


def test_other_questions_have_other_names():
    scene = build.coloured_room((build.box_mobile(),))
    moved = replace(scene, mobiles=(scene.mobiles[0]._replace(pose=Pose((0.5, 0.2, 0.3))),))
    brighter = replace(scene, lights=(scene.lights[0]._replace(flux=(2.0, 2.0, 0.5)), scene.lights[1]))
    darker = replace(scene, materials=(build.grey(0.1), *scene.materials[1:]))
    vertices = scene.static.vertices + 1e-9
    bent = replace(scene, static=scene.static._replace(vertices=vertices))
    metals = [build.grey(0.0)._replace(gloss=Gloss((0.9, 0.8, 0.7), alpha)) for alpha in (0.1, 0.3)]
    glossy = [replace(scene, materials=(metal, *scene.materials[1:])) for metal in metals]
    luminaires = [replace(scene, lights=(luminaire(intensity=uneven(k)),)) for k in (1, 2)]
    keys = [store(s).key() for s in (scene, moved, brighter, darker, bent, *glossy, *luminaires)]
    files = {StaticStore(Model(s), 0).path for s in (scene, brighter, darker, bent, *glossy, *luminaires)}
    assert len(files) == 8 and StaticStore(Model(moved), 0).path in files
    keys += [room(seed=1).key(), room(rows=ROWS[1:]).key(), room(poses={"box": Pose((0.1, 0.2, 0.3))}).key()]
    assert len(set(keys)) == len(keys)
    assert room().key() == keys[0]  # the same scene in another model has the same name
    assert room(poses={"box": Pose((0.5, 0.2, 0.3))}).key() == keys[1]  # for any form of the pose


@pytest.mark.parametrize("after", [1, 4])
def test_an_interrupt_loses_nothing(after, monkeypatch):
    """Stopped by Ctrl+C after some steps and resumed: the bits of an uninterrupted run."""
    monkeypatch.setattr(reference_store, "SAVE_SECONDS", 1e9)
    with monkeypatch.context() as patch:
        patch.setenv(reference_store.FOLDER_VARIABLE, str(reference_folder() / "other"))
        whole = list(room().gather(0.02))[-1]
    steps = room().gather(0.02)
    for _ in range(after):
        next(steps)
    with pytest.raises(KeyboardInterrupt):
        steps.throw(KeyboardInterrupt)
    there = room().load()
    assert there is not None and there.sets.sum() < whole.state.sets.sum()
    *_, resumed = room().gather(0.02)
    assert all(np.array_equal(a, b) for a, b in zip(resumed.state, whole.state, strict=True))


def test_reference_is_saved_while_gathering(monkeypatch):
    monkeypatch.setattr(reference_store, "SAVE_SECONDS", 0.0)
    steps = room().gather(1e-9)
    for _ in range(3):
        next(steps)
    assert room().load() is not None
    steps.close()


@pytest.fixture(scope="module")
def kept() -> tuple[Model, Kept]:
    solver = solve(build.coloured_room(()), photons=2000, radius=0.1, light="best")
    for _ in solver.gather_steps():
        if (g := solver.frame_light.static.gathered) and g.state is not None and g.state.rounds > 1:
            return solver.model, g.kept()
    raise AssertionError


def put(array: np.ndarray, value) -> np.ndarray:
    out = array.copy()
    out.flat[-1] = value
    return out


DAMAGES = {
    "nothing": lambda k: k,
    "NaN": lambda k: k._replace(estimate=k.estimate._replace(light=put(k.estimate.light, np.nan))),
    "below 0": lambda k: k._replace(estimate=k.estimate._replace(variance=put(k.estimate.variance, -1.0))),
    "sure of itself": lambda k: k._replace(estimate=k.estimate._replace(error=-1.0)),
    "inf": lambda k: k._replace(state=k.state._replace(mean=put(k.state.mean, np.inf))),
    "pilot": lambda k: k._replace(state=k.state._replace(pilot=put(k.state.pilot, np.inf))),
    "-3 sets": lambda k: k._replace(state=k.state._replace(sets=put(k.state.sets, -3))),
    "2^31 sets": lambda k: k._replace(state=k.state._replace(sets=put(k.state.sets, 2**31 - 1))),
    "2^100 paths": lambda k: k._replace(state=k.state._replace(log2_set=put(k.state.log2_set, 100))),
    "sample": lambda k: k._replace(sample=k.sample._replace(rows=put(k.sample.rows, 10**9))),
    "shares": lambda k: k._replace(shares=k.shares[1:]),
    "numbers": lambda k: k._replace(numbers=put(k.numbers, -1.0)),
    "a receiver less": lambda k: k._replace(estimate=k.estimate._replace(light=k.estimate.light[1:])),
    "float32": lambda k: k._replace(shares=k.shares.astype(np.float32)),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_stored_light_is_taken_by_its_values(damage, kept):
    """Light of NaN, or of less than none, was shown; 2^100 paths ended in an OverflowError."""
    s = StaticStore(kept[0], 0)
    s.save(DAMAGES[damage](kept[1]))
    loaded = s.load()
    assert (loaded is not None) == (damage == "nothing")
    if loaded is not None:
        assert np.array_equal(loaded.estimate.light, kept[1].estimate.light)
        assert loaded.kept().estimate[3:] == kept[1].estimate[3:]


def test_a_file_is_that_of_its_scene_and_read_no_further_than_its_light(kept, folder):
    """A file of another scene of as many receivers was shown; 3 MB unpacked to 3.2 GB; a pipe was waited for."""
    s, other = StaticStore(kept[0], 0), StaticStore(kept[0], 1)
    other.save(kept[1])
    other.path.rename(s.path)
    assert s.load() is None
    zeros = np.zeros((10_000_000, 3))
    vast = {f"estimate.{name}": zeros for name in ("light", "variance")}
    np.savez_compressed(s.path, key=s.key_text, **vast)
    before = peak_rss_mb()
    del zeros
    assert s.load() is None and peak_rss_mb() < before + 100
    if hasattr(os, "mkfifo"):
        s.path.unlink()
        os.mkfifo(s.path)
        assert s.load() is None
        s.save(kept[1])  # waited for a reader
        assert s.load() is not None


def test_the_oldest_static_light_goes(kept, folder, monkeypatch):
    static = StaticLight(kept[0], 0, DirectLight(kept[0], 0))
    static.gathered = StaticStore(kept[0], 0).load()
    for seed in range(3):
        StaticStore(kept[0], seed).keep_light(static)
        os.utime(StaticStore(kept[0], seed).path, (seed, seed))
    size = StaticStore(kept[0], 0).path.stat().st_size
    monkeypatch.setattr(reference_store, "MOST_BYTES", 2 * size)
    StaticStore(kept[0], 3).keep_light(static)
    assert {p.name for p in folder.iterdir()} == {StaticStore(kept[0], seed).path.name for seed in (2, 3)}


def test_damaged_file_is_ignored():
    s = room()
    *_, last = s.gather(0.3)
    whole = s.path.read_bytes()
    for contents in (b"", b"no zip", whole[: len(whole) // 2]):
        s.path.write_bytes(contents)
        assert room().load() is None
    s.save(last.state)
    assert room().load() is not None


@pytest.mark.slow
def test_progress_ends_at_one():
    seen = [r for r in room().gather(0.004) if r.fraction > 0]
    assert len(seen) > 3
    fractions = [r.fraction for r in seen]
    assert fractions[-1] == 1 and all(0 <= f <= 1 for f in fractions)
