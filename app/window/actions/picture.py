"""Actions on the picture: what it shows, exposure, estimator, settings."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from app.window.parts import Window


def toggle(field: str, window: Window) -> None:
    """Switch a field of the settings."""
    settings = window.session.settings
    change: dict[str, Any] = {field: not getattr(settings, field)}
    window.session.want(replace(settings, **change))


def meter(window: Window) -> None:
    """Meter the exposure from the view."""
    exposure = window.session.metered(window.viewport.view.camera)
    window.session.want(replace(window.session.settings, exposure=exposure))
    window.log(f"metered: {exposure:+.1f} EV")


def choose_estimator(k: int, window: Window) -> None:
    from gi_core.estimators import ESTIMATORS

    if k < len(ESTIMATORS):
        window.session.choose_estimator(list(ESTIMATORS)[k])
        window.viewport.name_estimator()


def reset_settings(window: Window) -> None:
    window.session.reset_settings()
