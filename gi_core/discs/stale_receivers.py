"""Estimates of receivers whose regions other objects shorten at the poses of a frame.

Sums of such a receiver are not additive, because its region differs from that in the background. Receivers on mobiles
are estimated from all current segments anyway, here with the region of the pose. Static receivers are *stale*: they are
estimated again from all current segments near them.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from gi_core.base.threads import run_ranges
from gi_core.discs.contact import NO_REGIONS, ContactSearch, PoseContacts
from gi_core.discs.region import RAYS, Regions
from gi_core.discs.search.brute_force import BruteForce
from gi_core.discs.search.disc_index import DiscGrid
from gi_core.discs.search.predicate import Discs, lines, longest_extension, to_list
from gi_core.geometry.receivers import NONE
from gi_core.model import Model
from gi_core.photons.flux_sums import Sums
from gi_core.photons.paths import Segments
from gi_core.rays.accelerator import Transforms
from gi_core.retrace.cuts import Wanted
from gi_core.scene.pose import to_world_at

FEW_DISCS = 128  # discs: with more, a grid over them (a millisecond) pays


def room_for_contacts(region: Regions) -> Regions:
    """Return the regions with one spare row per receiver, behind the others."""
    spare = np.zeros((len(region.row), RAYS, 2), np.uint8)
    return Regions(region.row, np.concatenate([region.reach, spare]), region.area)


class ControlFacts(NamedTuple):
    """Numbers of receivers under artifact control."""

    share: float  # of receivers whose discs their own object enters (photon_map: at borders), at any pose
    stale: int  # static receivers estimated again in the last frame, because a mobile enters their discs
    on_mobiles: int  # receivers of mobiles whose discs other objects enter in the last frame; 0 where mobiles gather


class ContactDiscs:
    """The discs of all objects, and their contacts at poses."""

    def __init__(self, model: Model, radius: float, discs: list[Discs], control: bool):
        """discs: one per object, of mobiles with room_for_contacts(). Without `control` there are no contacts."""
        self.model, self.radius, self._discs = model, radius, discs
        self._contacts = ContactSearch(model, radius, [d.regions for d in discs]) if control else None
        self._known: tuple[Transforms, bool, PoseContacts] | None = None
        count = sum(len(d.regions.row) for d in discs)
        self.share = sum(int((d.regions.row >= 0).sum()) for d in discs) / max(count, 1)

    def build(self) -> None:
        """Prepare the search for contacts."""
        if self._contacts and self.model.surfaces.objects > 1:
            self._contacts.build()

    def contacts_at(self, at: Transforms, mobiles: bool) -> PoseContacts:
        """Return the contacts at poses `at`, with or without those on mobiles; the last result is cached."""
        if not self._knows(at, mobiles):
            alone = PoseContacts((NO_REGIONS,) * len(at.position), (NO_REGIONS.rows,) * (len(at.position) - 1))
            together = self._contacts is not None and len(at.position) > 1
            self._known = at, mobiles, self._contacts.at(at, mobiles) if together else alone
        return self._known[-1]

    def _knows(self, at: Transforms, mobiles: bool) -> bool:
        if self._known is None or self._known[1] != mobiles:
            return False
        return all(np.array_equal(a, b) for a, b in zip(self._known[0], at, strict=True))

    def facts(self, contacts: PoseContacts) -> ControlFacts:
        """Return the numbers of receivers under artifact control."""
        static, *on_mobiles = (len(c.rows) for c in contacts.regions)
        return ControlFacts(self.share, static, sum(on_mobiles))

    def wanted(self, at: Transforms, mobiles: bool) -> Wanted:
        """Return the segments that a frame needs: near stale receivers and, for the light of mobiles, near mobiles."""
        m, boxes = self.model, []
        around, reach = np.zeros(len(at.position) - 1), longest_extension(m, at, self.radius)
        positions, normals = m.object_receivers.positions, m.object_receivers.normals
        for k, rows in enumerate(self.contacts_at(at, mobiles).static_rows):
            if len(rows):
                # A segment counts up to 2 r more behind its hit on a concave side.
                own = m.receiver_sides[rows]
                behind = 2.0 * self.radius if m.concave[own[own >= 0]].any() else 0.0
                half = self.radius * np.sqrt(np.clip(1 - normals[rows] ** 2, 0, 1)) + behind + 2 * reach
                boxes.append([(positions[rows] - half).min(axis=0), (positions[rows] + half).max(axis=0)])
                o = slice(k + 1, k + 2)
                middle = to_world_at(at.rotation[o], at.position[o], m.world.sphere_centre[o])
                off = positions[rows] - middle
                far = np.sqrt((off * off).sum(axis=1).max())
                around[k] = far + self.radius + behind + 2 * reach
        return Wanted(self.radius if mobiles else 0.0, np.array(boxes).reshape(-1, 2, 3), around, mobiles)

    @contextmanager
    def regions_of(self, contacts: PoseContacts) -> Iterator[None]:
        """Use the shortened regions of discs on mobiles in this context; searches must not copy regions."""
        contacts, before = contacts.regions, []
        try:
            for discs, contact in zip(self._discs[1:], contacts[1:], strict=True):
                row, reach, _ = discs.regions
                before.append(row[contact.rows])
                spare = len(reach) - len(row)
                if len(contact.rows):
                    reach[spare + contact.rows] = contact.reach
                    row[contact.rows] = spare + contact.rows
            yield
        finally:  # an interrupt may come before all are shortened
            for discs, contact, rows in zip(self._discs[1:], contacts[1:], before, strict=False):
                discs.regions.row[contact.rows] = rows

    def areas_of(self, contacts: PoseContacts) -> tuple[np.ndarray, np.ndarray]:
        """Return the receivers (n,) int64 of all objects with shortened regions, and their areas (n,) [m2]."""
        first, contacts = self.model.surfaces.first_receiver, contacts.regions
        rows = [first[o] + c.rows for o, c in enumerate(contacts)]
        return np.concatenate(rows), np.concatenate([c.area for c in contacts])

    def static_discs(self, contacts: PoseContacts) -> Discs:
        """Return the discs of stale receivers with their shortened regions."""
        contact, d = contacts.regions[0], self._discs[0]
        rows, n = contact.rows, len(contact.rows)
        region = Regions(np.arange(n, dtype=np.int32), contact.reach, contact.area)
        alone = np.full(n, NONE, np.int32)  # one disc per receiver: few are two-sided
        return Discs(d.positions[rows], d.normals[rows], d.own[rows], alone, d.radius, region)

    def static_sums(self, parts, at: Transforms, contacts: PoseContacts) -> tuple[np.ndarray, np.ndarray]:
        """Return stale receivers (n,) int64 and their sums (n, 3 G) int64 over parts (an iterable of Segments)."""
        rows = contacts.regions[0].rows
        n, channels = len(rows), self.model.emitters.lamps.channels
        if not n:
            return rows, np.zeros((0, channels), np.int64)
        discs = self.static_discs(contacts)
        search = BruteForce(discs) if n <= FEW_DISCS else DiscGrid(discs, np.flatnonzero(to_list(discs)))
        sums = [Sums.zeros(n, channels) for _ in range(self.model.threads)]
        for segments in parts:

            def work(thread, first, last, segments=segments):
                share = Segments(*(a[first:last] for a in segments))
                ready = lines(share, at.rotation[0], at.position[0], self.model, self.radius)
                search.accumulate(ready, 1, sums[thread])

            run_ranges(work, segments.size, self.model.threads, 1024)  # 1024 segments per thread
        return rows, sum(s.flux for s in sums)
