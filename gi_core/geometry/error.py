"""Measures of error, defined once: every number that the project quotes comes from here.

Truth T is `reference.py` or a closed form at `evaluation_points()`. All measures are of luminance and
weigh each receiver by the area that it stands for.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gi_core.geometry.border_angle import border_receivers
from gi_core.geometry.receivers import Receivers
from gi_core.geometry.surfaces import Surfaces

REC709 = np.array([0.2126, 0.7152, 0.0722])  # luminance of linear RGB
AFFECTED = 0.01  # of mean irradiance: a smaller change by the mobile counts as none
CLASSES = ("untouched", "affected", "mobile", "border")


class Error(NamedTuple):
    """The error of an estimate, relative; 0.05 is 5 %."""

    l1: float  # sum(w |E - T|) / sum(w T): the report's measure, well defined in shadows
    l2: float  # sqrt(sum(w (E - T)^2) / sum(w T^2)): the same with squares, strict on single spots


class Parts(NamedTuple):
    """The error of an estimate taken apart; as absolute errors, noise and bias need not add up to total."""

    noise: Error  # estimate against its own limit at very many photons
    bias: Error  # that limit against truth
    total: Error  # estimate against truth


def luminance(rgb: np.ndarray) -> np.ndarray:
    """Return the luminance (...) of linear RGB (..., 3), in the same unit."""
    return np.asarray(rgb, np.float64) @ REC709


def relative_error(E: np.ndarray, T: np.ndarray, weights: np.ndarray, rows=slice(None)) -> Error:
    """Return the error of irradiance E (n, 3) against T (n, 3) with areas `weights` (n,), over some rows.

    nan where T is black everywhere: nothing to be relative to.
    """
    e, t = luminance(E)[rows], luminance(T)[rows]
    w = np.asarray(weights, np.float64)[rows]
    light, light2 = float((w * t).sum()), float((w * t * t).sum())
    if light <= 0:
        return Error(float("nan"), float("nan"))
    off = np.abs(e - t)
    return Error(float((w * off).sum()) / light, float(np.sqrt((w * off * off).sum() / light2)))


def error_parts(E: np.ndarray, limit: np.ndarray, T: np.ndarray, weights: np.ndarray, rows=slice(None)) -> Parts:
    """Return noise, bias and total of E; `limit` is the same estimator at very many photons.

    Noise is relative to the limit, bias and total to the truth.
    """
    return Parts(
        relative_error(E, limit, weights, rows),
        relative_error(limit, T, weights, rows),
        relative_error(E, T, weights, rows),
    )


def falls_short(samples):
    """Return by what factor a standard deviation found from so few normal numbers is too small in the mean."""
    counts, at = np.unique(samples, return_inverse=True)
    factors = [math.sqrt(2 / (n - 1)) * math.exp(math.lgamma(n / 2) - math.lgamma((n - 1) / 2)) for n in counts]
    return np.array(factors)[at].reshape(np.shape(samples))


def noise_of_truth(standard_error: np.ndarray, T: np.ndarray, weights: np.ndarray, rows=slice(None)) -> float:
    """Return the l1 error that the reference's own noise adds at most, from its standard errors (n, 3).

    A normal deviate has mean magnitude sqrt(2 / pi); channels are taken as fully correlated. To be
    quoted beside any error: below it nothing can be told.
    """
    w = np.asarray(weights, np.float64)[rows]
    s, t = luminance(standard_error)[rows], luminance(T)[rows]
    light = float((w * t).sum())
    return float(np.sqrt(2 / np.pi) * (w * s).sum() / light) if light > 0 else float("nan")


def receiver_classes(
    surfaces: Surfaces, receivers: Receivers, now: np.ndarray, background: np.ndarray
) -> dict[str, np.ndarray]:
    """Return which receivers are in each class, {name: (R,) bool}; each receiver is in exactly one.

    mobile: on a mobile. border: of the others, those at a border or corner, where a disc hangs over an
    edge or into a wall. affected: of the rest, those where the mobiles change luminance by more than
    AFFECTED of its mean; `now` and `background` are irradiance (R, 3) with mobiles and of the static
    scene alone (rows of mobiles are not looked at). untouched: what is left.
    """
    on_mobile = np.arange(len(receivers.areas)) >= surfaces.first_receiver[1]
    border = border_receivers(surfaces, len(receivers.areas)) & ~on_mobile
    light = luminance(now)
    w = receivers.areas
    mean = float((w * light).sum() / w.sum()) if w.sum() > 0 else 0.0
    changed = np.abs(light - luminance(background)) > AFFECTED * mean
    rest = ~on_mobile & ~border
    return {"untouched": rest & ~changed, "affected": rest & changed, "mobile": on_mobile, "border": border}
