"""Light after an edit: that before it, changed, until the edited scene has light of less error.

    E = changed(G, B, F)        see `control_variate.py`
    E = the bounces of radiosity before the edit, in new direct light, where lights or colours alone change

G is the best light before the edit, F and B the light of photons with the edit and without. Photons that met no edited
face have the same paths, so most of the noise of F and B cancels. docs/decisions/edits.md has the measurements.

Static part: the estimate of less error counts. F and B are of the same number of photons. The change is smoothed in
proportion to its noise, which photon subsets measure. Receivers that the static part did not have before show photons
alone, as all do of a new or moved lamp: G = B = 0. Where the static part stays as it is, so does the light of each
unchanged lamp, though its photons may be others.

Resting poses: G is the light gathered there, F and B that of frames without it. The static light of frames may improve
meanwhile, which is no change by the edit. So F of static receivers is its difference from static light, added to that
before. Receivers of mobiles count where the mobile has the same receivers and poses.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.estimators import ESTIMATORS
from gi_core.estimators.base import Setting
from gi_core.frames.background import Background
from gi_core.frames.control_variate import REACH, changed
from gi_core.frames.unchanged_paths import StaticPart, edited_faces
from gi_core.gather.denoise import smoothed_by_subset
from gi_core.gather.direct_light import DirectLight
from gi_core.gather.estimate import Estimate, Source, better, variance_per_lamp
from gi_core.gather.importance import importance
from gi_core.gather.radiosity import Bounces, relit
from gi_core.gather.static import denoised
from gi_core.geometry.error import luminance, relative_noise
from gi_core.geometry.mesh_neighbours import Neighbours
from gi_core.lights.emission import Emitters, unchanged_lamps
from gi_core.lights.lamps import sum_of_lamps
from gi_core.model import Model
from gi_core.rays.accelerator import Transforms


class LightBefore(NamedTuple):
    """Static light before an edit, of n receivers."""

    places: np.ndarray  # (n, 6) float32, positions [m] and normals
    estimate: Estimate
    setting: Setting
    emitters: Emitters
    static: StaticPart
    unreached: np.ndarray  # (k,) int64 receivers that light cannot reach
    by_photons: dict[int, np.ndarray]  # number of photons -> their irradiance per lamp (n, 3 G) float32 [W/m2]
    bounces: Bounces | None  # None: none are kept


def light_before(b: Background, estimate: Estimate, unreached: np.ndarray, bounces: Bounces | None) -> LightBefore:
    """Return light of a background's static part, to be changed by edits; arguments as in LightBefore."""
    by_photons = {n: b.irradiance_per_lamp(n).astype(np.float32) for n in b.estimate.subsets}
    m = b.model
    return LightBefore(
        _places(m), estimate, b.setting, m.emitters, StaticPart(m.surfaces, m.scene), unreached, by_photons,
        bounces,
    )  # fmt: skip


