"""Photometric files: IES (LM-63 of 1986, 1991, 1995, 2002, 2019; photometry of types C and B) and EULUMDAT (.ldt).

They hold luminous intensity by plane C and angle gamma from straight down, and the luminous opening. Planes that a file
omits follow from its symmetry; type B is resampled. No library served: `photompy` 0.3 requires matplotlib and turns
EULUMDAT of symmetry 3 by 90 degrees, `eulumdat` has no wheels, `eulumdat-ies` reads LM-63-2002 alone.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gi_core.files.formats.boundary import Boundary
from gi_core.lights.photometric import flux_of
from gi_core.scene.errors import SceneError, shown
from gi_core.scene.validate import CLOSEST

SUFFIXES = (".ies", ".ldt")
TYPES = {1: "C", 2: "B", 3: "A"}
ELSEWHERE = 0.05  # relative difference between the stated flux and the table's, above which a note tells
MOST_ANGLES = 10_000  # in a direction
DAMAGED = 1e12  # cd, lm: such numbers in a file are damage
ROUND = math.sqrt(math.pi) / 2  # side of a square / diameter of the circle of the same area


class Tilt(NamedTuple):
    """Factors of the flux of a luminaire that is tilted (LM-63, TILT=INCLUDE)."""

    geometry: int  # of the lamp: 1 upright, 2 horizontal in any position, 3 horizontal and tilted with the luminaire
    degrees: np.ndarray  # (n,) float64, increasing
    factors: np.ndarray  # (n,) float64, >= 0

    def factor(self, degrees: float) -> float:
        """Return the factor at an angle between the luminaire's axis and straight down."""
        return float(np.interp(0.0 if self.geometry == 2 else degrees, self.degrees, self.factors))


class PhotometryFile(NamedTuple):
    """A photometric file as read, of all planes."""

    gammas: np.ndarray  # (T,) float64 degrees, increasing, from straight down
    planes: np.ndarray  # (P,) float64 degrees, from 0 to 360
    intensity: np.ndarray  # (P, T) float64 [cd]
    flux: float  # of the table [lm]
    size: tuple[float, float]  # of the luminous opening along C0 and C90, as a rectangle [m]; 0: a point
    tilt: Tilt | None
    notes: list[str]
    watts: float = 0.0  # 0: not stated


