"""Values of Mitsuba 3's reflection models, against which tests compare ours.

Mitsuba is no dependency: run this in an environment of its own, `pip install mitsuba numpy`, then
`python studies/mitsuba_brdfs.py tests/unit/bsdf/mitsuba_figures.json`. The committed figures are those of 3.9.1.
"""

from __future__ import annotations

import json
import math
import sys
from typing import Any

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")


def rgb(red: float, green: float, blue: float) -> dict:
    return {"type": "rgb", "value": [red, green, blue]}


def microfacets(distribution: str, alpha: float, **material: Any) -> dict:
    """Return a rough conductor; one that reflects all light unless a material is given."""
    return {"type": "roughconductor", "distribution": distribution, "alpha": alpha} | (material or {"material": "none"})


def principled(metallic: float, roughness: float, base: dict) -> dict:
    """Return metal or plastic; `specular` 0.5 is an index of 1.5."""
    return {"type": "principled", "base_color": base, "metallic": metallic, "roughness": roughness, "specular": 0.5}


BASE, BLACK = rgb(0.8, 0.5, 0.2), rgb(0, 0, 0)
COPPER = {"eta": rgb(0.27, 0.67, 1.13), "k": rgb(3.61, 2.63, 2.57)}
BSDFS = {
    "diffuse": {"type": "diffuse", "reflectance": BASE},
    "ggx 0.1": microfacets("ggx", 0.1),
    "ggx 0.6": microfacets("ggx", 0.6),
    "beckmann 0.05": microfacets("beckmann", 0.05),
    "beckmann 0.3 copper": microfacets("beckmann", 0.3, **COPPER),
    "principled metal 0.3": principled(1.0, 0.3, BASE),
    "principled metal 0.8": principled(1.0, 0.8, BASE),
    "black principled 0.5": principled(0.0, 0.5, BLACK),
    "black roughplastic 0.2": {
        "type": "roughplastic",
        "distribution": "ggx",
        "alpha": 0.2,
        "int_ior": 1.5,
        "ext_ior": 1.0,
        "diffuse_reflectance": BLACK,
    },
}
MIRRORS = {
    "copper": {"type": "conductor"} | COPPER,
    "tinted": {"type": "conductor", "material": "none", "specular_reflectance": BASE},
}


def pairs(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return directions i and o (count, 3): half of the o are near the mirror direction of i."""
    rng = np.random.default_rng(18)
    i, o = rng.normal(size=(2, count, 3))
    o[::2] = i[::2] * (-1, -1, 1) + rng.normal(scale=0.15, size=(len(o[::2]), 3))
    for w in (i, o):
        w[:, 2] = np.abs(w[:, 2]) + 0.02
        w /= np.linalg.norm(w, axis=1, keepdims=True)
    return i.round(9), o.round(9)


def evaluate(description: dict, i: np.ndarray, o: np.ndarray) -> list[list[float]]:
    """Return f (n, 3) [1/sr]; Mitsuba's eval() carries the cosine of o."""
    bsdf, context, result = mi.load_dict(description), mi.BSDFContext(), []
    for a, b in zip(i, o, strict=True):
        interaction = mi.SurfaceInteraction3f()
        interaction.wi = mi.Vector3f(*a)
        colour = bsdf.eval(context, interaction, mi.Vector3f(*b))
        result.append([float(channel) / b[2] for channel in colour])
    return result


def reflected(description: dict, cosine: float) -> list[float]:
    """Return the reflectance (3,) of a mirror, the weight of its only draw."""
    interaction = mi.SurfaceInteraction3f()
    interaction.wi = mi.Vector3f(math.sqrt(1 - cosine * cosine), 0, cosine)
    drawn, weight = mi.load_dict(description).sample(mi.BSDFContext(), interaction, 0.5, mi.Point2f(0.5, 0.5))
    assert [*drawn.wo] == [-interaction.wi.x, 0, interaction.wi.z]
    return [float(channel) for channel in weight]


def main() -> None:
    i, o = pairs(40)
    cosines = [math.cos(math.radians(angle)) for angle in (0, 30, 60, 75, 85, 89)]
    fresnel = [
        [n, k, [float(mi.fresnel_conductor(cos, mi.Complex2f(n, k))) for cos in cosines]]
        for n, k in ((1.5, 0.0), (0.27, 3.61), (1.13, 2.57), (2.9, 3.1))
    ]
    figures = {
        "mitsuba": mi.__version__,
        "i": i.tolist(),
        "o": o.tolist(),
        "f": {name: evaluate(description, i, o) for name, description in BSDFS.items()},
        "fresnel": {"cosines": cosines, "n, k, reflectances": fresnel},
        "mirrors": {name: [reflected(description, c) for c in cosines] for name, description in MIRRORS.items()},
    }
    with open(sys.argv[1], "w", encoding="utf-8") as file:
        json.dump(json.loads(json.dumps(figures), parse_float=lambda x: float(f"{float(x):.9g}")), file)
        file.write("\n")


if __name__ == "__main__":
    main()
