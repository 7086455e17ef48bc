"""Irradiance of a frame, from the background and the poses alone, and the same from scratch for comparison.

Static receivers: E = E_bg - E~(removed suffixes) + E~(new suffixes) (report Eq. 2.4), computed from integers in each
frame, so it cannot drift. Receivers on mobiles: from all segments near them, or by path gathering.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.discs.contact.stale_receivers import ControlFacts
from gi_core.frames.background import Background, Photons, add_fates
from gi_core.frames.control_variate import frame_irradiance
from gi_core.frames.light_source import LightSource
from gi_core.geometry.radiosity import irradiance
from gi_core.model import Model
from gi_core.photons.trace import Fates
from gi_core.rays.accelerator import Transforms
from gi_core.retrace.broad_phase import ScanBuffers
from gi_core.retrace.cuts import PoseChange, change, current_segments

SCRATCH_CHUNK = 1 << 16
NO_FACTS = ControlFacts(0.0, 0, 0)


class FrameSize(NamedTuple):
    """Photons and paths of a frame."""

    photons: int
    paths: int  # per receiver of a mobile; 0: photons light mobiles


class Generation(NamedTuple):
    """The parts that a frame was computed from."""

    background: Background | None  # frames are computed from it; None before the first
    change: PoseChange | None  # by the mobiles; None before the first frame
    size: FrameSize
    gathered: bool  # the static part's light is gathered
    facts: ControlFacts

    @property
    def photons(self) -> int:
        """Photons of the background, 0 before the first frame."""
        return self.background.estimate.photons if self.background is not None else 0


class Changes(NamedTuple):
    """Statistics of the path changes of a frame."""

    photons_cut: int
    old_segments: int  # removed
    new_segments: int  # added, including kept prefixes


def changes_of(f: PoseChange) -> Changes:
    """Return the statistics of a pose change."""
    return Changes(f.kept_prefixes.size, f.removed_suffixes.size, f.kept_prefixes.size + f.new_suffixes.size)


def frame_light(
    model: Model,
    photons: Photons,
    shown: Background,
    source: LightSource,
    at: Transforms,
    size: FrameSize,
    room: ScanBuffers,
    clock,
) -> tuple[PoseChange, np.ndarray]:
    """Return the path changes at the poses `at`, and irradiance (R, 3) [W/m2].

    shown: the background of all photons. `clock(stage)` is called at the end of each stage.
    """
    estimate = shown.estimate
    paths, coarse = photons.prefix(size.photons)
    wanted = estimate.wanted(at, mobiles=not size.paths)
    clock("contact")
    frame = change(model, paths, coarse, at, photons.seed, wanted, room, clock)
    evaluated = estimate.evaluate(frame)
    clock("estimate")
    if size.photons:
        scale, resting = model.emitters.unit_flux / size.photons, shown.resting(size.photons)
        better = source.static_irradiance(shown, size.photons)
        background = estimate.background(size.photons)[0]
        E = frame_irradiance(evaluated, scale, background, resting, better, model.threads)
    else:
        E = np.zeros(evaluated.sums.shape)
    clock("read out")
    if size.paths:
        source.light_mobiles(E, at, size.paths)
        clock("gather")
    return frame, E


def fluxes(photons: Photons, change: PoseChange | None) -> dict[str, np.ndarray]:
    """Return flux (3,) [W] emitted, absorbed, escaped and truncated, of all photons traced and a change of all."""
    total = photons.fates
    if change is not None and change.photons == photons.count:
        total = add_fates(total, change.fates)
    scale = photons.model.emitters.unit_flux / max(photons.count, 1)
    return {name: value * scale for name, value in zip(Fates._fields, total, strict=True)}


def light_from_scratch(
    model: Model, seed: int, shown: Background | None, made: Background, source: LightSource, at: Transforms, paths: int
) -> np.ndarray:
    """Return irradiance (R, 3) [W/m2] from all photons, traced again through static part and mobiles.

    A frame must equal this bit for bit. Structures are reused; the background's light is used only as the better
    static light of frames. made: background with the structures; shown: the same, or None before the first solve.
    """
    estimate = made.estimate
    n = estimate.photons
    parts = (
        current_segments(model, at, seed, first, min(SCRATCH_CHUNK, n - first))[0]
        for first in range(0, n, SCRATCH_CHUNK)
    )
    every = estimate.from_scratch(parts, at)
    if not n:
        return np.zeros(every.sums.shape)
    scale = model.emitters.unit_flux / n
    if shown is None:
        return irradiance(every.sums, scale, every.area)
    background, better = estimate.background(n)[0], source.static_irradiance(shown, n)
    E = frame_irradiance(every, scale, background, shown.resting(n), better, model.threads)
    if paths:
        source.light_mobiles(E, at, paths, fresh=True)
    return E
