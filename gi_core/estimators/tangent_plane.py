"""Density Estimation on the Tangent Plane (Lastra et al. 2002; report 1.2.1).

E = flux of the segments that cross a receiver's disc from the front / area of the disc's region. The sum is additive
in segments, so Eq. 2.4 holds on static receivers: background - removed suffixes + new suffixes. Receivers on a mobile
are estimated from all current segments near it (report 2.5.2), in its object space, where discs never move. Stale
receivers, whose regions a mobile enters, are estimated in the same way (`stale_receivers.py`).

Whether an intersection is accepted does not depend on a cut (`discs/search/predicate.py`), so a removed suffix has
exactly the intersections of its background segment behind the cut. They are cached once per segment, eight bytes each.
A frame looks them up instead of searching, unless the cache is full.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import allocating, kernel
from gi_core.base.pause import pause
from gi_core.base.threads import CHEAP, run_ranges, usable
from gi_core.discs.region import EXTENSION, Regions, regions, whole_discs
from gi_core.discs.search import SEARCHES
from gi_core.discs.search.predicate import Discs, begins, crossing, lines, share
from gi_core.discs.stale_receivers import ContactDiscs, PoseContacts, room_for_contacts
from gi_core.estimators import counting
from gi_core.estimators.base import AdditiveEstimator, Setting
from gi_core.estimators.counting import Counts, Find, Place
from gi_core.model import Model
from gi_core.photons.flux_sums import (
    CHUNK_BITS,
    NOT_ADDITIVE,
    CutFlux,
    Evaluated,
    IntersectionLog,
    Sums,
    ThreadSums,
)
from gi_core.photons.paths import Segments, bounced, rows_of
from gi_core.rays.accelerator import Transforms
from gi_core.retrace.cuts import PoseChange, RemovedSuffixes, Wanted, split_at_cuts

MOST_PER_PHOTON = 64  # entries per photon: half a GB per million photons. Beyond it, frames search for removed suffixes
ENTRIES_PER_SEGMENT = 4  # entries per segment in the first allocation
ENTRIES_PER_STEP = 1 << 20  # entries merged or moved between two pauses


class _Entries(NamedTuple):
    """Entries of all segments of consecutive photons."""

    photon: int  # index of the first
    photons: int
    count: (
        np.ndarray
    )  # (vertices,) uint32, entries of the segment that leaves each vertex; 0 at the last vertex of a path
    receiver: np.ndarray  # (n,) int32
    distance: np.ndarray  # (n,) float32 [m]


class IntersectionCache:
    """Disc intersections of background segments, by start vertex; append-only."""

    def __init__(self):
        self.complete = True  # False: there were too many, and the cache is empty
        self._parts: list[_Entries] = []  # not merged yet
        self._photons = self._vertices = 0
        self._first = np.zeros(1, np.uint32)  # (vertices + 1,), first entry of each vertex
        self._receiver, self._distance = np.empty(0, np.int32), np.empty(0, np.float32)

    def copied(self) -> IntersectionCache:
        """Return a copy; both share the memory of their present entries, which stay as they are."""
        other, end = copy.copy(self), int(self._first[self._vertices])
        other._parts, other._first = list(self._parts), self._first[: self._vertices + 1]
        other._receiver, other._distance = self._receiver[:end], self._distance[:end]
        return other

    @property
    def bytes_per_vertex(self) -> int:
        """Bytes of the cache per path vertex; an estimate before photons are known."""
        # 3 entries per vertex, before any are counted
        entries = int(self._first[self._vertices]) / self._vertices if self._vertices else 3
        return 4 + int(8 * entries) if self.complete else 0

    def find(self, segments: Segments, accumulate: Callable[[int, IntersectionLog], None]) -> None:
        """Call `accumulate(sign, log)`, which adds sign x segments to sums; cache the intersections that it records.

        segments: all of consecutive photons, photon-major. Thread safe for disjoint photons.
        """
        log = IntersectionLog.of(1 + ENTRIES_PER_SEGMENT * segments.size if self.complete else 0)
        accumulate(1, log)
        if not self.complete or not segments.size:
            return
        n = int(log.count[0])
        if n > len(log.line):
            log = IntersectionLog.of(n)
            accumulate(0, log)  # sign 0: record only, the sums have them already
        photons = int((segments.bounce == 0).sum())
        count = np.zeros(segments.size + photons, np.uint32)
        receiver, distance = np.empty(n, np.int32), np.empty(n, np.float32)
        _by_vertex(segments.bounce, log, n, count, receiver, distance)
        self._parts.append(_Entries(int(segments.photon[0]), photons, count, receiver, distance))

    def settle(self) -> None:
        """Merge the parts, which now cover all photons up to some last one, for subtract().

        May be broken off at a pause and begun again.
        """
        at, end = self._vertices, int(self._first[self._vertices])
        parts = self._parts = sorted(self._parts, key=lambda part: part.photon)
        n = end + sum(len(p.receiver) for p in parts)
        # 1 << 32 entries: indices have 32 bits
        if n > min(MOST_PER_PHOTON * (self._photons + sum(p.photons for p in parts)), (1 << 32) - 1):
            self.__init__()
            self.complete = False
            return
        self._first = _grown(self._first, at + 1, at + 1 + sum(len(p.count) for p in parts))
        self._receiver = _grown(self._receiver, end, n)
        self._distance = _grown(self._distance, end, n)
        merged = 0
        while parts:
            p = parts.pop(0)
            rows, entries = slice(at + 1, at + 1 + len(p.count)), slice(end, end + len(p.receiver))
            self._first[rows] = np.cumsum(p.count, dtype=np.uint32) + np.uint32(end)
            self._receiver[entries], self._distance[entries] = p.receiver, p.distance
            at, end = at + len(p.count), entries.stop
            self._photons, self._vertices = self._photons + p.photons, at
            if end // ENTRIES_PER_STEP > merged:
                merged = end // ENTRIES_PER_STEP
                pause()

    def subtract(self, removed_suffixes: RemovedSuffixes, radius: float, first: int, last: int, sums: Sums) -> int:
        """Subtract removed suffixes first .. last - 1 from the sums of discs; return the number of intersections."""
        removed = removed_suffixes.of(slice(first, last))
        return _subtract(self._first, self._receiver, self._distance, removed, begins(removed, radius), sums)


def _grown(array: np.ndarray, used: int, n: int) -> np.ndarray:
    """Return the array, reallocated if it has fewer than n entries; `used` of them count."""
    if n <= len(array):
        return array
    out = np.empty(max(n, len(array) * 5 // 4), array.dtype)
    for first in range(0, used, ENTRIES_PER_STEP):
        part = slice(first, min(first + ENTRIES_PER_STEP, used))
        out[part] = array[part]
        pause()
    return out


@allocating
def _by_vertex(bounce, log, n, count, receiver, distance):
    """Sort the first n records of a log by start vertex, and count them per vertex."""
    vertex = np.empty(len(bounce), np.int64)
    v = -1
    for k in range(len(bounce)):
        v += 2 if bounce[k] == 0 and k > 0 else 1  # skip the last vertex of the previous photon
        vertex[k] = v
    for e in range(n):
        count[vertex[log.line[e]]] += 1
    cursor = np.zeros(len(count) + 1, np.int64)
    for v in range(len(count)):
        cursor[v + 1] = cursor[v] + count[v]
    for e in range(n):
        v = vertex[log.line[e]]
        receiver[cursor[v]], distance[cursor[v]] = log.receiver[e], log.distance[e]
        cursor[v] += 1


@kernel
def _subtract(first, receiver, distance, removed, low, sums):
    total = 0
    for j in range(len(low)):
        v, end = removed.vertex[j], removed.paths.offsets[removed.photon[j] + 1] - 1
        first_channel = 3 * removed.paths.lamp[removed.photon[j]]
        for k in range(v, end):
            for e in range(first[k], first[k + 1]):
                if k > v or distance[e] >= low[j]:
                    i = receiver[e]
                    sums.touched[(sums.first + i) >> CHUNK_BITS] = True
                    for c in range(3):
                        sums.flux[i, first_channel + c] -= removed.paths.flux[k, c]
                    total += 1
    return total


PIECE = 1 << 15  # segments between two pauses of evaluate()


class SegmentBatch(NamedTuple):
    """Segments to add `sign` times to the sums of object o's receivers."""

    o: int
    segments: Segments
    sign: int
    to: ThreadSums


