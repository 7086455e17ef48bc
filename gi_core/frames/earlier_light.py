"""Light of the static part after an edit: the best before it, changed as photons say.

    E = G + d        d = G F / B - G    where F < B: light is removed
                     d = F - B          elsewhere: light is added

G is the light gathered before the edit, else that of all photons. B and F are the irradiance of the same number of
photons before and after. Photons that met no edited face have the same paths, so most of the noise of F and B cancels,
as in `control_variate.py`. The change d is smoothed in proportion to its noise, which photon subsets tell. Receivers
that the static part did not have before show photons alone, as all do of a lamp that is new or moved: G = B = 0. Where
the static part stays as it is, so does the light of each unchanged lamp: d = 0, though its photons may be others.

The light serves until the edited scene has light of less error. docs/decisions/039-edits-shown-live.md has the
measurements.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.steps import finish
from gi_core.estimators.setting import Setting
from gi_core.frames.background import Background
from gi_core.frames.smoothed_photons import smoothed_by_subset
from gi_core.frames.unchanged_paths import StaticPart, edited_faces
from gi_core.gather.static import StaticGather
from gi_core.geometry.error import luminance
from gi_core.geometry.mesh_neighbours import Neighbours
from gi_core.lights.emission import Emitters
from gi_core.lights.mix import sum_of_lamps
from gi_core.lights.unchanged_lamps import unchanged_lamps
from gi_core.model import Model


class EarlierLight(NamedTuple):
    """Static light before an edit, of n receivers."""

    places: np.ndarray  # (n, 6) float32, positions [m] and normals
    per_lamp: np.ndarray  # (n, 3 G) [W/m2], gathered, else that of all photons
    deviation: np.ndarray  # (n,) [W/m2], standard error of its luminance
    error: float  # relative l1, bias included
    of_photons: float  # relative l1 error of all photons, blur of discs included; 0: not measured
    setting: Setting
    emitters: Emitters
    static: StaticPart
    unreached: np.ndarray  # (k,) int64 receivers that light cannot reach
    by_photons: dict[int, np.ndarray]  # number of photons -> their irradiance per lamp (n, 3 G) float32 [W/m2]


def earlier_light(
    b: Background, per_lamp: np.ndarray, deviation: np.ndarray, error: float, of_photons: float, unreached: np.ndarray
) -> EarlierLight:
    """Return light of a background's static part, to be changed by edits; arguments as in EarlierLight."""
    by_photons = {n: b.irradiance_per_lamp(n).astype(np.float32) for n in b.estimate.subsets}
    m = b.model
    scene = m.emitters, _static(m), unreached
    return EarlierLight(_places(m), per_lamp, deviation, error, of_photons, b.setting, *scene, by_photons)


