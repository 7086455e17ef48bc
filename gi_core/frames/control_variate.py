"""Irradiance of a frame whose static light comes from a better source than the frame's own photons.

A frame of few photons is noisy everywhere, but the change that mobiles cause is small. F is the frame's irradiance, B
that of the same photons without mobiles, and G a better static solution (all photons, or gathered light):

    E = G F / B        where F < B: light is removed, G is scaled down
    E = G + (F - B)    elsewhere: light is added

Where direct light D is known (`gi_core.gather.direct_light`), F and B are bounced light alone, and G - D has the part
of G. The part that mobiles block is taken away from D as it is, without noise:

    E = (G - D) F / B + D (1 - blocked / D)

F and B share their photons, so most of their noise cancels. The difference alone would leave the noise of B in full
shadow, where F = 0 and E must be 0. The ratio alone is undefined where B = 0. Where F = B, E = G. F < B implies B > 0,
so there is no division by zero, and E is never negative. If segments are blocked independently, F / B is an unbiased
share for any number of segments but zero.

A few photons measure the change E - G with much noise. Its variance, in flux and summed over channels, is

    v = q (T (B - T + q) / (B + q) + A)

for T removed from B, A added by new suffixes, q the flux per photon. Photons are independent; that of the removed share
follows Laplace's rule, so one of one removed photon is no evidence of full shadow, but eight of eight are. In
proportion to this noise, changes are averaged over receivers around (`denoise.smooth`), so edges of shadows stay.
The noise itself is averaged first, and counts where it is larger: where chance cut no photon, v is 0, which is no
evidence of no change. Where it cut the only photon of a dark receiver, neighbours' noise is none of full shadow.
Then a change d is shrunk by the variance v that is left, as if receivers were independent, with the factor

    1 - SHRINKAGE v / d^2, at least 0

which is 0 for changes within noise and nearly 1 far above it (James-Stein). changes-by-mobiles.md has
the measurements.

Receivers are not independent: discs overlap and share photons. The noise that is left comes from the background's
photons. Their noise (`noise_field`), scaled to the mean of v, goes through the derivative of the averages (delta
method). Its mean square over receivers around is the variance.

Sums of a stale receiver are over another area than before, so they are no mean of neighbours. Its change is shrunk by
the variance of F - B, whose photons are partly the same.

Both biases have the same sign at many receivers. A mobile gathers from thousands, which averages noise and keeps bias:
it sees G + (F - B) - blocked everywhere, negative or not (docs/decisions/mobile-bounces.md).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.jit import inlined, kernel
from gi_core.base.threads import CHEAP, run_ranges
from gi_core.gather.denoise import VARIANCE, averaged, smooth
from gi_core.geometry.mesh_neighbours import Neighbours
from gi_core.lights.lamps import mixed, read_out
from gi_core.photons.flux_sums import CHUNK_BITS, NOT_ADDITIVE, Evaluated

SHRINKAGE = 4.0  # by measurement: less than the share of variance that averaging leaves for shared photons
AROUND = 4.0  # disc radii: distance of the receivers over which changes are averaged
REACH = 4.0  # standard deviations, see `denoise.smooth`
ALONE = -1e-300  # at most the variance of a stale receiver, negated: it is no mean of neighbours, and counts for none


class ControlledLight(NamedTuple):
    """Light of a frame by its control variate."""

    irradiance: np.ndarray  # (R, 3) float64 [W/m2], as shown
    unbiased: np.ndarray  # (>= n, 3) float64 [W/m2] of the static part: noisier, may be negative
    # (n,) float64 [W/m2], standard error that the change by mobiles brings to its luminance; None: not measured
    deviation: np.ndarray | None


class Direct(NamedTuple):
    """Direct light of n static receivers; zeros where photons bring it."""

    light: np.ndarray  # (n, 3) float64 [W/m2], without mobiles
    blocked: np.ndarray  # (n, 3) float64 [W/m2], the part that mobiles block

    @classmethod
    def unknown(cls, n: int) -> Direct:
        """Return that of frames whose photons bring direct light."""
        return cls(*np.zeros((2, n, 3)))


class _Sums(NamedTuple):
    """Sums of the frame's photons, int64 in fixed-point units, and areas."""

    background: np.ndarray  # (n, 3 G), of static receivers without mobiles
    frame: np.ndarray  # (R, 3 G)
    new_flux: np.ndarray  # (R, G), see `Evaluated`
    area: np.ndarray  # (R,) float64 [m2]


@inlined
def _changed(light, before, after):
    """Return light as it is after a change that another estimate of it has before and after."""
    if after < before:
        return light * (after / before)
    return light + (after - before)


