"""Irradiance of a frame, from the background and the poses alone, and the same from scratch for comparison.

Static receivers: E = E_bg - E~(removed suffixes) + E~(new suffixes) (report Eq. 2.4), computed from integers in each
frame, so it cannot drift. Receivers on mobiles: from all segments near them, or by path gathering.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from gi_core.base.pause import pause
from gi_core.base.threads import overlapped
from gi_core.discs.stale_receivers import ControlFacts
from gi_core.frames.background import Background, Photons
from gi_core.frames.control_variate import AROUND, ControlledLight, frame_irradiance, own_irradiance
from gi_core.frames.frame_light import FrameLight
from gi_core.frames.held_light import HeldLevels
from gi_core.frames.light_setting import FrameSize
from gi_core.geometry.error import luminance
from gi_core.gloss.light import GlossLight
from gi_core.lights.lamps import irradiance_at
from gi_core.model import Model
from gi_core.photons.flux_sums import Evaluated
from gi_core.photons.trace import Fates, add_fates
from gi_core.rays.accelerator import Transforms
from gi_core.retrace.cuts import PoseChange, change, current_segments
from gi_core.scene.types import Pose


class Changes(NamedTuple):
    """Statistics of the path changes of a frame."""

    photons_cut: int
    old_segments: int  # removed
    new_segments: int  # added, including kept prefixes


class Frame(NamedTuple):
    """A frame: its poses and light, and the parts that these were computed from."""

    poses: dict[str, Pose]
    irradiance: np.ndarray  # (R, 3) [W/m2]
    own: np.ndarray  # the same without light gathered at its poses
    levels: np.ndarray  # (G, 3), of the lamps
    store: Photons  # all photons traced
    background: Background | None = None  # None before the first solve
    change: PoseChange | None = None  # by the mobiles, until the next frame; None before the first
    evaluated: Evaluated | None = None  # sums of all lamps, until the next frame
    gloss: GlossLight | None = None  # directions of the light at glossy receivers
    size: FrameSize = FrameSize(0, 0)
    gathered: bool = False  # the static part's light is gathered
    control_facts: ControlFacts = ControlFacts(0.0, 0, 0)  # receivers under artifact control, in general and now
    held: HeldLevels | None = None  # None: lamps hold no targets
    timings: Mapping[str, float] = MappingProxyType({})  # stage -> seconds
    deviation: np.ndarray | None = None  # (n,) [W/m2], that of ControlledLight; None of some photons alone

    @property
    def photons(self) -> int:
        """Photons that irradiance was computed from."""
        return self.size.photons

    @property
    def paths(self) -> int:
        """Paths gathered per receiver of a mobile; 0 where photons light mobiles."""
        return self.size.paths

    @property
    def photons_at_rest(self) -> int:
        """Photons of the background, of which `photons` may be a subset; 0 before the first frame."""
        return self.background.estimate.photons if self.background is not None else 0

    @property
    def effective_photons(self) -> int:
        """Number of photons of equal flux that would have as little noise; fewer where lamps are dimmed unequally."""
        return round(self.photons * self.store.model.emitters.effective(self.levels))

    @property
    def subsets(self) -> tuple[int, ...]:
        """Numbers of photons that a frame can be computed from, ascending; the last is all."""
        return tuple(sorted(self.background.estimate.subsets)) if self.background is not None else ()

    @property
    def changes(self) -> Changes:
        """Statistics of the path changes."""
        if (c := self.change) is None:
            return Changes(0, 0, 0)
        return Changes(c.kept_prefixes.size, c.removed_suffixes.size, c.kept_prefixes.size + c.new_suffixes.size)

    def has_sums(self, b: Background, size: FrameSize, reach: float, direct: bool) -> bool:
        """Return whether this frame still holds the sums of a background for frames of this size at its poses.

        reach [m]: gloss needs the segments as near to mobiles, 0: none. direct: with segments that leave lamps.
        """
        alike = self.size.photons == size.photons and bool(self.size.paths) == bool(size.paths)
        alike = alike and (reach == 0.0 or (self.change is not None and bool(self.change.near_mobiles)))
        sums = self.evaluated
        return alike and self.background is b and sums is not None and sums is b.evaluated and sums.direct == direct

    @property
    def segments(self) -> int:
        """Number of background segments of the photons."""
        return self.store.segments(self.photons)

    @property
    def fates(self) -> dict[str, np.ndarray]:
        """Flux (3,) [W] emitted, absorbed, escaped and truncated at the frame's poses.

        Exact in fixed-point units: emitted = absorbed + escaped + truncated. Covers all photons traced.
        """
        total = self.store.fates
        if self.change is not None and self.change.photons == self.store.count:
            total = add_fates(total, self.change.fates)
        scale = self.store.weights(self.levels) * (self.store.model.emitters.unit_flux / max(self.store.count, 1))
        lit = ((value.reshape(-1, 3) * scale).sum(axis=0) for value in total)
        return dict(zip(Fates._fields, lit, strict=True))

    @property
    def probe_irradiance(self) -> dict[str, np.ndarray]:
        """Irradiance (3,) [W/m2] at each probe, see probe_irradiance()."""
        b = self.background
        return probe_irradiance(self.store.model, self.irradiance, b is not None and b.estimate.on_faces)

    @property
    def search_summary(self) -> str:
        """Summary of the disc search over the static part; "" where there is none."""
        searches = self.background.estimate.searches if self.background is not None else ()
        return searches[0].summary() if searches else ""


class StageTimer:
    """Call it with the name of a stage when that stage ends; `seconds` sums the time per name. Each call pauses.

    A stage may call it in between, too.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def __call__(self, stage: str) -> None:
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last = now
        pause()


