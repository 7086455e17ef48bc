"""Five sets of parameters per reflection model, and five angles of incidence, for tests and studies."""

from gi_core.bsdf.models import Lobe, lobe

ANGLES = (0.0, 30.0, 60.0, 75.0, 85.0)  # of incidence [degrees]
COPPER = {"n": (0.27, 0.67, 1.13), "k": (3.61, 2.63, 2.57)}

SETS: dict[str, list[dict]] = {
    "perfect_diffuse": [{"kd": kd} for kd in (0.0, 0.2, 0.5, (0.9, 0.1, 0.3), 1.0)],
    "perfect_specular": [{"ks": ks} for ks in (0.0, 0.2, 0.5, (0.9, 0.1, 0.3), 1.0)],
    "phong": [{"n": 1}, {"n": 5, "ks": 0.3, "kd": 0.5}, {"n": 20, "ks": (0.9, 0.4, 0.1)}, {"n": 100, "ks": 0.9},
        {"n": 1000, "ks": 0.9}],
    "blinn": [{"n": 1}, {"n": 20, "ks": 0.3, "kd": 0.5}, {"n": 80, "ks": (0.9, 0.4, 0.1)}, {"n": 500, "ks": 0.9},
        {"n": 10000, "ks": 0.9}],
    "torrance_sparrow": [{"m": 0.02, "n": 0, "k": 1}, {"m": 0.1, **COPPER}, {"m": 0.3, "kd": 0.5},
        {"m": 0.6, "n": 0, "k": 1}, {"m": 1.0, "n": 2.5}],
    "poulin_fournier": [{}, {"d": 2, "h": 1, "n": 50}, {"d": 4, "h": 1, "n": 20, "ks": (0.9, 0.4, 0.1)},
        {"d": 1, "h": 0.1, "n": 1000}, {"d": 10, "h": 0.05, "n": 100}],
    "he": [{}, {"sigma": 0.05, "tau": 2, **COPPER}, {"sigma": 1, "tau": 4, "n": 0, "k": 1},
        {"sigma": 0.3, "tau": 1.5, **COPPER}, {"sigma": 0.2, "tau": 10, "kd": 0.4}],
    "ward": [{"ax": 0.02, "ay": 0.02}, {"ax": 0.3, "ay": 0.3, "kd": 0.3},
        {"ax": 0.1, "ay": 0.5, "ks": (0.9, 0.4, 0.1)}, {"ax": 0.4, "ay": 0.05, "bounded": 1},
        {"ax": 1, "ay": 1, "bounded": 1}],
    "lewis": [{"n": 1}, {"n": 5, "ks": 0.3, "kd": 0.5}, {"n": 20, "ks": (0.9, 0.4, 0.1)}, {"n": 100, "ks": 0.9},
        {"n": 1000, "ks": 0.9}],
    "schlick": [{"r": 0.001}, {"r": 0.05, "C": (0.9, 0.4, 0.1)}, {"r": 0.2, "C": 0.3},
        {"r": 0.1, "p": 0.3, "C": 0.3}, {"r": 1.0, "C": 0.3}],
    "oren_nayar": [
        {"sigma": 0}, {"sigma": 0.2}, {"sigma": 0.5, "rho": 1}, {"sigma": 1, "rho": (0.9, 0.4, 0.1)}, {"sigma": 1.6}],
    "strauss": [{"s": 0}, {"s": 0.3, "m": 1}, {"s": 0.7, "m": 1, "C": (0.9, 0.4, 0.1)},
        {"s": 0.9, "m": 0.5, "t": 0.5}, {"s": 0.997, "m": 0}],
    "lafortune": [{"n": 20}, {"n": 20, "cx": 1, "cy": 1, "ks": (0.9, 0.4, 0.1)},
        {"n": 10, "cx": -1, "cy": -0.6, "cz": 0.9}, {"n": 5, "cx": -0.9, "cy": -0.9, "cz": 0.6, "kd": 0.4},
        {"n": 200, "cx": -1, "cy": -1, "cz": 0.98, "ks": 0.9}],
    "eon": [{"r": 0}, {"r": 0.3}, {"r": 0.6, "rho": (0.9, 0.4, 0.1)}, {"r": 1}, {"r": 1, "rho": 1}],
    "ggx": [{"alpha": 0.02, "f0": 1}, {"alpha": 0.1, "f0": (0.9, 0.4, 0.1)}, {"alpha": 0.3, "f0": 0.04, "kd": 0.4},
        {"alpha": 0.6, "f0": 1}, {"alpha": 1, "f0": 0.5}],
}  # fmt: skip


def lobes() -> list[tuple[str, Lobe]]:
    """Return all sets with a name each: model and number of the set."""
    return [(f"{model}-{n}", lobe(model, values)) for model, sets in SETS.items() for n, values in enumerate(sets)]
