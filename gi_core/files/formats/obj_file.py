"""Wavefront OBJ with its MTL.

Read here and not by trimesh: both classic Cornell boxes use relative indices between the vertices,
which trimesh 5.2 turns into wrong geometry without a word. It also keeps `Ke` as text.
"""

from __future__ import annotations

import math
import os
from array import array
from pathlib import Path

import numpy as np

from gi_core.files.formats.boundary import Boundary, text_of
from gi_core.files.formats.file_parts import FileParts, Part
from gi_core.files.formats.metallic_roughness import metallic_roughness
from gi_core.files.formats.texture_images import MISSING, Images, find
from gi_core.scene.errors import SceneError
from gi_core.scene.pose import three
from gi_core.scene.types import Gloss, Material

NO_MATERIAL = "default"
NUMBERS = {"Ns": (0.0, 1e6), "Pm": (0.0, 1.0), "Pr": (0.0, 1.0), "illum": (0.0, 10.0)}  # ranges of a material's numbers
LEAST_SPECULAR, LEAST_EXPONENT = 0.01, 2.0  # of Ks and Ns; less is diffuse


def read_obj(path: Path, data: bytes, where: str, boundary: Boundary) -> FileParts:
    """Read triangles and polygons (cut into fans), normals, materials and colour textures."""
    text = _joined(data)
    boundary.take(where, "lines of text", text.count("\n"))
    boundary.take(where, "vertices", text.count("\nv"))
    v, vt, vn = array("d"), array("d"), array("d")
    corners, face_material = array("q"), array("q")  # of each corner three indices: position, texture, normal
    library, names, current, notes, images = {}, {}, None, [], Images(boundary)
    libraries = set()
    for number, line in enumerate(text.split("\n"), 1):
        word, rest = [*line.split(None, 1), "", ""][:2]
        if word in ("v", "vt", "vn", "f"):
            rest = rest.partition("#")[0]
        try:
            if word == "v":
                v.extend(_numbers(rest, 3))
            elif word == "vn":
                vn.extend(_numbers(rest, 3))
            elif word == "vt":
                vt.extend(_numbers(rest + " 0", 2))
            elif word == "f":
                written = rest.split()
                boundary.take(where, "triangles", max(len(written) - 2, 0))
                counts = len(v) // 3, len(vt) // 2, len(vn) // 3
                polygon = [_corner(c, counts) for c in written]
                if current is None:
                    current = names.setdefault(NO_MATERIAL, len(names))
                for k in range(1, len(polygon) - 1):
                    corners.extend((*polygon[0], *polygon[k], *polygon[k + 1]))
                    face_material.append(current)
            elif word == "usemtl":
                current = names.setdefault(rest.strip() or NO_MATERIAL, len(names))
            elif word == "mtllib" and rest not in libraries:
                libraries.add(rest)
                library.update(_read_library(path, rest.strip(), where, notes, images, boundary))
        except SceneError:
            raise
        except (ValueError, IndexError) as error:
            raise SceneError(f"{where}: line {number} is not OBJ ({error}): {line.strip()[:60]!r}") from None
    vertices, placed, directions = (np.array(a).reshape(-1, n) for a, n in ((v, 3), (vt, 2), (vn, 3)))
    faces, uv_ids, ids = np.array(corners, np.int64).reshape(-1, 3, 3).transpose(2, 0, 1)
    material = np.array(face_material, np.int64)
    _average_unplaced(names, library, material, uv_ids, images, notes)
    materials = [library[n].material if n in library else Material(n, two_sided=True) for n in names]
    missing = [n for n in names if n not in library and n != NO_MATERIAL]
    if missing:
        notes.append(f"no definition of material {', '.join(missing)}: taken as grey 0.7")
    normals = directions[ids] if len(vn) and len(ids) and ids.min() >= 0 else None
    texture, uv = _texture_coordinates(names, library, material, placed, uv_ids)
    part = Part(vertices, faces, material, normals, None, texture, uv)
    return FileParts([part], materials, [], None, "y", notes + images.notes(), tuple(images.textures))


def _joined(data: bytes) -> str:
    """Return text whose continued lines are joined."""
    return text_of(data, "replace").replace("\\\n", " ")


