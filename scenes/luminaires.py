"""Photometric files of the shipped interiors: IES and EULUMDAT, of beams with a soft edge."""

from __future__ import annotations

import numpy as np

GAMMAS = np.arange(0.0, 91.0, 2.5)  # degrees from the axis


def beam(inner: float, outer: float, spill: float = 0.0) -> np.ndarray:
    """Return intensity (T,) at GAMMAS: 1 up to `inner`, soft to 0 at `outer` [degrees], and `spill` to 65 degrees."""
    cosine = np.cos(np.radians(GAMMAS))
    low, high = np.cos(np.radians([outer, inner]))
    ramp = np.clip((cosine - low) / (high - low), 0, 1) ** 2
    edge = np.cos(np.radians(65.0))
    return ramp + spill * np.clip((cosine - edge) / (1 - edge), 0, 1) * (1 - ramp)


def ies(name: str, peak: float, curve: np.ndarray, size: tuple[float, float] = (0, 0), watts: float = 0) -> bytes:
    """Return an IES file (LM-63-2002) of a luminaire that is the same all round; peak [cd], curve (T,).

    size: of the opening along C0 and C90 [m].
    """
    head = ["IESNA:LM-63-2002", f"[LUMINAIRE] {name}", "[MANUFAC] gi-viewer", "TILT=NONE"]
    long, wide = size
    numbers = [
        f"1 -1 1 {len(GAMMAS)} 1 1 2 {wide:g} {long:g} 0",
        f"1 1 {watts:g}",
        _row(GAMMAS),
        "0",
        _row(peak * curve),
    ]
    return "\r\n".join([*head, *numbers, ""]).encode("ascii")


def ldt(name: str, peak: float, curve: np.ndarray, lumens: float) -> bytes:
    """Return a EULUMDAT file of a luminaire that is the same all round; peak [cd], curve (T,), lumens of its lamp."""
    text = ["gi-viewer", 1, 1, 1, 0, len(GAMMAS), 0, "", name, "", "", ""]
    sizes = [0] * 9  # of housing and opening [mm]
    after = [100, 100, 1, 0, 1, 1, "LED", lumens, "3000", "80", 5, *[0] * 10]
    rows = [*text, *sizes, *after, 0, *GAMMAS, *(f"{v:.6g}" for v in curve * peak * 1000 / lumens)]
    return "\r\n".join([*map(str, rows), ""]).encode("ascii")


def _row(values: np.ndarray) -> str:
    return " ".join(f"{v:.6g}" for v in values)
