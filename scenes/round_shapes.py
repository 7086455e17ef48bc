"""Shapes for the generators that go round an axis or a line: turned bodies, balls, tubes, rods."""

from __future__ import annotations

import numpy as np

from scenes.modelling import FINE, Shape, grid_faces, without_lines


def turned_body(profile, segments: int) -> Shape:
    """Return a profile (n, 2) of radius and height, from below to above, turned about y; ends on the axis are closed.

    The front is outside where the profile runs upwards.
    """
    profile = np.asarray(profile, float)
    a = 2 * np.pi * np.arange(segments + 1) / segments
    r, h = profile[:, 0, None], profile[:, 1, None]
    length = np.concatenate([[0], np.cumsum(np.sqrt((np.diff(profile, axis=0) ** 2).sum(axis=1)))])
    vertices = np.stack([r * np.cos(a), h + 0 * a, -r * np.sin(a)], axis=2).reshape(-1, 3)
    uv = np.stack([np.broadcast_to(a / (2 * np.pi), (len(r), len(a))), length[:, None] + 0 * a], axis=2)
    return without_lines(Shape(vertices, grid_faces(len(profile), segments + 1)[:, ::-1], uv.reshape(-1, 2)))


def ball(radius: float, segments: int = 16) -> Shape:
    """Return a sphere about the origin."""
    a = np.pi * np.arange(segments // 2 + 1) / (segments // 2)
    return turned_body(np.stack([radius * np.sin(a), -radius * np.cos(a)], axis=1), segments)


def tube(points, radii, segments: int = 8, closed: bool = False) -> Shape:
    """Return a tube along points (n, 3) with a radius at each; open tubes have flat ends, closed ones none."""
    p = np.asarray(points, float)
    r = np.broadcast_to(np.asarray(radii, float), (len(p),))
    tangent = np.roll(p, -1, axis=0) - np.roll(p, 1, axis=0) if closed else np.gradient(p, axis=0)
    tangent /= np.sqrt((tangent * tangent).sum(axis=1, keepdims=True))
    side = np.cross(tangent[0], np.eye(3)[np.argmin(np.abs(tangent[0]))])
    a = 2 * np.pi * np.arange(segments + 1) / segments
    rings = []
    for point, t, radius in zip(p, tangent, r, strict=True):
        side = side - t * float(side @ t)  # carried along without twisting
        side = side / np.sqrt(float(side @ side))
        rings.append(point + radius * (np.cos(a)[:, None] * side + np.sin(a)[:, None] * np.cross(t, side)))
    if closed:
        rings.append(rings[0])
    else:
        rings = [np.tile(p[0], (segments + 1, 1)), *rings, np.tile(p[-1], (segments + 1, 1))]
    n = len(rings)
    uv = np.stack(np.meshgrid(np.linspace(0, 1, n), a / (2 * np.pi), indexing="ij"), axis=2).reshape(-1, 2)
    return without_lines(Shape(np.concatenate(rings), grid_faces(n, segments + 1)[:, ::-1], uv))


def rod(a, b, radius: float, segments: int = 8, end_radius: float | None = None) -> Shape:
    """Return a straight tube from a to b in pieces no longer than FINE, tapered if `end_radius` is given."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    n = int(np.ceil(np.sqrt((b - a) @ (b - a)) / FINE)) + 1
    t = np.linspace(0, 1, n)[:, None]
    return tube(a + t * (b - a), np.linspace(radius, radius if end_radius is None else end_radius, n), segments)