@kernel
def _change_all(light, before, after, out):
    for k in range(len(out)):
        out[k] = _changed(light[k], before[k], after[k])


def changed(light: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return light (n, k) [W/m2] changed as another estimate of it, (n, k) before and after: E, see the module."""
    out = np.empty(light.size)
    _change_all(light.reshape(-1), before.reshape(-1), after.reshape(-1), out)
    return out.reshape(light.shape)


@inlined
def _chance(taken, new_flux, before, flux_per_cut):
    """Return the variance of a change of flux; fluxes are summed over channels."""
    chance = flux_per_cut * new_flux
    if taken > 0.0:
        chance += flux_per_cut * taken * (before - taken + flux_per_cut) / (before + flux_per_cut)
    return chance


@inlined
def _noise(sums, background, new_flux, levels, flux_per_cut, r):
    """Return the variance of receiver r's change of flux, summed over channels; levels (G,): means over channels."""
    before = now = new = 0.0
    for g in range(len(levels)):
        before += levels[g] * (background[r, 3 * g] + background[r, 3 * g + 1] + background[r, 3 * g + 2])
        now += levels[g] * (sums[r, 3 * g] + sums[r, 3 * g + 1] + sums[r, 3 * g + 2])
        new += levels[g] * new_flux[r, g]
    return _chance(before + new - now, new, before, flux_per_cut)


@inlined
def _noise_of_stale(sums, background, levels, flux_per_cut, factor, own, r):
    """Return the variance of stale receiver r's change of irradiance: sums over areas that differ and overlap.

    factor: irradiance over its flux; own: irradiance of the background. Sums are as for _noise().
    """
    before = now = 0.0
    for g in range(len(levels)):
        before += levels[g] * (background[r, 3 * g] + background[r, 3 * g + 1] + background[r, 3 * g + 2])
        now += levels[g] * (sums[r, 3 * g] + sums[r, 3 * g + 1] + sums[r, 3 * g + 2])
    whole = own / before if before > 0.0 else 0.0
    if factor == 0.0 or (now == 0.0 and before > 8.0 * flux_per_cut):  # no light reaches it: filled in pictures
        return 0.0
    return flux_per_cut * (
        (now + flux_per_cut) * factor * factor + before * whole * whole - 2.0 * min(now, before) * factor * whole
    )


@kernel
def _read_chunks(chunks, sums, levels, scale, area, out):
    """Write irradiance of the receivers in chunks."""
    for chunk in chunks:
        read_out(sums, levels, scale, area, chunk << CHUNK_BITS, min((chunk + 1) << CHUNK_BITS, len(out)), out)


@kernel
def _measure(chunks, sums, own, better, direct, levels, mean_levels, flux_per_cut, scale, change, unbiased):
    """Write change, its variance and unbiased light of static receivers in chunks; scale [W] of the sums."""
    for chunk in chunks:
        for r in range(chunk << CHUNK_BITS, min((chunk + 1) << CHUNK_BITS, len(better))):
            factor = scale / sums.area[r] if sums.area[r] > 0.0 else 0.0
            frame, before, after = 0.0, 0.0, 0.0
            for c, flux in enumerate(mixed(sums.frame, r, levels)):
                bounced = max(better[r, c] - direct.light[r, c], 0.0)
                change[r, c] = _changed(bounced, own[r, c], flux * factor) - bounced
                unbiased[r, c] = better[r, c] + (flux * factor - own[r, c])
                frame, before, after = frame + flux * factor, before + own[r, c], after + bounced
            # The sum over channels of the variances of grey photons is a third of the variance of their sum.
            share = (after / before if frame < before else 1.0) ** 2 / 3.0
            if sums.new_flux[r, 0] != NOT_ADDITIVE:
                noise = _noise(sums.frame, sums.background, sums.new_flux, mean_levels, flux_per_cut, r)
                change[r, VARIANCE] = noise * factor * factor * share
            elif frame != before:  # else a variance of 0, as where nothing changes
                noise = _noise_of_stale(sums.frame, sums.background, mean_levels, flux_per_cut, factor, before, r)
                change[r, VARIANCE] = min(-noise * share, ALONE)


@inlined
def _kept(change, r):
    """Return the share of receiver r's change that is kept, 0 .. 1."""
    d, variance = change[r, 0] + change[r, 1] + change[r, 2], change[r, VARIANCE]
    noise = SHRINKAGE * variance if variance > 0.0 else -variance  # of stale receivers: negative
    # The variance of a sum of grey channels is three times the sum of their variances.
    return max(1.0 - 3.0 * noise / (d * d), 0.0) if d != 0.0 else 0.0


@kernel
def _add(better, change, direct, first, last, out, unbiased):
    """Write better light with the shrunk change of static receivers in chunks first .. last - 1.

    The blocked share of direct light is taken away from both kinds of light.
    """
    for chunk in range(first, last):
        begin, end = chunk << CHUNK_BITS, min((chunk + 1) << CHUNK_BITS, len(better))
        if not change[begin:end].any() and not direct.blocked[begin:end].any():
            continue
        for r in range(begin, end):
            kept = _kept(change, r) if change[r, VARIANCE] != 0.0 else 1.0
            for c in range(3):
                light, blocked = direct.light[r, c], direct.blocked[r, c]
                taken = min(better[r, c], light) * min(blocked / light, 1.0) if blocked > 0.0 else 0.0
                out[r, c] = max(better[r, c] + kept * change[r, c] - taken, 0.0)
                unbiased[r, c] -= blocked


def noise_field(whole: np.ndarray, part: np.ndarray, near: Neighbours, threads: int) -> np.ndarray:
    """Return noise (n,) of mean square 1 around each receiver, correlated as photons are that receivers share.

    whole, part: light (n,) of all photons, and that of some of them or another with the same mean around.
    """
    apart, every = part - whole, np.ones(len(whole), bool)
    size = np.sqrt(averaged(near, apart * apart, every, threads))
    return np.divide(apart, size, out=np.zeros(len(whole)), where=size > 0.0)


def own_irradiance(frame: Evaluated, flux_unit: float, own: np.ndarray, levels: np.ndarray, threads: int) -> np.ndarray:
    """Return E (R, 3) [W/m2] of a frame's own photons at levels (G, 3) of its lamps; flux_unit [W] of its sums.

    own: irradiance (n, 3) [W/m2] of static receivers without mobiles, of the frame's photons.
    """
    out = np.empty((len(frame.sums), 3))
    out[: len(own)] = own

    chunks = np.flatnonzero(frame.changed)

    def read(_, first, last):
        _read_chunks(chunks[first:last], frame.sums, levels, flux_unit, frame.area, out)

    run_ranges(read, len(chunks), threads, CHEAP)
    return out


def frame_irradiance(
    frame: Evaluated,
    flux_unit: float,
    background: np.ndarray,
    own: np.ndarray,
    better: np.ndarray,
    direct: Direct,
    levels: np.ndarray,
    near: Neighbours,
    field: np.ndarray | None,
    threads: int,
) -> ControlledLight:
    """Return light of a frame at levels (G, 3) of its lamps; flux_unit [W] of its sums.

    background: sums (n, 3 G) int64 of static receivers without mobiles, of the frame's photons. own, better:
    irradiance (n, 3) [W/m2] without mobiles, of the frame's photons and of the better source. Only the latter has
    direct light where that is known. near: static receivers within some AROUND radii of each. field (n,): that of
    noise_field(), None: state no deviation.
    """
    out, static = np.empty((len(frame.sums), 3)), len(better)
    out[:static] = better

    def read(_, first, last):
        read_out(frame.sums, levels, flux_unit, frame.area, static + first, static + last, out)

    run_ranges(read, len(out) - static, threads, CHEAP)
    mean_levels = levels.mean(axis=1)
    flux_per_cut = frame.cut.per_photon(mean_levels)
    change = np.zeros((static, 4))  # and its variance
    unbiased, chunks = better.copy(), np.flatnonzero(frame.changed)
    sums = _Sums(background, frame.sums, frame.new_flux, frame.area)

    def measure(_, first, last):
        _measure(
            chunks[first:last], sums, own, better, direct, levels, mean_levels, flux_per_cut, flux_unit, change,
            unbiased,
        )  # fmt: skip

    def add(_, first, last):
        _add(better, change, direct, first, last, out, unbiased)

    run_ranges(measure, len(chunks), threads, CHEAP)
    noise, is_mean = change[:, VARIANCE], change[:, VARIANCE] >= 0.0
    mean = averaged(near, noise, is_mean, threads)
    noise[:] = np.where(is_mean, np.maximum(noise, mean), noise)
    if field is not None:
        change = np.concatenate([change, (np.sqrt(3.0 * mean) * field)[:, None]], axis=1)  # see _kept
    smooth(change, REACH, near, threads, responds=field is not None)
    run_ranges(add, len(frame.changed), threads, CHEAP)
    if field is None:
        return ControlledLight(out, unbiased, None)
    noisy = change[:, VARIANCE] > 0.0
    of_means = averaged(near, change[:, VARIANCE + 1] ** 2, noisy, threads) / 3.0
    left = np.where(noisy, of_means, np.abs(change[:, VARIANCE]))
    return ControlledLight(out, unbiased, np.sqrt(left / 3.0))  # of grey light, see _measure
