"""Wavefront OBJ with its MTL.

Read here and not by trimesh: both classic Cornell boxes use relative indices between the vertices,
which trimesh 5.2 turns into wrong geometry without a word. It also keeps `Ke` as text.
"""

from __future__ import annotations

import math
import os
from array import array
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gi_core.files.formats.boundary import Boundary, like_named, text_of
from gi_core.files.formats.classes import lamps_of_texture
from gi_core.files.formats.file_parts import (
    MOST_COVER,
    FileParts,
    behind_cover,
    listed,
    placed,
    transmitting,
    without_overlaps,
)
from gi_core.files.formats.metallic_roughness import COAT, metallic_roughness
from gi_core.files.formats.texture_images import MISSING, Images, find
from gi_core.geometry.mesh_parts import untextured
from gi_core.geometry.texture_filter import srgb_to_linear
from gi_core.scene.errors import SceneError
from gi_core.scene.pose import three
from gi_core.scene.rules import MOST_IOR
from gi_core.scene.types import Finish, Gloss, Material, Mesh, Paint, Pane, Texture, VariedFinish

NO_MATERIAL = "default"
FINISH_MAPS = "map_Pr", "map_Pm", "map_Ks", None  # in the order of Finish
MAPS = {"map_Kd", "map_Ke", "map_d", *FINISH_MAPS[:3]}
RANGES = {  # smallest and largest number, and how many; Kd is limited with all materials
    "Kd": (0.0, math.inf, 3), "Ke": (0.0, math.inf, 3), "Ks": (0.0, 1.0, 3), "Tf": (0.0, 1.0, 3),
    "Ns": (0.0, 1e6, 1), "Pm": (0.0, 1.0, 1), "Pr": (0.0, 1.0, 1), "illum": (0.0, 10.0, 1), "Ni": (0.0, MOST_IOR, 1),
}  # fmt: skip


