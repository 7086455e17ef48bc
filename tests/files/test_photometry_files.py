"""IES and EULUMDAT files: every symmetry, every year, TILT, units of flux, and one sentence for each mistake."""

import math

import numpy as np
import pytest

from gi_core.files.formats.boundary import Boundary
from gi_core.files.formats.photometry_file import read_photometry
from gi_core.files.load import load_scene
from gi_core.scene import PhotometricLight, SceneError
from tests.support.grammar.choices import Grammar
from tests.support.grammar.photometry import photometry
from tests.support.mesh_writers import write_scene
from tests.support.photometry import write_ies, write_ldt

GAMMAS = [0.0, 30.0, 60.0, 90.0]
DOWN = np.array([100.0, 80.0, 30.0, 0.0])


def read(path):
    return read_photometry(path, path.name, Boundary(path.parent))


def sentence(path) -> str:
    with pytest.raises(SceneError) as caught:
        read(path)
    return str(caught.value)


def rows(*factors) -> np.ndarray:
    """Return planes of the same curve times a factor each."""
    return np.array(factors)[:, None] * DOWN


@pytest.mark.parametrize(
    ("planes", "factors", "full", "expected"),
    [
        ([0], [1], [0, 360], [1, 1]),
        ([0, 90], [1, 3], [0, 90, 180, 270, 360], [1, 3, 1, 3, 1]),
        ([0, 45, 90], [1, 2, 3], [0, 45, 90, 135, 180, 225, 270, 315, 360], [1, 2, 3, 2, 1, 2, 3, 2, 1]),
        ([0, 60, 180], [1, 2, 3], [0, 60, 180, 300, 360], [1, 2, 3, 2, 1]),
        ([0, 100, 360], [1, 2, 1], [0, 100, 360], [1, 2, 1]),
        ([90, 180, 270], [1, 2, 3], [0, 90, 180, 270, 360], [2, 1, 2, 3, 2]),
        ([90, 150, 270], [1, 2, 4], [0, 30, 90, 150, 270, 360], [2.5, 2, 1, 2, 4, 2.5]),  # 0 lies between 270 and 30
        ([0, 120, 240], [1, 2, 3], [0, 120, 240, 360], [1, 2, 3, 1]),
    ],
)
def test_planes_of_ies(tmp_path, planes, factors, full, expected):
    found = read(write_ies(tmp_path / "a.ies", GAMMAS, planes, rows(*factors)))
    assert found.planes.tolist() == full
    assert found.intensity == pytest.approx(rows(*expected))
    assert found.gammas.tolist() == GAMMAS and found.notes == []


def test_numbers_may_be_apart_by_anything(tmp_path):
    path = write_ies(tmp_path / "a.ies", GAMMAS, [0, 90], rows(1, 2))
    text = path.read_text().replace("\r\n", "\r").replace(" ", ", ")
    path.write_bytes(b"\xef\xbb\xbf" + text.replace("IESNA", "Lampe f\xfcr B\xfcros, IESNA").encode("latin-1"))
    assert read(path).intensity[1] == pytest.approx(2 * DOWN)


def test_tilt_scales_the_flux_of_a_tilted_luminaire(tmp_path):
    table = "TILT=INCLUDE\r\n{}\r\n3\r\n0 45 90\r\n1.0 0.8 0.6"
    write_scene(tmp_path)
    for geometry, direction, factor in (
        (1, (0, -1, 0), 1.0),
        (1, (1, -1, 0), 0.8),
        (3, (1, 0, 0), 0.6),
        (2, (1, 0, 0), 1),
    ):
        path = write_ies(tmp_path / "a.ies", GAMMAS, [0], rows(1), tilt=table.format(geometry))
        light = photometric(tmp_path, f"direction = {list(direction)}")
        assert light.flux == pytest.approx((factor * read(path).flux,) * 3)


def photometric(folder, *lines, name="a.ies", units="photometric") -> PhotometricLight:
    """Return the light of a scene file with these lines."""
    path = folder / "lit.toml"
    body = "\n".join(["[[light]]", 'type = "photometric"', f'file = "{name}"', "position = [0.5, 0.8, 0.5]", *lines])
    path.write_text(f'up = "y"\nunits = "{units}"\n[static]\nmesh = "room.obj"\n{body}\n')
    return load_scene(path, max_edge=math.inf).lights[-1]


