"""Dynamic occluders: receivers whose regions other objects shorten at the poses of a frame (report 1.2.1).

`region.py` measures a region against the receiver's own object, once. This module adds the other objects at the poses
of a frame. A mobile on a floor shortens regions of the floor, the floor those of the mobile, and mobiles those of each
other. Both distances of a direction become the minimum of the old one and the distance to the other object. Few
receivers are affected. Boxes of mobiles select static discs, and a coarse grid of the static part selects receivers of
mobiles. The result is a function of the poses alone.

Sums of such a receiver are not additive, because its region differs from that in the background. Receivers on mobiles
are estimated from all current segments anyway, here with the region of the pose. Static receivers are *stale*: they are
estimated again from all current segments near them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.pause import pause, pieces
from gi_core.base.random_numbers import basis
from gi_core.base.threads import CHEAP, run_ranges
from gi_core.base.vec import cell_of, cross, difference, dot, rotate, rotate_back, row
from gi_core.discs.region import COS, PROBES, RAYS, SIN, Regions, levels, look_from, polygon_areas
from gi_core.discs.search.disc_index import CELL_RADII, DiscIndex
from gi_core.discs.search.predicate import Discs, lines, longest_extension
from gi_core.geometry.receivers import NONE
from gi_core.model import Model
from gi_core.photons.flux_sums import Sums
from gi_core.photons.paths import Segments
from gi_core.rays.accelerator import CUT_PAD, Transforms, passes_box
from gi_core.retrace.cuts import Wanted
from gi_core.scene.pose import to_world_at


class SurfaceCells(NamedTuple):
    """Grid cells, marked if a surface lies within a given distance of any of their points."""

    near: np.ndarray  # (cells,) bool
    low: np.ndarray  # (3,) float64, corner of the grid [m]
    cell: float  # [m]
    shape: np.ndarray  # (3,) int64


def surface_cells(vertices: np.ndarray, faces: np.ndarray, reach: float) -> SurfaceCells:
    """Mark the cells within `reach` [m] of faces (F, 3) of vertices (V, 3)."""
    if not len(faces):
        return SurfaceCells(np.zeros(1, bool), np.full(3, np.inf), 1.0, np.ones(3, np.int64))
    low, high = vertices.min(axis=0) - reach, vertices.max(axis=0) + reach
    cell = max(reach, float((high - low).max()) / 1024)
    while float(np.prod(np.floor((high - low) / cell) + 1)) > 1 << 22:  # 1 << 22 cells, 4 MB; cells grow instead
        cell *= 1.26
    shape = np.floor((high - low) / cell).astype(np.int64) + 1
    near = np.zeros(int(shape.prod()), bool)
    for part in pieces(len(faces)):
        _mark(vertices, faces[part], reach, low, cell, shape, near)
    return SurfaceCells(near, low, cell, shape)


@kernel
def _range(a, b, low, cell, n):
    """Return the first and last cell that [a, b] covers along an axis; last < first for none."""
    first, last = (a - low) / cell, (b - low) / cell
    if not (last >= 0.0 and first < n):
        return 0, -1
    return max(int(math.floor(max(first, 0.0))), 0), min(int(math.floor(min(last, float(n)))), n - 1)


@kernel
def _mark(vertices, faces, reach, low, cell, shape, near):
    """Mark cells near the box and near the plane of a triangle; tilted floors have large boxes."""
    half = reach + 0.8661 * cell  # half the diagonal of a cell, rounded up
    for f in range(len(faces)):
        a, b, c = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
        nx, ny, nz = cross(difference(b, a), difference(c, a))
        limit = half * math.sqrt(dot((nx, ny, nz), (nx, ny, nz)))
        x0, x1 = _range(min(a[0], b[0], c[0]) - reach, max(a[0], b[0], c[0]) + reach, low[0], cell, shape[0])
        y0, y1 = _range(min(a[1], b[1], c[1]) - reach, max(a[1], b[1], c[1]) + reach, low[1], cell, shape[1])
        z0, z1 = _range(min(a[2], b[2], c[2]) - reach, max(a[2], b[2], c[2]) + reach, low[2], cell, shape[2])
        for x in range(x0, x1 + 1):
            dx = nx * (low[0] + (x + 0.5) * cell - a[0])
            for y in range(y0, y1 + 1):
                dy = dx + ny * (low[1] + (y + 0.5) * cell - a[1])
                for z in range(z0, z1 + 1):
                    if abs(dy + nz * (low[2] + (z + 0.5) * cell - a[2])) <= limit:
                        near[(x * shape[1] + y) * shape[2] + z] = True


@kernel
def box_is_near(near, low, cell, shape, box_low, box_high):
    """Return whether any cell that a box covers is marked."""
    x0, x1 = _range(box_low[0], box_high[0], low[0], cell, shape[0])
    y0, y1 = _range(box_low[1], box_high[1], low[1], cell, shape[1])
    z0, z1 = _range(box_low[2], box_high[2], low[2], cell, shape[2])
    for x in range(x0, x1 + 1):
        for y in range(y0, y1 + 1):
            for z in range(z0, z1 + 1):
                if near[(x * shape[1] + y) * shape[2] + z]:
                    return True
    return False


@kernel
def points_near(near, low, cell, shape, points, R, p, out):
    """List the points (n, 3), moved to the world by R and p, that lie in marked cells; return their number."""
    n = 0
    for k in range(len(points)):
        x, y, z = rotate(R, points[k])
        i, j, m = cell_of(x + p[0], low[0], cell), cell_of(y + p[1], low[1], cell), cell_of(z + p[2], low[2], cell)
        if 0 <= i < shape[0] and 0 <= j < shape[1] and 0 <= m < shape[2] and near[(i * shape[1] + j) * shape[2] + m]:
            out[n] = k
            n += 1
    return n


ALL, PROBED, REST = range(3)  # subsets of a receiver's directions
_STRIDE = RAYS // PROBES


class ShortenedRegions(NamedTuple):
    """Receivers of one object with regions shortened by other objects, and their regions at the pose."""

    rows: np.ndarray  # (n,) int64, index within the object, ascending
    reach: np.ndarray  # (n, RAYS, 2) uint8, as in Regions
    area: np.ndarray  # (n,) float64 [m2]


NO_REGIONS = ShortenedRegions(np.empty(0, np.int64), np.empty((0, RAYS, 2), np.uint8), np.empty(0))


class PoseContacts(NamedTuple):
    """Regions that objects shorten mutually, at some poses."""

    regions: tuple[ShortenedRegions, ...]  # per object
    static_rows: tuple[np.ndarray, ...]  # per mobile: (n,) int64, static receivers whose regions it shortens


class ContactSearch:
    """Search for contacts at any poses; `regions`: those of each object alone. radius [m]."""

    def __init__(self, model: Model, radius: float, regions: list[Regions]):
        self._model, self._radius, self._regions = model, radius, regions
        self._accelerator = model.accelerator.opaque

    def build(self) -> None:
        """Place receivers, and mark cells near surfaces."""
        m, s = self._model, self._model.surfaces
        self._origins, self._normals = [], []
        for o in range(s.objects):
            points, normals = look_from(m, o, self._radius)
            self._origins.append(np.ascontiguousarray(points, np.float32))
            self._normals.append(np.ascontiguousarray(normals))
            pause()
        self._cells = surface_cells(s.vertices[0], s.faces[0], 1.001 * self._radius)

    def at(self, at: Transforms, mobiles: bool) -> PoseContacts:
        """Return the contacts at poses `at`, on static receivers and, if `mobiles`, on receivers of mobiles."""
        objects = self._model.surfaces.objects
        shortened, static_rows = [NO_REGIONS] * objects, ()
        for o in range(objects if mobiles else 1):
            pairs = [self._shortened(o, b, at) for b in range(objects) if b != o]
            if o == 0:
                static_rows = tuple(rows for rows, _ in pairs)
            shortened[o] = self._regions_of(o, pairs)
        return PoseContacts(tuple(shortened), static_rows)

    def _regions_of(self, o: int, pairs) -> ShortenedRegions:
        """Return the shortened regions of object o from pairs of rows and distances (n, RAYS) float32 [m]."""
        pairs = [(rows, distances) for rows, distances in pairs if len(rows)]
        if not pairs:
            return NO_REGIONS
        rows, where = np.unique(np.concatenate([rows for rows, _ in pairs]), return_inverse=True)
        shortest = np.full((len(rows), RAYS), np.float32(self._radius))
        first = 0
        for part, distances in pairs:
            here = where[first : first + len(part)]
            shortest[here] = np.minimum(shortest[here], distances)
            first += len(part)
        alone = self._regions[o]
        before = np.full((len(rows), RAYS, 2), 255, np.uint8)
        has = alone.row[rows] >= 0
        before[has] = alone.reach[alone.row[rows[has]]]
        reach = np.minimum(before, levels(shortest, self._radius)[:, :, None])
        keep = (reach < before).any(axis=(1, 2)) & (alone.area[rows] > 0)
        return ShortenedRegions(rows[keep], reach[keep], polygon_areas(reach[keep], self._radius))

    def _shortened(self, o: int, b: int, at: Transforms) -> tuple[np.ndarray, np.ndarray]:
        """Return receivers of object o whose discs object b enters, and the distances (n, RAYS) float32 [m] to it."""
        rows = self._candidates(o, b, at)
        distances = np.full((len(rows), RAYS), np.float32(self._radius))
        if len(rows) and b == 0:
            # Near a wall most receivers of a mobile hit nothing: test a few directions first.
            self._look(o, b, at, rows, PROBED, distances)
            hit = (distances < np.float32(self._radius)).any(axis=1)
            rows, distances = rows[hit], distances[hit]
            self._look(o, b, at, rows, REST, distances)
        elif len(rows):
            self._look(o, b, at, rows, ALL, distances)
        hit = (distances < np.float32(self._radius)).any(axis=1)
        return rows[hit], distances[hit]

    def _candidates(self, o: int, b: int, at: Transforms) -> np.ndarray:
        """Return the receivers (n,) int64 of object o whose discs may come near object b, in any order."""
        world, R, p, origins = self._model.world, at.rotation, at.position, self._origins[o]
        if not len(self._model.surfaces.faces[b]) or not len(origins):
            return np.empty(0, np.int64)
        out = np.empty(len(origins), np.int64)
        if b == 0:
            low, high = _box_in_world(R[o], p[o], world.box_low[o], world.box_high[o], 0.02 * self._radius)
            if not box_is_near(*self._cells, low, high):
                return out[:0]
            return out[: points_near(*self._cells, origins, R[o], p[o], out)]
        pad = self._radius + CUT_PAD * world.size
        box = world.box_low[b], world.box_high[b]
        if o == 0:
            listed = out[: _in_box(origins, *_box_in_world(R[b], p[b], *box, pad), out)]
        else:
            off = _to_world(R[o], p[o], world.sphere_centre[o]) - _to_world(R[b], p[b], world.sphere_centre[b])
            if np.sqrt((off * off).sum()) > world.sphere_radius[o] + world.sphere_radius[b] + 1.1 * pad:
                return out[:0]
            listed = np.arange(len(origins))
        near = _discs_near(listed, origins, self._normals[o], R, p, o, b, *box, self._radius, CUT_PAD * world.size)
        return listed[:near]

    def _look(self, o: int, b: int, at: Transforms, rows: np.ndarray, which: int, distances: np.ndarray) -> None:
        """Shorten distances (n, RAYS) float32 [m] to the hits on object b, along a subset of the directions."""
        world, most = self._model.world, len(rows) * RAYS
        origins, directions = np.empty((most, 3), np.float32), np.empty((most, 3), np.float32)
        place = np.empty(most, np.int64)
        rays = origins, directions, place
        n = _rays(rows, which, self._origins[o], self._normals[o], at, world, o, b, self._radius, rays)
        limits = np.full(n, self._radius, np.float32)
        distance, face = self._accelerator.nearest(b, origins[:n], directions[:n], limits)
        hit = face >= 0
        distances.reshape(-1)[place[:n][hit]] = distance[hit]


def _to_world(R: np.ndarray, p: np.ndarray, x: np.ndarray) -> np.ndarray:
    return (R * x).sum(axis=1) + p


def _box_in_world(R: np.ndarray, p: np.ndarray, low: np.ndarray, high: np.ndarray, pad: float):
    """Return low and high (3,) of the bounding box of a rotated and moved box, grown by `pad` [m]."""
    centre, half = _to_world(R, p, (low + high) / 2), (np.abs(R) * (high - low) / 2).sum(axis=1) + pad
    return centre - half, centre + half


@kernel
def _in_box(points, low, high, out):
    """List the points (n, 3) in a box; return their number."""
    n = 0
    for k in range(len(points)):
        x, y, z = row(points, k)
        if low[0] <= x <= high[0] and low[1] <= y <= high[1] and low[2] <= z <= high[2]:
            out[n] = k
            n += 1
    return n


@kernel
def _discs_near(rows, origins, normals, rotation, position, o, b, low, high, radius, pad):
    """Move the rows whose discs' boxes intersect object b's box to the front of `rows`; return their number."""
    Ra, pa, Rb, pb = rotation[o], position[o], rotation[b], position[b]
    n = 0
    for j in range(len(rows)):
        i = rows[j]
        x, y, z = _across(Ra, pa, Rb, pb, origins[i, 0], origins[i, 1], origins[i, 2], 1.0)
        u, v, w = _across(Ra, pa, Rb, pb, normals[i, 0], normals[i, 1], normals[i, 2], 0.0)
        hx = radius * np.sqrt(max(1.0 - u * u, 0.0)) + pad
        hy = radius * np.sqrt(max(1.0 - v * v, 0.0)) + pad
        hz = radius * np.sqrt(max(1.0 - w * w, 0.0)) + pad
        meets_x = x - hx <= high[0] and x + hx >= low[0]
        if meets_x and y - hy <= high[1] and y + hy >= low[1] and z - hz <= high[2] and z + hz >= low[2]:
            rows[n] = i
            n += 1
    return n


@kernel
def _across(Ra, pa, Rb, pb, x, y, z, moved):
    """Transform a point (moved 1) or a direction (0) between object spaces, through float32 in the world.

    The bits of a ray must not depend on the other rays of the call.
    """
    u, v, w = rotate(Ra, (x, y, z))
    u, v, w = np.float32(u + moved * pa[0]), np.float32(v + moved * pa[1]), np.float32(w + moved * pa[2])
    return rotate_back(Rb, (u - moved * pb[0], v - moved * pb[1], w - moved * pb[2]))


@kernel
def _rays(rows, which, origins, normals, at, world, o, b, radius, out):
    """Write the rays in the tangent planes of receivers that pass object b's box; return their number."""
    ray_origins, ray_directions, place = out
    low, high, pad = world.box_low[b], world.box_high[b], CUT_PAD * world.size
    Ra, pa, Rb, pb = at.rotation[o], at.position[o], at.rotation[b], at.position[b]
    n = 0
    for j in range(len(rows)):
        i = rows[j]
        m = normals[i]
        ax, ay, az, bx, by, bz = basis(m[0], m[1], m[2])
        x, y, z = _across(Ra, pa, Rb, pb, origins[i, 0], origins[i, 1], origins[i, 2], 1.0)
        for k in range(RAYS):
            if which != ALL and (k % _STRIDE == 0) != (which == PROBED):
                continue
            c, s = COS[k], SIN[k]
            dx, dy, dz = _across(Ra, pa, Rb, pb, c * ax + s * bx, c * ay + s * by, c * az + s * bz, 0.0)
            ex, ey, ez = x + radius * dx, y + radius * dy, z + radius * dz
            if passes_box(x, y, z, ex, ey, ez, low, high, pad):
                ray_origins[n, 0], ray_origins[n, 1], ray_origins[n, 2] = x, y, z
                ray_directions[n, 0], ray_directions[n, 1], ray_directions[n, 2] = dx, dy, dz
                place[n] = j * RAYS + k
                n += 1
    return n


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
        search = DiscIndex(discs, cell_radii=CELL_RADII)
        sums = [Sums.zeros(n, channels) for _ in range(self.model.threads)]
        for segments in parts:

            def work(thread, first, last, segments=segments):
                share = Segments(*(a[first:last] for a in segments))
                ready = lines(share, at.rotation[0], at.position[0], self.model, self.radius)
                search.accumulate(ready, 1, sums[thread])

            run_ranges(work, segments.size, self.model.threads, CHEAP)
        return rows, sum(s.flux for s in sums)
