"""Photon paths of a scene before an edit, taken over where they met no edited face.

Photon i is a function of seed, index, lights and the static part. So its path stays, bit for bit, if its light, the
static geometry and the reflection of all faces that it met are the same. Mobiles do not matter. A light that is
moved or turned leaves the photons of other lamps as they are, because shares of the photons depend on fluxes alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.geometry.receivers import NONE
from gi_core.geometry.surfaces import Surfaces
from gi_core.lights.emission import unchanged_lamps
from gi_core.model import Model
from gi_core.photons.paths import PathVertices
from gi_core.photons.trace import Fates, add_fates, add_fates_behind, add_to, no_flux, trace_background
from gi_core.scene.types import Scene


class KnownPaths(NamedTuple):
    """Paths of the first photons before an edit."""

    paths: PathVertices
    edited: np.ndarray  # (F,) bool, faces of the static part that reflect differently now
    relit: np.ndarray  # (G,) bool, lamps that emit otherwise now

    @property
    def are_all_kept(self) -> bool:
        return not (self.edited.any() or self.relit.any())


def known_paths(before: Model, now: Model, paths: PathVertices) -> KnownPaths | None:
    """Return paths of the scene before an edit for that after it; None where none can be taken over."""
    same = (
        before.accelerator.rays == now.accelerator.rays
        and before.world.size == now.world.size
        and np.array_equal(before.origins[0], now.origins[0])
        and all(
            np.array_equal(getattr(before.emitters, name), getattr(now.emitters, name))
            for name in ("cdf", "units", "lamp")
        )
    )
    edited = edited_faces(StaticPart(before.surfaces, before.scene), StaticPart(now.surfaces, now.scene))
    if not same or edited is None:
        return None
    lamps = unchanged_lamps(before.emitters, now.emitters)
    return KnownPaths(paths, edited, lamps != np.arange(len(lamps)))


class StaticPart(NamedTuple):
    """The static part of a scene, as its surfaces and its materials."""

    surfaces: Surfaces
    scene: Scene


def edited_faces(before: StaticPart, now: StaticPart) -> np.ndarray | None:
    """Return which faces (F,) bool of the static part reflect differently after an edit; None: they are others."""
    old, new = before.surfaces, now.surfaces
    faces = old.face_range(0)
    if old is new:
        return np.zeros(faces.stop, bool)
    same = (
        np.array_equal(old.vertices[0], new.vertices[0])
        and np.array_equal(old.faces[0], new.faces[0])
        and np.array_equal(old.two_sided[faces], new.two_sided[faces])
    )
    if not same:
        return None
    (rho, lobe), (new_rho, new_lobe) = ((s.reflectance[faces], s.lobe[faces]) for s in (old, new))
    tables = (lobe[:, 4:] < 0) & (new_lobe[:, 4:] < 0)  # whose numbers may differ
    lobes = (lobe == new_lobe) | (np.isnan(lobe) & np.isnan(new_lobe)) | tables
    numbers: dict[tuple, int] = {}
    models = [_models(part.scene, numbers) for part in (before, now)]
    return (rho != new_rho).any(axis=1) | ~lobes.all(axis=1) | (models[0] != models[1])


def _models(scene: Scene, numbers: dict[tuple, int]) -> np.ndarray:
    """Return a number for the reflection models of each face of the static part, (F,) int64; `numbers` grows."""
    keys = ((m.brdf, m.scaled, m.grain) for m in scene.materials)
    of_material = np.array([numbers.setdefault(key, len(numbers)) for key in keys], np.int64)
    return of_material[scene.static.face_material]


def traced_paths(
    model: Model, seed: int, previous: KnownPaths | None, first: int, count: int
) -> tuple[PathVertices, Fates, int]:
    """Return paths and fates of photons first .. first + count - 1, and the number of those traced, in this thread."""
    whole = model.accelerator, model.world, model.static, model.emitters, seed
    last = min(first + count, len(previous.paths.offsets) - 1) if previous is not None else first
    if previous is None or last <= first:
        return *trace_background(*whole, first, count), count
    old = _part(previous.paths, first, last)
    photon = np.repeat(np.arange(last - first), np.diff(old.offsets))
    met = previous.relit[old.lamp]
    met[photon[(old.side != NONE) & previous.edited[old.side >> 1]]] = True
    again = np.concatenate([np.flatnonzero(met), np.arange(last - first, count)])
    new, fates = trace_background(*whole, first, count, again)
    kept = ~met[photon]
    lengths = np.zeros(count, np.int64)
    lengths[: last - first][~met] = np.diff(old.offsets)[~met]
    lengths[again] = np.diff(new.offsets)
    offsets = np.concatenate([[0], np.cumsum(lengths)])
    rows = (offsets[:-1][photon] + np.arange(len(photon)) - old.offsets[photon])[kept]
    places = np.repeat(offsets[:-1][again] - new.offsets[:-1], np.diff(new.offsets)) + np.arange(len(new.side))
    out = PathVertices(
        offsets, np.empty((offsets[-1], 3), np.float32), np.empty(offsets[-1], np.int32),
        np.empty((offsets[-1], 3), np.int32), *np.empty((2, count), np.uint8),
    )  # fmt: skip
    for whole_array, taken, traced in zip(out[1:4], old[1:4], new[1:4], strict=True):
        whole_array[rows], whole_array[places] = taken[kept], traced
    for own, taken, traced in zip(out[4:], old[4:], new[4:], strict=True):
        own[: last - first], own[again] = taken, traced
    return out, add_fates(fates, _fates(old, ~met, len(fates.emitted) // 3)), len(again)


def _part(paths: PathVertices, first: int, last: int) -> PathVertices:
    """Return the paths of photons first .. last - 1, their offsets from 0 on."""
    a, b = int(paths.offsets[first]), int(paths.offsets[last])
    position, side, flux = (array[a:b] for array in (paths.position, paths.side, paths.flux))
    own = (array[first:last] for array in (paths.lamp, paths.direct))
    return PathVertices(paths.offsets[first : last + 1] - a, position, side, flux, *own)


def _fates(paths: PathVertices, rows: np.ndarray, lamps: int) -> Fates:
    """Return the flux by fate of some of the photons, rows (N,) bool."""
    out, photons, sums = no_flux(lamps), np.flatnonzero(rows), np.zeros((3, 3 * lamps), np.int64)
    starts = paths.offsets[photons]
    for g in range(lamps):
        these = starts[paths.lamp[photons] == g]
        out.emitted[3 * g : 3 * g + 3] = paths.flux[these].sum(axis=0, dtype=np.int64)
    add_fates_behind(paths.offsets, paths.side, paths.flux, paths.lamp, photons, starts, sums)
    add_to(out, sums)
    return out
