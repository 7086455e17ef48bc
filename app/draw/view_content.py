"""What the viewport shows: the estimate, the reference, or two of them side by side; as radiance or as errors."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from app.draw.colour_map import UNKNOWN, round_scale, signed_colours
from app.settings import ERRORS, REFERENCE
from gi_core.geometry.error import signed_error

if TYPE_CHECKING:
    from app.draw.vertex_colours import DrawMesh
    from app.session.session import Session
    from gi_core.display.dilation import Drawn

LEAST_SCALE = 0.02  # at the end of the scale of errors: what is less is nobody's concern


class Side(NamedTuple):
    """One side of the picture, or all of it."""

    label: str  # what it is
    irradiance: np.ndarray  # (R, 3) [W/m2], nan where not known
    weights: np.ndarray | None = None  # (R,) of receivers in their triangles, see gi_core.display.dilation


class Errors(NamedTuple):
    """What errors are told against, and how."""

    truth: np.ndarray  # (R, 3) [W/m2], nan where not known
    areas: np.ndarray  # (R,) [m2]
    scale: float  # relative error at the ends of the colour map
    noise: float  # of the truth, relative l1


class Shown(NamedTuple):
    """What is drawn."""

    sides: tuple[Side, ...]  # left to right
    coming: str  # what will be beside or instead of it, empty if nothing is missing
    errors: Errors | None  # shown as errors rather than as light
    named: bool  # it is not plain what the picture is


def shown(session: Session) -> Shown:
    """Return what the settings ask for, as far as it is known for the light of this very frame."""
    s, light = session.settings, session.light.snapshot
    estimate = _estimate(light.estimator, light.photons, light.drawn)
    appraisal = session.appraisal
    truth = appraisal.truth(light.poses, True) if appraisal is not None else None
    reference = None
    if truth is not None and truth.drawn is not None:
        reference = Side(_of_truth(truth), *truth.drawn)
    coming, sides = [], [estimate]
    errors = None
    if s.show == ERRORS and reference is not None:
        errors = _errors(session, estimate, reference, truth)  # a map may have holes, a picture may not
    whole = reference if reference is not None and (truth.seen == 1 or errors is not None) else None
    if s.reference and whole is not None:
        sides = [whole]
    if s.compare:
        other = whole if s.compare == REFERENCE else _seen(session, s.compare)
        sides += [other] if other is not None else []
        coming += [s.compare] if other is None and s.compare != REFERENCE else []
    if REFERENCE in s.beside_estimate and (truth is None or truth.seen < 1):
        coming.append(f"{REFERENCE} ({100 * truth.seen:.0f} % seen)" if truth is not None else REFERENCE)
    told = f"{' and '.join(coming).replace('_', ' ')}: computed while everything rests" if coming else ""
    return Shown(tuple(sides), told, errors, s.reference or errors is not None)


def paint(mesh: DrawMesh, side: Side, errors: Errors | None, with_reflectance: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return what colours (D, 3) float32 the front and the back of an object's draw vertices have: linear radiance,
    negative where not known, or with `errors` display colours."""
    if errors is None:
        from app.draw.vertex_colours import colours

        front, back = colours(mesh, side.irradiance, with_reflectance)
        return np.nan_to_num(front, nan=-1.0), np.nan_to_num(back, nan=-1.0)
    of_receivers = signed_colours(signed_error(side.irradiance, errors.truth, errors.areas) / errors.scale)
    back = of_receivers[mesh.back]
    back[mesh.back < 0] = UNKNOWN
    return of_receivers[mesh.front], back


def _errors(session: Session, estimate: Side, reference: Side, truth) -> Errors:
    areas = session.model.object_receivers.areas
    off = signed_error(estimate.irradiance, reference.irradiance, areas)
    return Errors(reference.irradiance, areas, max(round_scale(off, areas), LEAST_SCALE), truth.noise)


def _seen(session: Session, estimator: str) -> Side | None:
    other = session.appraisal.other if session.appraisal is not None else None
    if other is None or not other.is_done(session.light.version, estimator):
        return None
    return _estimate(estimator, other.seen.photons, other.seen.drawn)


def _estimate(estimator: str, photons: int, drawn: Drawn) -> Side:
    return Side(f"{_title(estimator)}, {_thousands(photons)} photons", *drawn)


def _of_truth(truth) -> str:
    if not np.isfinite(truth.noise):
        return "Reference, a first look"
    return f"Reference, {_thousands(round(truth.paths))} paths a point, ±{100 * truth.noise:.2g} %"


def _title(name: str) -> str:
    return name.replace("_", " ").capitalize()


def _thousands(n: int) -> str:
    return f"{n:,}".replace(",", " ")