def read_photometry(path: Path, where: str, boundary: Boundary) -> PhotometryFile:
    """Read an IES or EULUMDAT file. Raises SceneError, one sentence."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise SceneError(
            f"{where}: a photometric file must be one of {' '.join(SUFFIXES)}, got {suffix or 'no suffix'}"
        )
    text = boundary.read(path, where, small=True).decode("latin-1")  # labels may be of any code page
    if not text.strip():
        raise SceneError(f"{where}: the photometric file is empty; export it again")
    lines = re.split("\r\n|\r|\n", text.removeprefix("\xef\xbb\xbf").rstrip("\x1a\0"))  # DOS ends a text by 1A
    file = (_ies if suffix == ".ies" else _eulumdat)(lines, where)
    return file._replace(notes=[f"{where}: {note}" for note in file.notes])


class _Numbers:
    """Numbers of a file, in order."""

    def __init__(self, where: str, words: list[tuple[int, str]]):
        """words: with the line of each, counted from 1."""
        self.where, self._words, self._next = where, words, 0
        self.notes: list[str] = []

    def take(self, what: str, count: int, low: float = -DAMAGED, high: float = DAMAGED) -> np.ndarray:
        """Return the next numbers (count,) float64. Raises SceneError for missing ones and for any out of range."""
        words = self._words[self._next : self._next + count]
        out = np.array([_number(word) for _, word in words])
        for value, (line, word) in zip(out.tolist(), words, strict=True):
            if not low <= value <= high:
                rule = f"must be a number from {low:g} to {high:g}, got {shown(word)}"
                raise SceneError(f"{self.where}: line {line}: {what} {rule}")
        if len(words) < count:
            raise SceneError(
                f"{self.where}: {what}: {count:,} numbers are needed, but the file ends after {len(words):,}; "
                "is it cut off?"
            )
        self._next += count
        return out

    def number(self, what: str, low: float = -DAMAGED, high: float = DAMAGED) -> float:
        return float(self.take(what, 1, low, high)[0])

    def count(self, what: str, low: int, high: int) -> int:
        value = self.number(what, low, high)
        if value != int(value):
            line, _ = self._words[self._next - 1]
            raise SceneError(f"{self.where}: line {line}: {what} must be a whole number, got {value:g}")
        return int(value)

    def angles(self, what: str, count: int, high: float, low: float = 0.0) -> np.ndarray:
        """Return angles (count,) in degrees that increase, from `low` to `high`."""
        values = self.take(what, count, low, high)
        if (np.diff(values) < CLOSEST).any():
            raise SceneError(f"{self.where}: {what} must increase, got {shown(values.tolist())}")
        return values

    def table(self, what: str, planes: int, rows: int) -> np.ndarray:
        """Return intensities (planes, rows) >= 0, the last numbers of the file; slightly negative ones count as 0."""
        first, last = self._next, self._next + planes * rows
        values = np.array([_number(word) for _, word in self._words[first:last]])
        # as much below 0 as 0.01 of the largest intensity is an error of measurement
        slight = (values < 0) & (values >= -0.01 * np.nanmax(values, initial=0.0))
        if slight.any():
            lowest = f"the lowest {values[slight].min():g}"
            self.notes.append(f"values below 0 count as 0: {slight.sum():,} of its {what}, {lowest}")
            for k in (first + np.flatnonzero(slight)).tolist():
                self._words[k] = self._words[k][0], "0"
        values = self.take(what, planes * rows, 0)
        left = [word for _, word in self._words[self._next :]]
        if surplus := sum(math.isfinite(_number(word)) for word in left):
            raise SceneError(
                f"{self.where}: {surplus:,} numbers follow the {planes:,} x {rows:,} {what} that the file announces, "
                f"the first one in line {self._words[self._next][0]}; is a comma out of place? Export it again"
            )
        if left:
            self.notes.append(f"{shown(' '.join(left))} after its {what} is left out")
        return values.reshape(planes, rows)


def _number(word: str) -> float:
    """Return a number, also one with a decimal comma; NaN for anything else."""
    try:
        return float(word.strip().replace(",", "."))
    except ValueError:
        return math.nan


# IES ------------------------------------------------------------------------------------------------


def _ies(lines: list[str], where: str) -> PhotometryFile:
    at = next((i for i, line in enumerate(lines) if line.strip().upper().startswith("TILT")), None)
    if at is None:
        raise SceneError(f"{where}: an IES file must have a line TILT=NONE or TILT=INCLUDE, which this has not")
    kind = lines[at].partition("=")[2].strip().upper()
    if kind not in ("NONE", "INCLUDE"):
        raise SceneError(f"{where}: TILT must be NONE or INCLUDE, got {shown(kind)}; include the file that it names")
    year = re.match(r"IES(?:NA)?:?(?:LM-63-)?(\d+)", lines[0].strip())
    early = year is None or int(year[1][-4:]) in (86, 91, 95, 1986, 1991, 1995)  # of 1986 the first line is a label
    numbers = _Numbers(where, words := _ies_words(lines[at + 1 :], at + 2))
    if any("," in word for _, word in words):
        numbers.notes.append("its commas are read as decimal points")
    tilt = _tilt(numbers) if kind == "INCLUDE" else None
    lamps, lumens = numbers.number("the number of lamps"), numbers.number("lumens per lamp")
    scale = numbers.number("the candela multiplier", 1e-12)
    rows = numbers.count("the number of vertical angles", 2, MOST_ANGLES)
    columns = numbers.count("the number of horizontal angles", 1, MOST_ANGLES)
    letter = TYPES[numbers.count("the photometric type", 1, 3)]
    if letter == "A":
        raise SceneError(f"{where}: photometry must be of type C or B, got type A; convert the file to type C")
    metres = 0.3048 if numbers.count("the unit of length", 1, 2) == 1 else 1.0
    opening = numbers.take("width, length and height of the luminous opening", 3) * metres
    size = _ies_opening(*opening.tolist(), early, numbers.notes)
    scale *= numbers.number("the ballast factor", 1e-12)
    later = numbers.number("the ballast-lamp photometric factor")  # since 2002 no factor any more
    if early and later > 0:
        scale *= later
    watts = max(numbers.number("the input watts"), 0.0)
    if letter == "C":
        gammas = numbers.angles("vertical angles", rows, 180)
        planes = numbers.angles("horizontal angles", columns, 360)
        full = _ies_planes(planes, numbers.table("candela values", columns, rows) * scale, where)
    else:
        vertical = numbers.angles("vertical angles", rows, 180, -180)
        horizontal = numbers.angles("horizontal angles", columns, 90, -90)
        if columns < 2:
            raise SceneError(f"{where}: photometry of type B must have two or more horizontal angles, got 1")
        gammas, *full = _of_type_b(vertical, horizontal, numbers.table("candela values", columns, rows) * scale)
    flux, stated = _flux(gammas, *full, where), lamps * lumens
    if stated > 0 and flux > (1 + ELSEWHERE) * stated:
        numbers.notes.append(f"its table has {flux:.0f} lm, more than the {stated:.0f} lm of its lamps")
    return PhotometryFile(gammas, *full, flux, size, tilt, numbers.notes, watts)


def _ies_words(lines: list[str], first: int) -> list[tuple[int, str]]:
    """Return the words of lines, each with its line, counted from `first`.

    A comma separates words, as the standard has it, unless all words are numbers with no more than one comma within.
    """
    words = [(k, word.strip(",")) for k, line in enumerate(lines, first) for word in line.split()]
    if all(math.isfinite(_number(word)) for _, word in words if word):
        return [(k, word) for k, word in words if word]
    return [(k, part) for k, word in words for part in word.split(",") if part]


def _ies_opening(width: float, length: float, height: float, early: bool, notes: list[str]) -> tuple[float, float]:
    """Return the luminous opening as a rectangle in the plane of C0 and C90, sides along these [m]; 0 and 0: a point.

    Negative numbers are round (LM-63, table of luminous openings): until 1995 a negative width or length makes the
    outline an ellipse, a circle if the other one is 0. Later files may say so by both, and a height that is negative as
    well makes of one a cylinder that lies, or a disc that stands. Without any, a negative height is the diameter of a
    cylinder that lies.
    """
    along, across, high = abs(length), abs(width), abs(height)
    if (width < 0 or length < 0) and (early or max(width, length) < 0 or height >= 0):
        along, across = ROUND * (along or across), ROUND * (across or along)
    elif height < 0 and min(width, length) >= 0:
        along, across = along or high, across or high
    return _opening(along, across, high, notes)


def _opening(along: float, across: float, height: float, notes: list[str]) -> tuple[float, float]:
    """Return an opening as a rectangle with sides > 0, or 0 and 0 for a point [m]; notes name omissions."""
    if max(along, across) > 20.0:  # a luminous opening longer than 20.0 m is in other units than the file says
        notes.append(
            f"its luminous opening of {along:g} x {across:g} m cannot be true, the light comes from a point; "
            "write its size in the scene file"
        )
        return 0.0, 0.0
    if height > 0:
        notes.append(f"its luminous opening is {height:g} m high; the light comes from the flat opening alone")
    # A line is 1 mm wide.
    return (max(along, 1e-3), max(across, 1e-3)) if max(along, across) > 0 else (0.0, 0.0)


def _tilt(numbers: _Numbers) -> Tilt:
    geometry = numbers.count("the lamp's position under TILT", 1, 3)
    count = numbers.count("the number of angles under TILT", 1, MOST_ANGLES)
    return Tilt(geometry, numbers.angles("angles under TILT", count, 180), numbers.take("factors under TILT", count, 0))


def _ies_planes(planes: np.ndarray, values: np.ndarray, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Return all planes from 0 to 360 and their intensity, by the symmetry that the angles tell."""
    first, last = planes[0], planes[-1]
    if len(planes) == 1:
        return _around([(0.0, values[0])])
    by_plane = list(zip(planes.tolist(), values, strict=True))
    if (first, last) == (0, 360):
        return planes, values
    if (mirrors := {(0, 90): (180, 0), (0, 180): (0,), (90, 270): (180,)}.get((first, last))) is not None:
        return _around(by_plane, mirrors)
    if first == 0 and last > 180 and 360 - last <= 2 * np.diff(planes).max():  # the plane at 360 left out
        return _around(by_plane)
    raise SceneError(
        f"{where}: horizontal angles must be 0 alone, or go from 0 to 90, 180 or 360, or from 90 to 270, "
        f"got {first:g} to {last:g}"
    )


