"""The current scene: name, units, reload; assumptions made where its files give no value."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from imgui_bundle import imgui

from app.settings import UNITS, Settings
from app.window import theme
from app.window.panel import widgets as ui
from app.window.parts import Window
from gi_core.scene.errors import utf8

RELOAD = ui.Button(
    "reload",
    "Reload",
    "Read the scene's files again; settings and poses stay. Key F5.\n"
    "To open another scene: menu File, or drop its file on the window.",
)
UNIT_NAMES = ["lx, cd/m², lm", "W/m², W/m²/sr, W"]  # of UNITS


def draw(s: Settings, window: Window, actions: set[str]) -> Settings:
    file = utf8(s.document or s.scene)
    imgui.text_wrapped(Path(file).name)
    ui.tip(file)
    ui.buttons(actions, RELOAD)
    ui.label("Units")
    changed, k = imgui.combo("##Units", UNITS.index(window.session.scene.units), UNIT_NAMES)
    ui.tip("Units of the numbers in the scene's files. Lights and emission of glTF are photometric by its standard. "
           "For other files choose lx, then set the level of each lamp so that its lumens are right.")  # fmt: skip
    if changed:
        s = replace(s, units=UNITS[k])
    if window.reload.problem:
        ui.wrapped(window.reload.problem, theme.ERROR)
    return s


def notes(s: Settings, window: Window, actions: set[str]) -> Settings:
    for note in window.session.scene.notes:
        ui.wrapped(note)
    return s
