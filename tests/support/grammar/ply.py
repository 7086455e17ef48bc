"""PLY 1.0 files."""

import struct

from tests.support.grammar.choices import Files, Grammar, shape
from tests.support.grammar.images import image

PLY_TYPES = {
    "char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f", "double": "d",
}  # fmt: skip
PLY_TYPES |= {
    "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "float32": "f",
    "float64": "d",
}  # fmt: skip
REAL_TYPES = ["float", "double", "float32", "float64"]


def ply(g: Grammar, files: Files, stem: str) -> str:
    """One PLY, ASCII or binary of either order, added to `files`; its name."""
    form = g.pick("ascii", "binary_little_endian", "binary_big_endian")
    vertices, faces = shape(g)
    kind = g.pick(*REAL_TYPES)
    columns: list[tuple[str, str, list]] = [(kind, axis, [v[i] for v in vertices]) for i, axis in enumerate("xyz")]
    if g.chance(0.4):
        columns += [(g.pick("float", "double"), axis, g.reals(len(vertices))) for axis in ("nx", "ny", "nz")]
    if g.chance(0.4):
        names = g.pick(
            ("red", "green", "blue"),
            ("red", "green", "blue", "alpha"),
            ("diffuse_red", "diffuse_green", "diffuse_blue"),
        )
        columns += [(g.pick("uchar", "uint8"), c, [g.rng.randint(0, 255) for _ in vertices]) for c in names]
    if g.chance(0.3):
        columns += [
            ("float", c, g.reals(len(vertices))) for c in g.pick(("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
        ]
    if g.chance(0.2):
        columns.append((g.pick(*PLY_TYPES), "quality", [1] * len(vertices)))
    if g.chance(0.1):
        g.rng.shuffle(columns)
    rows = [[(t, g.leaf(v[i]) if g.chance(0.05) else v[i]) for t, _, v in columns] for i in range(len(vertices))]
    vertex = ("vertex", [f"property {g.leaf(t) if g.chance(0.1) else t} {c}" for t, c, _ in columns], rows)

    count_type = g.pick("uchar", "uint8", "int", "ushort", "uint")
    if max(map(len, faces)) > 255:
        count_type = g.pick("int", "uint")
    index_type = g.pick("int", "uint", "int32", "uint32", *(["ushort"] if len(vertices) < 60000 else []))
    face_rows = [[(count_type, len(f)), *((index_type, g.leaf(i) if g.chance(0.05) else i) for i in f)] for f in faces]
    lists = [f"property list {count_type} {index_type} {g.pick('vertex_indices', 'vertex_indices', 'vertex_index')}"]
    if g.chance(0.2):
        lists.append("property uchar red")
        face_rows = [[*row, ("uchar", 200)] for row in face_rows]
    if g.chance(0.2):
        lists.append("property list uchar float texcoord")
        face_rows = [
            [*row, ("uchar", min(2 * len(f), 254)), *[("float", 0.5)] * min(2 * len(f), 254)]
            for row, f in zip(face_rows, faces, strict=True)
        ]
    elements = [vertex, ("face", lists, face_rows)]
    if g.chance(0.2):
        elements.insert(
            g.rng.randint(0, 2),
            ("edge", ["property int vertex1", "property int vertex2"], [[("int", 0), ("int", 1)]] * 3),
        )
    if g.chance(g.oddity):
        g.rng.shuffle(elements)
    head = ["ply", f"format {form} {g.leaf('1.0')}"]
    if g.chance(0.3):
        files.setdefault("wood.png", image(g))
        head.append(f"comment TextureFile {g.leaf('wood.png')}")
    for name, properties, rows in elements:
        head += [f"element {name} {g.leaf(len(rows))}", *properties]
        if g.chance(0.2):
            head.append(g.pick("comment made by a grammar", "obj_info 1 2 3", "comment"))
    head.append("end_header")
    body = b"".join(_ply_row(g, row, form) for _, _, rows in elements for row in rows)
    ending = g.pick("\n", "\n", "\r\n") if form == "ascii" else "\n"
    files[f"{stem}.ply"] = (
        (ending.join(map(str, head)) + ending).encode("utf-8", "replace")
        + body
        + g.pick(b"", b"", b"\n", b"tail" if g.chance(g.oddity) else b"")
    )
    return f"{stem}.ply"


def _ply_row(g: Grammar, row: list[tuple[str, object]], form: str) -> bytes:
    if form == "ascii":
        return (" ".join(str(v).replace("\n", "") for _, v in row) + "\n").encode("utf-8", "replace")
    order = ">" if "big" in form else "<"
    out = b""
    for kind, value in row:
        code = PLY_TYPES[kind]
        try:
            out += struct.pack(order + code, float(value) if code in "fd" else int(value))
        except (TypeError, ValueError, OverflowError, struct.error):
            out += g.pick(b"", b"\xff" * struct.calcsize(code))
    return out
