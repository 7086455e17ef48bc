"""Values of Mitsuba 3's reflection models, against which tests compare ours.

Mitsuba is no dependency: run this in an environment of its own, `pip install mitsuba numpy`, then
`python studies/mitsuba_brdfs.py tests/unit/bsdf/mitsuba_figures.json`. The committed figures are those of 3.9.1.
"""

from __future__ import annotations

import json
import math
import sys

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")

COPPER = {"n": [0.27, 0.67, 1.13], "k": [3.61, 2.63, 2.57]}
BSDFS = {
    "diffuse": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.8, 0.5, 0.2]}},
    "ggx 0.1": {"type": "roughconductor", "distribution": "ggx", "alpha": 0.1, "material": "none"},
    "ggx 0.6": {"type": "roughconductor", "distribution": "ggx", "alpha": 0.6, "material": "none"},
    "beckmann 0.05": {"type": "roughconductor", "distribution": "beckmann", "alpha": 0.05, "material": "none"},
    "beckmann 0.3 copper": {
        "type": "roughconductor",
        "distribution": "beckmann",
        "alpha": 0.3,
        "eta": {"type": "rgb", "value": COPPER["n"]},
        "k": {"type": "rgb", "value": COPPER["k"]},
    },
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
    }
    with open(sys.argv[1], "w", encoding="utf-8") as file:
        json.dump(json.loads(json.dumps(figures), parse_float=lambda x: float(f"{float(x):.9g}")), file)
        file.write("\n")


if __name__ == "__main__":
    main()
