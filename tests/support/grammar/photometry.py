"""IES (LM-63, type C) and EULUMDAT files of one smooth intensity, written in the many ways that the formats allow."""

from typing import NamedTuple

import numpy as np

from tests.support.grammar.choices import Grammar

PERIODS = {  # symmetry of EULUMDAT -> shares of cos C, sin C, cos 2C; first and last plane of an IES file
    0: ((0.2, 0.3, 0.1), 0, 360), 1: ((0, 0, 0), 0, 0), 2: ((0.4, 0, 0.1), 0, 180), 3: ((0, 0.4, 0.1), 90, 270),
    4: ((0, 0, 0.4), 0, 90),
}  # fmt: skip


class Written(NamedTuple):
    """A file, and what it says."""

    name: str
    body: bytes
    gammas: np.ndarray  # (T,) degrees
    shares: tuple[float, float, float]  # see PERIODS
    power: float
    peak: float  # [cd]
    size: tuple[float, float]  # along C0 and C90 [m]

    def candela(self, planes: np.ndarray, gammas: np.ndarray) -> np.ndarray:
        """Return the intensity (P, T) [cd] at angles [degrees]."""
        c, gamma = np.radians(planes)[:, None], np.radians(gammas)
        a, b, d = self.shares
        turn = a * np.cos(c) + b * np.sin(c) + d * np.cos(2 * c)
        return self.peak * (0.5 + 0.5 * np.cos(gamma)) ** self.power * (1 + np.sin(gamma) * turn)

    def lumens(self) -> float:
        """Return the flux [lm] of what is linear between the gammas, by the midpoints of small cells."""
        fine = (np.arange(3600) + 0.5) * self.gammas[-1] / 3600
        mean = np.interp(fine, self.gammas, self.candela(np.arange(0.0, 360.0, 5.0), self.gammas).mean(axis=0))
        return float(2 * np.pi * (mean * np.sin(np.radians(fine))).sum() * np.radians(self.gammas[-1] / 3600))


def photometry(g: Grammar) -> Written:
    """Return a valid file."""
    symmetry, gammas = g.pick(*PERIODS), np.linspace(0, g.pick(90, 180), g.pick(19, 37))
    shares, first, last = PERIODS[symmetry]
    size = g.pick((0.0, 0.0), (1.2, 0.3), (0.6, 0.6))
    of = Written("", b"", gammas, shares, g.rng.uniform(0.5, 6), g.rng.uniform(1, 5000), size)
    if g.chance(0.5):
        return _ies(g, of, [0.0] if last == 0 else np.linspace(first, last, 1 + (last - first) // g.pick(15, 30)))
    return _ldt(g, of, symmetry)


def _ies(g: Grammar, of: Written, planes) -> Written:
    late, before = ("IESNA:LM-63-2002", "IES:LM-63-2019"), ("IESNA91", "IESNA:LM-63-1995", "a label of 1986")
    first, early = g.pick(*((line, 0) for line in late), *((line, 1) for line in before))
    scale, ballast, later, foot = g.pick(1.0, 2.5), g.pick(1.0, 0.8), g.pick(1.0, 0.5), g.chance(0.5)
    metres, comma = 0.3048 if foot else 1.0, g.chance(0.3)
    table = of.candela(np.asarray(planes), of.gammas) / (scale * ballast * (later if early else 1.0))
    numbers = [1, -1, scale, len(of.gammas), len(planes), 1, 1 if foot else 2, of.size[1] / metres]
    numbers += [of.size[0] / metres, 0, ballast, later, 50, *of.gammas, *planes, *table.ravel()]
    words = [f"{v:.9g}" if isinstance(v, int) else format(v, g.pick(".7f", ".9g", ".8e")) for v in numbers]
    words = [word.replace(".", ",") for word in words] if comma else words
    text = words[0]
    for word in words[1:]:
        text += g.pick(" ", "\t", g.pick("\r\n", "  ") if comma else ", ", "\r\n", " \r\n") + word
    keywords = [f"[TEST] {g.name()}" for _ in range(g.pick(0, 1, 5))]
    return of._replace(
        name="a.ies", body="\r\n".join([first, *keywords, "TILT=NONE", text, ""]).encode("latin-1", "replace")
    )


def _ldt(g: Grammar, of: Written, symmetry: int) -> Written:
    count, lumens, factor = g.pick(12, 24), g.pick(1000, 2750), g.pick(1.0, 0.5)
    planes = np.arange(count) * 360 / count
    stored = {0: planes, 1: planes[:1], 2: np.arange(count // 2 + 1), 3: np.arange(-(count // 4), count // 4 + 1),
              4: np.arange(count // 4 + 1)}[symmetry]  # fmt: skip
    at = stored * 360 / count if symmetry > 1 else stored
    table = of.candela(at, of.gammas) * 1000 / (lumens * factor)
    head = ["maker", 1, symmetry, count, 360 / count, len(of.gammas), 5, "report", "name", "number", "file", "date"]
    sizes = [1300, 400, 80, 1000 * of.size[1], 1000 * of.size[0], 0, 0, 0, 0, 100, 80, factor, 0, 1]
    lines = [*head, *sizes, 1, "LED", lumens, "3000", "80", 40, *[0.5] * 10, *planes, *of.gammas, *table.ravel()]
    text = g.pick("\r\n", "\n").join(f"{v:.8g}" if isinstance(v, float) else str(v) for v in lines)
    return of._replace(name=g.pick("a.ldt", "a.LDT"), body=text.encode("latin-1"))
