"""Loaded glTF surfaces beside Mitsuba's `principled`, where Mitsuba is installed."""

import pytest

pytest.importorskip("mitsuba")

from studies import mitsuba_grid  # noqa: E402

DOCUMENTED = {  # docs/brdfs.md: by roughness, for metallic 0, 0.25, 0.5 and 0.75, percent apart and ratio of light
    0.1: ((6.5, 0.94), (4.9, 0.95), (3.3, 0.97), (1.7, 0.98)),
    0.4: ((7.3, 0.93), (4.8, 0.95), (2.2, 0.98), (1.7, 1.01)),
    0.55: ((12.2, 0.88), (3.9, 0.97), (3.3, 1.01), (6.3, 1.06)),
    0.7: ((11.1, 0.89), (5.0, 0.98), (7.5, 1.05), (14.0, 1.14)),
    0.85: ((10.6, 0.89), (7.3, 1.00), (13.0, 1.10), (25.0, 1.25)),
    1.0: ((10.6, 0.89), (9.4, 1.00), (17.0, 1.14), (36.0, 1.36)),
}


@pytest.fixture(scope="module")
def cells(tmp_path_factory):
    file = tmp_path_factory.mktemp("grid") / "grid.glb"
    file.write_bytes(mitsuba_grid.grid())
    return mitsuba_grid.cells_of(file)


def test_metals_are_principled_but_for_masking(cells):
    """Distribution and Schlick's F are the same; with separable masking of both nothing is left."""
    metals = [cell for cell in cells if cell.metallic == 1 and cell.roughness < 0.9]
    assert len(metals) == 5
    for cell in metals:
        assert mitsuba_grid.law(cell, "principled").separable < 5e-4


def test_mixtures_and_plastics_are_as_far_from_principled_as_documented(cells):
    """What is left is the base: Disney's has no factor 1 - F, and no further reflections between rough facets."""
    for cell in cells:
        if cell.metallic < 1:
            law = mitsuba_grid.law(cell, "principled")
            apart, ratio = DOCUMENTED[cell.roughness][round(4 * cell.metallic)]
            assert law.apart == pytest.approx(apart / 100, abs=0.01), cell
            assert law.ratio == pytest.approx(ratio, abs=0.01), cell
