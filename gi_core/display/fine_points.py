"""Fine points: drawn points between receivers, where direct light bends along the static part.

A picture interpolates light between receivers, which blurs contact shadows and draws teeth along borders of sunlight.
Edges of flat faces are halved where direct light in their middle differs from the mean of its ends. All faces at an
edge are cut, so no picture has a gap. Light at a fine point is the interpolated light of receivers without their direct
light, plus direct light at the point itself (section 4.1 of the report). Light of the sky is interpolated: it bends
little, and has many points. Receivers and their light do not change.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.pause import pause
from gi_core.base.vectors import dot, length
from gi_core.display.dilation import Drawn
from gi_core.gather.direct_light import DirectLight, Places
from gi_core.geometry.error import luminance
from gi_core.geometry.receivers import weld
from gi_core.geometry.tessellation import Faces, edge_ends, heights, join_faces, split_edges
from gi_core.lights.lamps import mix
from gi_core.lights.light_points import DELTA, FACE
from gi_core.model import Model
from gi_core.rays.accelerator import Transforms

# Of direct light, or of half its mean: difference in the middle of an edge. 0: error beside things 1.3 to 2.4 %.
BENT = 0.05
SHORTEST_EDGE = 1e-3  # of the scene's size: edges that are not cut. 0: the same light for 25 % more time


def compile_kernels() -> None:
    """Run each kernel without points."""
    none, light = np.zeros((0, 2), np.int64), np.zeros((1, 3))
    _between_receivers(none, 1, light, np.ones(1, np.float32))
    _visible_shares(none, 1, np.zeros(1), np.zeros(1))
    halfway(none, 1, light)
    halfway(none, 1, np.zeros((1, 2), np.int32))


class FinePoints(NamedTuple):
    """n points, numbered after the R receivers."""

    parents: np.ndarray  # (n, 2) int64, the two receivers or earlier points that each lies between
    pairs: tuple[np.ndarray, ...]  # per further id of corners: (m, 2) int64, the same for these
    source: np.ndarray  # (f,) int64, the face of the static part that each drawn face is a piece of
    ids: np.ndarray  # (f, 3, 2 + k) int64, of corners: point on the front, on the back (-1: none), further ids
    weights: np.ndarray  # (f, 3, 3) float64, of the source's corners, per corner
    direct: tuple[DirectLight, DirectLight]  # of static receivers, and of the points; without that of the sky
    poses: Transforms  # that the points suit

    def between(self, drawn: Drawn) -> Drawn:
        """Return light (R + n, 3) of receivers and points, and its weights: means at points."""
        E, parents = drawn.irradiance, self.parents
        light, weights = np.empty((len(E) + len(parents), 3)), np.ones(len(E) + len(parents), np.float32)
        light[: len(E)] = E
        if drawn.weights is not None:
            weights[: len(E)] = drawn.weights
        _between_receivers(parents, len(E), light, weights)
        return Drawn(light, weights)

    def at(self, at: Transforms, levels: np.ndarray) -> FineLight:
        """Return the light of points at poses, and levels (G, 3) of the lamps.

        At other poses than those that the points suit, the share that mobiles leave of direct light is interpolated
        between receivers: 50,000 points in the light that mobiles may block take 5 to 20 ms.
        """
        of_receivers, of_points = self.direct
        receivers = of_receivers.at(at, levels)
        if all(map(np.array_equal, at, self.poses)):
            return FineLight(self, receivers, of_points.at(at, levels))
        own, first = mix(of_points.per_lamp, levels), int(self.ids[..., :2].max(initial=-1)) + 1 - len(self.parents)
        full, share = np.zeros(first + len(own)), np.ones(first + len(own))
        full[: len(receivers)], full[first:] = luminance(mix(of_receivers.per_lamp, levels)), luminance(own)
        lit = full[: len(receivers)] > 0
        share[: len(receivers)][lit] = luminance(receivers[lit]) / full[: len(receivers)][lit]
        _visible_shares(self.parents, first, full, share)
        return FineLight(self, receivers, own * share[first:, None])


class FineLight(NamedTuple):
    """Direct light by the same points on lights, past mobiles."""

    points: FinePoints
    receivers: np.ndarray  # (s, 3) [W/m2], of static receivers
    own: np.ndarray  # (n, 3) [W/m2], of fine points

    def of(self, drawn: Drawn) -> Drawn:
        """Return light for pictures of receivers and fine points (R + n, 3) [W/m2], and its weights."""
        E, s = drawn.irradiance, len(self.receivers)
        light, weights = self.points.between(drawn._replace(irradiance=np.concatenate([E[:s] - self.receivers, E[s:]])))
        light[:s] = E[:s]
        np.maximum(light[len(E) :] + self.own, 0.0, out=light[len(E) :])
        return Drawn(light, weights)


@kernel
def _between_receivers(parents, first, light, weights):
    """Write light (R + n, 3) and weights (R + n,) of points from `first` on: weighted means of their two parents.

    A point between a receiver that light reaches and one that it does not is reached.
    """
    for k in range(len(parents)):
        p, q, r = parents[k, 0], parents[k, 1], first + k
        a, b = weights[p], weights[q]
        for c in range(3):
            light[r, c] = (a * light[p, c] + b * light[q, c]) / (a + b)
        weights[r] = max(a, b)


@kernel
def _visible_shares(parents, first, full, share):
    """Write the shares (R + n,) of direct light of points from `first` on that mobiles leave: means of their parents.

    full (R + n,): luminance of direct light without mobiles, which weighs them.
    """
    for k in range(len(parents)):
        p, q = parents[k, 0], parents[k, 1]
        a, b = full[p], full[q]
        share[first + k] = (a * share[p] + b * share[q]) / (a + b) if a + b > 0.0 else 1.0


def halfway(pairs: np.ndarray, first: int, values: np.ndarray) -> None:
    """Write values (first + m, c) of pairs (m, 2): the means of their parents; of integers those of the first one."""
    if np.issubdtype(values.dtype, np.integer):
        _inherit(pairs, first, values)
    else:
        _halve(pairs, first, values)


@kernel
def _halve(pairs, first, values):
    for k in range(len(pairs)):
        for c in range(values.shape[1]):
            values[first + k, c] = 0.5 * (values[pairs[k, 0], c] + values[pairs[k, 1], c])


@kernel
def _inherit(pairs, first, values):
    for k in range(len(pairs)):
        for c in range(values.shape[1]):
            values[first + k, c] = values[pairs[k, 0], c]


def fine_points(model: Model, seed: int, at: Transforms, corners: np.ndarray, most: int = 60_000) -> FinePoints | None:
    """Return the fine points of the static part at poses, of lamps at full level; None where lights have no points.

    corners (F, 3, k) int: further ids of corners, such as draw vertices; most: points. llvmpipe draws the office at
    1280 x 800 in 450 CPU ms with 50,000, in 250 without; 110,000 would leave 5.2 for 5.4 % near other things there.
    """
    direct = DirectLight(model, seed, (FACE, DELTA)).measured_at(Places.of_receivers(model))
    if not direct.is_known:
        return None
    cutting = _Cutting(model, direct, at, corners)
    while cutting.count < most and cutting.go_on(most):
        pause()
    return cutting.points()


class _Cutting:
    """Rounds of cuts. Edges of a piece that are new belong to pieces of the same round alone."""

    def __init__(self, model: Model, direct: DirectLight, at: Transforms, corners: np.ndarray):
        surfaces, receivers = model.surfaces, len(model.object_receivers.areas)
        of, n = surfaces.face_range(0), surfaces.receiver_range(0).stop
        self._direct, self._at, self._levels = direct, at, model.emitters.lamps.full()
        self._shortest = SHORTEST_EDGE * model.world.size
        self._receivers = receivers
        self._places = _padded(Places.of_receivers(model), receivers)
        self._light = np.zeros(receivers)  # luminance of direct light at receivers and points
        self._light[:n] = self._luminance(direct)
        areas = model.object_receivers.areas[:n]
        self._floor = 0.5 * float((areas * self._light[:n]).sum() / areas.sum())
        place, front = weld(surfaces.vertices[0]), surfaces.corner_front[of]
        self._vertices = surfaces.vertices[0][np.unique(place, return_index=True)[1]]
        ids = np.concatenate([np.stack([front, surfaces.corner_back[of]], axis=2), corners], axis=2).astype(np.int64)
        whole = np.broadcast_to(np.eye(3), (len(front), 3, 3))
        self._faces = Faces(np.arange(len(front)), place[surfaces.faces[0]], None, whole, ids)
        self._done: list[Faces] = []
        normals = self._places.normals[front]
        # Light on curved faces bends with their normals: by 1e-3 of 1 - cosine at least, none of them is cut.
        # Cut, they leave 7.1 for 6.7 % beside things in the showroom.
        curved = dot(normals, np.roll(normals, 1, axis=1)).min(axis=1) < 1 - 1e-3
        self._asked = np.unique(self._edges()[curved])  # edges that are not to be asked about, or have been
        self._parents: list[np.ndarray] = []
        self._pairs: list[list[np.ndarray]] = [[] for _ in range(corners.shape[2])]
        self._next = [receivers, receivers, *(ids[..., 2:].max(axis=(0, 1), initial=-1) + 1).tolist()]

    @property
    def count(self) -> int:
        """Points so far."""
        return len(self._light) - self._receivers

    def points(self) -> FinePoints:
        faces = join_faces([*self._done, self._faces])
        own = Places(*(a[self._receivers :] for a in self._places))
        pairs = (_concatenated(each) for each in self._pairs)
        direct = self._direct, self._direct.measured_at(own)
        parents = _concatenated(self._parents)
        return FinePoints(parents, tuple(pairs), faces.source, faces.ids, faces.weights, direct, self._at)

    def go_on(self, most: int) -> bool:
        """Cut edges once; return whether any was cut."""
        faces, key = self._faces, self._edges()
        low, high = edge_ends(faces)
        # Pieces of slivers are slivers: without an end, one per round, where a border of light passes a corner.
        slivers = heights(self._vertices[faces.corners]) < 0.25 * self._shortest
        self._asked = np.union1d(self._asked, key[slivers])
        asked = length(self._vertices[low] - self._vertices[high]) > self._shortest
        asked &= ~_is_in(key, self._asked)
        self._asked = np.union1d(self._asked, key[asked])
        edges = np.unique(key[asked])
        if not len(edges):
            return False
        row, k = np.nonzero(asked)
        sides = self._ends(row, k, 0), self._ends(row, k, 1)
        between = np.unique(np.concatenate(sides))
        between = between[between >= 0]
        pairs = _numbers(between)
        candidates = _between(self._places, pairs)
        light = self._luminance(self._direct.measured_at(candidates))
        ends = self._places.positions[pairs]
        resolved = self._direct.resolves(candidates.positions)
        resolved &= self._direct.resolves(ends[:, 0]) & self._direct.resolves(ends[:, 1])
        full, steps = np.maximum(light, self._floor), self._light[pairs]
        bend = np.abs(light - steps.mean(axis=1)) / full
        # The middle of an edge across a penumbra may have the mean by chance.
        bend = np.maximum(bend, 0.1 * np.abs(steps[:, 0] - steps[:, 1]) / full)
        bend[~resolved] = 0.0
        worst = np.zeros(len(edges))
        for side in sides:
            has = side >= 0
            of = np.searchsorted(edges, key[row, k][has])
            np.maximum.at(worst, of, bend[np.searchsorted(between, side[has])])
        span = length(np.subtract(*self._vertices[_numbers(edges)].swapaxes(0, 1)))
        order = np.argsort(-np.where(worst > BENT, worst * span**2, 0.0), kind="stable")
        cut = np.sort(edges[order[: min(int((worst > BENT).sum()), most - self.count)]])
        if not len(cut):
            return False
        self._cut(_is_in(key, cut), between, candidates, light)
        return True

    def _cut(self, long: np.ndarray, between: np.ndarray, candidates: Places, light: np.ndarray) -> None:
        """Cut the edges long (n, 3) bool of the faces; between (c,): pairs of ids, with their places and light."""
        row, k = np.nonzero(long)
        ids = np.full((*long.shape, self._faces.ids.shape[2]), -1, np.int64)
        sides = self._ends(row, k, 0), self._ends(row, k, 1)
        kept = np.unique(np.concatenate(sides))
        kept = kept[kept >= 0]
        for s, side in enumerate(sides):
            ids[row, k, s] = np.where(side < 0, -1, self._next[0] + np.searchsorted(kept, side))
        self._next[0] += len(kept)
        self._parents.append(_numbers(kept))
        at = np.searchsorted(between, kept)
        self._places = Places(*(np.concatenate([a, b[at]]) for a, b in zip(self._places, candidates, strict=True)))
        self._light = np.concatenate([self._light, light[at]])
        for c in range(2, ids.shape[2]):
            pair = self._ends(row, k, c)
            kept = np.unique(pair)
            ids[row, k, c] = self._next[c] + np.searchsorted(kept, pair)
            self._next[c] += len(kept)
            self._pairs[c - 2].append(_numbers(kept))
        low, high = edge_ends(self._faces)
        key = low * len(self._vertices) + high
        self._vertices, whole, self._faces = split_edges(self._vertices, self._faces, key, long, 0.5, ids)
        self._done.append(whole)

    def _edges(self) -> np.ndarray:
        """Return a number (n, 3) per edge of the faces."""
        low, high = edge_ends(self._faces)
        return low << 32 | high

    def _ends(self, row: np.ndarray, k: np.ndarray, column: int) -> np.ndarray:
        """Return the pair of ids at the ends of edges k (e,) of faces (e,) as one number (e,); -1: one has none."""
        a, b = self._faces.ids[row, k, column], self._faces.ids[row, (k + 1) % 3, column]
        return np.where(np.minimum(a, b) < 0, -1, np.minimum(a, b) << 32 | np.maximum(a, b))

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


def _concatenated(parts: list[np.ndarray]) -> np.ndarray:
    return np.concatenate([np.zeros((0, 2), np.int64), *parts])


def _padded(places: Places, n: int) -> Places:
    """Return places with rows of zeros up to n."""
    return Places(*(np.concatenate([a, np.zeros((n - len(a), *a.shape[1:]))]) for a in places))


def _between(places: Places, pairs: np.ndarray) -> Places:
    """Return the places between pairs (n, 2) of them."""
    positions, normals, lifts = (a[pairs] for a in places)
    normals = normals.sum(axis=1)
    return Places(positions.mean(axis=1), normals / length(normals)[:, None], lifts.max(axis=1))