def next_frame(
    b: Background, light: FrameLight, poses: dict[str, Pose], size: FrameSize,
    shown: Frame | None = None,
) -> Frame:  # fmt: skip
    """Return the frame of a background at poses, from `size.photons` of its photons.

    shown: a frame at the same poses, whose sums are used again if they still exist. Pauses every few ms.
    """
    clock, at = StageTimer(), b.model.transforms(poses)
    reach = light.gloss.reach(b.setting.radius, size.paths, light.setting.gloss)
    with overlapped(light.mobiles.rays_ahead(at, size.paths), b.model.threads):
        changed, evaluated = _sums(b, light, at, size, reach, clock, shown)
        held = light.hold(_held(b, light, changed, evaluated) if size.photons else None)
        clock("hold")
        if size.photons:
            E, unbiased, deviation = _controlled(b, light, evaluated, at, size.photons, clock)
        else:
            E = unbiased = np.zeros((len(evaluated.area), 3))
            deviation = np.zeros(b.model.surfaces.receiver_range(0).stop)
    clock("read out")
    if size.paths:
        light.light_mobiles(E, at, unbiased, size.paths, b)
        clock("gather")
    own, E = E, light.rested(E, at, b, size.photons)
    gloss, facts = light.gloss_at(b, changed, clock, size.paths), b.estimate.control_facts
    parts = changed, evaluated, gloss, size, light.is_gathered, facts, held, clock.seconds, deviation
    return Frame(poses, E, own, light.setting.levels, b.store, b, *parts)


def _held(b: Background, light: FrameLight, changed: PoseChange, sums: Evaluated) -> HeldLevels | None:
    if light.held is None:
        return None
    change, direct = (changed, None) if sums.direct else (changed.bounced(), light.direct)
    return light.held.in_frame(b, change, sums.cut, direct, light.setting.asked)


def _sums(
    b: Background, light: FrameLight, at: Transforms, size: FrameSize, reach: float,
    clock: StageTimer, shown: Frame | None,
) -> tuple[PoseChange, Evaluated]:  # fmt: skip
    """Return the change of paths and the sums of a frame; arguments as for next_frame().

    reach [m]: gloss needs the segments as near to mobiles, 0: none.
    """
    estimate, bounced = b.estimate, light.knows_direct(b)
    if shown is not None and shown.has_sums(b, size, reach, not bounced):
        return shown.change, shown.evaluated
    b.evaluated = None
    paths, coarse = b.store.subset(size.photons)
    wanted = estimate.wanted(at, mobiles=not size.paths)
    if reach:
        wanted = wanted._replace(mobiles=True, reach=max(wanted.reach, reach))
    clock("contact")
    changed = change(b.model, paths, coarse, at, b.store.seed, wanted, clock)
    needed = changed._replace(near_mobiles=()) if size.paths else changed
    needed = needed.bounced() if bounced else needed
    b.evaluated = estimate.evaluate(needed)
    clock("estimate")
    return changed, b.evaluated