def read_obj(path: Path, data: bytes, where: str, boundary: Boundary) -> FileParts:
    """Read triangles and polygons, normals, materials, textures, and colours of vertices."""
    text = _joined(data)
    boundary.take(where, "lines of text", text.count("\n"))
    boundary.take(where, "vertices", text.count("\nv"))
    v, vt, vn, vc = array("d"), array("d"), array("d"), array("d")
    corners, face_material = array("q"), array("q")  # of each corner three indices: position, texture, normal
    fans, astray = array("q"), set[str]()  # triangles of each polygon; missing data that corners name
    library, names, current, notes, images = {}, {}, NO_MATERIAL, [], Images(boundary)
    libraries = set()
    for number, line in enumerate(text.split("\n"), 1):
        word, rest = [*line.split(None, 1), "", ""][:2]
        if word in ("v", "vt", "vn", "f"):
            rest = rest.partition("#")[0]
        try:
            if word == "v":
                v.extend(_numbers(rest, 3))
                vc.extend(map(float, rest.split()[3:6] if rest.count(" ") > 4 else ()))
            elif word == "vn":
                vn.extend(_numbers(rest, 3))
            elif word == "vt":
                vt.extend(_numbers(rest + " 0", 2))
            elif word == "f":
                written = rest.split()
                boundary.take(where, "triangles", max(len(written) - 2, 0))
                counts = len(v) // 3, len(vt) // 2, len(vn) // 3
                polygon = [_corner(c, counts, astray) for c in written]
                for k in range(1, len(polygon) - 1):
                    corners.extend((*polygon[0], *polygon[k], *polygon[k + 1]))
                    face_material.append(names.setdefault(current, len(names)))
                if len(polygon) > 2:
                    fans.append(len(polygon) - 2)
            elif word == "usemtl":
                current = rest.strip() or NO_MATERIAL
            elif word == "mtllib" and rest not in libraries:
                libraries.add(rest)
                for name in _libraries(path, rest.strip()):
                    library.update(_read_library(path, name, where, notes, images, boundary))
        except SceneError:
            raise
        except (ValueError, IndexError) as error:
            raise SceneError(f"{where}: line {number} is not OBJ ({error}): {line.strip()[:60]!r}") from None
    vertices, coordinates, directions = (np.array(a).reshape(-1, n) for a, n in ((v, 3), (vt, 2), (vn, 3)))
    triples = np.array(corners, np.int64).reshape(-1, 3)
    order = np.arange(len(triples)).reshape(-1, 3)
    if len(order):
        order = without_overlaps(order, vertices[triples[:, 0]], np.array(fans))
    faces, uv_ids, ids = triples[order].transpose(2, 0, 1)
    material = np.array(face_material, np.int64)
    notes += [f"{what} that corners name but the file does not hold are left out" for what in sorted(astray)]
    _average_unplaced(names, library, material, uv_ids, images, notes)
    materials = [library[n].material if n in library else Material(n, two_sided=True) for n in names]
    missing = [n for n in names if n not in library and n != NO_MATERIAL]
    if missing:
        notes.append(f"no definition of material {listed(missing)}: taken as grey 0.7")
    normals = directions[ids] if len(vn) and len(ids) and ids.min() >= 0 else None
    entries = [library.get(n) or _Entry(n) for n in names]
    layers = [
        _placed(entries, word, [e.finish[k] for e in entries], material, coordinates, uv_ids)
        for k, word in enumerate(FINISH_MAPS)
    ]
    # The texture replaces Kd: exporters leave Kd at anything, black included, where a map is given.
    paint = _placed(entries, "map_Kd", [e.texture for e in entries], material, coordinates, uv_ids)
    if paint is not None:
        rho = np.array([m.reflectance for m in materials])[material, None]
        paint = paint._replace(corner_colour=np.where(paint.face_texture[:, None, None] < 0, rho, paint.corner_colour))
    if len(vc) == len(v) and len(v):
        kd = np.array([(1.0, 1.0, 1.0) if m.name not in library else m.reflectance for m in materials])
        tints = srgb_to_linear(np.clip(np.array(vc).reshape(-1, 3), 0, 1))[faces] * kd[material][:, None]
        paint = untextured(tints) if paint is None else paint._replace(corner_colour=tints)
    material = _emitting(entries, materials, material, vertices[faces], coordinates, uv_ids, images)
    part = Mesh(vertices, faces, material, normals, None, paint, Finish(*layers))
    textures = tuple(images.textures), tuple(images.finishes)
    return FileParts([part], materials, [], None, "y", notes + images.notes(), *textures)


