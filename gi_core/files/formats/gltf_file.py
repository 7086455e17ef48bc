"""glTF 2.0 and GLB: the node tree, materials, lights and cameras.

Read here and not by trimesh 5.2, which drops emissive strength, lights, cameras and texture transforms,
and rounds colours to 8 bit. Light units are the format's: candela, lux, nits.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gi_core.files.formats.boundary import Boundary
from gi_core.files.formats.classes import lamps_of_texture
from gi_core.files.formats.file_parts import (
    LEAST_TRANSMISSION,
    MOST_COVER,
    FileParts,
    behind_cover,
    placed,
    transmitting,
)
from gi_core.files.formats.gltf_buffers import Document
from gi_core.files.formats.gltf_parts import (
    checked_materials,
    instances,
    local_matrix,
    morphed,
    name_of,
    node_camera,
    node_light,
)
from gi_core.files.formats.metallic_roughness import COAT, MATTE, MOST_COAT, is_diffuse, metallic_roughness
from gi_core.files.formats.texture_images import MISSING, NO_FINISH, Images
from gi_core.geometry.mesh_parts import untextured
from gi_core.scene.errors import SceneError, shown
from gi_core.scene.pose import three
from gi_core.scene.types import Finish, Material, Mesh, Paint, VariedFinish

TRIANGLES, STRIP, FAN = range(4, 7)
NEAREST = 9728
CHOSEN = {"metallicFactor", "roughnessFactor", "metallicRoughnessTexture"}  # without any, a material is diffuse
FINISH_VALUES = "linear", "linear", "alpha", "sRGB"  # of the textures of Finish
WRAPS = {33071: "clamp", 33648: "mirror", 10497: "repeat"}


def read_gltf(path: Path, data: bytes, where: str, boundary: Boundary) -> FileParts:
    """Read every triangle primitive of the default scene, with its world transform applied."""
    try:
        return _Reader(Document(path, data, where, boundary)).read()
    except SceneError:
        raise
    except (LookupError, TypeError, AttributeError, ValueError, ArithmeticError, RecursionError) as error:
        raise SceneError(f"{where}: the glTF is damaged ({type(error).__name__}: {error}); export it again") from None


class _Reader:
    def __init__(self, document: Document):
        self.document = document
        self.json = document.json
        self.notes = document.notes
        self.images = Images(document.boundary)
        listed = self.json.get("materials", [])
        document.boundary.take(document.where, "materials", len(listed) if isinstance(listed, list) else 0)
        described = checked_materials(listed, document.where, document.notes)
        self.described = [self._as_metallic_roughness(i, m) for i, m in enumerate(described)]
        self.materials = [self._material(i, m) for i, m in enumerate(self.described)]
        self.plain = None  # index of the material for primitives without one
        self.parts, self.lights, self.camera = [], [], None
        self.world = {}  # node -> (4, 4)
        self.joints: dict[int, np.ndarray] = {}  # skin -> (J, 4, 4)

    def read(self) -> FileParts:
        nodes = self.json.get("nodes", [])
        scenes = self.json.get("scenes", [])
        if scenes:
            roots = scenes[self.json.get("scene", 0)].get("nodes", [])
        else:
            children = {c for n in nodes for c in n.get("children", [])}
            roots = [i for i in range(len(nodes)) if i not in children]
        stack, hidden = [(i, np.eye(4)) for i in reversed(roots)], 0
        while stack:
            i, parent = stack.pop()
            self._take("nodes")
            if i in self.world:
                raise SceneError(f"{self.document.where}: node {i} has two parents; a glTF scene must be a tree")
            if nodes[i].get("extensions", {}).get("KHR_node_visibility", {}).get("visible", True) is False:
                hidden += 1
                continue
            self.world[i] = parent @ local_matrix(nodes[i])
            stack += [(c, self.world[i]) for c in reversed(nodes[i].get("children", []))]
        if hidden:
            self.notes.append(f"left out {hidden:,} nodes that are invisible in the file, with all that hangs on them")
        for i, matrix in self.world.items():
            node = nodes[i]
            if "mesh" in node:
                mesh = self.json["meshes"][node["mesh"]]
                weights = node.get("weights", mesh.get("weights", []))
                for instance in instances(self.document, node):
                    for k, primitive in enumerate(mesh["primitives"]):
                        what = f"mesh {node['mesh']} primitive {k}"
                        self._primitive(node, matrix @ instance, primitive, weights, what)
            light = node_light(self.json, node, matrix, len(self.lights) + 1)
            if light is not None:
                self._take("objects")
                self.lights.append(light)
            if self.camera is None:
                self.camera = node_camera(self.json, node, matrix)
        self.notes += self.images.notes()
        textures = tuple(self.images.textures)
        finishes = tuple(self.images.finishes)
        return FileParts(self.parts, self.materials, self.lights, self.camera, "y", self.notes, textures, finishes)

    def _primitive(self, node, matrix, primitive, weights, what):
        mode = primitive.get("mode", TRIANGLES)
        attributes = primitive["attributes"]
        if mode not in (TRIANGLES, STRIP, FAN) or "POSITION" not in attributes:
            self.notes.append(f"{what} holds points or lines: left out")
            return
        self._take("primitives")
        p = self.document.accessor(attributes["POSITION"])
        self._take("vertices", len(p))
        n = self.document.accessor(attributes["NORMAL"]) if "NORMAL" in attributes else None
        p, n = morphed(self.document, primitive, weights, p, n)
        if "skin" in node and "JOINTS_0" in attributes:
            p, n = self._skinned(node["skin"], attributes, p, n)
        else:
            p = p @ matrix[:3, :3].T + matrix[:3, 3]
            # Normals go with the cofactors; the sign keeps them outside under a mirroring transform.
            n = None if n is None else n @ _cofactor(matrix[:3, :3]).T
        order = (
            self.document.accessor(primitive["indices"]).reshape(-1) if "indices" in primitive else np.arange(len(p))
        )
        self._take("triangles", len(order) // 3 if mode == TRIANGLES else max(len(order) - 2, 0))
        faces = _triangles(order.astype(np.int64), mode)
        if len(faces) and not (0 <= faces.min() and faces.max() < len(p)):
            raise SceneError(f"{self.document.where}: {what} has vertex indices outside its {len(p)} vertices")
        if np.linalg.det(matrix[:3, :3]) < 0:
            faces = faces[:, ::-1]
        index = self._material_index(primitive.get("material"), what)
        faces = faces[self._there(index, attributes, faces)]
        normals = None if n is None else n[faces]
        paint, finish = self._paint(index, attributes, faces), self._finish(index, attributes, faces)
        material = self._emitting(index, attributes, p, faces)
        self.parts.append(Mesh(p, faces, material, normals, None, paint, finish))

    def _emitting(self, index: int, attributes: dict, p: np.ndarray, faces: np.ndarray) -> np.ndarray:
        """Return the materials (F,) of faces: those of an emissive texture where there is one."""
        reference = self.described[index].get("emissiveTexture") if index < len(self.described) else None
        name, transform = _coordinates(reference or {})
        image = None
        if reference is not None and len(faces) and any(self.materials[index].emission):
            at = reference.get("index")
            image = self.images.emissive(*self._image(at), self._wrap(at))
        if image is None:
            return np.full(len(faces), index, np.int64)
        if name in attributes:
            uv = _transform_uv(self.document.accessor(attributes[name]), transform)[faces]
            return lamps_of_texture(self.materials, index, p[faces], image, uv)
        self.materials.append(self.materials[index]._replace(emission=three(
            self.images.mean(image.pixels) * self.materials[index].emission
        )))  # fmt: skip
        return np.full(len(faces), len(self.materials) - 1, np.int64)

    def _material_index(self, index, what: str) -> int:
        """Return the index into `materials` that a primitive names, that of a plain one for None."""
        if index is None:
            if self.plain is None:
                self.plain = len(self.materials)
                self.materials.append(Material("default"))
            return self.plain
        count = len(self.described)
        if type(index) is not int or not 0 <= index < count:
            rule = f"{what} must name a material by its number, {_numbered(count)}"
            raise SceneError(f"{self.document.where}: {rule}, got {shown(index)}; correct it, or export it again")
        return index

    def _take(self, what: str, amount: int = 1) -> None:
        self.document.boundary.take(self.document.where, what, amount)

    def _there(self, index, attributes, faces) -> np.ndarray:
        """Return the faces (n,) bool that the alpha of their vertices does not remove."""
        described = self.described[index] if index < len(self.described) else {}
        colours = self.document.accessor(attributes["COLOR_0"]) if "COLOR_0" in attributes else np.zeros((0, 3))
        if _cut(described) is None or colours.shape[1] < 4:
            return np.ones(len(faces), bool)
        factor, cutoff = _cut(described)
        return (factor * colours[faces, 3] >= cutoff).any(axis=1)

    def _paint(self, index, attributes, faces) -> Paint | None:
        """Return the paint of a part; None: its material gives the colour."""
        described = self.described[index] if index < len(self.described) else {}
        reference = described.get("pbrMetallicRoughness", {}).get("baseColorTexture")
        factor = np.array(self.materials[index].reflectance)
        colour = uv = number = None
        if reference is not None:
            name, transform = _coordinates(reference)
            number = self._texture(reference.get("index"), _cut(described))
            if number is None:
                factor = factor * MISSING
                colour = np.broadcast_to(factor, (*faces.shape, 3))
            elif name in attributes:
                colour = np.broadcast_to(factor, (*faces.shape, 3))
                uv = _transform_uv(self.document.accessor(attributes[name]), transform)[faces]
            else:
                factor = factor * self.images.mean(self.images.textures[number].pixels)
                colour = np.broadcast_to(factor, (*faces.shape, 3))
                note = "its mesh has no texture coordinates, it shows the mean colour of its texture"
                note = f'material "{self.materials[index].name}": {note}'
                if note not in self.notes:
                    self.notes.append(note)
        if "COLOR_0" in attributes:
            vertex = self.document.accessor(attributes["COLOR_0"])[:, :3]
            if np.abs(vertex - 1).max(initial=0) > 1e-3:
                colour = factor * np.clip(vertex[faces], 0, 1)
        if uv is not None:
            return placed(np.full(len(faces), number), uv, colour)
        return None if colour is None else untextured(colour)

    def _finish(self, index: int, attributes: dict, faces: np.ndarray) -> Finish | None:
        """Return the textures of gloss on faces; None where the material is even."""
        layers: list[Paint | None] = [None] * len(FINISH_VALUES)
        if self.materials[index].varied is None:
            return None
        references = _finish_references(self.described[index])
        for k, (reference, values) in enumerate(zip(references, FINISH_VALUES, strict=True)):
            number = self._finish_texture(reference, values)
            name, transform = _coordinates(reference or {})
            if number is not None and name in attributes:
                uv = _transform_uv(self.document.accessor(attributes[name]), transform)[faces]
                layers[k] = placed(np.full(len(faces), number), uv)
        return Finish(*layers)

    def _finish_texture(self, reference: dict | None, values: str) -> int | None:
        """Return the index of a texture of gloss among those read, None if there is none or it cannot be read."""
        if reference is None:
            return None
        index = reference.get("index")
        return self.images.finish(*self._image(index), self._wrap(index), values)

    def _material(self, i: int, m: dict) -> Material:
        pbr = m.get("pbrMetallicRoughness", {})
        extensions = m.get("extensions", {})
        name = name_of(i, m)
        emission = np.array(m.get("emissiveFactor", [0, 0, 0]), np.float64)
        emission = emission * extensions.get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0)
        if "emissiveTexture" in m and emission.any():
            self.notes.append(f'material "{name}": each triangle emits the mean of its emissive texture')
        base = np.array(pbr.get("baseColorFactor", [1, 1, 1, 1])[:3], np.float64)
        plain = Material(name, three(base), three(emission), bool(m.get("doubleSided", False)))
        if m.get("alphaMode") == "BLEND" or "KHR_materials_transmission" in extensions:
            if (pane := self._pane(plain, m)) is not None:
                return pane
            holes = " but where its texture is more than half transparent" if "baseColorTexture" in pbr else ""
            self.notes.append(f'material "{name}" is transparent in the file: taken as opaque{holes}')
        return plain if "KHR_materials_unlit" in extensions else self._glossy(plain, m)

    def _pane(self, plain: Material, described: dict) -> Material | None:
        """Return a transparent material as a pane; None: light that it reflects or emits counts for more."""
        pbr, extensions = described.get("pbrMetallicRoughness", {}), described.get("extensions", {})
        transmission = extensions.get("KHR_materials_transmission", {})
        share, colour = float(transmission.get("transmissionFactor", 0.0)), np.array(plain.reflectance)
        if max(plain.emission) > 0:
            return None
        if share >= LEAST_TRANSMISSION:
            if "baseColorTexture" in pbr:
                image = self.images.pixels(
                    *self._image(pbr["baseColorTexture"].get("index")), "a pane is clear without"
                )
                colour = colour * (1.0 if image is None else self.images.mean(image))
            colour = share * colour
        else:
            cover = float(pbr.get("baseColorFactor", [1, 1, 1, 1])[3])
            if described.get("alphaMode") != "BLEND" or "baseColorTexture" in pbr or cover >= MOST_COVER:
                return None
            colour = behind_cover(cover, colour)
        frosted = share and float(pbr.get("roughnessFactor", 1.0)) > 0
        solid = float(extensions.get("KHR_materials_volume", {}).get("thicknessFactor", 0.0)) > 0
        ways = ", clear though rough in the file" * bool(frosted) + ", thin though solid in the file" * solid
        self.notes.append(f'material "{plain.name}" is a pane of glass{ways}')
        return transmitting(plain, colour, float(extensions.get("KHR_materials_ior", {}).get("ior", 1.5)))

    def _as_metallic_roughness(self, i: int, m: dict) -> dict:
        """Return a material of KHR_materials_pbrSpecularGlossiness as metallic-roughness, others as they are.

        A specular colour of more than MOST_COAT is a metal's.
        """
        old = m.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness")
        if old is None:
            return m
        specular, glossiness = np.array(old.get("specularFactor", [1, 1, 1])), old.get("glossinessFactor", 1.0)
        if "specularGlossinessTexture" in old:
            name, load = self._image(old["specularGlossinessTexture"].get("index"))
            image, alpha = (self.images.pixels(name, load, NO_FINISH), self.images.mean_alpha(name, load))
            if image is not None:
                specular, glossiness = specular * self.images.mean(image), glossiness * alpha
            self.notes.append(f'material "{name_of(i, m)}": its gloss is the mean of its specular-glossiness texture')
        diffuse, metal = old.get("diffuseFactor", [1, 1, 1, 1]), float(specular.max()) > MOST_COAT
        base = {"baseColorFactor": [*specular.tolist(), diffuse[3]] if metal else diffuse}
        if "diffuseTexture" in old and not metal:
            base["baseColorTexture"] = old["diffuseTexture"]
        pbr = {**base, "metallicFactor": float(metal), "roughnessFactor": 1.0 - glossiness}
        coat = {} if metal else {"KHR_materials_specular": {"specularColorFactor": (specular / COAT).tolist()}}
        return {**m, "pbrMetallicRoughness": pbr, "extensions": {**m["extensions"], **coat}}

    def _glossy(self, plain: Material, described: dict) -> Material:
        """Return the material with the gloss of its metallic-roughness description."""
        pbr, extensions = described.get("pbrMetallicRoughness", {}), described.get("extensions", {})
        if not pbr.keys() & CHOSEN:
            return plain
        metallic, roughness = (float(pbr.get(f"{key}Factor", 1.0)) for key in ("metallic", "roughness"))
        ior = float(extensions.get("KHR_materials_ior", {}).get("ior", 1.5))  # 0: all light is reflected
        specular = extensions.get("KHR_materials_specular", {})
        strength = float(specular.get("specularFactor", 1.0))
        tint = np.array(specular.get("specularColorFactor", [1, 1, 1]), np.float64)
        tint = tint * ((ior - 1) / (ior + 1)) ** 2
        if "metallicRoughnessTexture" not in pbr and is_diffuse(metallic, roughness, strength):
            return plain
        numbers = [self._finish_texture(*of) for of in zip(_finish_references(described), FINISH_VALUES, strict=True)]
        if any(k is not None for k in numbers):
            means = self.images.finish_means(numbers)
            return plain._replace(varied=VariedFinish(roughness, metallic, three(tint), strength, means, MATTE))
        if is_diffuse(metallic, roughness, strength):
            return plain
        colour = np.array(plain.reflectance)
        if "baseColorTexture" in pbr:
            image = self.images.pixels(*self._image(pbr["baseColorTexture"].get("index")), "a metal is grey without it")
            colour = colour * (MISSING if image is None else self.images.mean(image))
        return metallic_roughness(plain, metallic, roughness, np.minimum(tint, 1) * strength, strength, colour)

    def _texture(self, index: int, cut) -> int | None:
        """Return the index of a texture among those read, None if it cannot be."""
        nearest = self._sampler(index).get("magFilter") == NEAREST
        return self.images.texture(*self._image(index), self._wrap(index), nearest, cut)

    def _sampler(self, texture: int) -> dict:
        sampler = self.json["textures"][texture].get("sampler")
        return {} if sampler is None else self.json["samplers"][sampler]

    def _wrap(self, texture: int) -> tuple[str, str]:
        described = self._sampler(texture)
        across, along = (WRAPS.get(described.get(axis), "repeat") for axis in ("wrapS", "wrapT"))
        return across, along

    def _image(self, texture: int):
        """Return the name of a texture's image and the function that reads its bytes."""
        textures = self.json.get("textures", [])
        if type(texture) is not int or not 0 <= texture < len(textures):
            rule = f"a material must name a texture by its number, {_numbered(len(textures))}"
            raise SceneError(
                f"{self.document.where}: {rule}, got {shown(texture)}; add the texture, or correct the index"
            )
        described = textures[texture]
        # Some files name the image by an extension for its format alone: Pillow reads most of them.
        extended = (e["source"] for e in described.get("extensions", {}).values() if "source" in e)
        source = described.get("source", next(extended, None))
        if source is None:
            return f"texture {texture}", self.document.no_image
        return self.document.image_name(source), lambda: self.document.image(source)

    def _skinned(self, skin: int, attributes, p, n):
        """Return positions and normals in the pose that the file's nodes hold: the rest pose."""
        if skin not in self.joints:
            described = self.json["skins"][skin]
            world = np.stack([self.world.get(j, np.eye(4)) for j in described["joints"]])
            if "inverseBindMatrices" in described:
                inverse = self.document.accessor(described["inverseBindMatrices"])
                world = world @ inverse.reshape(-1, 4, 4).swapaxes(1, 2)
            self.joints[skin] = world
        ids = self.document.accessor(attributes["JOINTS_0"]).astype(np.int64)
        weights = self.document.accessor(attributes["WEIGHTS_0"])
        weights = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-12)
        # Joint by joint: the matrices of all four would take 512 bytes per vertex at once.
        blend = sum(w[:, None, None] * self.joints[skin][j] for w, j in zip(weights.T, ids.T, strict=True))
        moved = np.einsum("vab,vb->va", blend[:, :3, :3], p) + blend[:, :3, 3]
        return moved, None if n is None else np.einsum("vab,vb->va", blend[:, :3, :3], n)


