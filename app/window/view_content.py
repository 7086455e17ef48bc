"""Content of the viewport: estimate or reference, as radiance or as errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from app.draw.colour_map import UNKNOWN_COLOUR, signed_colours
from app.draw.draw_mesh import DrawMesh, dimmed
from app.draw.false_colour import round_scale
from app.draw.lit_scene import LitScene
from app.draw.readout import Pinned
from app.rest.results import ReferencePicture
from app.session.readouts import Row, csv_text
from app.session.session import Session
from app.settings import CHANGE, ERRORS
from gi_core.display.dilation import Drawn
from gi_core.gather.estimate import Source
from gi_core.geometry.error import luminance, signed_error
from gi_core.scene.pose import three
from gi_core.scene.types import UNITS, Units

# Display colours of receivers by their last computation (method_view.py): background, changed, estimated, path traced
RECOMPUTED = ((0.52, 0.53, 0.55), (0.93, 0.66, 0.30), (0.85, 0.36, 0.32), (0.40, 0.70, 0.95))
RECOMPUTED_NAMES = (
    "from the background", "changed by removed and added segments", "estimated again from all segments", "path traced",
)  # fmt: skip


CERTAIN_CHANGE = 2.0  # standard errors, from which a change is coloured


class Side(NamedTuple):
    """Light of the picture."""

    label: str
    drawn: Drawn  # irradiance (R, 3) [W/m2], nan where unknown, and interpolation weights
    deviation: np.ndarray | None = None  # (R,) [W/m2], standard error of its luminance, nan where unknown


class Errors(NamedTuple):
    """Reference and scale of an error map."""

    reference: np.ndarray  # (R, 3) [W/m2], nan where unknown
    areas: np.ndarray  # (R,) [m2]
    scale: float  # relative error at the ends of the colour map
    noise: float  # of the reference, relative l1

    def positions(self, irradiance: np.ndarray) -> np.ndarray:
        """Return the place (R,) on the colour map, -1 .. 1, of irradiance (R, 3) [W/m2]; nan where unknown."""
        return signed_error(irradiance, self.reference, self.areas) / self.scale


class Change(NamedTuple):
    """The change since the kept light where it is certain."""

    values: np.ndarray  # (R,) [W/m2], of the luminance, see certain_change()
    scale: float  # change at the ends of the colour map [W/m2, or lx]
    units: Units
    before: np.ndarray  # (R, 3) [W/m2], the kept light
    deviation: np.ndarray  # (R,) [W/m2], standard error of the luminance of the change, nan where unknown

    def positions(self, irradiance: np.ndarray) -> np.ndarray:
        """Return the place (R,) on the colour map, as of Errors."""
        return self.values / self.scale


def certain_change(now: np.ndarray, before: np.ndarray, deviation: np.ndarray) -> np.ndarray:
    """Return now - before, (R,), 0 below CERTAIN_CHANGE standard errors of it, nan where these are unknown."""
    change = now - before
    return np.where(np.abs(change) < CERTAIN_CHANGE * deviation, 0.0, np.where(np.isnan(deviation), np.nan, change))


class Shown(NamedTuple):
    """Content of the picture."""

    side: Side
    coming: str  # a sentence about parts still to be computed; "": none
    errors: Errors | Change | None  # of an error map, or of a map of changes; None: light
    named: bool  # the picture needs a label
    recomputed: np.ndarray | None = None  # (R,) uint8, drawn as colours; None: not asked for, or unknown
    meshes: tuple[DrawMesh, ...] | None = None  # with fine points; None: the session's


def shown(session: Session) -> Shown:
    """Return the content for the settings, as far as it is computed for the light of this frame."""
    s, light = session.settings, session.light.snapshot
    reference = light.rest.reference
    estimator = light.setting.estimator.replace("_", " ").capitalize()
    begins = {Source.PHOTONS: f"{estimator},", Source.EDITED: "Light before the edit, changed by"}
    by = begins.get(light.source, "Gathered light, changed by")
    estimate = Side(f"{by} {light.photons:,} photons", light.drawn, light.deviation)
    exact = None if reference is None else Side(_label_of(reference), reference.drawn)
    errors: Errors | Change | None = None
    if s.show == ERRORS and reference is not None:
        errors = _errors(session, estimate, reference)
    elif s.show == CHANGE:
        errors = _change(session)
    if errors is None and reference is not None and reference.seen < 1:
        exact = None  # an error map may have holes, a picture may not
    side = exact if s.reference and exact is not None else estimate
    method = session.light.method
    recomputed = method.recomputed if s.show_recomputed and errors is None and method is not None else None
    fine = light.rest.fine
    if errors is not None or recomputed is not None:
        fine = None
    if fine is not None:
        side = side._replace(drawn=fine.light.of(side.drawn))
    coming, named = _coming(session, reference, errors), s.reference or errors is not None
    return Shown(side, coming, errors, named, recomputed, None if fine is None else fine.meshes)


def lit(session: Session, shown: Shown) -> LitScene:
    """Return the lit scene of the picture."""
    lit, meshes, side = session.lit, session.meshes, shown.side
    if shown.meshes is not None:
        meshes = dimmed(shown.meshes, lit.levels)
    return replace(lit, meshes=meshes, drawn=side.drawn, deviation=side.deviation)


def _coming(session: Session, reference: ReferencePicture | None, errors: Errors | Change | None) -> str:
    """Return the sentence about parts still to be computed."""
    s, moves = session.settings, session.motion.is_active
    if s.show == CHANGE and errors is None:
        return "change: no light is kept; Keep as A does" if session.kept is None else "change: computed at rest"
    if not s.needs_reference or (reference is not None and reference.seen >= 1):
        return ""
    share = "" if reference is None else f" ({100 * reference.seen:.0f} % of receivers)"
    return f"reference{share}: {'computed at rest' if moves else 'computing'}"


def readouts_csv(session: Session, pinned: Sequence[Pinned]) -> str:
    """Return all read-outs on show as CSV."""
    snapshot = session.light.snapshot
    places = {p.name: p.position for p in session.scene.probes}
    rows = [Row("probe", name, places[name], float(luminance(E))) for name, E in snapshot.probes.items()]
    for pin, position, reading in pinned:
        if reading is not None:
            light = three(position), reading.irradiance, reading.error, reading.radiance
            rows.append(Row("pin", pin.name, *light, reading.object, reading.material))
    current = [light for light in snapshot.rest.surfaces if light.is_current]
    return csv_text(rows, current, UNITS[session.scene.units])


def paint(
    lit: LitScene, errors: Errors | Change | None, recomputed: np.ndarray | None = None
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return colours (D, 3) float32 of front and back per object: linear radiance, negative where unknown.

    With `errors` or `recomputed` they are display colours.
    """
    if recomputed is None and errors is None:
        return [(_known(front), _known(back)) for front, back in lit.sides]
    if recomputed is not None:
        of_receivers = np.array(RECOMPUTED, np.float32)[recomputed]
    else:
        of_receivers = signed_colours(errors.positions(lit.drawn.irradiance))
    out = []
    for mesh in lit.meshes:
        back = of_receivers[mesh.back]
        back[mesh.back < 0] = UNKNOWN_COLOUR
        out.append((of_receivers[mesh.front], back))
    return out


