"""Assumptions made where the scene's files give no value."""

from __future__ import annotations

from imgui_bundle import imgui

from app.settings import Settings
from app.window import theme
from app.window.parts import Window


def draw(s: Settings, window: Window, actions: set[str]) -> Settings:
    imgui.push_style_color(imgui.Col_.text, (*theme.DIM_TEXT, 1.0))
    for note in window.session.scene.notes:
        imgui.text_wrapped(note)
    imgui.pop_style_color()
    return s