def test_keys_of_a_scene_file(tmp_path):
    write_scene(tmp_path)
    file = read(write_ies(tmp_path / "a.ies", GAMMAS, [0, 90], rows(1, 2)))
    light = photometric(tmp_path, "direction = [0, -1, 0]")
    assert light.flux == (file.flux,) * 3 and light.c0 == (1, 0, 0) and light.size == (0, 0)
    write_ies(tmp_path / "a.ies", GAMMAS, [0, 90], rows(1, 2), opening="2 0.1 0.6 0")
    assert photometric(tmp_path, "direction = [0, -1, 0]").size == (0.6, 0.1)
    assert photometric(tmp_path, "direction = [0, -1, 0]\nsize = [0, 0]").size == (0, 0)  # a point after all
    assert np.array_equal(light.intensity, file.intensity)
    more = "direction = [0, -2, 0]\nc0 = [0, 0, 1]\nflux = [1, 2, 3]\nsize = [0.1, 0.2]"
    light = photometric(tmp_path, more, units="radiometric")
    assert light.c0 == (0, 0, 1) and light.flux == (1, 2, 3) and light.size == (0.1, 0.2)


def test_files_outside_of_the_scene_are_refused(tmp_path):
    (tmp_path / "room").mkdir()
    write_scene(tmp_path / "room")
    write_ies(tmp_path / "a.ies", GAMMAS, [0], rows(1))
    with pytest.raises(SceneError, match="lies outside the folder of the scene"):
        photometric(tmp_path / "room", "direction = [0, -1, 0]", name="../a.ies")
    with pytest.raises(SceneError, match=r"there is no such file"):
        photometric(tmp_path / "room", "direction = [0, -1, 0]", name="a.ies")


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (
            ("TILT=NONE", "TILT=lamp.tlt"),
            "TILT must be NONE or INCLUDE, got 'LAMP.TLT'; include the file that it names",
        ),
        (("TILT=NONE", "NONE"), "must have a line TILT=NONE or TILT=INCLUDE"),
        (("4 1 1 2", "4 1 2 2"), "photometry of type B must have two or more horizontal angles, got 1"),
        (("4 1 1 2", "4 1 3 2"), "photometry must be of type C or B, got type A; convert the file to type C"),
        (("4 1 1 2", "4 1 1 3"), "the unit of length must be a number from 1 to 2, got '3'"),
        (("4 1 1 2", "4 1 9 2"), "the photometric type must be a number from 1 to 3, got '9'"),
        (("4 1 1 2", "9000 1 1 2"), "9,000 numbers are needed, but the file ends after"),
        (("4 1 1 2", "1e30 1 1 2"), "the number of vertical angles must be a number from 2 to 10000"),
        (("0 30 60 90", "0 60 30 90"), "vertical angles must increase, got"),
        (("100 80 30 0", "100 80 -30 0"), "candela values must be a number from 0 to 1e+12, got '-30'"),
        (
            ("100 80 30 0", "100 banana 30"),
            "a.ies: line 8: candela values must be a number from 0 to 1e+12, got 'banana'",
        ),
        (
            ("100 80 30 0", "100 80 30 0 7 8"),
            "a.ies: 2 numbers follow the 1 x 4 candela values that the file announces, the first one in line 8;",
        ),
        (("100 80 30 0", "1,100.5 80 30 0"), "1 numbers follow the 1 x 4 candela values"),  # a comma for thousands
        (("100 80 30 0", "100,5 80,25 30"), "4 numbers are needed, but the file ends after 3"),
        (("100 80 30 0", "100 80 nan 0"), "candela values must be a number from 0 to 1e+12, got 'nan'"),
        (("100 80 30 0", "0 0 0 0"), "the flux of the table must be from 1e-09 to 1e+12 lm, got 0 lm"),
    ],
)
def test_mistakes_in_ies_files(tmp_path, change, expected):
    path = write_ies(tmp_path / "a.ies", GAMMAS, [0], rows(1))
    assert change[0] in path.read_text()
    path.write_text(path.read_text().replace(*change))
    assert expected in sentence(path)


def test_decimal_commas_are_decimal_points(tmp_path):
    path = write_ies(tmp_path / "a.ies", [0.0, 30.5, 60.0], [0, 90.5, 180], rows(1, 2, 3)[:, :3] / 8, "Acme, 1986")
    expected = read(path)
    head, _, table = path.read_text().partition("TILT=NONE")
    path.write_text(f"{head}TILT=NONE{table.replace('.', ',')}\x1a")
    file = read(path)
    assert file.notes == ["a.ies: its commas are read as decimal points"] and expected.notes == []
    assert all(np.array_equal(a, b) for a, b in zip(file[:4], expected[:4], strict=True))


