"""Rows of the failure atlas: prediction by theory, measurement, remedy; and the small scenes that they measure."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from trimesh.creation import revolve

from gi_core.geometry.mesh_parts import join
from gi_core.scene import Camera, DirectionalLight, Material, Mesh, Scene
from gi_core.solver import Solver

SEEDS = 8  # runs per standard error


class Number(NamedTuple):
    """A measured mean and its standard error, 0 for numbers without chance."""

    mean: float
    error: float = 0.0
    runs: int = 1  # behind the error

    def __str__(self) -> str:
        if self.error <= 1e-12 * abs(self.mean):
            return f"{self.mean:.4g}"
        digits = max(1 - math.floor(math.log10(self.error)), 0)  # two digits of the error
        return f"{self.mean:.{digits}f} ± {self.error:.{digits}f}"


class View(NamedTuple):
    """The picture of a row: a scene under the setting that fails and under its remedy."""

    scene: Scene
    photons: int
    fails: dict  # fields of Setting
    helps: dict | None
    caption: str = "as it fails"  # without a remedy


class AtlasRow(NamedTuple):
    """One failure. Numbers are irradiance over truth unless `quantity` says otherwise."""

    key: str  # of its picture
    where: str
    theory: str
    predicted: float
    measured: Number
    remedy: str = "none needed"
    remedied: Number | None = None  # None: there is no remedy
    aim: float = 1.0  # prediction for `remedied`
    within: float = 0.0  # absolute uncertainty of the prediction
    cost: str = ""
    aim_within: float = 0.0  # absolute uncertainty of the aim
    view: View | None = None
    quantity: str = "E / truth"
    title: str = ""  # of the section of this row and its neighbours; "": `where`


def solved(scene: Scene, photons: int, seed: int = 0, **setting) -> Solver:
    """Return a solver that has traced its photons."""
    solver = Solver(scene, photons=photons, seed=seed, **{"neighbours": 50, "radius": 0.1, **setting})
    solver.solve()
    return solver


def over_seeds(runs: Callable[[int], Sequence[float]], seeds: int) -> list[Number]:
    """Return mean and standard error over seeds of each number of `runs(seed)`."""
    samples = np.array([runs(seed) for seed in range(seeds)], float)
    errors = samples.std(axis=0, ddof=1) / math.sqrt(seeds)
    return [Number(float(m), float(e), seeds) for m, e in zip(samples.mean(axis=0), errors, strict=True)]


def ratios(scene: Scene, photons: int, places: Sequence, settings: Sequence[dict], truth: float = 1.0):
    """Return irradiance / truth by setting and group of receivers.

    places: a function per group, receivers -> (R,) bool. All settings use the same photons.
    """

    def run(seed):
        solver, means = solved(scene, photons, seed, **settings[0]), []
        groups = [place(solver.receivers) for place in places]
        assert all(g.any() for g in groups)
        for setting in settings:
            solver.configure(**setting)
            solver.solve()
            means += [solver.irradiance[g, 1].mean() / truth for g in groups]
        return means

    flat = over_seeds(run, SEEDS)
    return [flat[k : k + len(places)] for k in range(0, len(flat), len(places))]


def near(*points) -> Callable:
    """Return a function of receivers: which of them (R,) bool lie at one of the points."""

    def find(receivers):
        p = receivers.positions
        return np.any([np.abs(p - q).max(axis=1) < 1e-6 for q in np.asarray(points, float)], axis=0)

    return find


BLACK = Material("black", (0.0, 0.0, 0.0))
SUN = DirectionalLight("sun", (0, 0, -1), (1.0, 1.0, 1.0), disc_degrees=0.0)
BARE: dict[str, Any] = {"estimator": "tangent_plane", "control": False}
CONTROL: dict[str, Any] = {"estimator": "tangent_plane", "control": True}
COUNT: dict[str, Any] = {"estimator": "impact_count"}
UNCORRECTED: dict[str, Any] = {"estimator": "photon_map", "border_correction": False}
FURNACE = 2 * math.pi  # E = pi Le / (1 - rho) in furnace()
UP = (0.0, 0.0, 1.0)


def sheet(corner, u, v, divisions=(1, 1), material: int = 0) -> Mesh:
    """Return a parallelogram; its front is the side of u x v."""
    m, n = divisions
    s, t = np.meshgrid(np.linspace(0, 1, m + 1), np.linspace(0, 1, n + 1), indexing="ij")
    points = np.asarray(corner, float) + s[..., None] * np.asarray(u, float) + t[..., None] * np.asarray(v, float)
    at = np.arange((m + 1) * (n + 1)).reshape(m + 1, n + 1)
    a, b, c, d = (x.reshape(-1) for x in (at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return Mesh(points.reshape(-1, 3), faces.astype(np.int32), np.full(len(faces), material, np.int32))


def floor(divisions: int) -> Mesh:
    """Return a square of 2 m about the origin that faces up."""
    return sheet((-1, -1, 0), (2, 0, 0), (0, 2, 0), (divisions, divisions))


def fan(place, degrees: float, step: float = 30.0) -> Mesh:
    """Return triangles round an apex that faces up: together they span an angle; 360 closes them."""
    count = max(round(degrees / step), 1)
    a = np.radians(degrees) * np.arange(count + (degrees < 360)) / count
    rim = np.stack([np.cos(a), np.sin(a), 0 * a], axis=1)
    points = np.concatenate([[[0.0, 0, 0]], rim]) + np.asarray(place, float)
    k = np.arange(count)
    faces = np.stack([0 * k, 1 + k, 1 + (k + 1) % len(a)], axis=1)
    return Mesh(points, faces.astype(np.int32), np.zeros(count, np.int32))


def box(low, high, divisions: int = 1, material: int = 0, inward: bool = False) -> Mesh:
    """Return a closed box, its front outside, or inside: a room."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    sides = []
    for axis in range(3):
        u, v = np.zeros(3), np.zeros(3)
        u[(axis + 1) % 3], v[(axis + 2) % 3] = (high - low)[(axis + 1) % 3], (high - low)[(axis + 2) % 3]
        top = np.where(np.arange(3) == axis, high, low)
        for corner, outward in ((top, True), (low, False)):
            a, b = (u, v) if outward != inward else (v, u)
            sides.append(sheet(corner, a, b, (divisions, divisions), material))
    return joined(*sides)