class EditedLight:
    """Static light before an edit, for the scene after it."""

    def __init__(self, earlier: EarlierLight, model: Model):
        self.earlier = earlier
        self._rows = _rows_of(_places(model), earlier.places)
        self._lamps = unchanged_lamps(earlier.emitters, model.emitters)
        edited = edited_faces(earlier.static, _static(model))
        stays = edited is not None and not edited.any()  # the static part: so does the light of unchanged lamps
        self._changes = np.flatnonzero(np.repeat((self._lamps < 0) | (not stays), 3))  # columns of light per lamp
        self._unreached = earlier.unreached if edited is not None else np.zeros(0, np.int64)  # by the same geometry
        self._weights = model.object_receivers.areas[: len(self._rows)]
        self._threads = model.threads
        self._shown: tuple[Background, int] | None = None

    def photons(self, b: Background) -> int:
        """Return the largest number of photons, of the background, whose light before the edit is known; 0: none."""
        known = self.earlier.by_photons if b.setting == self.earlier.setting else {}
        return max((n for n in b.estimate.subsets if n in known), default=0)

    def show(self, b: Background, around: Neighbours, gathered: StaticGather) -> None:
        """Let gathered light be that before the edit with the change that the photons of a background say."""
        photons, columns = self.photons(b), self._changes
        if not photons or self._shown == (b, photons):
            return
        self._shown = b, photons
        G = self._known(self.earlier.per_lamp)
        change = self._change(b, photons, G[:, columns])
        fewer = max((n for n in b.estimate.subsets if n in self.earlier.by_photons and 2 * n <= photons), default=0)
        of_change = np.zeros(len(G))
        if fewer:
            both = sum_of_lamps(change), sum_of_lamps(self._change(b, fewer, G[:, columns]))
            given = *both, photons / fewer, around, np.ones(len(G), bool), self._weights, self._threads, change
            change, of_change = finish(smoothed_by_subset(*given))
        E = G.copy()
        E[:, columns] = np.maximum(G[:, columns] + change, 0.0)
        E[self._unreached] = 0.0  # smoothing would light them a little
        kept = self._kept(G)
        of_kept = kept * self._at_receivers(self.earlier.deviation)
        lit = max(float(self._weights @ luminance(sum_of_lamps(E))), 1e-300)
        errors = kept.max(initial=0.0) * self.earlier.error, np.sqrt(2 / np.pi) * (self._weights @ of_change) / lit
        error = float(np.hypot(*errors))
        gathered.show_earlier(E, np.hypot(of_kept, of_change), error)

    def _kept(self, G: np.ndarray) -> np.ndarray:
        """Return the share (n,) of the light before the edit that comes from unchanged lamps."""
        everything = luminance(sum_of_lamps(self._at_receivers(self.earlier.per_lamp)))
        return np.divide(luminance(sum_of_lamps(G)), everything, out=np.zeros(len(G)), where=everything > 0)

    def _known(self, per_lamp: np.ndarray) -> np.ndarray:
        """Return light per lamp before the edit for the lamps and the receivers after it; 0 for new ones."""
        light = self._at_receivers(per_lamp).reshape(len(self._rows), -1, 3)[:, self._lamps]
        light[:, self._lamps < 0] = 0.0
        return light.reshape(len(self._rows), -1)

    def _at_receivers(self, light: np.ndarray) -> np.ndarray:
        """Return values of receivers before the edit, at those after it; 0 at new ones."""
        out = light[self._rows].astype(np.float64)
        out[self._rows < 0] = 0.0
        return out

    def _change(self, b: Background, photons: int, G: np.ndarray) -> np.ndarray:
        """Return d (n, k) [W/m2] in the columns that change, see the module; G (n, k)."""
        B = self._known(self.earlier.by_photons[photons])[:, self._changes]
        F = b.irradiance_per_lamp(photons)[:, self._changes]
        F = F.astype(np.float32).astype(np.float64)  # equal light leaves no difference
        return change_of(G, B, F)


def change_of(light: np.ndarray, before: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Return the change of light by an edit, which another estimate of it has before the edit and now."""
    less = now < before
    return np.where(less, light * np.divide(now, before, out=np.ones_like(now), where=less) - light, now - before)


def _static(model: Model) -> StaticPart:
    return StaticPart(model.surfaces, model.scene)


def _places(model: Model) -> np.ndarray:
    rows, r = model.surfaces.receiver_range(0), model.object_receivers
    places = np.concatenate([r.positions[rows] + model.origins[0], r.normals[rows]], axis=1)
    return places.astype(np.float32) + np.float32(0.0)  # no -0


def _rows_of(places: np.ndarray, among: np.ndarray) -> np.ndarray:
    """Return the row of each place (n, 6) among others (m, 6), -1 where it is not there."""
    if places.shape == among.shape and np.array_equal(places, among):
        return np.arange(len(places))
    known = {key.tobytes(): k for k, key in enumerate(among)}
    return np.array([known.get(key.tobytes(), -1) for key in places], np.int64)