def _known(colours: np.ndarray) -> np.ndarray:
    """Return colours with -1 in place of nan."""
    return np.nan_to_num(colours, nan=-1.0) if np.isnan(colours).any() else colours


def _errors(session: Session, estimate: Side, reference: ReferencePicture) -> Errors:
    areas, E = session.model.object_receivers.areas, reference.drawn.irradiance
    off = signed_error(estimate.drawn.irradiance, E, areas)
    # ends of the colour map: a relative error of 0.02 at least
    scale = session.settings.error_range or max(round_scale(off, areas), 0.02)
    return Errors(E, areas, scale, reference.noise)


def _change(session: Session) -> Change | None:
    """Return the change since the kept light; None without one, and while anything moves."""
    kept, light = session.kept, session.light.snapshot
    if kept is None or light.deviation is None:
        return None
    if (of := light.rest.change) is not None:
        before, now, deviation = of
    else:  # light of another scene, or of other photons
        before, now, deviation = kept.irradiance, light.irradiance, np.hypot(kept.deviation, light.deviation)
    values = certain_change(luminance(now), luminance(before), deviation)
    scale = round_scale(values, session.model.object_receivers.areas * (np.nan_to_num(values) != 0))
    return Change(values, scale, UNITS[session.scene.units], before, deviation)


def _label_of(reference: ReferencePicture) -> str:
    if not np.isfinite(reference.noise):
        return "Reference, noise unknown"
    return f"Reference, {round(reference.paths):,} paths per receiver, ±{100 * reference.noise:.2g} %"
