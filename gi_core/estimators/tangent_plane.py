"""Density Estimation on the Tangent Plane (Lastra et al. 2002; report 1.2.1).

E = flux of the segments that cross a receiver's disc from the front / the disc's reachable area. Additive in segments,
so on static receivers Eq. 2.4 holds: background - tails + branches. Receivers on a mobile are
estimated from all current segments near it (report 2.5.2), in its own space, where discs never move; and
so are, with artifact control, static receivers whose regions a mobile enters (`contact_discs`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from gi_core.base.threads import run_ranges
from gi_core.discs.contact.contact import Met
from gi_core.discs.contact.stale_receivers import ContactDiscs, ControlFacts, room_for_contacts
from gi_core.discs.crossing_cache import Crossings
from gi_core.discs.region import regions, whole_discs
from gi_core.discs.search import SEARCHES, Search
from gi_core.discs.search.predicate import Discs, lines, share
from gi_core.estimators.setting import Setting
from gi_core.model import Model
from gi_core.photons.flux_sums import CHUNK_BITS, NOT_ADDITIVE, Evaluated, FrameSums, Log, Sums, ThreadSums, carried
from gi_core.photons.paths import Segments
from gi_core.photons.prefixes import SubsetStore
from gi_core.rays.accelerator import Transforms
from gi_core.retrace.cuts import CutFlux, PoseChange, Wanted
from gi_core.retrace.removed_suffixes import RemovedSuffixes

LINE_GRAIN = 1024  # segments a thread


class Job(NamedTuple):
    """Segments to add, `sign` times, to sums of the receivers of object o."""

    o: int
    segments: Segments
    sign: int
    to: ThreadSums


class TangentPlane:
    """See the module; `radius` [m] is the disc's."""

    about = "Density Estimation on the Tangent Plane (Lastra et al. 2002): the flux of the segments that cross a disc."
    additive, controlled, on_faces = True, True, False
    smoothing: str | None = "radius"
    compile_seconds = 12

    def __init__(self, model: Model, setting: Setting):
        self.model, self.radius, self.control = model, setting.radius, setting.control
        self._search = SEARCHES[setting.search]
        self.area = np.full(len(model.object_receivers.areas), math.pi * self.radius * self.radius)
        self.control_facts = ControlFacts(0.0, 0, 0)
        self.stale = 0
        self.photons = 0
        self.prefixes = SubsetStore()  # sums of the background
        self.searches: list[Search] = []
        self._background = np.zeros((model.surfaces.receiver_range(0).stop, 3), np.int64)
        self._crossings = Crossings()  # of the background, with static receivers
        self._contact: ContactDiscs | None = None
        self._areas = self.area.copy()  # of the last frame ...
        self._differ = np.empty(0, np.int64)  # ... and where they are not `area`
        self._added = ThreadSums(len(self._background), model.threads)
        self._frame = FrameSums(len(self.area), len(self._background), model.threads)

    @staticmethod
    def summary(setting: Setting) -> str:
        return f"radius {setting.radius:.3g} m"

    def build(self) -> Iterator[None]:
        """Find reachable regions and index the discs of every object, in steps of a few ms."""
        own, r = self.model.receiver_sides, self.model.object_receivers
        self.searches = []
        for o in range(self.model.surfaces.objects):
            rows = self.model.surfaces.receiver_range(o)
            if self.control:
                region = yield from regions(self.model, o, self.radius)
                region = room_for_contacts(region) if o else region
            else:
                region = whole_discs(self.model, o, self.radius)
            self.area[rows] = region.area
            positions = np.ascontiguousarray(r.positions[rows], np.float32)
            normals = np.ascontiguousarray(r.normals[rows], np.float32)
            discs = Discs(positions, normals, own[rows], self.model.backs(o), np.float32(self.radius), region)
            self.searches.append(self._search(discs))
            yield
        self._contact = ContactDiscs(self.model, self.radius, [s.discs for s in self.searches], self.control)
        yield from self._contact.build()
        self._areas = self.area.copy()

    @property
    def bytes_a_hit(self) -> int:
        """What each segment crosses."""
        return self._crossings.bytes_a_vertex

    def add_background(self, segments: Segments, thread: int) -> None:
        """Add background segments to the sums of static receivers; several threads may, each with its number."""

        def splat(sign: int, log: Log) -> None:
            self._splat_part(0, segments, self.model.static, sign, self._added[thread]._replace(log=log))

        self._crossings.find(segments, splat)

    def prepare(self, photons: int) -> Iterator[None]:
        """Let frames use all that was added, which is the first `photons`; kept by that prefix."""
        self._added.move_to(self._background)
        self._crossings.settle()
        self.prefixes[photons] = self._background.copy()
        self.photons = photons
        return iter(())

    def background(self, photons: int) -> tuple[np.ndarray, np.ndarray]:
        """Return sums (n, 3) int64 and area (n,) [m2] of static receivers without mobiles, of a prefix."""
        return self.prefixes[photons], self.area[: len(self._background)]

    def wanted(self, at: Transforms, mobiles: bool) -> Wanted:
        """Return the segments that a frame at these poses must hold, with the light of mobiles or without it."""
        return self._contact.wanted(at, mobiles)

    def evaluate(self, frame: PoseChange) -> Evaluated:
        """Return what the frame's irradiance is read from, valid until the next call."""
        added, removed_suffixes = self._frame.added, frame.removed_suffixes
        jobs = [Job(0, frame.new_suffixes, 1, self._frame.new_suffixes)]
        jobs += [Job(o, segments, 1, added) for o, segments in enumerate(frame.near_mobiles, 1)]
        if not self._crossings.kept:
            jobs, removed_suffixes = (
                [Job(0, removed_suffixes.segments(self.model.threads), -1, added), *jobs],
                removed_suffixes.of(slice(0)),
            )
        met = self._contact.met(frame.at, mobiles=bool(frame.near_mobiles))
        try:
            with self._contact.regions_of(met):
                self._splat(jobs, frame.at, removed_suffixes)
            rows, stale = self._contact.static_sums([frame.near_boxes], frame.at, met)
            added[0].touched[rows >> CHUNK_BITS] = True
            out = self._frame.collect(self.prefixes[frame.photons], self._areas_of(met), frame.kept_prefixes.flux)
        except BaseException:
            self._frame.clear()  # or the next frame would begin with half of this one
            raise
        out.sums[rows], out.brought[rows] = stale, NOT_ADDITIVE
        self.stale = len(rows)
        self.control_facts = self._contact.facts(met)
        return out

    def _areas_of(self, met: Met) -> np.ndarray:
        """Return the areas (R,) with these contacts, valid until the next call; few differ from `area`."""
        self._areas[self._differ] = self.area[self._differ]
        self._differ, areas = self._contact.areas_of(met)
        self._areas[self._differ] = areas
        return self._areas

    def from_scratch(self, parts: Iterable[Segments], at: Transforms) -> Evaluated:
        """Return what irradiance is read from, from all current segments (an iterable of Segments)."""
        added, new_suffixes = (ThreadSums(len(self.area), self.model.threads) for _ in range(2))
        sums, brought = np.zeros((2, len(self.area), 3), np.int64)
        kept_prefixes, stale, met = CutFlux(), 0, self._contact.met(at, mobiles=True)
        for segments in parts:
            with self._contact.regions_of(met):
                jobs = [Job(o, segments, 1, added) for o in range(self.model.surfaces.objects)]
                self._splat([*jobs, Job(0, kept_prefixes.split_off(segments), 1, new_suffixes)], at)
            stale = stale + self._contact.static_sums([segments], at, met)[1]
        added.move_to(sums)
        new_suffixes.move_to(brought)
        areas, (rows, areas_there) = self.area.copy(), self._contact.areas_of(met)
        areas[rows] = areas_there
        brought, rows = brought.sum(axis=1), met.contacts[0].rows
        sums[rows], brought[rows] = stale, NOT_ADDITIVE
        return Evaluated.of_all(sums, areas, brought, carried(kept_prefixes.flux, kept_prefixes.count))

    def _splat(self, jobs: list[Job], at: Transforms, removed_suffixes: RemovedSuffixes | None = None) -> None:
        """Do jobs, and take tails out of what is added.

        Every thread takes its share of every job, so that all end at about the same time.
        """
        threads = min(self.model.threads, 1 + sum(job.segments.size for job in jobs) // LINE_GRAIN)

        def work(part, *_):
            if removed_suffixes is not None:
                gone = share(len(removed_suffixes.photon), part, threads)
                sums = self._frame.added[part].of(self.model.surfaces.receiver_range(0))
                self._crossings.take_out(removed_suffixes, *gone, sums)
            for o, segments, sign, to in jobs:
                rows = self.model.surfaces.receiver_range(o)
                self._splat_part(o, segments, at, sign, to[part].of(rows), part, threads)

        run_ranges(work, threads, threads, 1)

    def _splat_part(
        self, o: int, segments: Segments, at: Transforms, sign: int, sums: Sums, part: int = 0, parts: int = 1
    ) -> None:
        """Do one of `parts` shares of a job. Making lines ready twice is cheaper than waiting for another thread."""
        search = self.searches[o]
        if not search.parts_share_lines:
            first, last = share(segments.size, part, parts)
            segments, part, parts = Segments(*(a[first:last] for a in segments)), 0, 1
        if segments.size and len(sums.flux):
            ready = lines(segments, at.rotation[o], at.position[o], self.model, self.radius)
            search.splat(ready, sign, sums, part, parts)
