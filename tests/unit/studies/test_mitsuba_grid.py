"""Loaded glTF surfaces beside Mitsuba's `principled`, where Mitsuba is installed."""

from __future__ import annotations

import pytest

pytest.importorskip("mitsuba")

from studies import mitsuba_grid  # noqa: E402


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


def test_mixtures_and_plastics_are_near_principled(cells):
    """What is left is the base: Disney's has no factor 1 - F. Before mixtures had their coat's base: 14 to 29 %."""
    for cell in cells:
        if cell.roughness < 0.9:
            assert mitsuba_grid.law(cell, "principled").apart < 0.125, cell
            assert 0.87 < mitsuba_grid.law(cell, "principled").ratio < 1.06, cell
