"""The materials of a scene as `gi-viewer info` lists them: what [materials.NAME] of a scene file can change."""

from __future__ import annotations

import numpy as np

LISTED, NAMED = 12, 24  # materials with a line each, and those after them that are named at least
HEAD = ("materials", "reflectance", "triangles", "area", "")


def material_lines(scene, surfaces) -> list[str]:
    """Return a table of what surfaces wear, one name a line, the largest area first, the rest in one line."""
    s = surfaces
    worn = np.concatenate([m.face_material for m in (scene.static, *(m.mesh for m in scene.mobiles))])
    every = zip(s.faces, s.paint, strict=True)
    textured = np.concatenate([np.zeros(len(f), bool) if p is None else p.face_texture >= 0 for f, p in every])
    # Loading copies materials to change their sides: one name, one line.
    names = [m.name for m in scene.materials]
    number = np.array([names.index(name) for name in names], np.int64)[worn]
    whole = max(float(s.areas.sum()), 1e-300)
    rows = []
    for k in np.unique(number):
        faces = np.flatnonzero(number == k)
        area = float(s.areas[faces].sum())
        rho = (s.reflectance[faces] * s.areas[faces, None]).sum(axis=0) / max(area, 1e-300)
        cells = f'"{names[k]}"', triple(np.round(rho, 3)), f"{len(faces):,}", f"{100 * area / whole:.3g} %"
        rows.append((area, names[k], (*cells, _kind(s.two_sided[faces], textured[faces], s.emission[faces]))))
    rows.sort(key=lambda row: -row[0])
    shown = [HEAD, *(cells for *_, cells in rows[:LISTED])]
    widths = [max(len(row[k]) for row in shown) + 2 for k in range(len(HEAD))]
    lines = ["".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in shown]
    rest = rows[LISTED:]
    if rest:
        share = 100 * sum(area for area, *_ in rest) / whole
        named = ", ".join(f'"{name}"' for _, name, _ in rest[:NAMED]) + (", ..." if len(rest) > NAMED else "")
        lines.append(f"and {len(rest)} more on {share:.3g} % of the area: {named}")
    return lines


def _kind(two_sided: np.ndarray, textured: np.ndarray, emission: np.ndarray) -> str:
    """Return what else there is to say of the faces of a material."""
    said = [" and ".join("two-sided" if k else "one-sided" for k in np.unique(two_sided))]
    if textured.any():
        said.append("mean of its texture" if textured.all() else "partly textured")
    if emission.any():
        said.append(f"emits {triple(emission.max(axis=0))}")
    return ", ".join(said)


def triple(values) -> str:
    """Return three numbers in brackets, to four digits."""
    return "(" + ", ".join(f"{v + 0.0:.4g}" for v in values) + ")"  # + 0.0: no "-0"