def _joined(data: bytes) -> str:
    """Return the text of a file, decoded as UTF-16 after its byte-order mark, with continued lines joined."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        data = data.decode("utf-16", "replace").encode()
    return text_of(data, "replace").replace("\\\n", " ")


def _libraries(obj: Path, names: str) -> list[str]:
    """Return the material files of a line: one whose name may have spaces, else several."""
    whole = names.replace("\\", "/")
    several = whole.split()
    if len(several) < 2 or os.path.isfile(like_named(obj.parent / whole)):
        return [whole]
    return several


class _Map(NamedTuple):
    """An image that a line names."""

    name: str
    load: Callable[[], bytes]
    wrap: tuple[str, str]
    scale: tuple[float, float]  # of texture coordinates, like the next; v upwards
    offset: tuple[float, float]


class _Entry:
    """A material of an MTL file."""

    def __init__(self, name: str):
        self.name, self.kd, self.ke = name, (0.7, 0.7, 0.7), (0.0, 0.0, 0.0)
        self.ks, self.ns, self.illum = (0.0, 0.0, 0.0), 0.0, 2  # Phong's colour and exponent; 0, 1: without them
        self.pm, self.pr = 0.0, None  # metallic and roughness, of the PBR extension
        self.maps: dict[str, _Map] = {}  # by the line's first word
        self.cover: float | None = None  # opacity all over, None: not in the file
        self.tf, self.ni = None, Pane().ior  # filter of transmitted light, and index of refraction
        self.texture: int | None = None  # into Images.textures
        self.missing = False  # the texture
        self.emissive: Texture | None = None
        self.finish: tuple[int | None, ...] = (None,) * len(FINISH_MAPS)  # into Images.finishes
        self.means: tuple[float, ...] = ()  # of these, as VariedFinish has them

    @property
    def material(self) -> Material:
        plain = Material(self.name, (MISSING,) * 3 if self.missing else self.kd, self.ke, two_sided=True)
        if self.is_glass:
            colour = behind_cover(self.cover or 0.0, np.minimum(self.kd, 1.0)) if self.tf is None else self.tf
            return transmitting(plain, colour, self.ni)
        # A map stands in place of its number: exporters leave that at anything.
        mapped_pr, mapped_pm, mapped_ks, _ = (k is not None for k in self.finish)
        if self.pr is not None or mapped_pr:
            roughness, metallic = 1.0 if mapped_pr else self.pr, 1.0 if mapped_pm else self.pm
            if mapped_pr or mapped_pm:
                return plain._replace(varied=self._varied(roughness, metallic, (COAT,) * 3))
            return metallic_roughness(plain, metallic, roughness)
        ks = self.means[2:5] if mapped_ks else self.ks
        if self.illum < 2 or max(ks) < 0.01 or self.ns < 2.0:  # diffuse
            return plain
        # Microfacets whose lobe is as wide as that of the exponent (Walter et al. 2007); the sum stays below 1.
        rest, alpha = 1 - max(ks), math.sqrt(2 / (self.ns + 2))
        plain = plain._replace(reflectance=three(min(c, rest) for c in plain.reflectance))
        if mapped_ks:
            return plain._replace(varied=self._varied(math.sqrt(alpha), 0.0, (1.0,) * 3))
        return plain._replace(gloss=Gloss(ks, alpha, max(ks)))

    @property
    def is_transparent(self) -> bool:
        """Whether the file says so: exporters disagree about the meaning of 0 and 1 in Tr."""
        by_model = self.illum in (4.0, 6.0, 7.0, 9.0) and self.cover is None
        return by_model or 0 < (self.cover or 0) < 1

    @property
    def is_glass(self) -> bool:
        """Whether it becomes a pane: one without a picture or light of its own."""
        bare = not any(self.ke) and not {"map_Kd", "map_d", "map_Ke"} & self.maps.keys()
        return bare and self.is_transparent and (self.cover or 0) < MOST_COVER

    def _varied(self, roughness: float, metallic: float, f0: tuple[float, float, float]) -> VariedFinish:
        return VariedFinish(roughness, metallic, f0, 1.0, self.means, math.inf)


def _numbers(text: str, n: int) -> list[float]:
    values = [float(x) for x in text.split()[:n]]
    if len(values) < n:
        raise ValueError(f"{n} numbers wanted")
    return values


WHAT = "vertices", "texture coordinates", "normals"  # that a corner names


def _corner(text: str, counts: tuple[int, int, int], astray: set[str]) -> tuple[int, int, int]:
    """Return 0-based position, texture and normal index of `7`, `7/1`, `7//3`, `-1/-1/-1`; -1 for none.

    Those that the file does not hold are -1 too, and join `astray`; positions must be there.
    """
    fields = (text.split("/") + ["", ""])[:3]
    if not fields[0]:
        raise ValueError("a corner must name a vertex")
    result = []
    for field, count, what in zip(fields, counts, WHAT, strict=True):
        if not field:
            result.append(-1)
            continue
        # A negative index counts back from the last element read so far, not from the end of the file.
        i = int(field)
        i = i - 1 if i > 0 else i + count
        if not 0 <= i < count:
            if what == WHAT[0]:
                raise ValueError(f"index {field} of {count}")
            astray.add(what)
            i = -1
        result.append(i)
    return tuple(result)


def _read_library(obj: Path, name: str, where: str, notes, images: Images, boundary: Boundary) -> dict[str, _Entry]:
    # Exporters write the path of their own machine: the file's bare name beside the OBJ comes next.
    tries = [obj.parent / name, obj.parent / name.replace("\\", "/").rpartition("/")[2], obj.with_suffix(".mtl")]
    library = next((p for p in map(like_named, tries) if boundary.file(p)), None)
    if library is None:
        boundary.take(where, "files")  # a file that was not found counts too
        why = "lies outside the folder of the scene" if os.path.isfile(tries[0]) else "not found"
        notes.append(f"material file {name} {why}: materials taken as grey 0.7")
        return {}
    entries, entry = {}, None
    changed: dict[str, list[str]] = {}  # change of values that break a rule: materials
    for line in _joined(boundary.read(library, f"{where}: {library.name}")).split("\n"):
        words = line.partition("#")[0].split()
        if not words:
            continue
        words[0] = KEYWORDS.get(words[0].lower(), words[0])
        if words[0] == "newmtl":
            boundary.take(where, "materials")
            entry = entries.setdefault(" ".join(words[1:]), _Entry(" ".join(words[1:])))
        elif entry is not None and words[0] in RANGES and len(words) > 1:
            _read_value(entry, words, changed)
        elif entry is not None and words[0] in ("d", "Tr") and len(words) > 1 and _is_number(words[-1]):
            entry.cover = float(words[-1]) if words[0] == "d" else 1 - float(words[-1])
        elif entry is not None and words[0] in MAPS and len(words) > 1:
            _read_map(entry, words, images, [library.parent, obj.parent], boundary, notes)
    for entry in entries.values():
        _make_textures(entry, images)
    for what, names in changed.items():
        notes.append(f"{what} in {listed(list(dict.fromkeys(names)))}")
    for what, holds in (("panes of glass", True), ("transparent in the file, taken as opaque", False)):
        if of := [f'"{e.name}"' for e in entries.values() if e.is_transparent and e.is_glass == holds]:
            notes.append(f"{what}: {listed(of)}")
    return entries


def _read_value(entry: _Entry, words: list[str], changed: dict[str, list[str]]) -> None:
    """Read a line `Pr 0.5`, `Kd 0.5 0.4 0.3` or `Kd 0.5` for grey, limited to its range; left out without numbers."""
    word, (low, high, n) = words[0], RANGES[words[0]]
    bounds = f">= {low:g}" if high == math.inf else f"from {low:g} to {high:g}"
    rule, written = f"{word} must be {'a number' if n == 1 else 'three numbers'} {bounds}", words[1 : 1 + n]
    if not all(map(_is_number, written)):
        changed.setdefault(f"{rule}: left out", []).append(entry.name)
        return
    values = [float(x) for x in written]
    limited = [min(max(low, x), high) for x in values]
    if limited != values:
        changed.setdefault(f"{rule}: limited", []).append(entry.name)
    setattr(entry, word.lower(), limited[0] if n == 1 else three((limited * 3)[:3]))


KEYWORDS = {word.lower(): word for word in ("newmtl", "d", "Tr", *RANGES, *MAPS)}  # in any case


def _make_textures(entry: _Entry, images: Images) -> None:
    """Give a material its textures: its picture, or its colour where there is a mask alone, and those of gloss."""
    picture, mask = entry.maps.get("map_Kd"), entry.maps.get("map_d")
    if picture is not None:
        masked = None if mask is None else (mask.name, mask.load)
        entry.texture = images.texture(picture.name, picture.load, picture.wrap, mask=masked)
        entry.missing = entry.texture is None
    elif mask is not None:
        entry.texture = images.plain(entry.kd, mask.name, mask.load)
    glow = entry.maps.get("map_Ke")
    if glow is not None:
        entry.emissive = images.emissive(glow.name, glow.load, glow.wrap)
        entry.ke = entry.ke if any(entry.ke) else (1.0, 1.0, 1.0)
    rough = entry.pr is not None or "map_Pr" in entry.maps
    numbers: list[int | None] = []
    for k, word in enumerate(FINISH_MAPS):
        image = entry.maps.get(word or "") if rough == (k < 2) else None
        values = "linear" if k < 2 else "sRGB"
        numbers.append(None if image is None else images.finish(image.name, image.load, image.wrap, values))
    entry.finish, entry.means = tuple(numbers), images.finish_means(numbers)


MAP_OPTIONS = {"-blendu": 1, "-blendv": 1, "-cc": 1, "-mm": 2, "-boost": 1, "-texres": 1, "-imfchan": 1, "-type": 1}


def _read_map(entry: _Entry, words, images: Images, folders: list[Path], boundary: Boundary, notes: list[str]) -> None:
    """Read the texture of a line `map_Kd -s 2 2 -clamp on wood.png`, options in any order, spaces in the name."""
    rest, wrap, placing = list(words[1:]), "repeat", {"-s": (1.0, 1.0), "-o": (0.0, 0.0)}
    while rest and rest[0].startswith("-") and len(rest) > 1:
        option = rest.pop(0)
        if option in ("-s", "-o", "-t"):
            numbers = []
            while len(rest) > 1 and len(numbers) < 3 and _is_number(rest[0]):
                numbers.append(float(rest.pop(0)))
            placing[option] = tuple((numbers + [1.0 if option == "-s" else 0.0] * 2)[:2])
        elif option == "-clamp":
            wrap = "clamp" if rest.pop(0) == "on" else "repeat"
        else:
            del rest[: min(MAP_OPTIONS.get(option, 0), len(rest) - 1)]
    name = " ".join(rest)

    def load() -> bytes:
        return boundary.read(find(folders, boundary, name), name)

    entry.maps[words[0]] = _Map(name, load, (wrap, wrap), placing["-s"], placing["-o"])
    if words[0] == "map_Ke":
        notes.append(f'material "{entry.name}": each triangle emits the mean of its emissive texture')


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


def _emitting(entries: list[_Entry], materials: list[Material], material, corners, vt, uv_ids, images: Images):
    """Return the materials (F,) of faces: where a texture scales emission, new ones, which are appended."""
    glows = [e.emissive for e in entries]
    numbers = [None if glow is None else k for k, glow in enumerate(glows)]
    paint = _placed(entries, "map_Ke", numbers, material, vt, uv_ids)
    material = material.copy()
    for k, glow in enumerate(glows):
        if glow is None:
            continue
        rows = np.flatnonzero((material == k) & (False if paint is None else paint.face_texture == k))
        if paint is not None and len(rows):
            material[rows] = lamps_of_texture(materials, k, corners[rows], glow, paint.corner_uv[rows])
        emission = images.mean(glow.pixels) * np.array(materials[k].emission)
        materials[k] = materials[k]._replace(emission=three(emission))  # of faces without a place in it
    return material


def _placed(entries: list[_Entry], word: str | None, textures: list[int | None], material, vt, uv_ids) -> Paint | None:
    """Return one texture per material, `textures`, on each face (F,) with corner coordinates (F, 3, 2), v downwards."""
    if not len(vt) or all(k is None for k in textures):
        return None
    plain = _Map("", bytes, ("", ""), (1.0, 1.0), (0.0, 0.0))
    maps = [e.maps.get(word or "", plain) for e in entries]
    scale, offset = np.array([m.scale for m in maps]), np.array([m.offset for m in maps])
    texture = np.array([-1 if k is None else k for k in textures])[material]
    texture[uv_ids.min(axis=1) < 0] = -1
    rows, uv = np.flatnonzero(texture >= 0), np.zeros((len(material), 3, 2))
    used = material[rows, None]
    uv[rows] = (vt[uv_ids[rows]] * scale[used] + offset[used]) * [1, -1] + [0, 1]  # OBJ counts v upwards
    return placed(texture, uv)