class _Entry:
    """A material of an MTL file."""

    def __init__(self, name: str):
        self.name, self.kd, self.ke = name, (0.7, 0.7, 0.7), (0.0, 0.0, 0.0)
        self.ks, self.ns, self.illum = (0.0, 0.0, 0.0), 0.0, 2  # Phong's colour and exponent; 0, 1: without them
        self.pm, self.pr = 0.0, None  # metallic and roughness, of the PBR extension
        self.picture: tuple | None = None  # name, loader and wrapping of map_Kd
        self.mask: tuple | None = None  # name and loader of map_d: where the surface is
        self.dissolved = False  # the file says that it is transparent all over
        self.texture: int | None = None  # into Images.textures
        self.missing = False  # the texture
        self.scale, self.offset = (1.0, 1.0), (0.0, 0.0)  # of texture coordinates, v upwards

    @property
    def material(self) -> Material:
        plain = Material(self.name, (MISSING,) * 3 if self.missing else self.kd, self.ke, two_sided=True)
        if self.pr is not None:
            return metallic_roughness(plain, self.pm, self.pr)
        if self.illum < 2 or max(self.ks) < LEAST_SPECULAR or self.ns < LEAST_EXPONENT:
            return plain
        # Microfacets whose lobe is as wide as that of the exponent (Walter et al. 2007); the sum stays below 1.
        rest, alpha = 1 - max(self.ks), math.sqrt(2 / (self.ns + 2))
        kd = three(min(c, rest) for c in plain.reflectance)
        return plain._replace(reflectance=kd, gloss=Gloss(self.ks, alpha, max(self.ks)))


def _numbers(text: str, n: int) -> list[float]:
    values = [float(x) for x in text.split()[:n]]
    if len(values) < n:
        raise ValueError(f"{n} numbers wanted")
    return values


def _corner(text: str, counts: tuple[int, int, int]) -> tuple[int, int, int]:
    """Return 0-based position, texture and normal index of `7`, `7/1`, `7//3`, `-1/-1/-1`; -1 for none."""
    fields = (text.split("/") + ["", ""])[:3]
    if not fields[0]:
        raise ValueError("a corner must name a vertex")
    result = []
    for field, count in zip(fields, counts, strict=True):
        if not field:
            result.append(-1)
            continue
        # A negative index counts back from the last element read so far, not from the end of the file.
        i = int(field)
        i = i - 1 if i > 0 else i + count
        if i < 0 or (i >= count):
            raise ValueError(f"index {field} of {count}")
        result.append(i)
    return tuple(result)


def _read_library(obj: Path, name: str, where: str, notes, images: Images, boundary: Boundary) -> dict[str, _Entry]:
    # Exporters write the path of their own machine: the file's bare name beside the OBJ comes next.
    tries = [obj.parent / name, obj.parent / name.replace("\\", "/").rpartition("/")[2], obj.with_suffix(".mtl")]
    found = next((p for p in tries if boundary.file(p)), None)
    if found is None:
        boundary.take(where, "files")  # a file that was not found counts too
        why = "lies outside the folder of the scene" if os.path.isfile(tries[0]) else "not found"
        notes.append(f"material file {name} {why}: materials taken as grey 0.7")
        return {}
    entries, entry = {}, None
    for line in _joined(boundary.read(found, where)).split("\n"):
        words = line.partition("#")[0].split()
        if not words:
            continue
        if words[0] == "newmtl":
            entry = entries.setdefault(" ".join(words[1:]), _Entry(" ".join(words[1:])))
        elif entry is not None and words[0] in ("Kd", "Ke") and len(words) > 1 and words[1] not in ("spectral", "xyz"):
            colour = tuple(max(0.0, float(x)) for x in (words[1:] * 3)[:3])
            setattr(entry, words[0].lower(), colour)
        elif entry is not None and words[0] == "Ks" and len(words) > 1 and words[1] not in ("spectral", "xyz"):
            entry.ks = three(min(max(0.0, float(x)), 1.0) for x in (words[1:] * 3)[:3])
        elif entry is not None and words[0] in NUMBERS and len(words) > 1 and _is_number(words[1]):
            low, high = NUMBERS[words[0]]
            setattr(entry, words[0].lower(), min(max(low, float(words[1])), high))
        elif entry is not None and words[0] in ("d", "Tr") and len(words) > 1 and _is_number(words[-1]):
            entry.dissolved = 0 < float(words[-1]) < 1  # exporters disagree about the meaning of 0 and 1 in Tr
        elif entry is not None and words[0] in ("map_Kd", "map_Ke", "map_d", "map_D") and len(words) > 1:
            _read_map(entry, words, images, [found.parent, obj.parent], boundary, notes)
    for entry in entries.values():
        _make_texture(entry, images)
    dissolved = [f'"{e.name}"' for e in entries.values() if e.dissolved]
    if dissolved:
        notes.append(f"transparent in the file, taken as opaque: {', '.join(dissolved)}")
    return entries


