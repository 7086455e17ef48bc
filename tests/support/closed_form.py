"""Closed forms of irradiance with their derivations; tests compare estimators and reference with them.

Scalars in, scalars or arrays out; watts, metres, steradians. `E` is always irradiance [W/m2].
"""

import math

import numpy as np

RADIAL, ANGULAR = 12, 32  # quadrature nodes over a disc: exact to rounding for smooth fields
TRIANGLE_SPLITS = 8  # a triangle is integrated as SPLITS^2 equal ones at their centroids


# -- small lights ---------------------------------------------------------------------------------


def point_over_plane(intensity: float, height: float, x):
    """Return E on a plane at distance x from the foot of a point light of intensity I [W/sr].

    A point at distance d = sqrt(h^2 + x^2) sees the light at cos(theta) = h / d, so
    E = I cos(theta) / d^2 = I h / (h^2 + x^2)^(3/2). A light of flux Phi has I = Phi / 4 pi.
    """
    return intensity * height / (height * height + np.square(x)) ** 1.5


def spot_over_plane(intensity: float, height: float, x, cos_inner: float, cos_outer: float):
    """Return E below a spot that shines straight down: the point light's, times the falloff.

    The axis is the plane's normal, so the angle off the axis is the angle of incidence: its cosine is
    h / d. Falloff is the square of a ramp in the cosine, from 0 at `outer` to 1 at `inner`.
    """
    cosine = height / np.sqrt(height * height + np.square(x))
    ramp = np.clip((cosine - cos_outer) / (cos_inner - cos_outer), 0, 1)
    return point_over_plane(intensity, height, x) * ramp * ramp


def point_light(intensity: float, light, position, normal):
    """Return E at points (n, 3) with normals (n, 3), nothing in between: I max(0, cos) / d^2."""
    to_light = np.asarray(light, float) - position
    d2 = (to_light * to_light).sum(axis=-1)
    return intensity * np.maximum(0, (to_light * normal).sum(axis=-1)) / d2**1.5


def directional(irradiance: float, direction, normal):
    """Return E of parallel light on surfaces of given normals (n, 3): E0 cos(theta), 0 from behind."""
    d = np.asarray(direction, float)
    return irradiance * np.maximum(0, -(np.asarray(normal) * (d / np.linalg.norm(d))).sum(axis=-1))


def sky(radiance: float, cos_tilt: float = 1.0) -> float:
    """Return E in the open under a uniform dome, on a plane tilted from the horizontal.

    Horizontal: integral of L cos over the hemisphere = pi L. Tilted by b, the dome's part behind the
    plane is lost; the rest projects to half a unit disc and half an ellipse with half axes 1 and
    cos b (Nusselt): E = pi L (1 + cos b) / 2.
    """
    return math.pi * radiance * (1 + cos_tilt) / 2


# -- area lights ----------------------------------------------------------------------------------


def lambert_polygon(radiance: float, polygon, position, normal) -> float:
    """Return E at a point from a planar polygon of uniform radiance L (Lambert 1760).

    Stokes turns the integral of L cos over the polygon's solid angle into one over its outline: each
    edge, seen from the point under an angle Theta_i and spanning with it a plane of unit normal
    Gamma_i, adds L/2 Theta_i (Gamma_i . n). The polygon is clipped at the point's horizon first; its
    emission is taken from both sides, so the caller sees to it that the point is in front.
    """
    n = np.asarray(normal, float)
    v = _above_horizon(np.asarray(polygon, float) - position, n)
    if len(v) < 3:
        return 0.0
    v = v / np.sqrt((v * v).sum(axis=1))[:, None]
    w = np.roll(v, -1, axis=0)
    cross = np.cross(v, w)
    sine = np.sqrt((cross * cross).sum(axis=1))
    theta = np.arctan2(sine, (v * w).sum(axis=1))
    gamma = cross / np.where(sine > 0, sine, 1)[:, None]
    return float(abs(radiance / 2 * (theta * (gamma @ n)).sum()))


def _above_horizon(v: np.ndarray, n: np.ndarray) -> np.ndarray:
    out = []
    for a, b in zip(v, np.roll(v, -1, axis=0), strict=True):
        ha, hb = a @ n, b @ n
        if ha >= 0:
            out.append(a)
        if (ha > 0) != (hb > 0) and ha != hb:
            out.append(a + (b - a) * ha / (ha - hb))
    return np.array(out).reshape(-1, 3)


