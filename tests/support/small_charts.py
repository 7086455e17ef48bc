"""Charts of few photons, a rough truth and tiny pictures."""

from __future__ import annotations

import pytest

from app.measure.chart import pictures, settings


def small_charts(patch: pytest.MonkeyPatch) -> None:
    """Make every part of `chart --quick` small."""
    less = settings.QUICK._replace(
        photons=(4096, 8192), limit_photons=32_768, truth=0.1, picture_truth=0.3, gathered_seconds=0.3
    )
    patch.setattr(settings, "QUICK", less)
    patch.setattr(pictures, "SIZE", (60, 40))
