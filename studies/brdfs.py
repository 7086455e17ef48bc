"""Tables of reflection models against their formulas, and polar plots of all models.

python -m studies.brdfs errors            a table: mean |f - model| / albedo by angle of incidence, time, size
python -m studies.brdfs plot docs/brdfs.png
"""

from __future__ import annotations

import math
import sys
import time

import numpy as np

from gi_core.bsdf import table, tabulate
from gi_core.bsdf.models import Lobe, lobe
from tests.support.brdf_tables import direction, exact, nodes, values

ANGLES = (3.0, 41.0, 60.0, 75.0, 83.0, 87.0)
COPPER = {"n": (0.27, 0.67, 1.13), "k": (3.61, 2.63, 2.57)}
CASES: dict[str, tuple[Lobe, ...]] = {
    "oren_nayar, sigma 0.5": (lobe("oren_nayar"),),
    "eon, r 0.8": (lobe("eon"),),
    "lewis, n 20": (lobe("lewis", {"n": 20}),),
    "lewis, n 100": (lobe("lewis", {"n": 100}),),
    "lewis, n 1000": (lobe("lewis", {"n": 1000}),),
    "blinn, n 80": (lobe("blinn"),),
    "blinn, n 10000": (lobe("blinn", {"n": 10000}),),
    "torrance_sparrow, m 0.3": (lobe("torrance_sparrow"),),
    "torrance_sparrow, m 0.02": (lobe("torrance_sparrow", {"m": 0.02}),),
    "ggx, alpha 0.3": (lobe("ggx"),),
    "ggx, alpha 0.02": (lobe("ggx", {"alpha": 0.02}),),
    "ward, a 0.2": (lobe("ward"),),
    "ward, a 0.02": (lobe("ward", {"ax": 0.02, "ay": 0.02}),),
    "ward, ax 0.1, ay 0.5": (lobe("ward", {"ax": 0.1, "ay": 0.5}),),
    "ward, ax 0.02, ay 0.4": (lobe("ward", {"ax": 0.02, "ay": 0.4}),),
    "schlick, r 0.1, p 0.3": (lobe("schlick", {"p": 0.3, "C": 0.3}),),
    "he, sigma 0.18, tau 3": (lobe("he", COPPER),),
    "he, sigma 1, tau 4": (lobe("he", {"sigma": 1, "tau": 4, **COPPER}),),
    "poulin_fournier, d 1.5, h 0.2": (lobe("poulin_fournier"),),
    "poulin_fournier, d 4, h 1": (lobe("poulin_fournier", {"d": 4, "h": 1, "n": 50}),),
    "lafortune, back, n 20": (lobe("lafortune", {"cx": 1, "cy": 1}),),
    "lafortune, -1, -0.6, 0.9": (lobe("lafortune", {"cx": -1, "cy": -0.6, "cz": 0.9, "n": 10}),),
    "ward 0.03 + lafortune n 3": (
        lobe("ward", {"ax": 0.03, "ay": 0.03, "ks": 0.3}),
        lobe("lafortune", {"ks": 0.3, "n": 3}),
    ),
}

PLOTTED: dict[str, dict] = {
    "perfect_diffuse": {"kd": 0.8},
    "perfect_specular": {"ks": 0.9},
    "phong": {"n": 20, "ks": 0.8},
    "blinn": {"n": 80, "ks": 0.8},
    "torrance_sparrow": {"m": 0.3, **COPPER},
    "poulin_fournier": {"ks": 0.9, "d": 2, "h": 0.5, "n": 50},
    "he": {"sigma": 0.3, "tau": 1.5, **COPPER},
    "ward": {"ks": 0.8, "ax": 0.25, "ay": 0.25},
    "lewis": {"n": 20, "ks": 0.8},
    "schlick": {"C": 0.4, "r": 0.1},
    "oren_nayar": {"rho": 0.8, "sigma": 0.7},
    "strauss": {"C": 0.8, "s": 0.6, "m": 0.8},
    "lafortune": {"ks": 0.8, "cx": -1, "cy": -1, "cz": 0.7, "n": 8},
    "eon": {"rho": 0.8, "r": 1},
    "ggx": {"f0": 0.9, "alpha": 0.3},
}


def errors() -> None:
    """Print a row of markdown per case; azimuth of i 30 degrees, between rows of the tables."""
    print("| lobe | " + " | ".join(f"{angle:.0f}" for angle in ANGLES) + " | build [s] | [MB] |")
    print("|---" * (len(ANGLES) + 3) + "|")
    for name, lobes in CASES.items():
        tabulate.tabulate.cache_clear()
        began = time.process_time()
        made = tabulate.tabulate(lobes, scale=True)
        spent = time.process_time() - began
        tables, row = table.join([made]), []
        for angle in ANGLES:
            i = direction(angle, 30.0)
            o, weights = nodes(i)
            model = exact(lobes, i, o)
            off = np.abs(values(tables, 0, i, o) - model).max(axis=1)
            row.append(f"{100 * (weights @ off) / (weights @ model.max(axis=1)):.1f}")
        print(f"| {name} | " + " | ".join(row) + f" | {spent:.2f} | {made.data.nbytes / 1e6:.1f} |", flush=True)


def plot(path: str) -> None:
    """Draw f cos(theta_o) [1/sr] in the plane of incidence at 20, 50 and 75 degrees, one panel per model."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(3, 5, figsize=(11, 5.2), dpi=80)
    theta = np.radians(np.linspace(-89.9, 89.9, 1201))
    o = np.stack((np.sin(theta), np.zeros_like(theta), np.cos(theta)), axis=1)
    for axis, (model, parameters) in zip(axes.ravel(), PLOTTED.items(), strict=True):
        found, largest = lobe(model, parameters), 0.05
        for angle, colour in ((20.0, "#1b6ca8"), (50.0, "#d1495b"), (75.0, "#66a182")):
            i = direction(angle, 180.0)
            kd = np.max(tabulate.MODELS[model].diffuse(found.values())) / math.pi
            f = (exact([found], i, o).max(axis=1) + kd) * o[:, 2]
            axis.plot(f * o[:, 0], f * o[:, 2], color=colour, linewidth=1.2)
            albedo = float(tabulate.MODELS[model].mirror(found.values(), i[2:]).max())
            if albedo > 1e-3:  # a mirror, its length the albedo
                axis.plot([0, -albedo * i[0]], [0, albedo * i[2]], "--", color=colour, linewidth=1.0)
            largest = max(largest, f.max(), albedo if model == "perfect_specular" else 0.0)
            axis.plot([0, 2 * largest * i[0]], [0, 2 * largest * i[2]], ":", color=colour, linewidth=0.7)
        axis.set(xlim=(-largest, largest), ylim=(0, largest), aspect="equal", yticks=[])
        axis.set_title(model.replace("_", " "), fontsize=9)
        axis.tick_params(labelsize=7)
        for side in ("top", "right", "left"):
            axis.spines[side].set_visible(False)
    figure.tight_layout()
    figure.savefig(path)


if __name__ == "__main__":
    if sys.argv[1:] == ["errors"]:
        errors()
    elif len(sys.argv) == 3 and sys.argv[1] == "plot":
        plot(sys.argv[2])
    else:
        sys.exit(__doc__)
