"""OBJ and MTL files."""

from tests.support.grammar.choices import Files, Grammar, shape
from tests.support.grammar.images import image


def _number(g: Grammar, value: float) -> str:
    if g.chance(g.oddity / 4):
        return g.pick(
            "nan", "inf", "-inf", "1e999", "1e-999", "0x10", "1,5", "--1", "1_0", "", "#", "\u0661", "9" * 5000, "1e30"
        )
    return g.pick(f"{value:g}", f"{value:.6f}", f"{value:+.3e}", f"{value:.9E}", repr(float(value)))


def _line(g: Grammar, *words: object) -> str:
    text = g.pick(" ", " ", " ", "\t", "  ").join(map(str, words))
    if g.chance(0.01):
        at = text.find(" ") + 1
        text = text[:at] + "\\\n" + text[at:]
    return g.pick("", "", "", " ") + text + g.pick("", "", "", " ", " # comment" if g.chance(0.2) else "")


def _index(g: Grammar, index: int, count: int) -> str:
    if g.chance(g.oddity / 4):
        return g.pick("0", "-0", str(count + 1), str(-count - 1), str(10**12), "1.0", "a", str(-(2**63)), "")
    return str(index - count if g.chance(0.1) else index + 1)


def obj(g: Grammar, files: Files, stem: str) -> str:
    """One OBJ with its libraries and images, added to `files`; its name."""
    lines, points, coordinates, normals, materials = [], 0, 0, 0, []
    if g.chance(0.7):
        libraries = [f"{stem}{i}.mtl" for i in range(g.pick(1, 1, 1, 2))]
        for library in libraries:
            materials += mtl(g, files, library)
        named = [g.leaf(library) for library in libraries]
        lines += (
            [_line(g, "mtllib", *map(str, named))] if g.chance(0.5) else [_line(g, "mtllib", str(n)) for n in named]
        )
    for _ in range(g.pick(1, 1, 2, 4)):
        vertices, faces = shape(g)
        offset = g.reals(3)
        tail = g.pick(0, 0, 0, 1, 3)
        for vertex in vertices:
            values = (
                [a + b for a, b in zip(vertex, offset, strict=True)] + [1.0] * (tail == 1) + [0.5] * 3 * (tail == 3)
            )
            lines.append(_line(g, "v", *(_number(g, v) for v in values)))
        first, points = points, points + len(vertices)
        count_t = g.pick(0, 0, len(vertices), 4)
        count_n = g.pick(0, 0, len(vertices), 1)
        lines += [_line(g, "vt", *(_number(g, v) for v in g.reals(g.pick(1, 2, 2, 2, 3)))) for _ in range(count_t)]
        lines += [_line(g, "vn", *(_number(g, v) for v in g.reals(3))) for _ in range(count_n)]
        first_t, coordinates = coordinates, coordinates + count_t
        first_n, normals = normals, normals + count_n
        for face in faces:
            if g.chance(0.05):
                lines.append(_statement(g, materials))
            corners = []
            for corner in face:
                text = _index(g, first + corner, points)
                if count_t or count_n:
                    text += "/" + (_index(g, first_t + corner % count_t, coordinates) if count_t else "")
                if count_n:
                    text += "/" + _index(g, first_n + corner % count_n, normals)
                corners.append(text)
            lines.append(_line(g, g.leaf("f") if g.chance(0.1) else "f", *corners))
    ending = g.pick("\n", "\n", "\r\n")
    files[f"{stem}.obj"] = (
        g.pick("", "# made by a grammar\n", "\ufeff") + ending.join(map(str, lines)) + g.pick("", ending)
    ).encode(g.pick("utf-8", "utf-8", "utf-16") if g.chance(g.oddity) else "utf-8", "replace")
    return f"{stem}.obj"


def _statement(g: Grammar, materials: list[str]) -> str:
    known = g.pick(*materials) if materials else "none"
    others = [
        "g", "s off", "s 1", "mg 1 0.5", "l 1 2 3", "p 1", "usemap off", "lod 1", "bevel on", "c_interp off", "end",
    ]  # fmt: skip
    others += ["d_interp on", "shadow_obj a.obj", "trace_obj a.obj", "cstype rat bspline", "deg 3", "curv 0 1 1 2 3 1"]
    others += [
        "surf 0 1 0 1 1 2 3", "parm u 0 0 1 1", "vp 0.5 0.5", "call a.obj 1", "csh -touch nothing", "maplib a.map",
    ]  # fmt: skip
    named = [f"usemtl {g.leaf(known)}", f"o {g.name()}", f"g {g.name()} {g.name()}"]
    return g.pick(*named * 4, *others, "", "# comment", "unknown 1 2 3")


def mtl(g: Grammar, files: Files, name: str) -> list[str]:
    """One material library, added to `files`; the names of its materials."""
    lines, names = [], []
    for _ in range(g.rng.randint(1, 5)):
        names.append(g.name())
        lines.append(_line(g, "newmtl", names[-1]))
        for _ in range(g.rng.randint(0, 6)):
            lines.append(_property(g, files))
    files[name] = "\n".join(lines).encode("utf-8", "replace")
    return names


def _property(g: Grammar, files: Files) -> str:
    def colour(top: float) -> list[str]:
        return [_number(g, v) for v in g.reals(g.pick(3, 3, 3, 1), 0.0, top)]

    def picture() -> str:
        name = g.pick("wood.png", "brick.jpg", "a b.png", "mask.png")
        files.setdefault(name, image(g))
        return str(g.leaf(name))

    options = [
        "-s 2 2 1", "-s 3", "-o 0.5 0.5", "-t 0.1", "-mm 0 1", "-bm 0.5", "-clamp on", "-clamp off", "-blendu on",
        "-blendv off",
    ]  # fmt: skip
    options += ["-texres 64", "-imfchan l", "-boost 2", "-type sphere", "-cc on"]
    some = g.rng.sample(options, g.pick(0, 0, 0, 1, 2))
    glow, glowing = (0.0, "map_Kd") if g.dark else (20.0, "map_Ke")
    maps = ["map_Kd", "map_Kd", glowing, "map_d", "map_Ka", "bump", "map_Bump", "disp", "decal", "refl", "norm"]
    maps += ["map_Pr", "map_Pr", "map_Pm", "map_Ks"]
    lines = [
        ["Kd", *colour(1.0)],
        ["Ka", *colour(1.0)],
        ["Tf", *colour(1.0)],
        ["Ke", *colour(glow)],
        ["Ns", _number(g, g.pick(0.0, 10.0, 1000.0))],
    ]
    lines += [
        ["Kd", "xyz", *colour(1.0)],
        ["Kd", "spectral", "wood.rfl", 1],
        ["Ni", _number(g, 1.5)],
        ["sharpness", 60],
    ]
    lines += [["d", _number(g, 0.7)], ["d", "-halo", 0.5], ["Tr", _number(g, 0.2)], ["illum", g.pick(0, 1, 2, 10, 99)]]
    lines += [["Ks", *colour(1.0)], ["Pm", _number(g, g.real(0.0, 1.0))]]
    lines += [["Pr", _number(g, g.real(0.0, 1.0))], ["map_aat", "on"], ["#", "comment"], [""]]
    return _line(g, g.pick(*maps), *some, picture()) if g.chance(0.3) else _line(g, *g.pick(*lines))