def rectangle_above_corner(radiance: float, a, b, height: float):
    """Return E below one corner of a parallel a x b rectangle at a height, facing it.

    Integrating L h^2 / (x^2 + y^2 + h^2)^2 over the rectangle:
    E = L/2 [a/A atan(b/A) + b/B atan(a/B)], A = sqrt(a^2 + h^2), B = sqrt(b^2 + h^2).
    Any rectangle seen from any point is a signed sum of four of these.
    """
    A, B = np.hypot(a, height), np.hypot(b, height)
    return radiance / 2 * (a / A * np.arctan(b / A) + b / B * np.arctan(a / B))


def parallel_rectangle(radiance: float, x0: float, x1: float, y0: float, y1: float, height: float, x, y):
    """Return E at (x, y, 0) below the rectangle [x0, x1] x [y0, y1] at a height, by four corners."""

    def corner(u, v):
        return np.sign(u * v) * rectangle_above_corner(radiance, np.abs(u), np.abs(v), height)

    return corner(x1 - x, y1 - y) - corner(x0 - x, y1 - y) - corner(x1 - x, y0 - y) + corner(x0 - x, y0 - y)


def furnace(radiance: float, reflectance: float) -> float:
    """Return E in a closed room whose walls all emit Le and reflect rho.

    Every ray ends on a wall of the same outgoing radiance L = Le + rho E / pi, and E = pi L, so
    E = pi Le / (1 - rho): at every point, in a room of any shape.
    """
    return math.pi * radiance / (1 - reflectance)


def corner_view(angle: float) -> float:
    """Return the view factor of an endless wall from a floor point at its foot.

    In the cross-section normal to the edge the wall fills the elevations from 0 to `angle` [rad] of the
    half circle over the floor; for endless strips the factor is (sin b2 - sin b1) / 2 with b measured
    from the normal, here (1 - cos(angle)) / 2: half the view for an upright wall.
    """
    return (1 - math.cos(angle)) / 2


# -- means over the kernel of an estimator --------------------------------------------------------


def disc_nodes(centre, normal, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Return points (..., m, 3) and weights (m,) whose weighted sum of a field is its mean over a disc.

    centre, normal (..., 3). Gauss-Legendre in r^2 (the area grows with it), trapezoid in the angle (periodic: exact
    fast).
    """
    n = np.asarray(normal, float)
    n = n / np.linalg.norm(n, axis=-1, keepdims=True)
    a = np.cross(n, np.where(np.abs(n[..., :1]) < 0.7, [1.0, 0, 0], [0, 1.0, 0]))
    a /= np.linalg.norm(a, axis=-1, keepdims=True)
    b = np.cross(n, a)
    s, w = np.polynomial.legendre.leggauss(RADIAL)
    r = radius * np.sqrt((s + 1) / 2)
    phi = 2 * math.pi * (np.arange(ANGULAR) + 0.5) / ANGULAR
    along = np.cos(phi)[:, None] * a[..., None, :] + np.sin(phi)[:, None] * b[..., None, :]
    points = np.asarray(centre, float)[..., None, None, :] + r[:, None, None] * along[..., None, :, :]
    return points.reshape(*n.shape[:-1], -1, 3), np.repeat(w / 2 / ANGULAR, ANGULAR)


def sector_nodes(centre, normal, first, angle, radius) -> tuple[np.ndarray, np.ndarray]:
    """As disc_nodes(), over sectors that turn from the directions `first` (n, 3) by `angle` (n,) [rad] about `normal`.

    centre, normal (n, 3); radius (n,).
    """
    f = first / np.linalg.norm(first, axis=1, keepdims=True)
    g = np.cross(normal, f)
    s, w = np.polynomial.legendre.leggauss(4)
    r = radius[:, None] * np.sqrt((s + 1) / 2)
    phi = angle[:, None] * (s + 1) / 2
    along = np.cos(phi)[..., None] * f[:, None] + np.sin(phi)[..., None] * g[:, None]
    points = centre[:, None, None] + r[:, :, None, None] * along[:, None]
    return points.reshape(len(centre), -1, 3), np.outer(w, w).reshape(-1) / 4


def triangle_mean(field, corners) -> float:
    """Return the mean of field((m, 3) points) -> (m,) over one triangle (3, 3)."""
    k = TRIANGLE_SPLITS
    i, j = (g.reshape(-1) for g in np.meshgrid(np.arange(k), np.arange(k), indexing="ij"))
    up = np.stack([i, j], axis=1)[i + j < k] + 1 / 3
    down = np.stack([i, j], axis=1)[i + j < k - 1] + 2 / 3
    uv = np.concatenate([up, down]) / k
    a, b, c = np.asarray(corners, float)
    return float(np.mean(field(a + uv[:, :1] * (b - a) + uv[:, 1:] * (c - a))))