class EditedLight:
    """Static light before an edit, for the scene after it."""

    def __init__(self, before: LightBefore, model: Model):
        self.before = before
        self._rows = _rows_of(_places(model), before.places)
        self._lamps = unchanged_lamps(before.emitters, model.emitters)
        edited = edited_faces(before.static, StaticPart(model.surfaces, model.scene))
        stays = edited is not None and not edited.any()  # the static part: so does the light of unchanged lamps
        self._changes = np.flatnonzero(np.repeat((self._lamps < 0) | (not stays), 3))  # columns of light per lamp
        self._unreached = before.unreached if edited is not None else np.zeros(0, np.int64)  # by the same geometry
        self._model, self._threads = model, model.threads
        # Light compares as it counts in the picture; else a sunlit outside counts alone.
        self._weights = importance(model, luminance(sum_of_lamps(self._at_receivers(before.estimate.light))))
        self._last: tuple[Background, int, Estimate] | None = None  # of the photons of a background
        bounces = before.bounces
        can_be_relit = bounces is not None and bounces.hits and bounces.rays_key == model.static_rays_key
        self._bounces = bounces if can_be_relit and len(self._changes) else None  # to be lit, None: not, or done
        self._relit: Estimate | None = None

    @property
    def paths(self) -> int:
        """Paths per receiver of the bounces that are lit; 0: photons change the light."""
        return self.before.bounces.paths if self._relit is not None and self.before.bounces else 0

    def relight(self, direct: DirectLight, seed: int) -> None:
        """Light the bounces of the scene before an edit that leaves geometry, with a pause every 10 ms; once.

        Only columns that change are lit. Direct light of a lamp is that before where it stays, else that of points on
        the lamp, where these stand for it; without either this does nothing.
        """
        bounces, model, columns = self._bounces, self._model, self._changes
        if bounces is None or not direct.is_known:
            return
        stays = unchanged_lamps(bounces.emitters, model.emitters)
        light, deviation = direct.per_lamp.copy(), direct.deviation
        for g in np.unique(columns // 3):
            if stays[g] >= 0 and not direct.has_delta(g):
                after, earlier = (slice(3 * k, 3 * k + 3) for k in (g, stays[g]))
                light[:, after], deviation[:, after] = bounces.direct[:, earlier], bounces.deviation[:, earlier]
            elif not direct.stands_for(g):
                self._bounces = None
                return
        now = light.take(columns, 1), deviation.take(columns, 1), direct.by_delta
        r = relit(model, seed, self._weights, bounces, columns, *now)
        errors = r.standard_error, r.lamp_error
        lit, variance, left = denoised(model, seed, self._weights, r.per_lamp, *errors, exact=r.by_delta)
        G, of = self._per_lamp(self.before.estimate.light), self.before.estimate
        share, E, V = self._share_kept(G), G.copy(), np.zeros((len(G), G.shape[1] // 3))
        kept = self._lamps >= 0
        V[:, kept] = self._at_receivers(of.variance)[:, self._lamps[kept]]
        E[:, columns], V[:, columns[::3] // 3] = lit, variance
        self._weights = importance(model, luminance(sum_of_lamps(E)))
        noise = relative_noise(np.sqrt(V.sum(axis=1)), sum_of_lamps(E), self._weights)
        error = math.hypot(share.max(initial=0.0) * of.error, max(math.hypot(left * r.noise, 0.01), noise))
        self._relit, self._bounces = Estimate(Source.EDITED, E, V, noise, error), None

    def estimate(self, b: Background, around: Neighbours) -> Estimate | None:
        """Return the light by bounces, or with the change that the photons of a background say, of less error.

        None: neither is known; photons only by a number that was known before.
        """
        counts = self.before.by_photons if _of_sums(b) == _of_sums(self.before) else {}
        photons = max((n for n in b.estimate.subsets if n in counts), default=0)
        if photons and (self._last is None or self._last[:2] != (b, photons)):
            fewer = max((n for n in b.estimate.subsets if n in counts and 2 * n <= photons), default=0)
            self._last = b, photons, self._changed(b, photons, fewer, around)
        return better(self._relit, self._last[2] if photons else None)

    def _changed(self, b: Background, photons: int, fewer: int, around: Neighbours) -> Estimate:
        """Return the light changed by a number of photons; fewer: a subset that measures the noise; 0: none."""
        before, columns = self.before.estimate, self._changes
        G = self._per_lamp(before.light)
        change, of_change = self._change(b, photons, G[:, columns]), np.zeros(len(G))
        if fewer:
            both = sum_of_lamps(change), sum_of_lamps(self._change(b, fewer, G[:, columns]))
            every = np.ones(len(G), bool)
            times, threads = photons / fewer, self._threads
            change, of_change = smoothed_by_subset(*both, times, REACH, around, every, self._weights, threads, change)
        E = G.copy()
        E[:, columns] = np.maximum(G[:, columns] + change, 0.0)
        E[self._unreached] = 0.0  # smoothing would light them a little
        share = self._share_kept(G)
        deviation = np.hypot(share * self._at_receivers(before.deviation), of_change)
        noise = relative_noise(of_change, sum_of_lamps(E), self._weights)
        error = float(np.hypot(share.max(initial=0.0) * before.error, 0.0 if np.isnan(noise) else noise))
        variance = variance_per_lamp(deviation, luminance(E.reshape(len(E), -1, 3)))
        return Estimate(Source.EDITED, E, variance, error, error)

    def _share_kept(self, G: np.ndarray) -> np.ndarray:
        """Return the share (n,) of the light before the edit that comes from unchanged lamps."""
        everything = luminance(sum_of_lamps(self._at_receivers(self.before.estimate.light)))
        return np.divide(luminance(sum_of_lamps(G)), everything, out=np.zeros(len(G)), where=everything > 0)

    def _per_lamp(self, per_lamp: np.ndarray) -> np.ndarray:
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
        """Return E - G (n, k) [W/m2] in the columns that change, see the module; G (n, k)."""
        B = self._per_lamp(self.before.by_photons[photons])[:, self._changes]
        F = b.irradiance_per_lamp(photons)[:, self._changes]
        F = F.astype(np.float32).astype(np.float64)  # equal light leaves no difference
        return changed(G, B, F) - G


def _of_sums(of: Background | LightBefore) -> Setting:
    """Return the setting by which photons are summed: the default of k follows the scene, but few estimators use it."""
    setting = of.setting
    return setting._replace(neighbours=0) if ESTIMATORS[setting.estimator].additive else setting


def _places(model: Model) -> np.ndarray:
    rows, r = model.surfaces.receiver_range(0), model.object_receivers
    places = np.concatenate([r.positions[rows] + model.origins[0], r.normals[rows]], axis=1)
    return places.astype(np.float32) + np.float32(0.0)  # no -0


def _rows_of(places: np.ndarray, among: np.ndarray) -> np.ndarray:
    """Return the row of each place (n, 6) among others (m, 6), -1 where it is not there."""
    if places.shape == among.shape and np.array_equal(places, among):
        return np.arange(len(places))
    rows = {key.tobytes(): k for k, key in enumerate(among)}
    return np.array([rows.get(key.tobytes(), -1) for key in places], np.int64)


class LightAtPoses(NamedTuple):
    """Light of a frame at resting poses before an edit."""

    model: Model
    at: Transforms
    levels: np.ndarray  # (G, 3)
    irradiance: np.ndarray  # (R, 3) [W/m2]
    own: np.ndarray  # (R, 3) [W/m2], without light gathered at the poses
    static: np.ndarray  # (n, 3) [W/m2], without mobiles
    deviation: np.ndarray  # (R,) [W/m2], standard error of the luminance


class EditedAtPoses:
    """Light at resting poses before an edit, for the model after it. rows (k,) int64: receivers that it lights."""

    def __init__(self, before: LightAtPoses, model: Model):
        self.before = before
        numbers = {name: o for o, name in enumerate(before.model.names, 1)}
        pairs = [(o, numbers[name]) for o, name in enumerate(model.names, 1) if name in numbers]
        self._objects, self._objects_before = np.array(pairs, np.int64).reshape(-1, 2).T
        rows, rows_before = [np.arange(len(before.static))], [np.arange(len(before.static))]
        for o, p in pairs:
            mine, theirs = model.surfaces.receiver_range(o), before.model.surfaces.receiver_range(p)
            places = zip(model.object_receivers[:2], before.model.object_receivers[:2], strict=True)
            if all(np.array_equal(a[mine], b[theirs]) for a, b in places):
                rows.append(np.arange(mine.start, mine.stop))
                rows_before.append(np.arange(theirs.start, theirs.stop))
        gathered = (before.irradiance != before.own).any(axis=1)
        self.rows_before = np.concatenate(rows_before)
        self.rows = np.concatenate(rows)[gathered[self.rows_before]]
        self.rows_before = self.rows_before[gathered[self.rows_before]]
        self._static = self.rows < len(before.static)

    def is_at(self, at: Transforms, levels: np.ndarray) -> bool:
        """Return whether the mobiles that both scenes have are at the poses of the light; levels (G, 3)."""
        pairs = zip(at[:2], self.before.at[:2], strict=True)
        same = all(np.array_equal(a[self._objects], b[self._objects_before]) for a, b in pairs)
        return same and np.array_equal(levels, self.before.levels)

    def irradiance(self, own: np.ndarray, static: np.ndarray) -> np.ndarray:
        """Return irradiance (k, 3) [W/m2] at `rows`; own (R, 3) and static (n, 3) as in LightAtPoses, of a frame."""
        now, improved = own[self.rows], self.rows[self._static]
        now[self._static] += self.before.static[improved] - static[improved]
        light, before = (E[self.rows_before] for E in (self.before.irradiance, self.before.own))
        return np.maximum(changed(light, before, np.maximum(now, 0.0)), 0.0)