def _controlled(
    b: Background, light: FrameLight, sums: Evaluated, at: Transforms, photons: int,
    clock: Callable[[str], None] = lambda stage: None,
) -> ControlledLight:  # fmt: skip
    """Return the light of a frame's sums, with its static light as control variate where that is a better source."""
    model, levels = b.model, light.setting.levels
    unit, own = model.emitters.unit_flux / photons, b.irradiance(photons, levels, sums.direct)
    if light.is_own(b, photons):
        E = own_irradiance(sums, unit, own, b.store.weights(levels), model.threads)
        return ControlledLight(E, E, np.zeros(len(own)))
    direct, every = light.direct_at(at, b), photons == b.estimate.photons
    of_shadows = light.direct.share_error(levels) if every and light.knows_direct(b) else 0.0
    clock("direct")
    background, _ = b.estimate.background(photons, sums.direct)
    better, near = light.static_irradiance(b, photons), light.static.around(AROUND * b.setting.radius)
    weights = b.store.weights(levels)
    field = light.static.noise_field(b, sums.direct) if every else None  # else 1 to 3 ms
    lit = frame_irradiance(sums, unit, background, own, better, direct, weights, near, field, model.threads)
    of_points = np.minimum(luminance(better), luminance(direct.light)) * of_shadows
    return lit if lit.deviation is None else lit._replace(deviation=np.hypot(lit.deviation, of_points))


def light_from_scratch(shown: Frame, b: Background, light: FrameLight, poses: dict[str, Pose]) -> np.ndarray:
    """Return irradiance (R, 3) [W/m2] from all photons, traced again through static part and mobiles.

    A frame must equal this bit for bit. Structures of a background are reused; its light is used only as the better
    static light, and only where it is on show.
    """
    model, at, n = b.model, b.model.transforms(poses), b.estimate.photons
    chunk = max(1, n * (1 << 18) // max(b.store.segments(n), 1))  # photons of some 262,144 segments
    parts = (current_segments(model, at, b.store.seed, first, min(chunk, n - first))[0] for first in range(0, n, chunk))
    if not n:
        return np.zeros((len(model.object_receivers.areas), 3))
    kept = list(parts) if light.held is not None else parts
    every = b.estimate.from_scratch(kept, at, direct=not light.knows_direct(b))
    if light.held is not None:
        direct = light.direct if light.knows_direct(b) else None
        light.hold(light.held.from_scratch(b, at, kept, n, every.cut, direct, light.setting.asked))
    if shown.background is None:
        weights = b.store.weights(light.setting.levels)
        return irradiance_at(every.sums, weights, model.emitters.unit_flux / n, every.area)
    E, unbiased, _ = _controlled(b, light, every, at, n)
    if shown.paths:
        light.light_mobiles(E, at, unbiased, shown.paths, b, fresh=True)
    return light.rested(E, at, b, n)


def probe_irradiance(model: Model, irradiance: np.ndarray, on_faces: bool) -> dict[str, np.ndarray]:
    """Return irradiance (3,) [W/m2] by probe name, from that of all receivers (R, 3).

    A probe is a receiver. With an estimator that counts hits on faces, it takes the interpolated irradiance of the
    static face that it lies on, or 0 off any face.
    """
    rows = slice(model.first_probe, model.surfaces.receiver_range(0).stop)
    at_probes = _interpolated(model, irradiance, rows) if on_faces else irradiance[rows]
    return dict(zip((p.name for p in model.scene.probes), at_probes, strict=True))


def _interpolated(model: Model, irradiance: np.ndarray, rows: slice) -> np.ndarray:
    r, s = model.object_receivers, model.surfaces
    positions, normals = r.positions[rows], r.normals[rows]
    # a probe nearer than 1e-4 of a face's largest coordinate lies on it
    face = model.faces_at(model.static, positions, normals, 1e-4)
    out = np.zeros((len(face), 3))
    for k in np.flatnonzero(face >= 0):
        a, *ends = s.vertices[0][s.faces[0][face[k]]]
        u, v = np.linalg.lstsq((ends - a).T, positions[k] - a, rcond=None)[0]  # of the foot in the face's plane
        front = normals[k] @ s.normals[face[k]] > 0
        index = (s.corner_front if front else s.corner_back)[face[k]]
        out[k] = np.where(index[:, None] >= 0, irradiance[index], 0).T @ (1 - u - v, u, v)
    return out
