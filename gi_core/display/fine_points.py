"""Fine points: drawn points between receivers, where direct light bends along faces.

A picture interpolates light between receivers, which blurs contact shadows and draws teeth along borders of sunlight.
Edges of flat faces are cut where direct light differs most from the line between their ends, so that pieces follow
the borders of shadows. All faces at an edge are cut, so no picture has a gap. Light at a fine point is the interpolated
light of receivers without their direct light, plus direct light at the point itself (section 4.1 of the report). Light
of the sky is interpolated: it bends little, and has many points. Receivers and their light do not change. Points on a
mobile that has moved take interpolated light.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.vectors import length
from gi_core.display.dilation import Drawn
from gi_core.gather.direct_light import DirectLight, Places, joined
from gi_core.gather.hit_cache import pose_bits
from gi_core.geometry.error import luminance
from gi_core.geometry.receivers import weld
from gi_core.geometry.tessellation import Faces, edge_ends, heights, join_faces, split_edges
from gi_core.lights.lamps import mix
from gi_core.lights.next_event import DELTA, FACE
from gi_core.model import Model
from gi_core.rays.accelerator import Transforms

# Of direct light, or of half its mean: difference from the line between ends. 0: error beside things 1.3 to 2.4 %.
BENT = 0.05
SHORTEST_EDGE = 1e-3  # of the scene's size: edges that are not cut. 0: the same light for 25 % more time


def compile_kernels() -> None:
    """Run each kernel without points."""
    none, light = Cuts(np.zeros((0, 2), np.int64), np.zeros(0)), np.zeros((1, 3))
    _between_receivers(*none, 1, light, np.ones(1, np.float32))
    _visible_shares(*none, 1, np.zeros(1), np.zeros(1))
    none.fill(1, light)
    none.fill(1, np.zeros((1, 2), np.int32))


class Cuts(NamedTuple):
    """n new ids on edges."""

    ends: np.ndarray  # (n, 2) int64, the earlier ids that each lies between
    shares: np.ndarray  # (n,) float64, of the way from the first end to the second

    def fill(self, first: int, values: np.ndarray) -> None:
        """Write values (first + n, c): those between the ends; of integers those of the first end."""
        if np.issubdtype(values.dtype, np.integer):
            _inherit(self.ends, first, values)
        else:
            _interpolate(*self, first, values)


class FinePoints(NamedTuple):
    """n points, numbered after the R receivers."""

    parents: Cuts  # between receivers or earlier points
    pairs: tuple[Cuts, ...]  # per further id of corners
    source: np.ndarray  # (f,) int64, the face that each drawn face is a piece of
    ids: np.ndarray  # (f, 3, 2 + k) int64, of corners: point on the front, on the back (-1: none), further ids
    weights: np.ndarray  # (f, 3, 3) float64, of the source's corners, per corner
    direct: tuple[DirectLight, DirectLight]  # of receivers, and of the points; without that of the sky
    objects: np.ndarray  # (R + n,) int64, of receivers and points
    poses: Transforms  # that the points suit

    def between(self, drawn: Drawn) -> Drawn:
        """Return light (R + n, 3) of receivers and points, and its weights: interpolated at points."""
        E, n = drawn.irradiance, len(drawn.irradiance) + len(self.parents.shares)
        light, weights = np.empty((n, 3)), np.ones(n, np.float32)
        light[: len(E)] = E
        if drawn.weights is not None:
            weights[: len(E)] = drawn.weights
        _between_receivers(*self.parents, len(E), light, weights)
        return Drawn(light, weights)

    def at(self, at: Transforms, levels: np.ndarray, interpolated: Collection[int] = ()) -> FineLight:
        """Return the light of points at poses, and levels (G, 3) of the lamps.

        interpolated: objects whose receivers have other direct light; their points take interpolated light.
        At poses that the points do not suit, the share of direct light that mobiles leave is interpolated between
        receivers: 50,000 points in the light that mobiles may block take 5 to 20 ms.
        """
        of_receivers, of_points = self.direct
        receivers = of_receivers.at(at, levels)
        moved = {o for o in range(len(at.position)) if pose_bits(at, o) != pose_bits(self.poses, o)}
        stay = ~np.isin(self.objects, [*moved, *interpolated])[:, None]
        first = len(receivers)
        if not moved:
            return FineLight(self, receivers * stay[:first], of_points.at(at, levels) * stay[first:])
        full = luminance(mix(np.concatenate([of_receivers.per_lamp, of_points.per_lamp]), levels))
        share = np.ones(len(full))
        lit = full[:first] > 0
        share[:first][lit] = luminance(receivers[lit]) / full[:first][lit]
        _visible_shares(*self.parents, first, full, share)
        own = mix(of_points.per_lamp, levels) * share[first:, None]
        return FineLight(self, receivers * stay[:first], own * stay[first:])


class FineLight(NamedTuple):
    """Direct light by the same points on lights, past mobiles."""

    points: FinePoints
    receivers: np.ndarray  # (R, 3) [W/m2]
    own: np.ndarray  # (n, 3) [W/m2], of fine points

    def of(self, drawn: Drawn) -> Drawn:
        """Return light for pictures of receivers and fine points (R + n, 3) [W/m2], and its weights."""
        E, n = drawn.irradiance, len(self.receivers)
        light, weights = self.points.between(drawn._replace(irradiance=E - self.receivers))
        light[:n] = E
        np.maximum(light[n:] + self.own, 0.0, out=light[n:])
        return Drawn(light, weights)


@kernel
def _between_receivers(ends, shares, first, light, weights):
    """Write light (R + n, 3) and weights (R + n,) of points from `first` on: weighted means of their two ends.

    A point between a receiver that light reaches and one that it does not is reached.
    """
    for k in range(len(ends)):
        p, q, r = ends[k, 0], ends[k, 1], first + k
        a, b = (1.0 - shares[k]) * weights[p], shares[k] * weights[q]
        for c in range(3):
            light[r, c] = (a * light[p, c] + b * light[q, c]) / (a + b)
        weights[r] = max(weights[p], weights[q])


@kernel
def _visible_shares(ends, shares, first, full, visible):
    """Write the shares (R + n,) of direct light of points from `first` on that mobiles leave: means of their ends.

    full (R + n,): luminance of direct light without mobiles, which weighs them.
    """
    for k in range(len(ends)):
        p, q = ends[k, 0], ends[k, 1]
        a, b = (1.0 - shares[k]) * full[p], shares[k] * full[q]
        visible[first + k] = (a * visible[p] + b * visible[q]) / (a + b) if a + b > 0.0 else 1.0


@kernel
def _interpolate(ends, shares, first, values):
    for k in range(len(ends)):
        for c in range(values.shape[1]):
            values[first + k, c] = (1.0 - shares[k]) * values[ends[k, 0], c] + shares[k] * values[ends[k, 1], c]


@kernel
def _inherit(ends, first, values):
    for k in range(len(ends)):
        for c in range(values.shape[1]):
            values[first + k, c] = values[ends[k, 0], c]


def fine_points(
    model: Model, seed: int, at: Transforms, corners: np.ndarray, most: int = 40_000
) -> Iterator[FinePoints]:
    """Yield the fine points at poses, of lamps at full level, after each round of cuts.

    None come where lights have no points.

    corners (F, 3, k) int: further ids of corners of all faces, such as draw vertices; most: points. 60,000 leave
    direct light 3.5 for 4.8 % off in the classroom, 1.5 for 1.6 in the office, with 40,000 more faces to draw.
    """
    direct = DirectLight(model, seed, (FACE, DELTA)).measured_at(Places.at_poses(model, at))
    if not direct.is_known:
        return
    cutting, cut = _Cutting(model, direct, at, corners), True
    while cut and cutting.count < most:
        cut = cutting.go_on(most)
        yield cutting.points()


class _Bends(NamedTuple):
    """Where light bends most along n edges, of the places looked at."""

    ends: np.ndarray  # (n, 2) int64
    share: np.ndarray  # (n,) of the way between the ends
    bend: np.ndarray  # (n,)

    def look(self, rows: np.ndarray, step: float, bend_at: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> None:
        """Look a step to both sides along edges `rows`; bend_at(ends, share): returns the bend there."""
        ends, share = self.ends[rows], self.share[rows]
        for aside in share - step, share + step:
            bend = bend_at(ends, aside)
            more = bend > self.bend[rows]
            self.share[rows[more]], self.bend[rows[more]] = aside[more], bend[more]


class _Cutting:
    """Rounds of cuts. Edges of a piece that are new belong to pieces of the same round alone."""

    def __init__(self, model: Model, direct: DirectLight, at: Transforms, corners: np.ndarray):
        surfaces, receivers = model.surfaces, len(model.object_receivers.areas)
        n = surfaces.receiver_range(0).stop
        self._direct, self._at, self._levels = direct, at, model.emitters.lamps.full()
        self._own = [direct.measured_at(Places(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)))]  # of points, by round
        self._shortest = SHORTEST_EDGE * model.world.size
        self._receivers = receivers
        self._places = Places.at_poses(model, at)
        self._objects = surfaces.object_of(np.arange(receivers))
        self._light = self._luminance(direct)  # of direct light at receivers and points
        self._resolved = direct.resolves(self._places.positions)
        areas = model.object_receivers.areas[:n]
        self._floor = 0.5 * float((areas * self._light[:n]).sum() / areas.sum())
        front, back = surfaces.corner_front, surfaces.corner_back
        ids = np.concatenate([np.stack([front, back], axis=2), corners], axis=2).astype(np.int64)
        vertices, faces = np.zeros((0, 3)), []
        for own, of in zip(surfaces.vertices, surfaces.faces, strict=True):
            place = weld(own)
            faces.append(place[of] + len(vertices))
            vertices = np.concatenate([vertices, own[np.unique(place, return_index=True)[1]]])  # for lengths
        self._vertices, whole = vertices, np.broadcast_to(np.eye(3), (len(front), 3, 3))
        self._faces = Faces(np.arange(len(front)), np.concatenate(faces), None, whole, ids)
        self._done: list[Faces] = []
        self._asked = np.zeros(0, np.int64)  # edges that are not to be asked about, or have been
        self._parents: list[Cuts] = []
        self._pairs: list[list[Cuts]] = [[] for _ in range(corners.shape[2])]
        self._next = [receivers, receivers, *(ids[..., 2:].max(axis=(0, 1), initial=-1) + 1).tolist()]

    @property
    def count(self) -> int:
        """Points so far."""
        return len(self._light) - self._receivers

    def points(self) -> FinePoints:
        faces = join_faces([*self._done, self._faces])
        pairs = (_concatenated(each) for each in self._pairs)
        self._own = [joined(self._own)]
        direct = self._direct, self._own[0]
        parents = _concatenated(self._parents)
        of = np.concatenate([self._objects, np.empty(len(parents.shares), np.int64)])[:, None]
        parents.fill(len(self._objects), of)
        return FinePoints(parents, tuple(pairs), faces.source, faces.ids, faces.weights, direct, of[:, 0], self._at)

    def go_on(self, most: int) -> bool:
        """Cut edges once; return whether any was cut."""
        key, asked = self._edges(), self._to_ask()
        edges = np.unique(key[asked])
        if not len(edges):
            return False
        number = np.where(asked, np.searchsorted(edges, key), len(edges))
        row, k = np.nonzero(asked)
        pairs, first = np.unique(np.concatenate([self._ends(row, k, side) for side in (0, 1)]), return_index=True)
        ends, of = _numbers(pairs[pairs >= 0]), np.tile(number[row, k], 2)[first[pairs >= 0]]
        bends = _Bends(ends, np.full(len(ends), 0.5), self._bend(ends, np.full(len(ends), 0.5)))
        closely = np.zeros(len(edges) + 1, bool)
        while True:  # a thin shadow leaves a face by other edges, where it may lie beside the middle
            bent, closer = np.zeros((2, len(edges) + 1), bool)
            bent[of[bends.bend > BENT]] = True
            closer[number[bent[number].any(axis=1)]] = True
            closer[-1] = False
            if not (closer & ~closely).any():
                break
            bends.look(np.flatnonzero((closer & ~closely)[of]), 0.25, self._bend)
            closely |= closer
        worst = np.zeros(len(edges), np.int64)
        ascending = np.argsort(bends.bend, kind="stable")
        worst[of[ascending]] = ascending  # the last one stays
        span = length(np.subtract(*self._vertices[_numbers(edges)].swapaxes(0, 1)))
        order = np.argsort(-np.where(bent[:-1], bends.bend[worst] * span**2, 0.0), kind="stable")
        cut = np.sort(order[: min(int(bent.sum()), most - self.count)])
        if not len(cut):
            return False
        bends.look(worst[cut], 0.125, self._bend)
        least = 0.25 * self._shortest / span[cut]
        self._cut(edges[cut], np.clip(bends.share[worst[cut]], least, 1 - least))
        return True

    def _to_ask(self) -> np.ndarray:
        """Return which edges (n, 3) bool of the faces are long, and have not been asked about; these have been now."""
        key, (low, high) = self._edges(), edge_ends(self._faces)
        # Pieces of slivers are slivers: without an end, one per round, where a border of light passes a corner.
        slivers = heights(self._vertices[self._faces.corners]) < 0.25 * self._shortest
        self._asked = np.union1d(self._asked, key[slivers])
        asked = length(self._vertices[low] - self._vertices[high]) > self._shortest
        asked &= ~_is_in(key, self._asked)
        self._asked = np.union1d(self._asked, key[asked])
        return asked

    def _bend(self, ends: np.ndarray, shares: np.ndarray) -> np.ndarray:
        """Return how far (n,) light at shares (n,) between ends (n, 2) is from the line between theirs, of itself."""
        places, steps = _between(self._places, ends, shares), self._light[ends]
        light = self._luminance(self._direct.measured_at(places))
        off = np.abs(light - (1 - shares) * steps[:, 0] - shares * steps[:, 1]) / np.maximum(light, self._floor)
        resolved = self._direct.resolves(places.positions) & self._resolved[ends].all(axis=1)
        return np.where(resolved, off, 0.0)

    def _cut(self, edges: np.ndarray, shares: np.ndarray) -> None:
        """Cut edges (e,), ascending, at shares (e,) of the way from their lower end."""
        low, high = edge_ends(self._faces)
        key, long = low * len(self._vertices) + high, _is_in(self._edges(), edges)
        row, k = np.nonzero(long)
        share = shares[np.searchsorted(edges, self._edges()[long])]
        ids = np.full((*long.shape, self._faces.ids.shape[2]), -1, np.int64)

        def cuts(columns: range, first: int) -> Cuts:
            """Number the cuts of these columns of ids from `first` on."""
            pairs = np.stack([self._ends(row, k, c) for c in columns])
            kept, at = np.unique(pairs, return_index=True)
            kept, at = kept[kept >= 0], at[kept >= 0] % len(row)
            for c, pair in zip(columns, pairs, strict=True):
                ids[row, k, c] = np.where(pair < 0, -1, first + np.searchsorted(kept, pair))
            return Cuts(_numbers(kept), share[at])

        new = cuts(range(2), self._next[0])
        self._parents.append(new)
        self._next[0] += len(new.shares)
        places = _between(self._places, *new)
        self._places = Places(*map(np.concatenate, zip(self._places, places, strict=True)))
        self._own.append(self._direct.measured_at(places))
        self._light = np.concatenate([self._light, self._luminance(self._own[-1])])
        self._resolved = np.concatenate([self._resolved, self._direct.resolves(places.positions)])
        for c in range(2, ids.shape[2]):
            self._pairs[c - 2].append(new := cuts(range(c, c + 1), self._next[c]))
            self._next[c] += len(new.shares)
        self._vertices, whole, self._faces = split_edges(self._vertices, self._faces, key, long, shares, ids)
        self._done.append(whole)

    def _edges(self) -> np.ndarray:
        """Return a number (n, 3) per edge of the faces."""
        low, high = edge_ends(self._faces)
        return low << 32 | high

    def _ends(self, row: np.ndarray, k: np.ndarray, column: int) -> np.ndarray:
        """Return the ids at the lower and the higher end of edges k (e,) of faces (e,) as one number; -1: none."""
        ends, corners = (each[row[:, None], np.stack([k, (k + 1) % 3], axis=1)]
                         for each in (self._faces.ids[..., column], self._faces.corners))  # fmt: skip
        a, b = np.where(corners[:, :1] < corners[:, 1:], ends, ends[:, ::-1]).T
        return np.where(np.minimum(a, b) < 0, -1, a << 32 | b)

    def _luminance(self, direct: DirectLight) -> np.ndarray:
        """Return the luminance (n,) of direct light past mobiles."""
        return np.maximum(luminance(direct.at(self._at, self._levels)), 0.0)


def _numbers(pairs: np.ndarray) -> np.ndarray:
    """Return the numbers (n, 2) of pairs (n,) that are one number each."""
    return np.stack([pairs >> 32, pairs & 0xFFFFFFFF], axis=1)


def _is_in(keys: np.ndarray, ascending: np.ndarray) -> np.ndarray:
    """Return whether each key, of any shape, is among ascending ones."""
    if not len(ascending):
        return np.zeros(keys.shape, bool)
    return ascending[np.minimum(np.searchsorted(ascending, keys), len(ascending) - 1)] == keys


def _concatenated(parts: list[Cuts]) -> Cuts:
    return Cuts(*map(np.concatenate, zip((np.zeros((0, 2), np.int64), np.zeros(0)), *parts, strict=True)))


def _between(places: Places, ends: np.ndarray, shares: np.ndarray) -> Places:
    """Return the places at shares (n,) of the way between ends (n, 2)."""
    share, (p, q), (n, m) = shares[:, None], *(a[ends].swapaxes(0, 1) for a in places[:2])
    normals = (1 - share) * n + share * m
    return Places((1 - share) * p + share * q, normals / length(normals)[:, None], places.lifts[ends].max(axis=1))