def _numbered(count: int) -> str:
    return f"0 to {count - 1}" if count else "of which the file has none"


def _cut(material: dict) -> tuple[float, float] | None:
    """Return the factor of the texture's alpha and the cutoff below which a surface is a hole; None without holes.

    Blended materials are cut at one half: leaves and hair are often exported so. Their factor is thin glass.
    """
    mode = material.get("alphaMode", "OPAQUE")
    if mode == "MASK":
        factor = material.get("pbrMetallicRoughness", {}).get("baseColorFactor", [1, 1, 1, 1])
        return float(factor[3]), float(material.get("alphaCutoff", 0.5))
    return (1.0, 0.5) if mode == "BLEND" else None


def _cofactor(A: np.ndarray) -> np.ndarray:
    rows = [np.cross(A[1], A[2]), np.cross(A[2], A[0]), np.cross(A[0], A[1])]
    return np.stack(rows) * (1 if np.linalg.det(A) >= 0 else -1)


def _triangles(order: np.ndarray, mode: int) -> np.ndarray:
    if mode == TRIANGLES:
        return order[: len(order) // 3 * 3].reshape(-1, 3)
    k = np.arange(max(len(order) - 2, 0))
    if mode == FAN:
        return np.stack([np.broadcast_to(order[:1], k.shape), order[k + 1], order[k + 2]], axis=1)
    odd = k % 2  # every other triangle of a strip runs the other way round
    return np.stack([order[k], order[k + 1 + odd], order[k + 2 - odd]], axis=1)


def _finish_references(material: dict) -> tuple[dict | None, ...]:
    """Return the references to textures of gloss, in the order of Finish."""
    both = material.get("pbrMetallicRoughness", {}).get("metallicRoughnessTexture")
    specular = material.get("extensions", {}).get("KHR_materials_specular", {})
    return both, both, specular.get("specularTexture"), specular.get("specularColorTexture")


def _coordinates(reference: dict) -> tuple[str, dict]:
    """Return the attribute with the coordinates of a texture, and their transform."""
    transform = reference.get("extensions", {}).get("KHR_texture_transform", {})
    return f"TEXCOORD_{transform.get('texCoord', reference.get('texCoord', 0))}", transform


def _transform_uv(uv: np.ndarray, transform: dict) -> np.ndarray:
    if not transform:
        return uv
    r = transform.get("rotation", 0.0)
    u, v = (uv * transform.get("scale", [1, 1])).T
    rotated = np.stack([np.cos(r) * u + np.sin(r) * v, -np.sin(r) * u + np.cos(r) * v], axis=1)
    return rotated + transform.get("offset", [0, 0])