def _make_texture(entry: _Entry, images: Images) -> None:
    """Give a material its texture: its picture, or its colour where there is a mask alone."""
    if entry.picture is not None:
        name, load, wrap = entry.picture
        entry.texture = images.texture(name, load, wrap, mask=entry.mask)
        entry.missing = entry.texture is None
    elif entry.mask is not None:
        name, load = entry.mask
        entry.texture = images.plain(entry.kd, name, load)


MAP_OPTIONS = {"-blendu": 1, "-blendv": 1, "-cc": 1, "-mm": 2, "-boost": 1, "-texres": 1, "-imfchan": 1, "-type": 1}


def _read_map(entry: _Entry, words, images: Images, folders: list[Path], boundary: Boundary, notes: list[str]) -> None:
    """Read the texture of a line `map_Kd -s 2 2 -clamp on wood.png`, options in any order, spaces in the name."""
    rest, wrap = list(words[1:]), "repeat"
    while rest and rest[0].startswith("-") and len(rest) > 1:
        option = rest.pop(0)
        if option in ("-s", "-o", "-t"):
            numbers = []
            while len(rest) > 1 and len(numbers) < 3 and _is_number(rest[0]):
                numbers.append(float(rest.pop(0)))
            pair = tuple((numbers + [1.0 if option == "-s" else 0.0] * 2)[:2])
            if words[0] == "map_Kd" and option != "-t":
                setattr(entry, "scale" if option == "-s" else "offset", pair)
        elif option == "-clamp":
            wrap = "clamp" if rest.pop(0) == "on" else "repeat"
        else:
            del rest[: min(MAP_OPTIONS.get(option, 0), len(rest) - 1)]
    name = " ".join(rest)

    def load() -> bytes:
        return boundary.read(find(folders, boundary, name), name)

    if words[0] == "map_Kd":
        entry.picture = (name, load, (wrap, wrap))
        return
    if words[0] in ("map_d", "map_D"):
        entry.mask = (name, load)
        return
    image = images.pixels(name, load, "lamps emit evenly where an emissive texture is missing")
    if image is not None:
        strength = np.array(entry.ke if any(entry.ke) else (1.0, 1.0, 1.0))
        entry.ke = tuple(float(c) for c in strength * images.mean(image))
        notes.append(f'material "{entry.name}": emits the mean colour of its emissive texture')


def _is_number(text: str) -> bool:
    try:
        return np.isfinite(float(text))
    except ValueError:
        return False


def _average_unplaced(names, library, material, uv_ids, images: Images, notes: list[str]) -> None:
    """Give materials without any texture coordinates the mean colour of their texture instead."""
    unplaced = set(material.tolist()) - set(material[(uv_ids >= 0).any(axis=1)].tolist())
    for name, i in names.items():
        entry = library.get(name)
        if entry is None or entry.texture is None or i not in unplaced:
            continue
        entry.kd = tuple(float(c) for c in images.mean(images.textures[entry.texture].pixels))
        entry.texture = None
        notes.append(f'material "{name}": its mesh has no texture coordinates, it shows the mean colour of its texture')


def _texture_coordinates(names, library, material, vt, uv_ids):
    """Return the texture (F,) and the corner coordinates (F, 3, 2), v downwards, of each face; None for no texture.

    The texture replaces Kd: exporters leave Kd at anything, black included, where a map is given.
    """
    entries = [library.get(n) or _Entry(n) for n in names]
    if not len(vt) or all(e.texture is None for e in entries):
        return None, None
    scale, offset = np.array([e.scale for e in entries]), np.array([e.offset for e in entries])
    texture = np.array([-1 if e.texture is None else e.texture for e in entries])[material]
    texture[uv_ids.min(axis=1) < 0] = -1
    rows, uv = np.flatnonzero(texture >= 0), np.zeros((len(material), 3, 2))
    used = material[rows, None]
    with np.errstate(over="ignore", invalid="ignore"):  # cleaned with the rest of the mesh
        uv[rows] = (vt[uv_ids[rows]] * scale[used] + offset[used]) * [1, -1] + [0, 1]  # OBJ counts v upwards
    return texture, uv