def test_a_little_below_zero_is_zero(tmp_path):
    table = rows(1, 2)
    table[1, 2:] = -0.05, -0.01
    file = read(write_ies(tmp_path / "a.ies", GAMMAS, [0, 90], table))
    assert file.notes == ["a.ies: values below 0 count as 0: 2 of its candela values, the lowest -0.05"]
    assert file.intensity[1].tolist() == [200, 160, 0, 0]
    file = read(write_ldt(tmp_path / "a.ldt", 1, GAMMAS, EVERY, table[1], ratio=100 * file.flux / 2000))
    assert file.notes[0] == "a.ldt: values below 0 count as 0: 2 of its luminous intensities, the lowest -0.05"
    table[1, 2] = -3
    assert "must be a number from 0 to 1e+12, got '-3'" in sentence(
        write_ies(tmp_path / "a.ies", GAMMAS, [0, 90], table)
    )


ROUND = math.sqrt(math.pi) / 2


@pytest.mark.parametrize(
    ("opening", "first", "size"),
    [
        ("2 0 0 0", "IESNA:LM-63-2002", (0, 0)),
        ("1 0.5 4 0", "IESNA:LM-63-2002", (4 * 0.3048, 0.5 * 0.3048)),  # width lies along C90
        ("2 0 1.2 0", "IESNA:LM-63-2002", (1.2, 0.001)),  # a line
        ("2 -0.3 0 0", "IESNA:LM-63-1995", (ROUND * 0.3, ROUND * 0.3)),  # a circle, as a square of its area
        ("2 -0.3 0 0", "IES:LM-63-2019", (ROUND * 0.3, ROUND * 0.3)),
        ("2 -0.3 -0.3 0", "IES:LM-63-2019", (ROUND * 0.3, ROUND * 0.3)),
        ("2 -0.3 -0.6 0", "IES:LM-63-2019", (ROUND * 0.6, ROUND * 0.3)),
        ("2 -0.3 0.6 0", "IESNA91", (ROUND * 0.6, ROUND * 0.3)),
        ("2 0.2 0.6 0.1", "IES:LM-63-2019", (0.6, 0.2)),  # luminous sides
        ("2 -0.3 0 -0.3", "IESNA91", (ROUND * 0.3, ROUND * 0.3)),  # a sphere
        ("2 -0.3 -0.3 -0.3", "IES:LM-63-2019", (ROUND * 0.3, ROUND * 0.3)),
        ("2 0 1.2 -0.1", "IESNA91", (1.2, 0.1)),  # a tube
        ("2 1.2 0 -0.1", "IESNA91", (0.1, 1.2)),
        ("2 -0.1 1.2 -0.1", "IES:LM-63-2019", (1.2, 0.1)),
        ("2 -0.3 0 -0.3", "IES:LM-63-2019", (0.001, 0.3)),  # a disc that stands
        ("2 600 600 0", "IES:LM-63-2019", (0, 0)),  # millimetres
    ],
)
def test_luminous_openings_of_ies(tmp_path, opening, first, size):
    file = read(write_ies(tmp_path / "a.ies", GAMMAS, [0], rows(1), first, opening=opening))
    assert file.size == pytest.approx(size)
    high = float(opening.split()[-1]) != 0
    assert any("m high; the light comes from the flat opening alone" in note for note in file.notes) == high
    assert any("write its size in the scene file" in note for note in file.notes) == ("600" in opening)


@pytest.mark.parametrize(
    ("opening", "size", "high"),
    [
        ((0, 0, 0, 0, 0, 0), (0, 0), False),
        ((1200, 100, 0, 0, 0, 0), (0.1, 1.2), False),  # the length lies along C90
        ((300, 0, 0, 0, 0, 0), (ROUND * 0.3, ROUND * 0.3), False),
        ((300, 0, 40, 40, 40, 40), (ROUND * 0.3, ROUND * 0.3), True),
    ],
)
def test_luminous_areas_of_eulumdat(tmp_path, opening, size, high):
    file = read(write_ldt(tmp_path / "a.ldt", 1, GAMMAS, EVERY, rows(1), opening=opening))
    assert file.size == pytest.approx(size)
    assert any("0.04 m high" in note for note in file.notes) == high


def type_b(h, v):
    """Return an uneven distribution [cd] over angles of type B [degrees]."""
    return 100 * np.cos(np.radians(h)) * (1 + 0.5 * np.sin(np.radians(v))) * np.cos(np.radians(v)) ** 2


