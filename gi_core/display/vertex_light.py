"""Kernels of a picture's vertices: their radiance, their interpolation weights, and diagonals that follow the light.

They take the place of some twenty passes of numpy, for which a lamp's slider would wait (lamps.md).
"""

from __future__ import annotations

import math

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.vec import cross, difference, dot, row
from gi_core.geometry.error import REC709

PI = np.float32(math.pi)
RED, GREEN, BLUE = REC709.astype(np.float32)


def compile_kernels() -> None:
    """Run each kernel on a vertex or two."""
    light, rows, both = np.ones((2, 3)), np.arange(2, dtype=np.int32), np.ones((2, 2), np.float32)
    seen, quad, turned = np.ones((2, 3), np.float32), np.zeros((4, 1), np.int64), np.zeros(1, bool)
    light_vertices(light, rows, seen, seen)
    weigh_vertices(np.ones(2, np.float32), rows, rows, both)
    follow_light(quad, seen, seen, both, both, turned)
    turn_triangles(turned, turned, np.zeros((1, 2), np.int64), quad, np.zeros((2, 3), np.int32))
    corners, one, first = np.ones((1, 3, 3), np.float32), np.zeros(1, np.int64), np.arange(2)
    for face in (one, one.astype(np.int32)):
        meet_pieces(face, first, one, corners, corners[0, :1], corners[0, :1], one)


@kernel
def light_vertices(irradiance, receivers, reflectance, out):
    """Write radiance rho E / pi (D, 3) float32 of vertices.

    irradiance (R, 3) [W/m2]; receivers (D,): -1 leaves a vertex as it is; reflectance (D, 3) float32, or one row for
    all.
    """
    for v in range(len(receivers)):
        r = receivers[v]
        if r < 0:
            continue
        rho = v if len(reflectance) > 1 else 0
        for c in range(3):
            out[v, c] = np.float32(irradiance[r, c]) * reflectance[rho, c] / PI


@kernel
def weigh_vertices(of_receivers, front, back, out):
    """Write weights (D, 2) float32 of both sides of vertices; of_receivers (R,) float32; front, back (D,): -1 is 1."""
    for v in range(len(out)):
        out[v, 0] = of_receivers[front[v]] if front[v] >= 0 else np.float32(1.0)
        out[v, 1] = of_receivers[back[v]] if back[v] >= 0 else np.float32(1.0)


@kernel
def follow_light(corners, front, back, weights, light, out):
    """Write which of q quadrilaterals differ less in luminance along their other diagonal, from b to c.

    corners (4, q): vertices a, b, d, c; front, back (D, 3) float32; weights (D, 2) float32, or none for 1; light
    (D, 2) float32: room for luminance. A quadrilateral with a weight below 1 keeps its diagonal.
    """
    for v in range(len(light)):
        light[v, 0] = RED * front[v, 0] + GREEN * front[v, 1] + BLUE * front[v, 2]
        light[v, 1] = RED * back[v, 0] + GREEN * back[v, 1] + BLUE * back[v, 2]
        if len(weights) and min(weights[v, 0], weights[v, 1]) < 1.0:
            light[v, 0] = np.nan  # no diagonal differs less than nan
    for k in range(len(out)):
        a, b, d, c = corners[0, k], corners[1, k], corners[2, k], corners[3, k]
        shared = abs(light[b, 0] - light[c, 0]) + abs(light[b, 1] - light[c, 1])
        other = abs(light[a, 0] - light[d, 0]) + abs(light[a, 1] - light[d, 1])
        out[k] = other < shared


@kernel
def turn_triangles(turned, before, faces, corners, triangles):
    """Write the triangles (F, 3) int32 of q quadrilaterals whose diagonal changes; return the number of these.

    turned, before (q,) bool: now and in `triangles`; faces (q, 2): rows of their triangles; corners (4, q): vertices a,
    b, d, c.
    """
    changed = 0
    for k in range(len(turned)):
        if turned[k] == before[k]:
            continue
        changed += 1
        a, b, d, c = corners[0, k], corners[1, k], corners[2, k], corners[3, k]
        one, two = triangles[faces[k, 0]], triangles[faces[k, 1]]
        one[0], one[1], one[2] = a, b, d if turned[k] else c
        two[0], two[1], two[2] = d, c, a if turned[k] else b
    return changed


@kernel
def meet_pieces(face, first, pieces, corners, origins, directions, out):
    """Write the piece (n,) int64 of each face (n,) that a ray meets: that of the largest least barycentric weight.

    Pieces of a face f are pieces[first[f] : first[f + 1]]; corners (F, 3, 3) float32 [m]: of all pieces; origins,
    directions (n, 3) float32.
    """
    for k in range(len(face)):
        begin, end = first[face[k]], first[face[k] + 1]
        out[k] = pieces[begin]
        if end == begin + 1:
            continue
        o, d, most = row(origins, k), row(directions, k), -np.inf
        for i in range(begin, end):
            at = corners[pieces[i]]
            a, e, f = row(at, 0), difference(row(at, 1), row(at, 0)), difference(row(at, 2), row(at, 0))
            h, s = cross(d, f), difference(o, a)
            det = dot(e, h)
            if det == 0.0:
                continue
            u, v = dot(s, h) / det, dot(d, cross(s, e)) / det
            least = min(u, v, 1.0 - u - v)
            if least > most:
                most, out[k] = least, pieces[i]
