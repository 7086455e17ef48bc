"""Actions on the view and the picture: camera, kept views, panel, help; drawn quantity, exposure, estimator."""

from __future__ import annotations

from dataclasses import replace

from app.window.actions.objects import reset_poses
from app.window.panel.widgets import with_field
from app.window.parts import Window
from gi_core.estimators import ESTIMATORS


def frame(window: Window) -> None:
    """Show the selected objects or lamp, or everything."""
    window.viewport.control.frame(window.viewport.selection, window.viewport.lamps.selected)


def bookmark(window: Window) -> None:
    window.log(f"kept as {window.viewport.control.bookmark()}; menu View shows it again")


def reset_all(window: Window) -> None:
    reset_poses(window)
    window.viewport.control.go_home()


def toggle_panel(window: Window) -> None:
    panel = window.params.docking_params.dockable_window_of_name("Panel")
    panel.is_visible = not panel.is_visible


def toggle_help(window: Window) -> None:
    window.help_open = not window.help_open


def cancel(window: Window) -> None:
    """Cancel the drag; without one, close the help."""
    if not window.viewport.cancel_drag():
        window.help_open = False


def toggle(field: str, window: Window) -> None:
    """Switch a field of the settings."""
    settings = window.session.settings
    window.session.want(with_field(settings, field, not getattr(settings, field)))


def meter(window: Window) -> None:
    """Meter the exposure from the view."""
    exposure = window.session.metered(window.viewport.view.camera)
    window.session.want(replace(window.session.settings, exposure=exposure))
    window.log(f"metered: {exposure:+.1f} EV")


def choose_estimator(k: int, window: Window) -> None:
    if k < len(ESTIMATORS):
        window.session.choose_estimator(list(ESTIMATORS)[k])
        window.viewport.name_estimator()