def test_type_b_becomes_type_c(tmp_path):
    """Type B: V turns about the horizontal axis C90, H is the latitude; 0, 0 is the axis of the luminaire."""
    h, v = np.arange(-90.0, 91.0, 2), np.arange(-90.0, 91.0, 2)
    table = type_b(h[:, None], v)
    file = read(write_ies(tmp_path / "a.ies", v, h, table, kind=2))
    area = np.cos(np.radians(h))[:, None] * np.radians(2) ** 2
    assert file.flux == pytest.approx(float((table * area).sum()), rel=1e-3)
    gamma, plane = np.radians(file.gammas), np.radians(file.planes)[:, None]
    x, y, z = np.sin(gamma) * np.cos(plane), np.sin(gamma) * np.sin(plane), np.cos(gamma)
    expected = type_b(np.degrees(np.arcsin(y)), np.degrees(np.arctan2(x, z)))
    assert file.intensity == pytest.approx(expected, abs=0.1)
    assert file.intensity[0, 20] > 1.2 * file.intensity[len(plane) // 2, 20]  # V > 0 lies towards C0


def test_type_b_that_begins_at_0_is_symmetric(tmp_path):
    h, v = np.arange(0.0, 46.0, 5), np.arange(0.0, 31.0, 5)
    quarter = np.cos(np.radians(2 * h))[:, None] * np.cos(np.radians(3 * v))
    part = read(write_ies(tmp_path / "a.ies", v, h, quarter, kind=2))
    full = read(
        write_ies(
            tmp_path / "b.ies",
            [*-v[:0:-1], *v],
            [*-h[:0:-1], *h],
            np.block([[quarter[:0:-1, :0:-1], quarter[:0:-1]], [quarter[:, :0:-1], quarter]]),
            kind=2,
        )
    )
    assert np.array_equal(part.intensity, full.intensity) and part.flux == full.flux
    assert part.intensity[:, part.gammas > 50].max() == 0 < part.intensity[:, 0].min()  # nothing beyond the table


def test_odd_planes_are_refused(tmp_path):
    found = sentence(write_ies(tmp_path / "a.ies", GAMMAS, [0, 45], rows(1, 2)))
    assert found.endswith("or from 90 to 270, got 0 to 45")


EVERY = list(range(0, 360, 45))  # C-planes of a file


def test_eulumdat_notes_what_it_cannot_follow(tmp_path):
    found = read(write_ldt(tmp_path / "a.ldt", 1, GAMMAS, EVERY, rows(1), ratio=50, sets=2))
    assert "it has 2 sets of lamps; the first one is used, of 2000 lm" in found.notes[1]
    assert "but it states 1000 lm (50 % of 2000 lm)" in found.notes[0]
    right = 100 * found.flux / 2000
    assert read(write_ldt(tmp_path / "a.ldt", 1, GAMMAS, EVERY, rows(1), ratio=right)).notes == []


@pytest.mark.parametrize(
    ("line", "value", "expected"),
    [
        (3, "7", "line 3: the symmetry Isym must be a number from 0 to 4, got '7'"),
        (4, "6", "line 4: the number of C-planes must be a multiple of 4 for symmetry 4, got 6"),
        (6, "", "line 6: the number of intensities per C-plane must be a number from 2 to 10000, got ''"),
        (24, "0", "line 24: the conversion factor for intensities must be a number from 1e-12"),
        (29, "0", "line 29: the luminous flux of the lamps must be a number from 1e-12"),
        (44, "0", "C-planes must increase"),
        (55, "x", "luminous intensities must be a number from 0 to 1e+12, got 'x'"),
    ],
)
def test_mistakes_in_eulumdat_files(tmp_path, line, value, expected):
    path = write_ldt(tmp_path / "a.ldt", 4, GAMMAS, EVERY, rows(1, 2, 3))
    lines = path.read_text().split("\n")
    lines[line - 1] = value
    path.write_text("\n".join(lines))
    assert expected in sentence(path)


def test_files_by_grammar_have_the_light_that_was_written(tmp_path):
    """Intensity in all planes, flux by an integral of its own, opening: 300 files of all symmetries and years."""
    for seed in range(300):
        made = photometry(Grammar(seed, 0.0))
        (tmp_path / made.name).write_bytes(made.body)
        file = read(tmp_path / made.name)
        assert np.abs(file.intensity - made.candela(file.planes, made.gammas)).max() < 1e-6 * made.peak, seed
        assert file.flux == pytest.approx(made.lumens(), rel=1e-5) and file.size == pytest.approx(made.size), seed


@pytest.mark.parametrize("name", ["a.ies", "a.ldt"])
def test_an_empty_file_is_called_empty(tmp_path, name):
    (tmp_path / name).write_text("\n \n")
    assert sentence(tmp_path / name).endswith(f"{name}: the photometric file is empty; export it again")


def test_short_eulumdat_file(tmp_path):
    path = tmp_path / "a.ldt"
    path.write_text("maker\n1")
    assert "line 3: the symmetry Isym: 1 numbers are needed, but the file ends after 0" in sentence(path)