def _of_type_b(vertical: np.ndarray, horizontal: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return gammas (T,), planes (P,) [degrees] and intensity (P, T) of a table (H, V) of type B, with its flux.

    Planes of type B share the horizontal axis C90: tan V = tan gamma cos C, sin H = sin gamma sin C (LM-63, LM-75; EN
    13032-1). Angles that begin at 0 are symmetric. Outside of the table is no light.
    """
    if vertical[0] == 0:
        vertical, values = np.append(-vertical[:0:-1], vertical), np.concatenate([values[:, :0:-1], values], axis=1)
    if horizontal[0] == 0:
        horizontal, values = np.append(-horizontal[:0:-1], horizontal), np.concatenate([values[:0:-1], values])
    step = min(max(float(min(np.diff(vertical).min(), np.diff(horizontal).min())), 0.5), 2.5)  # degrees
    gammas = np.linspace(0.0, most := 90.0 if np.abs(vertical).max() <= 90 else 180.0, math.ceil(most / step) + 1)
    planes = np.linspace(0.0, 360.0, 4 * math.ceil(90 / step) + 1)
    gamma, plane = np.radians(gammas), np.radians(planes)[:, None]
    v = np.degrees(np.arctan2(np.sin(gamma) * np.cos(plane), np.cos(gamma)))
    h = np.degrees(np.arcsin(np.clip(np.sin(gamma) * np.sin(plane), -1.0, 1.0)))
    j, w = _places(vertical, v)
    k, t = _places(horizontal, h)
    between = (1 - t) * ((1 - w) * values[k, j] + w * values[k, j + 1])
    intensity = between + t * ((1 - w) * values[k + 1, j] + w * values[k + 1, j + 1])
    beyond = np.maximum.reduce([vertical[0] - v, v - vertical[-1], horizontal[0] - h, h - horizontal[-1]])
    intensity = np.where(beyond > CLOSEST, 0.0, intensity)
    # Solid angle is cos H dH dV: H is the latitude, gamma + 90 degrees of a type C table about the axis C90.
    flux = flux_of(horizontal + 90, vertical, values.T)
    return gammas, planes, intensity * (flux / max(flux_of(gammas, planes, intensity), 1e-300))


def _places(angles: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the intervals (int64) of angles that hold values, and the place within each, from 0 to 1."""
    k = np.clip(np.searchsorted(angles, values, "right") - 1, 0, len(angles) - 2)
    return k, np.clip((values - angles[k]) / (angles[k + 1] - angles[k]), 0.0, 1.0)


# EULUMDAT -------------------------------------------------------------------------------------------


def _eulumdat(lines: list[str], where: str) -> PhotometryFile:
    def field(number: int) -> _Numbers:
        """Return the number of a line, counted from 1."""
        words = lines[number - 1 : number] if number <= len(lines) else []
        return _Numbers(
            where if words else f"{where}: line {number}", [(number, w.strip().partition(" ")[0]) for w in words]
        )

    symmetry = field(3).count("the symmetry Isym", 0, 4)
    planes = field(4).count("the number of C-planes", 1, MOST_ANGLES)
    rows = field(6).count("the number of intensities per C-plane", 2, MOST_ANGLES)
    if symmetry > 1 and planes % (4 if symmetry > 2 else 2):
        raise SceneError(
            f"{where}: line 4: the number of C-planes must be a multiple of {4 if symmetry > 2 else 2} "
            f"for symmetry {symmetry}, got {planes}"
        )
    ratio = field(23).number("the light output ratio [%]")
    factor = field(24).number("the conversion factor for intensities", 1e-12)
    tilt = field(25).number("the tilt during measurement")
    sets = field(26).count("the number of sets of lamps", 1, 20)
    lumens = field(29).number("the luminous flux of the lamps", 1e-12)
    after = 26 + 6 * sets + 10  # lines before the angles
    numbers = _Numbers(where, [(k, line) for k, line in enumerate(lines[after:], after + 1) if line.strip()])
    angles = numbers.angles("C-planes", planes, 360)
    gammas = numbers.angles("angles gamma", rows, 180)
    first, count = {
        0: (0, planes), 1: (0, 1), 2: (0, planes // 2 + 1), 3: (3 * planes // 4, planes // 2 + 1),
        4: (0, planes // 4 + 1),
    }[symmetry]  # fmt: skip
    if count > planes:
        raise SceneError(f"{where}: line 4: symmetry {symmetry} needs more C-planes than {planes}")
    scale = factor * lumens / 1000  # the table is in cd per 1,000 lm of the lamps
    values = numbers.table("luminous intensities", count, rows) * scale
    by_plane = list(zip(angles[np.arange(first, first + count) % planes].tolist(), values, strict=True))
    if symmetry == 1:
        by_plane = [(0.0, values[0])]
    full = _around(by_plane, {2: (0,), 3: (180,), 4: (0, 180)}.get(symmetry, ()))
    flux, stated = _flux(gammas, *full, where), lumens * ratio / 100
    notes = numbers.notes
    if stated > 0 and abs(flux / stated - 1) > ELSEWHERE:
        notes.append(f"its table has {flux:.0f} lm, but it states {stated:.0f} lm ({ratio:g} % of {lumens:g} lm)")
    if sets > 1:
        notes.append(f"it has {sets} sets of lamps; the first one is used, of {lumens:g} lm")
    if tilt:
        notes.append(f"the luminaire was measured at a tilt of {tilt:g} degrees, which is not undone")
    length, width, *heights = (
        field(k).number("the luminous area [mm]", 0, 1e6) / 1000 if lines[k - 1].strip() else 0.0 for k in range(16, 22)
    )
    # The length lies along C90: C0 is the plane across a luminaire (EN 13032-2). Width 0: a circle.
    sides = (width, length) if width > 0 else (ROUND * length, ROUND * length)
    watts = _number(lines[31].strip().partition(" ")[0]) if len(lines) > 31 else math.nan  # of the first set of lamps
    watts = watts if 0 < watts < DAMAGED else 0.0
    return PhotometryFile(gammas, *full, flux, _opening(*sides, max(heights), notes), None, notes, watts)


# Both -----------------------------------------------------------------------------------------------


def _around(by_plane: list[tuple[float, np.ndarray]], mirrors: Sequence[int] = ()) -> tuple[np.ndarray, np.ndarray]:
    """Return planes (P,) from 0 to 360 and their intensity (P, T), of some planes at any angles [degrees].

    mirrors: sums of the angles of two mirrored planes, one mirror after the other. Between planes intensity is linear,
    so the plane at 0 that may have to be added changes nothing.
    """
    for both in mirrors:
        by_plane = by_plane + [(both - angle, row) for angle, row in by_plane]
    by_angle = {round(angle % 360, 9) % 360: row for angle, row in by_plane}
    angles = sorted(by_angle)
    if angles[0] > 0:
        before, after = angles[-1] - 360, angles[0]
        w = -before / (after - before)
        by_angle[0.0] = (1 - w) * by_angle[angles[-1]] + w * by_angle[after]
        angles.insert(0, 0.0)
    return np.array([*angles, 360.0]), np.array([by_angle[a] for a in (*angles, 0.0)])


def _flux(gammas: np.ndarray, planes: np.ndarray, intensity: np.ndarray, where: str) -> float:
    flux = flux_of(gammas, planes, intensity)
    if not 1e-9 <= flux <= DAMAGED:
        raise SceneError(f"{where}: the flux of the table must be from 1e-09 to {DAMAGED:g} lm, got {flux:.3g} lm")
    return flux