def ball(radius: float, rings: int = 24, inward: bool = False) -> Mesh:
    """Return a sphere about the origin from rings of latitude, its front outside or inside."""
    angle = np.linspace(0, np.pi, rings + 1)
    turned = revolve(radius * np.stack([np.sin(angle), -np.cos(angle)], axis=1), sections=2 * rings)
    faces = np.ascontiguousarray(turned.faces[:, ::-1] if inward else turned.faces, np.int32)
    return Mesh(np.array(turned.vertices, np.float64), faces, np.zeros(len(faces), np.int32))


def joined(*meshes: Mesh) -> Mesh:
    """Return several meshes as one; materials keep their numbers."""
    return join(list(meshes), ())


def scene(mesh: Mesh, materials, eye, target, lights=(), mobiles=()) -> Scene:
    """Return a scene with z up and a camera for its picture."""
    return Scene(mesh, tuple(materials), tuple(mobiles), tuple(lights), (), Camera(eye, target, 40.0), UP, name="atlas")


def furnace(divisions: int, *more: Mesh) -> Scene:
    """A closed room whose surfaces all emit Le = 1 and reflect: E = pi / (1 - rho) everywhere."""
    glow = Material("glow", (0.5,) * 3, (1.0, 1.0, 1.0))
    room = joined(box((0.0,) * 3, (1.0,) * 3, divisions, inward=True), *more)
    return scene(room, (glow,), (0.5, -1.9, 1.1), (0.5, 0.5, 0.4))


def control_off_and_on(radius: float) -> list[dict[str, Any]]:
    """Return the settings of tangent_plane, radius in metres."""
    return [{**BARE, "radius": radius}, {**CONTROL, "radius": radius}]


def beyond(distance: float, radius: float) -> float:
    """Return the share of a disc's area that lies beyond a line at a distance from its middle (negative: before it)."""
    d = max(min(distance / radius, 1.0), -1.0)
    return (math.acos(d) - d * math.sqrt(1 - d * d)) / math.pi
