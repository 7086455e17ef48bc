"""glTF 2.0 files, as text and as GLB."""

import base64
import contextlib
import json
import math
import struct

import numpy as np

from tests.support.grammar.choices import Files, Grammar, shape
from tests.support.grammar.images import image

COMPONENTS = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
SHAPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Document:
    """A glTF document under construction: its JSON, and the bytes of its one buffer."""

    def __init__(self, g: Grammar, files: Files) -> None:
        self.g, self.files, self.data = g, files, bytearray()
        self.json: dict = {"asset": {"version": g.leaf("2.0")}}
        self.extensions: set[str] = set()

    def add(self, table: str, entry: dict) -> int:
        """Append an entry to a table of the document; its index, seldom another."""
        self.json.setdefault(table, []).append(entry)
        index = len(self.json[table]) - 1
        return self.g.leaf(index) if self.g.chance(0.3) else index

    def view(self, body: bytes, stride: int = 0) -> int:
        self.data += bytes(-len(self.data) % 4)
        entry = {"buffer": self.g.leaf(0), "byteLength": self.g.leaf(len(body))}
        if self.data or self.g.chance(0.5):
            entry["byteOffset"] = self.g.leaf(len(self.data))
        if stride:
            entry["byteStride"] = self.g.leaf(stride)
        if self.g.chance(0.3):
            entry["target"] = self.g.pick(34962, 34963)
        self.data += body
        return self.add("bufferViews", entry)

    def accessor(self, array: np.ndarray, component: int = 5126, normalized: bool = False) -> int:
        """An accessor of an array (N, C): packed, interleaved, sparse, or of zeros without a view."""
        g = self.g
        array = np.atleast_2d(np.asarray(array).T).T
        kind = COMPONENTS[component]
        values = array.astype(kind)
        entry: dict = {
            "componentType": g.leaf(component),
            "count": g.leaf(len(values)),
            "type": g.leaf(SHAPES[array.shape[1]]),
        }
        if len(values) and g.chance(0.8):
            entry |= {"min": [float(v) for v in array.min(axis=0)], "max": [float(v) for v in array.max(axis=0)]}
        if normalized:
            entry["normalized"] = g.leaf(True)
        way = g.pick("packed", "packed", "packed", "padded", "sparse", "sparse zeros")
        size = values.dtype.itemsize * values.shape[1]
        if way == "padded" or (size % 4 and array.shape[1] > 1):
            stride = -(-size // 4) * 4 + g.pick(0, 4, 12) * (way == "padded")
            body = b"".join(row.tobytes().ljust(stride, b"\0") for row in values)
            entry["bufferView"] = self.view(body, stride)
        elif way != "sparse zeros":
            entry["bufferView"] = self.view(values.tobytes())
        if way == "sparse zeros" or (way == "sparse" and len(values)):
            chosen = (
                np.arange(len(values))
                if way == "sparse zeros"
                else np.sort(g.rng.sample(range(len(values)), g.rng.randint(1, len(values))))
            )
            entry["sparse"] = {
                "count": g.leaf(len(chosen)),
                "indices": {
                    "bufferView": self.view(np.asarray(chosen, np.uint32).tobytes()),
                    "componentType": g.leaf(5125),
                },
                "values": {"bufferView": self.view(values[chosen].tobytes())},
            }
            if not len(chosen):
                del entry["sparse"]
        return self.add("accessors", entry)


def gltf(g: Grammar, files: Files, stem: str, binary: bool) -> str:
    """One glTF, as .glb or .gltf with or without an external buffer, added to `files`; its name."""
    d = Document(g, files)
    materials = [d.add("materials", _gltf_material(d)) for _ in range(g.rng.randint(0, 3))]
    meshes = [d.add("meshes", _gltf_mesh(d, materials)) for _ in range(g.rng.randint(1, 3))]
    nodes = _gltf_nodes(d, meshes)
    if g.chance(0.9):
        d.add("scenes", {"nodes": g.leaf(nodes)} | ({"name": g.name()} if g.chance(0.3) else {}))
        if g.chance(0.8):
            d.json["scene"] = g.leaf(0)
    if g.chance(0.1):
        times, values = d.accessor(np.array([0.0, 1.0])), d.accessor(np.zeros((2, 3)))
        channel = {"sampler": 0, "target": {"node": 0, "path": "translation"}}
        d.add("animations", {"channels": [channel], "samplers": [{"input": times, "output": values}]})
    if d.extensions:
        d.json["extensionsUsed"] = sorted(d.extensions)
        if g.chance(0.2):
            d.json["extensionsRequired"] = sorted(d.extensions)
    if g.chance(g.oddity):
        d.json["extensionsRequired"] = [
            g.pick("KHR_draco_mesh_compression", "EXT_meshopt_compression", "VENDOR_unknown", "KHR_texture_basisu")
        ]
    if g.chance(0.1):
        d.json |= {"extras": {"a": [1, {"b": None}]}, "extensions": d.json.get("extensions", {}) | {"VENDOR_x": {}}}
    name = f"{stem}.{'glb' if binary else 'gltf'}"
    if binary and g.chance(0.8):
        d.json["buffers"] = [{"byteLength": g.leaf(len(d.data))}]
        files[name] = _glb(g, d)
        return name
    if g.chance(0.5):
        uri = (
            "data:"
            + g.pick("application/octet-stream", "application/gltf-buffer", "")
            + ";base64,"
            + base64.b64encode(d.data).decode()
        )
    else:
        uri = g.pick(f"{stem}.bin", f"{stem}%20b.bin")
        files[uri.replace("%20", " ")] = bytes(d.data)
    d.json["buffers"] = [{"byteLength": g.leaf(len(d.data)), "uri": g.leaf(uri)}]
    d.data = bytearray()
    files[name] = _glb(g, d) if binary else _json(g, d)
    return name


def material_names(body: bytes) -> list[str]:
    """The names of the materials of a glTF file; of one without any, or too odd to be read, that of plain surfaces."""
    text = body[20 : 20 + int.from_bytes(body[12:16], "little")] if body[:4] == b"glTF" else body
    with contextlib.suppress(ValueError, AttributeError):
        materials = json.loads(text).get("materials", [])
        return [str(m.get("name") or f"material {i}") for i, m in enumerate(materials)] or ["default"]
    return ["default"]


def _json(g: Grammar, d: Document) -> bytes:
    return json.dumps(d.json, indent=g.pick(None, None, 2), ensure_ascii=g.chance(0.5)).encode("utf-8", "surrogatepass")


def _glb(g: Grammar, d: Document) -> bytes:
    text = _json(g, d)
    chunks = [(g.leaf(0x4E4F534A), text + b" " * (-len(text) % 4))]
    if d.data:
        chunks.append((g.leaf(0x004E4942), bytes(d.data) + bytes(-len(d.data) % 4)))
    if g.chance(0.1):
        chunks.append((0x12345678, b"abcd"))
    if g.chance(g.oddity):
        g.rng.shuffle(chunks)

    def word(value: object) -> bytes:
        return struct.pack("<I", int(value) % 2**32) if isinstance(value, int) else b"\xff\xff\xff\xff"

    body = b"".join(word(g.leaf(len(c))) + word(kind) + c for kind, c in chunks)
    return b"glTF" + word(g.leaf(2)) + word(g.leaf(12 + len(body))) + body


def _texture(d: Document) -> dict:
    g = d.g
    body = image(g)
    entry: dict = {}
    if g.chance(0.4):
        entry = {"bufferView": d.view(body), "mimeType": g.leaf(g.pick("image/png", "image/jpeg"))}
    elif g.chance(0.5):
        entry = {"uri": g.leaf("data:image/png;base64," + base64.b64encode(body).decode())}
    else:
        name = g.pick("wood.png", "brick.jpg")
        d.files.setdefault(name, body)
        entry = {"uri": g.leaf(name)}
    texture = {"source": d.add("images", entry)}
    if g.chance(0.5):
        wrap = {"wrapS": g.leaf(g.pick(33071, 33648, 10497)), "wrapT": g.leaf(g.pick(33071, 33648, 10497))}
        texture["sampler"] = d.add("samplers", wrap | ({"magFilter": 9728, "minFilter": 9987} if g.chance(0.5) else {}))
    use: dict = {"index": d.add("textures", texture)}
    if g.chance(0.3):
        use["texCoord"] = g.leaf(g.pick(0, 1))
    if g.chance(0.3):
        d.extensions.add("KHR_texture_transform")
        use["extensions"] = {
            "KHR_texture_transform": {
                "offset": g.leaf(g.reals(2)),
                "rotation": g.leaf(g.real()),
                "scale": g.leaf(g.reals(2)),
            }
        }
    return use


def _gltf_material(d: Document) -> dict:
    g = d.g
    material: dict = {"name": g.leaf(g.name())} if g.chance(0.7) else {}
    if g.chance(0.8):
        rough = {"baseColorFactor": g.leaf(g.reals(4, 0.0, 1.0))}
        rough |= {key: g.leaf(g.pick(0, 1, g.real(0.0, 1.0))) for key in ("metallicFactor", "roughnessFactor")}
        material["pbrMetallicRoughness"] = {k: v for k, v in rough.items() if g.chance(0.7)}
        for key in ("baseColorTexture", "metallicRoughnessTexture"):
            if g.chance(0.3):
                material["pbrMetallicRoughness"][key] = _texture(d)
    if g.chance(0.0 if g.dark else 0.4):
        material["emissiveFactor"] = g.leaf(g.reals(3, 0.0, 1.0))
        if g.chance(0.5):
            d.extensions.add("KHR_materials_emissive_strength")
            material["extensions"] = {
                "KHR_materials_emissive_strength": {"emissiveStrength": g.leaf(g.real(0.0, 50.0))}
            }
    if g.chance(0.3):
        d.extensions.add("KHR_materials_specular")
        specular: dict = {
            "specularFactor": g.leaf(g.real(0.0, 1.0)),
            "specularColorFactor": g.leaf(g.reals(3, 0.0, 2.0)),
        }
        specular |= {key: _texture(d) for key in ("specularTexture", "specularColorTexture") if g.chance(0.6)}
        material.setdefault("extensions", {})["KHR_materials_specular"] = g.leaf(specular)
    if g.chance(0.2):
        d.extensions.add("KHR_materials_ior")
        ior = g.leaf({"ior": g.leaf(g.pick(0, 1, g.real(1.0, 3.0)))})
        material.setdefault("extensions", {})["KHR_materials_ior"] = ior
    for key in ("normalTexture", "occlusionTexture", "emissiveTexture"):
        if g.chance(0.15):
            material[key] = _texture(d)
    if g.chance(0.3):
        material |= {"alphaMode": g.leaf(g.pick("OPAQUE", "MASK", "BLEND")), "doubleSided": g.leaf(g.chance(0.5))}
        if material["alphaMode"] == "MASK":
            material["alphaCutoff"] = g.leaf(g.real(0.0, 1.0))
    return material


def _gltf_mesh(d: Document, materials: list[int]) -> dict:
    g = d.g
    primitives = []
    for k in range(g.pick(1, 1, 2)):
        vertices, faces = shape(g)
        triangles = np.array([[f[0], f[i], f[i + 1]] for f in faces for i in range(1, len(f) - 1)])
        points = np.array(vertices, dtype=np.float64)
        n = len(points)
        attributes = {"POSITION": d.accessor(points)}
        if g.chance(0.1):
            d.extensions.add("KHR_mesh_quantization")
            span = max(1e-9, np.abs(points).max())
            attributes["POSITION"] = d.accessor(np.round(points / span * 30000), 5122, normalized=True)
        if g.chance(0.5):
            normal = np.array([g.reals(3, 0.1, 1.0) for _ in range(n)]) + 0.01
            attributes["NORMAL"] = d.accessor(normal / np.linalg.norm(normal, axis=1, keepdims=True))
        for key in ("TEXCOORD_0", "TEXCOORD_1"):
            if g.chance(0.5):
                part = g.pick((5126, 1.0), (5121, 255.0), (5123, 65535.0))
                attributes[key] = d.accessor(
                    np.array([g.reals(2, 0.0, 1.0) for _ in range(n)]) * part[1], part[0], part[0] != 5126
                )
        if g.chance(0.3):
            width, part = g.pick(3, 4), g.pick((5126, 1.0), (5121, 255.0), (5123, 65535.0))
            colours = np.array([g.reals(width, 0.0, 1.0) for _ in range(n)])
            attributes["COLOR_0"] = d.accessor(colours * part[1], part[0], part[0] != 5126)
        if g.chance(0.1):
            attributes |= {"TANGENT": d.accessor(np.ones((n, 4))), "_CUSTOM": d.accessor(np.ones(n))}
        if g.chance(0.2):
            joints = d.accessor(np.zeros((n, 4)), g.pick(5121, 5123))
            attributes |= {"JOINTS_0": joints, "WEIGHTS_0": d.accessor(np.tile([1.0, 0, 0, 0], (n, 1)))}
        primitive: dict = {"attributes": attributes}
        mode = g.pick(4, 4, 5, 6, *([0, 1, 2, 3] if k else []))
        if mode != 4 or g.chance(0.5):
            primitive["mode"] = g.leaf(mode)
        if mode == 4 or g.chance(0.5):
            order = triangles.reshape(-1) if mode == 4 else np.arange(n)
            primitive["indices"] = d.accessor(
                order, g.pick(5125, *([5123] if n < 65535 else []), *([5121] if n < 255 else []))
            )
        if materials and g.chance(0.8):
            primitive["material"] = g.pick(*materials)
        if g.chance(0.1):
            primitive["targets"] = [{"POSITION": d.accessor(np.zeros((n, 3)))}]
        if g.chance(g.oddity / 2):
            primitive["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}
        primitives.append({k: v for k, v in primitive.items() if not g.chance(g.oddity / 4)})
    return {"primitives": g.leaf(primitives)} | ({"name": g.name()} if g.chance(0.5) else {})


def _gltf_nodes(d: Document, meshes: list[int]) -> list[int]:
    g = d.g
    count = g.rng.randint(len(meshes), len(meshes) + 4)
    first_skin = None
    for i in range(count):
        node: dict = {"mesh": meshes[i]} if i < len(meshes) else {}
        if g.chance(0.3):
            node["matrix"] = g.leaf([1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, *g.reals(3), 1.0])
        elif g.chance(0.6):
            angle = g.real(0.0, 3.0)
            placed = {
                "translation": g.reals(3),
                "rotation": [0.0, math.sin(angle), 0.0, math.cos(angle)],
                "scale": g.reals(3, 0.6, 2.0),
            }
            node |= {k: g.leaf(v) for k, v in placed.items() if g.chance(0.6)}
        if i >= len(meshes) and g.chance(0.3):
            kind = g.pick("perspective", "perspective", "orthographic")
            lens = (
                {"yfov": g.leaf(0.8), "znear": g.leaf(0.1)}
                if kind == "perspective"
                else {"xmag": 1.0, "ymag": 1.0, "znear": 0.1, "zfar": 9.0}
            )
            node["camera"] = d.add("cameras", {"type": g.leaf(kind), kind: lens})
        if g.chance(0.3):
            d.extensions.add("KHR_lights_punctual")
            lights = d.json.setdefault("extensions", {}).setdefault("KHR_lights_punctual", {"lights": []})["lights"]
            kind = g.pick("point", "spot", "directional")
            light: dict = {
                "type": g.leaf(kind),
                "intensity": g.leaf(g.real(0.0, 500.0)),
                "color": g.leaf(g.reals(3, 0.0, 1.0)),
            }
            if kind == "spot":
                light["spot"] = g.leaf({"innerConeAngle": g.leaf(0.2), "outerConeAngle": g.leaf(0.6)})
            lights.append({k: v for k, v in light.items() if k == "type" or g.chance(0.9)})
            node["extensions"] = {"KHR_lights_punctual": {"light": g.leaf(len(lights) - 1)}}
        if g.chance(0.1) and "mesh" in node:
            d.extensions.add("EXT_mesh_gpu_instancing")
            moves = d.accessor(np.array([g.reals(3) for _ in range(g.pick(1, 3, 50))]))
            node.setdefault("extensions", {})["EXT_mesh_gpu_instancing"] = {"attributes": {"TRANSLATION": moves}}
        if first_skin is None and g.chance(0.1) and "mesh" in node:
            inverse = d.accessor(np.tile(np.eye(4).reshape(-1), (1, 1)))
            node["skin"] = first_skin = d.add("skins", {"joints": g.leaf([count - 1]), "inverseBindMatrices": inverse})
        if g.chance(0.3):
            node["name"] = g.leaf(g.name())
        d.add("nodes", node)
    roots = []
    for i in range(count):
        if i and g.chance(0.4):
            parent = d.json["nodes"][g.rng.randrange(i)]
            parent.setdefault("children", []).append(i)
        else:
            roots.append(i)
    if g.chance(g.oddity):
        d.json["nodes"][g.rng.randrange(count)]["children"] = [g.rng.randrange(count)]
    return roots
