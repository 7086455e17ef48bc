"""Discs in contact: estimating the receivers whose regions other objects shorten at the poses of a frame.

Sums of such a receiver are not additive: its region is not what it is in the background. On a mobile it is
estimated from all current segments anyway, with the region of the pose in place of its own. On the static
part it is *stale* (design: estimators tell which receivers are), and estimated again from all current
segments near it.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from gi_core.base.threads import run_ranges
from gi_core.discs.contact.contact import NOTHING, Contacts, Met
from gi_core.discs.region import RAYS, Regions
from gi_core.discs.search.brute_force import BruteForce
from gi_core.discs.search.disc_grid import DiscGrid
from gi_core.discs.search.predicate import Discs, lines, to_list
from gi_core.geometry.sides import NONE
from gi_core.model import Model
from gi_core.photons.flux_sums import Sums
from gi_core.photons.paths import Segments
from gi_core.rays.accelerator import Transforms
from gi_core.retrace.cuts import Wanted
from gi_core.scene.pose import to_world_at

LINE_GRAIN = 1024  # segments a thread
FEW = 128  # discs: more repay the millisecond that a grid over them costs


def room_for_contacts(region: Regions) -> Regions:
    """Return the regions with a spare row for each receiver, behind the others."""
    spare = np.zeros((len(region.row), RAYS, 2), np.uint8)
    return Regions(region.row, np.concatenate([region.reach, spare]), region.area)


class ControlFacts(NamedTuple):
    """How many receivers artifact control concerns."""

    share: float  # of all receivers, those whose discs their own object enters (photon_map: at borders); at any poses
    stale: int  # static receivers that were estimated again in the last frame, because a mobile enters their discs
    on_mobiles: int  # receivers of mobiles whose discs other objects enter in the last frame; none where they gather


class ContactDiscs:
    """The discs of all objects, and which of them are in contact."""

    def __init__(self, model: Model, radius: float, discs: list[Discs], control: bool):
        """discs: one an object, those of mobiles with room_for_contacts(); without `control` nothing ever meets."""
        self.model, self.radius, self._discs = model, radius, discs
        self._contacts = Contacts(model, radius, [d.regions for d in discs]) if control else None
        self._known: tuple[Transforms, bool, Met] | None = None
        count = sum(len(d.regions.row) for d in discs)
        self.share = sum(int((d.regions.row >= 0).sum()) for d in discs) / max(count, 1)

    def build(self) -> Generator[None, None, None]:
        """Prepare the search for contacts, in steps of a few ms."""
        if self._contacts and self.model.surfaces.objects > 1:
            yield from self._contacts.build()

    def met(self, at: Transforms, mobiles: bool) -> Met:
        """Return the contacts at some poses, on mobiles too or not; those of the last call are kept."""
        if not self._knows(at, mobiles):
            alone = Met((NOTHING,) * len(at.position), (NOTHING.rows,) * (len(at.position) - 1))
            together = self._contacts is not None and len(at.position) > 1
            self._known = at, mobiles, self._contacts.at(at, mobiles) if together else alone
        return self._known[-1]

    def _knows(self, at: Transforms, mobiles: bool) -> bool:
        if self._known is None or self._known[1] != mobiles:
            return False
        return all(np.array_equal(a, b) for a, b in zip(self._known[0], at, strict=True))

    def facts(self, met: Met) -> ControlFacts:
        """Return how many receivers contacts concern."""
        floor, *others = (len(c.rows) for c in met.contacts)
        return ControlFacts(self.share, floor, sum(others))

    def wanted(self, at: Transforms, mobiles: bool) -> Wanted:
        """Return which segments a frame must hold: those near mobiles, if their light is wanted, and near static
        receivers in contact.
        """
        m, boxes = self.model, []
        around = np.zeros(len(at.position) - 1)
        positions, normals = m.object_receivers.positions, m.object_receivers.normals
        for k, rows in enumerate(self.met(at, mobiles).floor):
            if len(rows):
                # Behind its hit a segment counts for up to 2 r on a concave side, for eps on any.
                own = m.receiver_sides[rows]
                behind = 2.0 * self.radius if m.concave[own[own >= 0]].any() else 0.0
                half = self.radius * np.sqrt(np.clip(1 - normals[rows] ** 2, 0, 1)) + behind + 2 * float(m.eps)
                boxes.append([(positions[rows] - half).min(axis=0), (positions[rows] + half).max(axis=0)])
                o = slice(k + 1, k + 2)
                middle = to_world_at(at.rotation[o], at.position[o], m.world.sphere_centre[o])
                off = positions[rows] - middle
                far = np.sqrt((off * off).sum(axis=1).max())
                around[k] = far + self.radius + behind + 2 * float(m.eps)
        return Wanted(self.radius if mobiles else 0.0, np.array(boxes).reshape(-1, 2, 3), around, mobiles)

    @contextmanager
    def regions_of(self, met: Met) -> Iterator[None]:
        """Let discs on mobiles have their regions in contact meanwhile; searches must not keep copies."""
        contacts, before = met.contacts, []
        for discs, contact in zip(self._discs[1:], contacts[1:], strict=True):
            row, reach, _ = discs.regions
            before.append(row[contact.rows])
            spare = len(reach) - len(row)
            if len(contact.rows):
                reach[spare + contact.rows] = contact.reach
                row[contact.rows] = spare + contact.rows
        try:
            yield
        finally:
            for discs, contact, rows in zip(self._discs[1:], contacts[1:], before, strict=True):
                discs.regions.row[contact.rows] = rows

    def areas_of(self, met: Met) -> tuple[np.ndarray, np.ndarray]:
        """Return receivers (n,) int64, of all objects, whose regions contacts shorten, and their areas (n,) [m2]."""
        first, contacts = self.model.surfaces.first_receiver, met.contacts
        rows = [first[o] + c.rows for o, c in enumerate(contacts)]
        return np.concatenate(rows), np.concatenate([c.area for c in contacts])

    def static_discs(self, met: Met) -> Discs:
        """Return the discs of the static receivers in contact, with their regions there."""
        contact, d = met.contacts[0], self._discs[0]
        rows, n = contact.rows, len(contact.rows)
        region = Regions(np.arange(n, dtype=np.int32), contact.reach, contact.area)
        alone = np.full(n, NONE, np.int32)  # each its own disc: few of them see both sides
        return Discs(d.positions[rows], d.normals[rows], d.own[rows], alone, d.radius, region)

    def static_sums(self, parts, at: Transforms, met: Met) -> tuple[np.ndarray, np.ndarray]:
        """Return static receivers (n,) int64 in contact and their sums (n, 3) int64 over parts (Segments)."""
        rows = met.contacts[0].rows
        n = len(rows)
        if not n:
            return rows, np.zeros((0, 3), np.int64)
        discs = self.static_discs(met)
        search = BruteForce(discs) if n <= FEW else DiscGrid(discs, np.flatnonzero(to_list(discs)))
        sums = [Sums.zeros(n) for _ in range(self.model.threads)]
        for segments in parts:

            def work(thread, first, last, segments=segments):
                share = Segments(*(a[first:last] for a in segments))
                ready = lines(share, at.rotation[0], at.position[0], self.model, self.radius)
                search.splat(ready, 1, sums[thread])

            run_ranges(work, segments.size, self.model.threads, LINE_GRAIN)
        return rows, sum(s.flux for s in sums)
