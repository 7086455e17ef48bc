"""A scene made ready for tracing: flattened surfaces, accelerators, emitters, epsilons."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np

from gi_core.base.results import Results, digest
from gi_core.base.threads import available_cores
from gi_core.base.vectors import dot, length
from gi_core.bsdf.surface import Diffuse
from gi_core.geometry.mesh_neighbours import Neighbours, neighbours, open_sides, without
from gi_core.geometry.receiver_classes import covered_share
from gi_core.geometry.receivers import NONE, Receivers
from gi_core.geometry.surfaces import Surfaces, evaluation_points, flatten
from gi_core.lights.emission import Guide, build_emitters
from gi_core.lights.lamps import Lights, at_levels, lights_of
from gi_core.photons.pilot import LitPart, Pilot, lit_part, pilot
from gi_core.rays.accelerator import FAR, LIFT, Accelerator, Transforms, bounding_spheres, transforms
from gi_core.rays.all_objects import build_world, enclosing_sphere, nearest_in_world
from gi_core.rays.holes import holed_faces
from gi_core.rays.structures import checked
from gi_core.scene.errors import SceneError, nearest
from gi_core.scene.origin import origin_of, translated
from gi_core.scene.pose import as_pose, to_world, to_world_directions
from gi_core.scene.types import DistantLight, PlacedLight, Pose, Scene
from gi_core.scene.validate import check_scene

BEHIND = -2  # in place of the back receiver's index: this receiver is a back, its front represents both


class Model:
    """Derived data of a scene that does not depend on poses, estimator or photons.

    origins (objects, 3) float64 [m]: of each object's geometry in the given coordinates, zeros unless it lies far from
    their origin. `scene`, surfaces, receivers and transforms are relative to them; poses are in the given coordinates.
    rays: a key of `gi_core.rays.structures.STRUCTURES`; None: Embree, or bvh where Embree is missing. before: of an
    earlier version of the scene, results: of earlier versions; both save time alone.
    Raises SceneError for an invalid scene, and for any other name of rays.
    """

    def __init__(
        self, scene: Scene, threads: int | None = None, rays: str | None = None, before: Model | None = None,
        results: Results | None = None,
    ):  # fmt: skip
        check_scene(scene)
        self.given = scene
        self.origins = np.array([origin_of(mesh) for mesh in (scene.static, *(m.mesh for m in scene.mobiles))])
        self.names = [m.name for m in scene.mobiles]
        if len(set(self.names)) != len(self.names):
            raise SceneError(f"{scene.name}: the names of mobiles must differ, got {self.names}")
        self.scene = scene = self._shifted(scene)
        self.threads = available_cores() if threads is None else threads
        earlier = None if before is None else (before.scene, before.surfaces)
        self.surfaces, self.object_receivers = flatten(scene, before=earlier)
        self.accelerator = Accelerator(self.surfaces, self.threads, checked(rays))
        self.static = transforms([])
        self.first_probe = self.surfaces.receiver_range(0).stop - len(scene.probes)
        self.results = Results() if results is None else results
        self._guides: dict[str, Guide] = {}
        self._light()

    def _light(self) -> None:
        """Prepare the lights of the scene; epsilons depend on their places."""
        scene = self.scene
        centres, radii = bounding_spheres(self.surfaces)
        start = self.transforms(self.start_poses()).position[1:]
        mobiles = [p + s * (radii[o] + np.abs(centres[o])) for o, p in enumerate(start, 1) for s in (-1, 1)]
        lights = np.array([light.position for light in scene.lights if isinstance(light, PlacedLight)], np.float64)
        self.world = build_world(self.surfaces, self.accelerator, lights)
        # Directional and sky light must reach mobiles outside the static part.
        lit = enclosing_sphere(self.surfaces.vertices[0], lights, np.array(mobiles))
        distant = any(isinstance(light, DistantLight) for light in scene.lights)
        _check_reach(scene, self.surfaces, max(self.world.size, 2 * lit[1] * distant))
        self.emitters = build_emitters(scene, self.surfaces, *lit).guided(self._guide_of)
        self.lit = lit  # centre (3,) and radius [m] of the sphere that light can reach
        self.farthest = float(np.abs(lit[0]).max() + 1.5 * lit[1])  # [m], largest coordinate of lights and of photons

    def _guide_of(self, kind: int, parameters: np.ndarray, tables: np.ndarray) -> Guide:
        """Return the guide of a distant light, kept for other lights of the same geometry."""
        key = digest(np.array([kind, self.world.size]), parameters)
        if key not in self._guides:
            self._guides[key] = Guide(kind, parameters, tables, self._meets_receivers)
        return self._guides[key]

    def _meets_receivers(self, origin: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return whether rays (n, 3) meet a side of the static part that has receivers, and any side, (n,) bool."""
        limits = np.full(len(origin), FAR * self.world.size, np.float32)
        _, face = nearest_in_world(self.accelerator, self.static, origin, direction, limits)
        behind = dot(direction, self.world.normals[face]) > 0.0
        return (face >= 0) & (~behind | self.world.two_sided[face]), face >= 0

    def relit(self, scene: Scene) -> Model | None:
        """Return the model of a scene that differs in lights and poses alone, with the same geometry; None: in more.

        Raises SceneError for an invalid scene.
        """
        if not _same_objects(self.given, scene):
            return None
        check_scene(scene)
        other = copy.copy(self)
        for name in ("lights", "lamp_of_face", "static_rays_key", "static_key", "pilot", "lit_part"):
            other.__dict__.pop(name, None)
        other.given, other.scene = scene, self._shifted(scene)
        other._light()
        return other

    def _shifted(self, scene: Scene) -> Scene:
        """Return the scene with its places relative to `origins[0]`, and mobiles' meshes to their own origins."""
        mobiles = tuple(
            m._replace(mesh=m.mesh._replace(vertices=m.mesh.vertices - o)) if o.any() else m
            for m, o in zip(scene.mobiles, self.origins[1:], strict=True)
        )
        return replace(translated(replace(scene, mobiles=()), -self.origins[0]), mobiles=mobiles)

    def checked_poses(self, poses: Mapping[str, Pose | np.ndarray]) -> dict[str, Pose]:
        """Return valid poses. Raises SceneError for a name that no mobile has and for a pose that is not rigid."""
        for name in poses:
            if name not in self.names:
                raise SceneError(f'{self.scene.name}: no mobile is called "{name}"; {nearest(name, self.names)}')
        return {name: as_pose(pose, f'{self.scene.name}: mobile "{name}"') for name, pose in poses.items()}

    def start_poses(self) -> dict[str, Pose]:
        return self.checked_poses({m.name: m.pose for m in self.scene.mobiles})

    def transforms(self, poses: Mapping[str, Pose]) -> Transforms:
        """Return the transforms of all objects at the given poses, for geometry relative to `origins`."""
        at = transforms([poses[name] for name in self.names])
        if not self.origins.any():
            return at
        shift = (at.rotation @ self.origins[:, :, None])[:, :, 0] - self.origins[0]
        return at._replace(position=at.position + shift)

    def vertices_at(self, o: int, poses: Mapping[str, Pose]) -> np.ndarray:
        """Return the vertices (V, 3) float64 [m] of object o in the world."""
        points = self.surfaces.vertices[o] + self.origins[o]
        return to_world(poses[self.names[o - 1]], points) if o else points

    def receivers_at(self, poses: Mapping[str, Pose]) -> Receivers:
        """Return all receivers in the world."""
        positions, normals = self.object_receivers.positions.copy(), self.object_receivers.normals.copy()
        positions[self.surfaces.receiver_range(0)] += self.origins[0]
        for o, name in enumerate(self.names, 1):
            rows = self.surfaces.receiver_range(o)
            positions[rows] = to_world(poses[name], positions[rows] + self.origins[o])
            normals[rows] = to_world_directions(poses[name], normals[rows])
        return Receivers(positions, normals, self.object_receivers.areas)

    def with_shares(self, shares: np.ndarray) -> Model:
        """Return this model with other shares (G,) of its lamps in the photons."""
        other = copy.copy(self)
        other.emitters = self.emitters.shared(shares)
        return other

    def white(self) -> Model:
        """Return this model with all surfaces painted white: light goes wherever a path leads."""
        other, bsdfs = copy.copy(self), self.world.bsdfs
        white = np.full(bsdfs.reflectance.shape, 0.9)  # reflectance: paths have ten bounces on average
        changes = {"kind": np.full_like(bsdfs.kind, -1)} if not isinstance(bsdfs, Diffuse) else {}
        other.world = self.world._replace(bsdfs=bsdfs._replace(reflectance=white, albedo=white, **changes))
        return other

    @cached_property
    def shape_keys(self) -> list[str]:
        """Digest of each object's triangles, sides and receivers, and of the way of rays."""
        return [digest(self.accelerator.rays, *self._shape(o)) for o in range(self.surfaces.objects)]

    def _shape(self, o: int) -> list[np.ndarray]:
        s, r = self.surfaces, self.object_receivers
        rows, faces = s.receiver_range(o), s.face_range(o)
        front, back, patch = s.corner_front[faces], s.corner_back[faces], s.patch[faces]
        numbers = [front - rows.start, np.where(back >= 0, back - rows.start, back), patch - patch[:1]]
        receivers = [r.positions[rows], r.normals[rows], r.areas[rows]]
        return [s.vertices[o], s.faces[o], s.two_sided[faces], *numbers, *receivers]

    @cached_property
    def static_rays_key(self) -> str:
        """Digest of all that rays from the receivers of the static part depend on, bit for bit."""
        s, rows, faces, holed = self.surfaces, self.surfaces.receiver_range(0), self.surfaces.face_range(0), []
        paint, of_holes = s.paint[0], holed_faces(s)[0]
        if paint is not None and len(of_holes):
            textures = [(t.wrap, t.nearest, None if t.cover is None else digest(t.cover)) for t in paint.textures]
            holed = [of_holes, paint.face_texture[of_holes], paint.corner_uv[of_holes], textures]
        points = (a[rows] for a in self.evaluation_points)
        panes = s.panes[s.pane[faces]] if (s.pane[faces] >= 0).any() else s.panes[:0]
        places = self.world.size, self.origins[0], self.shape_keys[0], *points
        return digest(*places, panes, s.pane[faces] >= 0, *holed)

    @cached_property
    def static_key(self) -> str:
        """Digest of all that the light of the static part without mobiles depends on, bit for bit, but for a seed."""
        s, e, faces = self.surfaces, self.emitters, self.surfaces.face_range(0)
        lobe, (used, of_face) = s.lobe[faces].copy(), np.unique(self.scene.static.face_material, return_inverse=True)
        lobe[:, 4:][lobe[:, 4:] < 0] = -1.0  # numbers of tables: mobiles have some too
        models = [(m.brdf, m.scaled, m.grain) for m in (self.scene.materials[k] for k in used)]
        lights = e.kind, e.parameters, e.flux, e.cdf, e.units, e.lamp, e.tables, e.guides, e.lamps.names
        return digest(self.static_rays_key, s.reflectance[faces], lobe, models, of_face, *lights)

    @cached_property
    def pilot(self) -> Pilot:
        """A few photons of all lamps through the static part."""
        return pilot(self.accelerator, self.world, self.static, self.emitters)

    @cached_property
    def lit_part(self) -> LitPart:
        """The part of the static part that light reaches, relative to `origins[0]`."""
        return lit_part(self.pilot, self.surfaces)

    @property
    def scene_size(self) -> float:
        """Longest side [m] of the box of the lit part, unless the scene file states another size."""
        lit = self.lit_part
        return self.scene.defaults.scene_size or max(float((lit.high - lit.low).max()), 1e-9)

    @cached_property
    def lamp_of_face(self) -> np.ndarray:
        """Lamp of each emissive face, (F,) int32; 0 for all others."""
        lamps, materials = self.emitters.lamps, self.scene.materials
        out = np.zeros(len(self.surfaces.areas), np.int32)
        of_material = np.array([lamps.sources.get(m.name, 0) for m in materials], np.int32)
        out[self.surfaces.face_range(0)] = of_material[self.scene.static.face_material]
        return out * (self.surfaces.emission.max(axis=1) > 0)

    @cached_property
    def lights(self) -> Lights:
        """Lights for path tracing, apart by lamp."""
        return lights_of(self.scene, self.surfaces, self.emitters.lamps)

    def lights_at(self, levels: np.ndarray) -> Lights:
        """Return the lights as one lamp, at levels (G, 3) of the lamps."""
        return at_levels(self.lights, levels)

    @cached_property
    def receiver_sides(self) -> np.ndarray:
        """2 patch + side of each receiver (1: back of a two-sided surface), -1 of probes, (R,) int32."""
        s = self.surfaces
        own = np.full(len(self.object_receivers.areas), -1, np.int32)
        own[s.corner_front.reshape(-1)] = np.repeat(2 * s.patch, 3)
        back = s.corner_back.reshape(-1)
        own[back[back >= 0]] = np.repeat(2 * s.patch + 1, 3)[back >= 0]
        return own

    @cached_property
    def linked(self) -> Neighbours:
        """Neighbours of all receivers along edges of the mesh; those of the static part come first, and stay apart."""
        corners = np.concatenate([self.corners(o) for o in range(self.surfaces.objects)])
        return neighbours(corners, len(self.object_receivers.areas))

    @cached_property
    def adjacency(self) -> Neighbours:
        """Those of `linked` whose edge lies in the open: their light is alike.

        A floor goes on under a wall between two rooms. Averages across it had the dark one's corners 80 % off.
        """
        hidden = [self._hidden_edges(o) for o in range(self.surfaces.objects)]
        return without(self.linked, np.concatenate(hidden))

    @cached_property
    def open_sides(self) -> np.ndarray:
        """open_sides() (2 F, 3) int32 of the fronts and backs of static faces, numbered face by face."""
        s, faces = self.surfaces, self.surfaces.face_range(0)
        corners = np.stack([s.corner_front[faces], s.corner_back[faces]], axis=1)
        return open_sides(corners.reshape(-1, 3), self.adjacency)

    def _hidden_edges(self, o: int) -> np.ndarray:
        """Return edges (k, 2) of object o's faces, as receivers, that its own opaque faces cross just above them."""
        aside = 1e-3  # of the edge: how far rays are above the face, and from its ends; of the way to the middle
        s, faces, hidden = self.surfaces, self.surfaces.face_range(o), [np.zeros((0, 2), np.int32)]
        places, normals = s.vertices[o][s.faces[o]].astype(np.float64), s.normals[faces]
        lift = LIFT * np.abs(places).max(axis=(1, 2), initial=0.0)
        for side, corners in ((1.0, s.corner_front[faces]), (-1.0, s.corner_back[faces])):
            rows = np.flatnonzero((corners >= 0).all(axis=1))
            for start, end in ((0, 1), (1, 2), (2, 0)):
                p, way = places[rows, start], places[rows, end] - places[rows, start]
                size = length(way)[:, None]
                way /= np.maximum(size, 1e-300)
                inward = places[rows].mean(axis=1) - p
                inward -= dot(inward, way)[:, None] * way
                above = side * (lift[rows, None] + aside * size) * normals[rows]
                rays = p + aside * (size * way + inward) + above, way, (1.0 - 2.0 * aside) * size[:, 0]
                blocked = self.accelerator.occluded(o, *(a.astype(np.float32) for a in rays))
                hidden.append(corners[rows[blocked]][:, [start, end]])
        return np.concatenate(hidden)

    def corners(self, o: int) -> np.ndarray:
        """Return the receivers at the corners of object o's faces, fronts and then backs, (m, 3) int32."""
        s, faces = self.surfaces, self.surfaces.face_range(o)
        back = s.corner_back[faces]
        return np.concatenate([s.corner_front[faces], back[(back >= 0).all(axis=1)]])

    def backs(self, o: int) -> np.ndarray:
        """Return for each receiver of object o the back receiver of its disc, (n,) int32 within the object.

        NONE on one-sided surfaces, BEHIND for back receivers.
        """
        s, rows = self.surfaces, self.surfaces.receiver_range(o)
        front, back = (c[s.face_range(o)].reshape(-1) for c in (s.corner_front, s.corner_back))
        front, back = front[back >= 0] - rows.start, back[back >= 0] - rows.start
        out = np.full(rows.stop - rows.start, NONE, np.int32)
        out[front] = back
        out[back] = BEHIND
        return out

    @cached_property
    def towards_faces(self) -> np.ndarray:
        """Offset from each receiver to the mean centroid of its faces [m], in object space, (R, 3) float64."""
        s, n = self.surfaces, len(self.object_receivers.areas)
        total, count = np.zeros((n, 3)), np.zeros(n)
        for o in range(s.objects):
            p = s.vertices[o][s.faces[o]]
            centroids = np.repeat((p[:, 0] + p[:, 1] + p[:, 2]) / 3, 3, axis=0)
            for corners in (s.corner_front, s.corner_back):
                index = corners[s.face_range(o)].reshape(-1)
                has = index >= 0
                count += np.bincount(index[has], minlength=n)
                for c in range(3):
                    total[:, c] += np.bincount(index[has], centroids[has, c], n)
        has = count > 0
        out = np.zeros((n, 3))
        out[has] = total[has] / count[has][:, None] - self.object_receivers.positions[has]
        return out

    @cached_property
    def evaluation_points(self) -> tuple[np.ndarray, np.ndarray]:
        """Evaluation points of all receivers [m] and their normals, both (R, 3) float64, in object space."""
        return evaluation_points(self.surfaces, self.object_receivers)

    @cached_property
    def lifts(self) -> np.ndarray:
        """How far rays start off the evaluation points of the static part's receivers, (n,) float64 [m]."""
        points, normals = (a[self.surfaces.receiver_range(0)] for a in self.evaluation_points)
        out, probes = LIFT * np.abs(points).max(axis=1, initial=0.0), slice(self.first_probe, None)
        out[probes] = self.lifts_at(self.static, points[probes], normals[probes])  # others are off their faces
        return out

    def lifts_at(self, at: Transforms, positions: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Return how far (n,) [m] rays start off points of the world: past the rounding of a face that they lie on.

        A ray meets a face with an error that grows with the face's coordinates, such as those of a lawn under a chair.
        """
        face, reach = self.faces_at(at, positions, normals, LIFT), np.append(self.world.reach, 0.0)
        return LIFT * np.maximum(np.abs(positions).max(axis=1, initial=0.0), reach[face])

    def faces_at(self, at: Transforms, positions: np.ndarray, normals: np.ndarray, share: float) -> np.ndarray:
        """Return the face (n,) int64 that each point of the world lies on, -1 for none.

        share: of the face's largest coordinate, the distance along the normal (n, 3) up to which a point lies on it.
        """
        reach, n = np.append(self.world.reach, 0.0), len(positions)
        out, nearest = np.full(n, -1), np.full(n, np.inf)
        for way in (-normals, normals):
            limits = np.full(n, share * reach.max())
            distance, face = nearest_in_world(self.accelerator, at, positions, way, limits)
            on = (face >= 0) & (distance <= share * reach[face]) & (distance < nearest)
            out[on], nearest[on] = face[on], distance[on]
        return out

    @cached_property
    def covered_share(self) -> np.ndarray:
        """alpha / 2 pi of each receiver, (R,) float64; see `gi_core.geometry.receiver_classes`."""
        return covered_share(self.surfaces, self.object_receivers)

    @cached_property
    def concave(self) -> np.ndarray:
        """Whether a patch rises through a tangent plane on a side, (2 P,) bool by 2 patch + side."""
        own, way = self.receiver_sides, self.towards_faces
        height = dot(way, self.object_receivers.normals)
        # The faces around a receiver are about as wide as the root of its area.
        # height over width of the faces around a receiver: in float32 files of flat surfaces up to 1e-5
        rises = (own >= 0) & (height > 1e-3 * np.sqrt(self.object_receivers.areas))
        out = np.zeros(2 * (int(self.surfaces.patch.max(initial=-1)) + 1), bool)
        out[own[rises]] = True
        return out


def _same_objects(a: Scene, b: Scene) -> bool:
    """Return whether two scenes share all objects, materials and probes."""

    def parts(scene: Scene) -> list:
        meshes = (scene.static, *(m.mesh for m in scene.mobiles))
        return [*map(id, (*meshes, *scene.materials)), *(m.name for m in scene.mobiles), scene.probes]

    return parts(a) == parts(b)


def _check_reach(scene: Scene, surfaces: Surfaces, reach: float) -> None:
    """Raise SceneError for lights, mobiles or vertices so far away that rays miss the static part or its corners."""
    farthest_reach = 1000  # sizes of the static part; at 3000, float32 loses 5 % of the light in corners
    size = 2 * enclosing_sphere(surfaces.vertices[0][surfaces.faces[0]])[1]
    if size and reach > farthest_reach * size:
        raise SceneError(
            f"{scene.name}: lights, lit mobiles and unused vertices reach over {reach:.3g} m, more than "
            f"{farthest_reach} times the static part's {size:.3g} m, so float32 rays are inexact; move them nearer"
        )