class TangentPlane(AdditiveEstimator):
    """The estimator of the module; `radius` [m] of the discs."""

    about = "Density Estimation on the Tangent Plane (Lastra et al. 2002): the flux of the segments that cross a disc."
    controlled, smoothing = True, "radius"

    def __init__(self, model: Model, setting: Setting):
        whole_disc = math.pi * setting.radius * setting.radius
        super().__init__(model, setting, np.full(len(model.object_receivers.areas), whole_disc))
        self.radius, self.control, self._search = setting.radius, setting.control, SEARCHES[setting.search]
        self._channels = model.emitters.lamps.channels
        self._intersections = IntersectionCache()  # of background segments with static discs
        self._contact: ContactDiscs | None = None

    def copied(self, model: Model, setting: Setting) -> TangentPlane:
        other = super().copied(model, setting)
        other._intersections = self._intersections.copied()
        return other

    @staticmethod
    def summary(setting: Setting) -> str:
        return f"radius {setting.radius:.3g} m"

    def build(self) -> None:
        own, r = self.model.receiver_sides, self.model.object_receivers
        self.searches = []
        for o in range(self.model.surfaces.objects):
            rows = self.model.surfaces.receiver_range(o)
            if self.control:
                region = regions(self.model, o, self.radius)
                region = room_for_contacts(region) if o else region
            else:
                region = whole_discs(self.model, o, self.radius)
            self.area[rows] = region.area
            positions = np.ascontiguousarray(r.positions[rows], np.float32)
            normals = np.ascontiguousarray(r.normals[rows], np.float32)
            discs = Discs(positions, normals, own[rows], self.model.backs(o), np.float32(self.radius), region)
            self.searches.append(self._search(discs))
            pause()
        self._contact = ContactDiscs(self.model, self.radius, [s.discs for s in self.searches], self.control)
        self._contact.build()

    def crossing(self, receiver: int, segments: Segments, at: Transforms) -> np.ndarray:
        """Return which segments (n,) bool count at a receiver, at the poses `at`."""
        o, disc, _ = self.disc(receiver, at)
        out = np.zeros(segments.size, bool)
        crossing(disc, 0, lines(segments, at.rotation[o], at.position[o], self.model, self.radius), out)
        return out

    def disc(self, receiver: int, at: Transforms) -> tuple[int, Discs, bool]:
        """Return the object of a receiver, its disc in the object's space with its region at poses, and whether it sums
        current segments. Others change the background's sums by suffixes."""
        first = self.model.surfaces.first_receiver
        o = int(np.searchsorted(first[1:], receiver, side="right"))
        i, discs = receiver - int(first[o]), self.searches[o].discs
        row, reach, area = discs.regions
        distances = reach[row[i] : row[i] + 1] if row[i] >= 0 else reach[:0]
        own = Regions(np.minimum(row[i : i + 1], 0), distances, area[i : i + 1])
        shortened = self._contact.contacts_at(at, mobiles=True).regions[o]
        k = int(np.searchsorted(shortened.rows, i))
        if is_shortened := k < len(shortened.rows) and bool(shortened.rows[k] == i):
            own = Regions(np.zeros(1, np.int32), shortened.reach[k : k + 1], shortened.area[k : k + 1])
        alone = (a[i : i + 1] for a in (discs.positions, discs.normals, discs.own, discs.back))
        return o, Discs(*alone, discs.radius, own), o > 0 or is_shortened

    @property
    def bytes_per_hit(self) -> int:
        return self._intersections.bytes_per_vertex

    def add_background(self, segments: Segments, thread: int) -> None:
        apart, sums = self._background.apart(segments), self._background.added[thread]

        def accumulate(sign: int, log: IntersectionLog) -> None:
            self._accumulate_part(0, apart, self.model.static, sign, sums._replace(log=log))

        self._intersections.find(segments, accumulate)

    def prepare(self, photons: int) -> None:
        self._intersections.settle()
        super().prepare(photons)

    def wanted(self, at: Transforms, mobiles: bool) -> Wanted:
        return self._contact.wanted(at, mobiles)

    def evaluate(self, frame: PoseChange) -> Evaluated:
        added, removed_suffixes = self._frame.added, frame.removed_suffixes
        batches = [SegmentBatch(0, frame.new_suffixes, 1, self._frame.new_suffixes)]
        batches += [SegmentBatch(o, segments, 1, added) for o, segments in enumerate(frame.near_mobiles, 1)]
        if not self._intersections.complete:
            batches, removed_suffixes = (
                [SegmentBatch(0, removed_suffixes.segments(self.model.threads), -1, added), *batches],
                removed_suffixes.of(slice(0)),
            )
        contacts = self._contact.contacts_at(frame.at, mobiles=bool(frame.near_mobiles))
        try:
            with self._contact.regions_of(contacts):
                self._accumulate(batches, frame.at, removed_suffixes)
            rows, stale = self._contact.static_sums([frame.near_boxes], frame.at, contacts)
            added[0].touched[rows >> CHUNK_BITS] = True
            before = self._background.of(frame.photons, frame.direct)
            out = self._frame.collect(before, self._areas_of(contacts), frame.kept_prefixes)
        except BaseException:
            self._frame.clear()  # the next frame must not start with half of this one
            raise
        out.sums[rows], out.new_flux[rows] = stale, NOT_ADDITIVE
        self.control_facts = self._contact.facts(contacts)
        return out._replace(direct=frame.direct)

    def _areas_of(self, contacts: PoseContacts) -> np.ndarray:
        """Return the areas (R,) [m2] with these contacts; few differ from `area`."""
        rows, areas_there = self._contact.areas_of(contacts)
        if not len(rows):
            return self.area
        areas = self.area.copy()
        areas[rows] = areas_there
        return areas

    def counted(self, place: Place, find: Find) -> Counts:
        """Return the segments that count at the disc of a receiver.

        Some count that end before they cross it: see `predicate.accepts`.
        """
        model, at = self.model, place.at
        o, disc, current = self.disc(place.row, at)
        rule = counting.crossing(place, (2 + EXTENSION) * place.radius)
        kept, removed, added = find(rule, current=current)
        about = f"segments across the disc of {place.radius:.3g} m"
        if disc.regions.row[0] < 0:
            outline = counting.circle(place, place.radius)
        else:
            rim = counting.polygon(disc.regions.reach[0], model.object_receivers.normals[place.row], place.radius)
            outline = rim @ at.rotation[o].T + place.position
            about = f"{about}, as far as light can reach it (artifact control)"
        kept, removed, added = (rows_of(s, self.crossing(place.row, s, at)) for s in (kept, removed, added))
        return Counts((kept, removed, added), outline, about)

    def from_scratch(self, parts: Iterable[Segments], at: Transforms, direct: bool = True) -> Evaluated:
        shape = len(self.area), self._channels
        added, new_suffixes = (ThreadSums(*shape, self.model.threads) for _ in range(2))
        sums, behind_cuts = np.zeros((2, *shape), np.int64)
        cut, stale, contacts = CutFlux.none(self._channels // 3), 0, self._contact.contacts_at(at, mobiles=True)
        for segments in parts:
            kept_prefixes, behind = split_at_cuts(segments)
            cut = cut.plus(kept_prefixes)
            segments, behind = (s if direct else bounced(s) for s in (segments, behind))
            with self._contact.regions_of(contacts):
                batches = [SegmentBatch(o, segments, 1, added) for o in range(self.model.surfaces.objects)]
                self._accumulate([*batches, SegmentBatch(0, behind, 1, new_suffixes)], at)
            stale = stale + self._contact.static_sums([segments], at, contacts)[1]
        added.move_to(sums)
        new_suffixes.move_to(behind_cuts)
        new_flux = behind_cuts.reshape(len(sums), self._channels // 3, 3).sum(axis=2)
        areas, rows = self._areas_of(contacts), contacts.regions[0].rows
        sums[rows], new_flux[rows] = stale, NOT_ADDITIVE
        return Evaluated.of_all(sums, areas, new_flux, cut, direct)

    def _accumulate(
        self, batches: list[SegmentBatch], at: Transforms, removed_suffixes: RemovedSuffixes | None = None
    ) -> None:
        """Accumulate batches, and subtract removed suffixes from the frame's sums, with a pause after each PIECE.

        Each thread takes its share of each batch, so that all threads end at about the same time.
        """
        for piece in _pieces(batches):
            self._accumulate_piece(piece, at, removed_suffixes)
            removed_suffixes = None
            pause()

    def _accumulate_piece(
        self, batches: list[SegmentBatch], at: Transforms, removed_suffixes: RemovedSuffixes | None
    ) -> None:
        threads = min(usable(self.model.threads), 1 + sum(batch.segments.size for batch in batches) // CHEAP)

        def work(part, *_):
            if removed_suffixes is not None:
                gone = share(len(removed_suffixes.photon), part, threads)
                sums = self._frame.added[part].of(self.model.surfaces.receiver_range(0))
                self._intersections.subtract(removed_suffixes, self.radius, *gone, sums)
            for o, segments, sign, to in batches:
                mine = slice(*share(segments.size, part, threads))
                sums = to[part].of(self.model.surfaces.receiver_range(o))
                self._accumulate_part(o, rows_of(segments, mine), at, sign, sums)

        run_ranges(work, threads, threads, 1)

    def _accumulate_part(self, o: int, segments: Segments, at: Transforms, sign: int, sums: Sums) -> None:
        if segments.size and len(sums.flux):
            ready = lines(segments, at.rotation[o], at.position[o], self.model, self.radius)
            self.searches[o].accumulate(ready, sign, sums)


def _pieces(batches: list[SegmentBatch]) -> Iterator[list[SegmentBatch]]:
    """Split batches into lists of at most PIECE segments each; at least one list."""
    piece: list[SegmentBatch] = []
    room = PIECE
    for batch in batches:
        for first in range(0, batch.segments.size, PIECE):
            part = batch._replace(segments=rows_of(batch.segments, slice(first, first + PIECE)))
            if part.segments.size > room:
                yield piece
                piece, room = [], PIECE
            piece.append(part)
            room -= part.segments.size
    yield piece
