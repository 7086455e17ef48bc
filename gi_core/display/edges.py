"""Edges of surfaces, and pictures of one sample per pixel that are smooth across them.

A pixel at an edge takes the share beyond the edge from its neighbour across: geometric post-process
anti-aliasing (Persson 2011). Depths tell which edges are seen. A face narrower than a pixel may lie between samples; it
adds its own colour. docs/decisions/drawn-light.md has the measurements.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.vectors import cross, dot

ALIKE_DEPTH = 4e-7  # of the range of depths: seven steps of 24 bits


class Edges(NamedTuple):
    """E edges of an object: its borders, creases and possible folds."""

    points: np.ndarray  # (E, 4, 3) float32 [m], in the object's space: both ends, the third corners of two faces
    turns: np.ndarray  # (E, 2) int8, per face: 1 where end, end, corner run counter-clockwise on its front; -1; 0: none
    two_sided: np.ndarray  # (E, 2) bool, of the faces
    fold: np.ndarray  # (E,) bool: light runs on across the edge, so it shows only where one face hides the other
    corners: np.ndarray  # (E, 2, 3) int32 vertices of the faces


NO_EDGES = Edges(*map(np.zeros, ((0, 4, 3), (0, 2), (0, 2), 0, (0, 2, 3)), ("f4", "i1", "?", "?", "i4")))


def edges_of(positions: np.ndarray, triangles: np.ndarray, two_sided: np.ndarray) -> Edges:
    """Return the edges of triangles (F, 3) into vertices at positions (D, 3) float32; two_sided (F,) bool.

    Faces whose colours differ at an edge have vertices of their own there.
    """
    p = positions.astype(np.float64)[triangles]
    normal = cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    length = np.sqrt(dot(normal, normal))
    faces = np.flatnonzero(length > 0)
    if not len(faces):
        return NO_EDGES
    normal[faces] /= length[faces, None]
    bits = np.ascontiguousarray(positions + np.float32(0)).view("V12").reshape(-1)  # + 0: -0 becomes 0
    places = np.unique(bits, return_inverse=True)[1].reshape(-1)[triangles[faces]]
    one, two = places.reshape(-1), places[:, [1, 2, 0]].reshape(-1)
    key = np.minimum(one, two).astype(np.int64) * len(positions) + np.maximum(one, two)
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.r_[True, np.diff(key[order]) > 0])
    paired = np.diff(np.r_[first, len(key)]) > 1  # of three faces at an edge, two count
    pair = order[np.stack([first, first + paired], axis=1)]
    f, k = faces[pair // 3], pair % 3
    against = (one < two)[pair[:, 0]] != (one < two)[pair[:, 1]]
    corners = np.take_along_axis(triangles[f], (k[..., None] + np.arange(3)) % 3, axis=2).astype(np.int32)
    shared = np.where(against[:, None], corners[:, 1, 1::-1], corners[:, 1, :2]) == corners[:, 0, :2]
    fold = paired & shared.all(axis=1)
    cosine = np.where(against, 1.0, -1.0) * dot(normal[f[:, 0]], normal[f[:, 1]])
    shown = ~(fold & (cosine > 1 - 1e-6))  # not within a plane
    turns = np.stack([np.ones(len(f)), np.where(paired, np.where(against, -1, 1), 0)], axis=1).astype(np.int8)
    points = positions[np.c_[corners[:, 0], corners[:, 1, 2]]].astype(np.float32)
    return Edges(points[shown], turns[shown], two_sided[f][shown], fold[shown], corners[shown])


def compile_kernels() -> None:
    """Run each kernel on no edge."""
    placed, faces, size = np.zeros((0, 10)), np.zeros((0, 3), np.int32), np.ones(2)
    place_edges(*NO_EDGES[:4], np.eye(4), size, True, np.empty((4, 4)), placed, faces)
    pixels, depth = np.zeros((1, 1, 4), np.uint8), np.zeros((1, 1), np.float32)
    blend_edges(
        placed,
        np.zeros((0, 2, 3), np.float32),
        depth,
        pixels,
        pixels,
        np.zeros(0, bool),
        np.zeros((0, 5), np.float32),
        0,
    )


@kernel
def place_edges(points, turns, two_sided, fold, to_clip, size, cull, q, out, faces):
    """Write the edges that may show in a picture, as many as there is room for, and return their number.

    to_clip (4, 4); size (2,): pixels; cull: whether backs of one-sided faces are left out; q (4, 4): scratch. out
    (n, 10) float64: x, y [pixels] and depth of both ends. Then follow, for the side of lower and of higher x (y, where
    the edge lies flatter), the change of depth per pixel away and the width of the face [pixels], -1: no face.
    faces (n, 3) int32: the edge, and the faces of both sides, 2 k for a front, 2 k + 1 for a back.
    """
    n = 0
    for e in range(len(points)):
        if n == len(out):
            break
        beyond = 31
        for k in range(4):
            x, y, z = points[e, k, 0], points[e, k, 1], points[e, k, 2]
            for r in range(4):
                q[k, r] = to_clip[r, 0] * x + to_clip[r, 1] * y + to_clip[r, 2] * z + to_clip[r, 3]
            if k < 2:
                w = q[k, 3]
                sides = (q[k, 0] > w) + 2 * (q[k, 0] < -w) + 4 * (q[k, 1] > w) + 8 * (q[k, 1] < -w)
                beyond &= sides + 16 * (q[k, 2] < -w)
            if k == 1 and beyond:
                break
        if beyond:
            continue
        for end in range(2):  # the near plane cuts the edge
            here, other = q[end, 2] + q[end, 3], q[1 - end, 2] + q[1 - end, 3]
            if here < 0.0:
                for r in range(4):
                    q[end, r] += here / (here - other) * (q[1 - end, r] - q[end, r])
        middle = 0.5 * (q[0, 3] + q[1, 3])
        if min(q[0, 3], q[1, 3]) <= 0.0:
            continue
        for k in range(2, 4):  # a corner near or behind the eye moves towards the edge, in the plane of the face
            if q[k, 3] < 0.5 * middle:
                share = 0.5 * middle / (middle - q[k, 3])
                for r in range(4):
                    q[k, r] = share * q[k, r] + (1.0 - share) * 0.5 * (q[0, r] + q[1, r])
        for k in range(4):
            w = 1.0 / q[k, 3]
            q[k, 0], q[k, 1] = 0.5 * (q[k, 0] * w + 1.0) * size[0], 0.5 * (q[k, 1] * w + 1.0) * size[1]
            q[k, 2] = 0.5 * (q[k, 2] * w + 1.0)
        dx, dy = q[1, 0] - q[0, 0], q[1, 1] - q[0, 1]
        across = 0 if abs(dy) >= abs(dx) else 1
        along = dx if across else dy
        if abs(along) < 1e-6:
            continue
        slope, rise = (dy if across else dx) / along, (q[1, 2] - q[0, 2]) / along
        o = out[n]
        o[7], o[9] = -1.0, -1.0
        for k in range(2):
            turned = (dx * (q[2 + k, 1] - q[0, 1]) - dy * (q[2 + k, 0] - q[0, 0])) * turns[e, k]
            if turns[e, k] == 0 or (cull and not two_sided[e, k] and turned <= 0.0):
                continue
            far = q[2 + k, 1 - across] - q[0, 1 - across]
            width = q[2 + k, across] - q[0, across] - slope * far
            side = 0 if width < 0.0 else 1
            width = max(abs(width), 1e-4)
            change = (q[2 + k, 2] - q[0, 2] - rise * far) / width
            if o[7 + 2 * side] < 0.0 or change < o[6 + 2 * side]:  # the nearer of two faces
                o[6 + 2 * side], o[7 + 2 * side] = change, width
                faces[n, 1 + side] = 2 * k + (turned <= 0.0)
        if (o[7] < 0.0 and o[9] < 0.0) or (fold[e] and o[7] >= 0.0 and o[9] >= 0.0):
            continue
        for end in range(2):
            for c in range(3):
                o[3 * end + c] = q[end, c]
        faces[n, 0] = e
        n += 1
    return n


@kernel
def _beyond(away, slope):
    """Return the share of a pixel beyond a line whose distance from its middle is `away` [pixels] along an axis."""
    high, low = 0.5 - away + 0.5 * slope, 0.5 - away - 0.5 * slope
    high = 0.0 if high < 0.0 else 0.5 * high * high if high < 1.0 else high - 0.5
    low = 0.0 if low < 0.0 else 0.5 * low * low if low < 1.0 else low - 0.5
    return (high - low) / slope


@kernel
def _at(pixels, at, line, across):
    return pixels[at, line] if across else pixels[line, at]


@kernel
def _mix(pixel, share, colour):
    for c in range(3):
        before = np.float64(pixel[c])
        pixel[c] = np.uint8(before + share * (np.float64(colour[c]) - before) + 0.5)


@kernel
def blend_edges(placed, thin, depth, drawn, out, wanted, gaps, stage):
    """Smooth a picture across edges, in three stages: blend pixels, add faces that lie between samples, fill gaps.

    placed (n, 10): of place_edges(); thin (n, 2, 3) float32: display colours of the faces of both sides; depth (h, w)
    float32; drawn (h, w, 4) uint8; out: the same, then smoothed. The first stage sets wanted (n,) bool where the second
    would add a face, and counts in gaps (n, 5) float32, 0 before: pixels beside an edge that show a gap of a surface,
    those that show the surface, and the sum of colours in the gap.
    """
    height, width = depth.shape
    for n in range(len(placed)):
        o = placed[n]
        across = 0 if abs(o[4] - o[1]) >= abs(o[3] - o[0]) else 1
        low, high = (0, 3) if o[1 - across] <= o[4 - across] else (3, 0)
        start, end = o[low + 1 - across], o[high + 1 - across]
        slope, rise = (o[high + across] - o[low + across]) / (end - start), (o[high + 2] - o[low + 2]) / (end - start)
        lines, most = (width, height) if across else (height, width)
        for line in range(int(np.ceil(max(start - 0.5, 0.0))), int(np.ceil(min(end - 0.5, lines)))):
            far = line + 0.5 - start
            at, z = o[low + across] + slope * far, o[low + 2] + rise * far
            a = int(np.floor(at - 0.5))
            if a < 1 or a + 2 >= most:
                continue
            moves = 0.0
            for side in range(2):
                if o[7 + 2 * side] >= 0.0:
                    continue
                first, step, change = a + side, 2 * side - 1, o[8 - 2 * side]
                near, further = _at(depth, first, line, across), _at(depth, first + step, line, across)
                over = z - near - (near - further) * abs(first + 0.5 - at)
                if over > ALIKE_DEPTH:  # a surface in front of the edge: the face ends where it meets this surface
                    moves = over / max(near - further - change, 1e-12)
                    at, z = at - step * moves, z + change * moves
            a = int(np.floor(at - 0.5)) if moves <= 1.0 else -1  # farther within the face, it is hidden
            if a < 0 or a + 1 >= most:
                continue
            away_a, away_b = at - a - 0.5, a + 1.5 - at
            za = _at(depth, a, line, across) - z - o[6] * away_a
            zb = _at(depth, a + 1, line, across) - z - o[8] * away_b
            # The next faces of a curve lie farther than the plane of the one at its silhouette.
            crease = min(o[7], o[9]) >= 0.0
            off_a = 0.5 * abs(o[6]) * (min(o[7], 1.0) if crease else 1.0) + ALIKE_DEPTH
            off_b = 0.5 * abs(o[8]) * (min(o[9], 1.0) if crease else 1.0) + ALIKE_DEPTH
            seen_a = o[7] < 0.0 or -off_a <= za <= (off_a if crease else 2.0 * off_a)
            seen_b = o[9] < 0.0 or -off_b <= zb <= (off_b if crease else 2.0 * off_b)
            ya, xa, yb, xb = (a, line, a + 1, line) if across else (line, a, line, a + 1)
            pixel_a, pixel_b = out[ya, xa], out[yb, xb]
            if seen_a and seen_b:
                if stage == 0:
                    steep = max(abs(slope), 1e-3)
                    _mix(pixel_a, _beyond(away_a, steep), drawn[yb, xb])
                    _mix(pixel_b, _beyond(away_b, steep), drawn[ya, xa])
                if crease or moves > 0.0 or stage == 1:
                    continue
                # A surface may go on in its plane beyond a gap that is narrower than a pixel.
                step, change, away = (-1, o[8], away_a) if o[7] < 0.0 else (1, o[6], away_b)
                first = a if o[7] < 0.0 else a + 1
                if not 0 <= first + step < most:
                    continue
                off = 0.25 * abs(change) + ALIKE_DEPTH
                over = _at(depth, first, line, across) - z + change * away
                next_over = _at(depth, first + step, line, across) - z + change * (away + 1.0)
                is_gap = over > off and abs(next_over) <= off
                if not is_gap and abs(over) > off:
                    continue
                here = drawn[ya, xa] if o[7] < 0.0 else drawn[yb, xb]
                if stage == 0:
                    gaps[n, 0 if is_gap else 1] += 1.0
                    if is_gap and gaps[n, 0] == 1.0:
                        for c in range(3):
                            gaps[n, 2 + c] = here[c]
                    continue
                width_of = gaps[n, 0] / (gaps[n, 0] + gaps[n, 1])
                inner, outer = (pixel_b, pixel_a) if o[7] < 0.0 else (pixel_a, pixel_b)
                in_inner = min(width_of, max(away - 0.5, 0.0))
                yn, xn = (first + step, line) if across else (line, first + step)
                for c in range(3):
                    if is_gap:
                        gaps[n, 2 + c] += 0.25 * (here[c] - gaps[n, 2 + c])
                    colour = gaps[n, 2 + c]
                    before = drawn[yb, xb, c] if o[7] < 0.0 else drawn[ya, xa, c]
                    inner[c] = np.uint8(before + in_inner * (colour - before) + 0.5)
                    before = drawn[yn, xn, c] if is_gap else here[c]
                    outer[c] = np.uint8(before + (width_of - in_inner) * (colour - before) + 0.5)
                continue
            if moves > 0.0 or stage == 2:
                continue
            thin_a, thin_b = not seen_a and 0.0 <= o[7] <= 1.0, not seen_b and 0.0 <= o[9] <= 1.0
            if thin_a and (seen_b or (thin_b and zb + o[8] * away_b > 0.0)):
                wanted[n] = True
                if stage == 1:  # half of the face, because both of its edges add it
                    in_b = min(o[7], max(0.5 - away_b, 0.0))
                    _mix(pixel_a, 0.5 * (o[7] - in_b), thin[n, 0])
                    _mix(pixel_b, 0.5 * in_b, thin[n, 0])
            if thin_b and (seen_a or (thin_a and za + o[6] * away_a > 0.0)):
                wanted[n] = True
                if stage == 1:
                    in_a = min(o[9], max(0.5 - away_a, 0.0))
                    _mix(pixel_b, 0.5 * (o[9] - in_a), thin[n, 1])
                    _mix(pixel_a, 0.5 * in_a, thin[n, 1])
