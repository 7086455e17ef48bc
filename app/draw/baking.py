"""Light baked into the vertices of a GLB file: unlit materials times vertex colours. Light maps: irradiance as an
image over a second set of texture coordinates (xatlas).

Each vertex has COLOR_0 and _IRRADIANCE [W/m2 or lx], both linear float32. A material's base colour times its texture
times COLOR_0 is the diffuse radiance at an exposure, with white balance. glTF requires values of COLOR_0 up to 1, so
those above are cut off; by default the exposure is the highest at which lamps alone are. Gloss depends on the view and
is not baked: materials keep metallic and roughness, from which an engine adds reflections of its own.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from PIL import Image
from trimesh.triangles import closest_point, points_to_barycentric

from app.draw.camera import Turntable
from app.draw.shot import Shot
from app.draw.vertex_colours import colours, mean_radiance
from app.settings import UsageError
from gi_core.files.formats.gltf_buffers import GlbWriter
from gi_core.files.formats.gltf_file import NEAREST, WRAPS
from gi_core.files.formats.metallic_roughness import as_metal_rough
from gi_core.scene.pose import least_turn, quaternion_of
from gi_core.scene.types import Material, Mesh, Texture

CODES = {name: code for code, name in WRAPS.items()}
UNLIT, TRANSMISSION, IOR = "KHR_materials_unlit", "KHR_materials_transmission", "KHR_materials_ior"
UP = np.array([0.0, 1.0, 0.0])  # of a glTF file


class Baked(NamedTuple):
    """A file of light, and its light map, if one was asked for."""

    glb: bytes
    light_map: LightMap | None


class Side(NamedTuple):
    """The faces of one material and texture of an object, seen from one side."""

    material: int
    texture: int  # -1: none
    tinted: bool  # vertex colours contain the reflectance; else the material's base colour does
    lamp: bool
    back: bool
    faces: np.ndarray  # (n,) int64


def baked(shot: Shot, exposure: float | None = None, light_map: tuple[int, str] | None = None) -> Baked:
    """Return a GLB file of the scene with its light; mobiles are nodes at their poses.

    shot: its exposure is noted in the file; exposure [EV]: of COLOR_0, None: by default; light_map: pixels per side,
    about, and name of the light map's file. Raises UsageError if that many pixels do not suffice.
    """
    shot.expose()
    baking = _Baking(shot)
    if light_map is not None:
        baking.unwrap(light_map[0])
    exposure = baking.default_exposure() if exposure is None else exposure
    notes = {"exposure": exposure, "picture_exposure": shot.exposure, "gains": list(shot.gains)}
    notes["units"] = shot.solver.scene.units
    if light_map is not None:
        notes["light_map"] = {"file": light_map[1], "texCoord": 1}
    return Baked(baking.file(shot.camera, exposure, notes), baking.light_map())


class _Baking:
    def __init__(self, shot: Shot) -> None:
        lit = shot.lit
        self.model, self.poses, self.meshes, self.factor = lit.model, lit.poses, lit.meshes, np.array(shot.gains)
        self.irradiance = shot.solver.irradiance.astype(np.float32)
        self.drawn, self.weights = lit.drawn  # unreached vertices filled, as in the picture
        self.parts = [self.model.scene.static, *(m.mesh for m in self.model.scene.mobiles)]
        self.out = GlbWriter()
        self.materials: list[dict] = []
        self.material_index: dict[tuple, int] = {}  # material, texture, tinted -> index
        self.textures: list[dict] = []
        self.samplers: list[dict] = []
        self.of_texture: dict[Texture, int] = {}
        self.unwrapped: list[Unwrapped] = []  # of all sides, in order; []: without a light map
        self.map_size = 0, 0

    def _all_sides(self) -> Iterator[tuple[int, Side]]:
        return ((o, side) for o, mesh in enumerate(self.parts) for side in self._sides(o, mesh))

    def unwrap(self, pixels: int) -> None:
        """Prepare the light map."""
        meshes = []
        for o, side in self._all_sides():
            rows, corners = self._triangles(o, side)
            meshes.append((self.meshes[o].positions[rows], corners))
        self.unwrapped, self.map_size = unwrap(meshes, pixels)

    def light_map(self) -> LightMap | None:
        """Return the irradiance over the second texture coordinates; None without them."""
        if not self.unwrapped:
            return None
        parts = []
        for (o, side), part in zip(self._all_sides(), self.unwrapped, strict=True):
            receivers = self._receivers(o, side)[self._triangles(o, side)[0][part.vertices]]
            weights = np.ones(len(receivers)) if self.weights is None else self.weights[receivers]
            parts.append((part, self.drawn[receivers], weights))
        return light_map(self.map_size, parts)

    def _receivers(self, o: int, side: Side) -> np.ndarray:
        """Return the receiver of each draw vertex of an object on a side."""
        return self.meshes[o].back if side.back else self.meshes[o].front

    def _triangles(self, o: int, side: Side) -> tuple[np.ndarray, np.ndarray]:
        """Return the draw vertices (m,) of a side, and its triangles (n, 3) in these, counter-clockwise from it."""
        triangles = self.meshes[o].triangles[side.faces]
        rows, corners = np.unique(triangles, return_inverse=True)
        corners = corners.reshape(-1, 3)
        return rows, corners[:, ::-1] if side.back else corners

    def default_exposure(self) -> float:
        """Return the highest exposure [EV] at which no colour exceeds 1, lamps left out; 0 without light."""
        dark = ((o, s) for o, s in self._all_sides() if not s.lamp)
        most = max((float(self._colours(o, s).max(initial=0.0)) for o, s in dark), default=0.0)
        return -math.log2(most) if most > 0 else 0.0

    def file(self, camera: Turntable, exposure: float, notes: dict) -> bytes:
        """Return the file's bytes; notes: extras of its scene."""
        scene, at, parts = self.model.scene, self.model.transforms(self.poses), self.parts
        self.factor, names = self.factor * 2.0**exposure, ["static", *self.model.names]
        nodes: list[dict] = [{"name": scene.name, "children": list(range(1, len(parts) + 2))}]
        turn = least_turn(np.array(scene.up) / np.linalg.norm(scene.up), UP)  # z becomes y as in Blender's exporter
        nodes[0] |= _placed(turn, turn @ self.model.origins[0])
        gltf_meshes: list[dict] = []
        unwrapped = iter(self.unwrapped)
        for o, (name, mesh) in enumerate(zip(names, parts, strict=True)):
            primitives = [self._primitive(o, side, next(unwrapped, None)) for side in self._sides(o, mesh)]
            nodes.append({"name": name} | _placed(at.rotation[o], at.position[o]))
            if primitives:
                nodes[-1]["mesh"] = len(gltf_meshes)
                gltf_meshes.append({"name": name, "primitives": primitives})
        view = camera.relative_to(self.model.origins[0])
        eye = np.linalg.inv(view.view())
        nodes.append({"name": "camera", "camera": 0} | _placed(eye[:3, :3], eye[:3, 3]))
        near, far = view.depths()
        lens = {"type": "perspective", "perspective": {"yfov": view.fov, "znear": near, "zfar": far}}
        document: dict[str, Any] = {
            "scene": 0,
            "scenes": [{"nodes": [0], "extras": notes}],
            "nodes": nodes,
            "meshes": gltf_meshes,
            "materials": self.materials,
            "cameras": [lens],
            "extensionsUsed": sorted({UNLIT, *(name for m in self.materials for name in m["extensions"])}),
        }
        if self.textures:
            document |= {"textures": self.textures, "samplers": self.samplers}
        return self.out.bytes(document)

    def _sides(self, o: int, mesh: Mesh) -> Iterator[Side]:
        """Yield the sides of an object; the back of a two-sided face has its own light, and so its own triangles."""
        paint, surfaces = mesh.paint, self.model.surfaces
        texture = np.full(len(mesh.faces), -1) if paint is None else paint.face_texture
        materials = self.model.scene.materials
        kinds = np.unique(np.stack([mesh.face_material, texture], axis=1), axis=0)
        two_sided = surfaces.two_sided[surfaces.face_range(o)]
        for m, t in kinds:
            faces = np.flatnonzero((mesh.face_material == m) & (texture == t))
            tinted = bool(t >= 0 or _is_painted(mesh, faces, materials[m]))
            lit = any(materials[m].emission)
            yield Side(int(m), -1 if lit else int(t), tinted or lit, lit, False, faces)
            if len(backs := faces[two_sided[faces]]):
                yield Side(int(m), int(t), tinted, False, True, backs)

    def _colours(self, o: int, side: Side) -> np.ndarray:
        """Return the colours (m, 3) of the draw vertices of a side."""
        draw, rows = self.meshes[o], self._triangles(o, side)[0]
        if self.model.scene.materials[side.material].pane is not None:
            return np.ones((len(rows), 3))
        pair = colours(draw, self.drawn, side.tinted)
        if side.lamp:  # with the mean of its texture
            pair = mean_radiance(draw, *pair)
        base = self.model.scene.materials[side.material]
        if not side.tinted and base.gloss is not None:
            described = as_metal_rough(np.array(base.reflectance), base.gloss).base
            diffuse = np.divide(base.reflectance, described, out=np.zeros(3), where=described > 0)
            pair = pair[0] * diffuse, pair[1] * diffuse
        return pair[side.back][rows] * self.factor

    def _primitive(self, o: int, side: Side, unwrapped: Unwrapped | None) -> dict:
        draw, colour = self.meshes[o], self._colours(o, side)
        rows, corners = self._triangles(o, side)
        if unwrapped is not None:
            rows, colour, corners = rows[unwrapped.vertices], colour[unwrapped.vertices], unwrapped.corners
        receivers = self._receivers(o, side)[rows]
        normals = self.model.object_receivers.normals[receivers].astype(np.float32)
        normals[~normals.any(axis=1)] = UP
        store = self.out.accessor
        attributes = {
            "POSITION": store(draw.positions[rows], bounds=True),
            "NORMAL": store(normals),
            "COLOR_0": store(np.clip(colour, 0, 1).astype(np.float32)),
            "_IRRADIANCE": store(self.irradiance[receivers]),
        }
        if side.texture >= 0:
            attributes["TEXCOORD_0"] = store(draw.uv[rows].astype(np.float32))
        if unwrapped is not None:
            attributes["TEXCOORD_1"] = store(unwrapped.uv)
            attributes.setdefault("TEXCOORD_0", attributes["TEXCOORD_1"])  # glTF numbers them without gaps
        indices = store(corners.astype(np.uint32).reshape(-1))
        return {"attributes": attributes, "indices": indices, "material": self._material(o, side)}

    def _material(self, o: int, side: Side) -> int:
        texture = self.meshes[o].textures[side.texture] if side.texture >= 0 else None
        key = side.material, texture, side.tinted
        if key not in self.material_index:
            self.material_index[key] = len(self.materials)
            base = self.model.scene.materials[side.material]
            self.materials.append(self._described(base, texture, side.tinted))
        return self.material_index[key]

    def _described(self, base: Material, texture: Texture | None, tinted: bool) -> dict:
        if base.pane is not None:
            glass = {"baseColorFactor": [*base.pane.transmittance, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.0}
            more = {TRANSMISSION: {"transmissionFactor": 1.0}, IOR: {"ior": base.pane.ior}}
            return {"name": base.name, "pbrMetallicRoughness": glass, "extensions": more}
        metal = None if base.gloss is None else as_metal_rough(np.array(base.reflectance), base.gloss)
        factor = np.ones(3) if tinted else np.array(base.reflectance) if metal is None else metal.base
        share, roughness = (0.0, 1.0) if metal is None else (metal.metallic, metal.roughness)
        pbr: dict[str, Any] = {"baseColorFactor": [*factor.tolist(), 1.0]}
        pbr |= {"metallicFactor": share, "roughnessFactor": roughness}
        out: dict[str, Any] = {"name": base.name, "pbrMetallicRoughness": pbr, "extensions": {UNLIT: {}}}
        out["extras"] = {"reflectance": base.reflectance, "emission": base.emission}
        if base.gloss is not None:
            out["extras"]["gloss"] = base.gloss._asdict()
        if base.brdf:
            out["extras"]["brdf"] = [dict(k.parameters) | {"model": k.model, "factor": k.factor} for k in base.brdf]
        if texture is not None:
            pbr["baseColorTexture"] = {"index": self._texture(texture)}
            if texture.cover is not None:
                out |= {"alphaMode": "MASK", "alphaCutoff": 0.5}  # 0.5 of the alpha of a texture with holes
        return out

    def _texture(self, texture: Texture) -> int:
        if texture not in self.of_texture:
            pixels = texture.pixels
            if texture.cover is not None:
                pixels = np.concatenate([pixels, texture.cover[..., None]], axis=2)
            data = io.BytesIO()
            Image.fromarray(np.ascontiguousarray(pixels)).save(data, "PNG")
            wraps = dict(zip(("wrapS", "wrapT"), (CODES[w] for w in texture.wrap), strict=True))
            near = NEAREST if texture.nearest else 9729  # GL_LINEAR
            self.samplers.append(wraps | {"magFilter": near, "minFilter": 9987})  # GL_LINEAR_MIPMAP_LINEAR
            self.textures.append({"source": self.out.image(data.getvalue()), "sampler": len(self.samplers) - 1})
            self.of_texture[texture] = len(self.textures) - 1
        return self.of_texture[texture]


def _is_painted(mesh: Mesh, faces: np.ndarray, material: Material) -> bool:
    """Return whether the colours of faces (n,) differ from that of their material."""
    flat = None if mesh.face_reflectance is None else mesh.face_reflectance[faces]
    at_corners = None if mesh.paint is None else mesh.paint.corner_colour[faces]
    # 1e-6: reflectances this close are one; paint has float32
    return any(c is not None and not np.allclose(c, material.reflectance, atol=1e-6) for c in (flat, at_corners))


def _placed(rotation: np.ndarray, position: np.ndarray) -> dict:
    """Return a node's transform; nothing for the identity."""
    w, x, y, z = quaternion_of(rotation)
    turned = {} if np.array_equal(rotation, np.eye(3)) else {"rotation": [x, y, z, w]}
    return turned | ({"translation": np.asarray(position).tolist()} if np.any(position) else {})


PADDING = 4  # texels between charts, filled with the light of the nearest chart
SEAM = 1.0  # texels round a triangle that its light continues in: bilinear filters read there


class Unwrapped(NamedTuple):
    """A mesh cut along the edges of its charts."""

    vertices: np.ndarray  # (m,) numbers of the mesh's vertices
    corners: np.ndarray  # (n, 3) of each triangle, in these
    uv: np.ndarray  # (m, 2) float32 in 0 .. 1, from the upper left corner of the image


class LightMap(NamedTuple):
    """Irradiance over texture coordinates."""

    irradiance: np.ndarray  # (h, w, 3) float32 [W/m2 or lx]
    coverage: np.ndarray  # (h, w) float32: 1 where a texel's centre lies in a chart


def unwrap(meshes: Sequence[tuple[np.ndarray, np.ndarray]], pixels: int) -> tuple[list[Unwrapped], tuple[int, int]]:
    """Return each mesh, positions (m, 3) and triangles (n, 3), unwrapped into one image, and its width and height.

    pixels: about, per side. Raises UsageError.
    """
    import xatlas

    atlas = xatlas.Atlas()
    for positions, triangles in meshes:
        atlas.add_mesh(np.ascontiguousarray(positions, np.float32), np.ascontiguousarray(triangles, np.uint32))
    packing = xatlas.PackOptions()
    packing.resolution, packing.padding, packing.bilinear, packing.create_image = pixels, PADDING, True, False
    atlas.generate(xatlas.ChartOptions(), packing)
    if atlas.atlas_count != 1:
        raise UsageError(f"the light map of {pixels} pixels needs {atlas.atlas_count} images: choose more pixels")
    arrays = (atlas[k] for k in range(len(meshes)))
    return [Unwrapped(v.astype(np.int64), c.astype(np.int64), uv) for v, c, uv in arrays], (atlas.width, atlas.height)


def light_map(size: tuple[int, int], parts: Iterable[tuple[Unwrapped, np.ndarray, np.ndarray]]) -> LightMap:
    """Return the light of unwrapped meshes, each with irradiance (m, 3) and interpolation weights (m,) at its vertices.

    A texel has the light of its centre, interpolated as in the picture. size: width and height.
    """
    width, height = size
    light = np.zeros((height * width, 3), np.float32)
    nearest = np.full(height * width, np.inf)  # squared distance of a texel's centre from its triangle [texels2]
    for part, irradiance, weights in parts:
        at = part.uv.astype(np.float64) * (width, height) - 0.5  # centres of texels are whole numbers
        for triangles in _chunks(at[part.corners]):
            rows = part.corners[triangles]
            f, texel, shares, away = _texels(at[rows], width, height)
            share = shares * weights[rows[f]]
            values = (share[:, :, None] * irradiance[rows[f]]).sum(axis=1) / share.sum(axis=1)[:, None]
            order = np.argsort(-away, kind="stable")  # the nearest triangle is written last
            order = order[away[order] < nearest[texel[order]]]
            light[texel[order]], nearest[texel[order]] = values[order], away[order]
    filled = np.isfinite(nearest)
    _fill(light, filled, width, height)
    covered = (nearest == 0).astype(np.float32)
    return LightMap(light.reshape(height, width, 3), covered.reshape(height, width))


def _boxes(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the first texel (n, 2) and the numbers of texels (n, 2) of boxes round triangles (n, 3, 2)."""
    low = np.floor(p.min(axis=1) - SEAM).astype(np.int64)
    return low, np.ceil(p.max(axis=1) + SEAM).astype(np.int64) - low + 1


def _chunks(p: np.ndarray) -> Iterable[np.ndarray]:
    """Yield numbers of triangles (n, 3, 2) whose boxes have about a million texels together; flat ones are left out."""
    e, g = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    solid = np.flatnonzero(np.abs(e[:, 0] * g[:, 1] - e[:, 1] * g[:, 0]) > 1e-9)
    if len(solid):
        sizes = _boxes(p[solid])[1].prod(axis=1)
        yield from np.split(solid, np.flatnonzero(np.diff(np.cumsum(sizes) // (1 << 20))) + 1)


def _texels(p: np.ndarray, width: int, height: int) -> tuple[np.ndarray, ...]:
    """Return the texels within SEAM of triangles (n, 3, 2): triangle, texel, barycentric weights (k, 3) of the nearest
    point on it, and the squared distance from that."""
    low, size = _boxes(p)
    counts = size.prod(axis=1)
    f = np.repeat(np.arange(len(p)), counts)
    k = np.arange(len(f)) - np.repeat(np.cumsum(counts) - counts, counts)
    centre = low[f] + np.stack([k % size[f, 0], k // size[f, 0]], axis=1)
    corners, at = (np.pad(a, [*[(0, 0)] * (a.ndim - 1), (0, 1)]) for a in (p[f], centre))  # in the plane z = 0
    nearest = closest_point(corners, at)
    shares = points_to_barycentric(corners, nearest, "cross")
    away = ((nearest - at) ** 2).sum(axis=1)
    away[away < 1e-18] = 0.0
    inside = ((centre >= 0) & (centre < (width, height))).all(axis=1) & (away <= SEAM * SEAM)
    return f[inside], centre[inside, 1] * width + centre[inside, 0], shares[inside], away[inside]


def _fill(light: np.ndarray, filled: np.ndarray, width: int, height: int) -> None:
    """Give texels within PADDING of filled ones the mean of their filled neighbours, ring by ring, in place."""
    for _ in range(PADDING):
        grid, seen = light.reshape(height, width, 3), filled.reshape(height, width)
        total, count = np.zeros((height + 2, width + 2, 3), np.float64), np.zeros((height + 2, width + 2))
        for y in range(3):
            for x in range(3):
                total[y : y + height, x : x + width] += np.where(seen[..., None], grid, 0)
                count[y : y + height, x : x + width] += seen
        sums, counts = total[1:-1, 1:-1].reshape(-1, 3), count[1:-1, 1:-1].reshape(-1)
        ring = ~filled & (counts > 0)
        light[ring] = sums[ring] / counts[ring, None]
        filled |= ring
