"""Sites of a picture: the places, one or more per pixel, whose light its rays share; means over those around."""

from __future__ import annotations

import math

import numpy as np

from gi_core.base.jit import kernel
from gi_core.base.vec import difference, dot, largest, row
from gi_core.geometry.mesh_neighbours import SAME_WAY
from gi_core.rays.accelerator import LIFT


@kernel
def start_rays(corners, flat, corner_normals, corner_of, face, u, v, facing, start, normal):
    """Write where rays from n hits start, and shading normals there, (n, 3) float64, on the sides that are seen.

    On a curved surface they start on the tangent planes of the corners (Hanika 2021), else coarse faces would shade
    themselves. corners (F, 3, 3), flat (F, 3) float32; corner_normals (D, 3) float64 unit, corner_of (F, 3) into them.
    """
    for k in range(len(face)):
        f, side = face[k], 1.0 if facing[k] else -1.0
        n = row(flat, f)
        scale = side / max(math.sqrt(dot(n, n)), 1e-30)
        n = n[0] * scale, n[1] * scale, n[2] * scale
        b, c = np.float64(u[k]), np.float64(v[k])
        x, smooth, reach, least = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 1.0
        for j in range(3):
            share = 1.0 - b - c if j == 0 else (b if j == 1 else c)
            p, m = row(corners[f], j), row(corner_normals, corner_of[f, j])
            m = side * m[0], side * m[1], side * m[2]
            least = min(least, dot(m, n))
            reach = max(reach, largest(p))
            x = x[0] + share * p[0], x[1] + share * p[1], x[2] + share * p[2]
            smooth = smooth[0] + share * m[0], smooth[1] + share * m[1], smooth[2] + share * m[2]
        size = math.sqrt(dot(smooth, smooth))
        lift = LIFT * reach
        # A face is flat up to 1e-6 of the cosine; normals steeper than 0.1 over it would shade it.
        if least < 1 - 1e-6 and dot(smooth, n) > 0.1 * size:
            y = x
            for j in range(3):
                share = 1.0 - b - c if j == 0 else (b if j == 1 else c)
                m = row(corner_normals, corner_of[f, j])
                below = share * min(side * dot(difference(y, row(corners[f], j)), m), 0.0) * side
                x = x[0] - below * m[0], x[1] - below * m[1], x[2] - below * m[2]
            normal[k, 0], normal[k, 1], normal[k, 2] = smooth[0] / size, smooth[1] / size, smooth[2] / size
        else:
            normal[k, 0], normal[k, 1], normal[k, 2] = n
        start[k, 0], start[k, 1], start[k, 2] = x[0] + lift * n[0], x[1] + lift * n[1], x[2] + lift * n[2]


@kernel
def group(pixel, start, normal, site, first):
    """Write the site (n,) of each hit, counted from 0, and the first hit (n,) of each site; return their number.

    pixel (n,) int64: ascending; start, normal (n, 3) float64: of hits. Hits of a pixel on one surface share a site.
    """
    count, begin = 0, 0
    for k in range(len(pixel)):
        if k > 0 and pixel[k] != pixel[k - 1]:
            begin = count
        site[k] = count
        for s in range(begin, count):
            if _on_one_surface(start, normal, first[s], k):
                site[k] = s
                break
        if site[k] == count:
            first[count] = k
            count += 1
    return count


@kernel
def _on_one_surface(start, normal, i, k):
    way, n = difference(row(start, k), row(start, i)), row(normal, i)
    if dot(n, row(normal, k)) < SAME_WAY:
        return False
    return abs(dot(way, n)) <= 0.2 * math.sqrt(dot(way, way))  # height over the tangent plane per distance


@kernel
def around(pixels, pixel, start, normal, values, reach, radius, first, out):
    """Write means (m, c) of values (n, c) of sites `first` and following over those around, on the same surface.

    pixels (h, w): the first site of each pixel, -1: none; pixel (n,): of each site; radius: pixels; reach (n,) [m]:
    standard deviation of weights; the last column: variances, whose weights are squared.
    """
    h, w = pixels.shape
    last = values.shape[1] - 1
    for k in range(len(out)):
        i = first + k
        y, x = pixel[i] // w, pixel[i] % w
        total, per = 1.0, -0.5 / max(reach[i] * reach[i], 1e-300)
        for c in range(last + 1):
            out[k, c] = values[i, c]
        for v in range(max(y - radius, 0), min(y + radius + 1, h)):
            for u in range(max(x - radius, 0), min(x + radius + 1, w)):
                j = pixels[v, u]
                if j < 0 or (u == x and v == y) or not _on_one_surface(start, normal, i, j):
                    continue
                way = difference(row(start, j), row(start, i))
                weight = math.exp(per * dot(way, way))
                total += weight
                for c in range(last):
                    out[k, c] += weight * values[j, c]
                out[k, last] += weight * weight * values[j, last]
        for c in range(last):
            out[k, c] /= total
        out[k, last] /= total * total


@kernel
def spans(pixels, pixel, start, normal, values, first, out):
    """Write the difference (m,) between extremes of values (n,) at and beside sites, on the same surface."""
    h, w = pixels.shape
    for k in range(len(out)):
        i = first + k
        y, x = pixel[i] // w, pixel[i] % w
        low, high = values[i], values[i]
        for v in range(max(y - 1, 0), min(y + 2, h)):
            for u in range(max(x - 1, 0), min(x + 2, w)):
                j = pixels[v, u]
                if j >= 0 and _on_one_surface(start, normal, i, j):
                    low, high = min(low, values[j]), max(high, values[j])
        out[k] = high - low


@kernel
def alike(pixels, pixel, start, normal, light, guide, radius, first, out):
    """Write means (m, 4) of light (n, 4) of sites `first` and following over those around of a like share of light.

    light: red, green, blue over the unblocked luminance, and the variance of luminance over that. guide (n, 2): mean
    share of the unblocked light around each site, and the variance of that mean.
    """
    h, w = pixels.shape
    for k in range(len(out)):
        i = first + k
        y, x = pixel[i] // w, pixel[i] % w
        total = 1.0
        for c in range(4):
            out[k, c] = light[i, c]
        if guide[i, 1] <= 0.0:
            continue
        for v in range(max(y - radius, 0), min(y + radius + 1, h)):
            for u in range(max(x - radius, 0), min(x + radius + 1, w)):
                j = pixels[v, u]
                if j < 0 or (u == x and v == y) or not _on_one_surface(start, normal, i, j):
                    continue
                off = guide[i, 0] - guide[j, 0]
                weight = math.exp(-0.5 * off * off / guide[i, 1])
                total += weight
                for c in range(3):
                    out[k, c] += weight * light[j, c]
                out[k, 3] += weight * weight * light[j, 3]
        for c in range(3):
            out[k, c] /= total
        out[k, 3] /= total * total
