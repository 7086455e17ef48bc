"""Which scene is on show, and loading it again."""

from __future__ import annotations

from pathlib import Path

from imgui_bundle import imgui

from app.settings import Settings
from app.window import theme
from app.window.panel import widgets as ui
from app.window.panel.facts import Facts


def draw(s: Settings, facts: Facts, actions: set[str]) -> Settings:
    ui.label(Path(s.scene).name)
    if facts.coming is not None:
        what, fraction = facts.coming
        imgui.progress_bar(-imgui.get_time() if fraction is None else fraction, (-1, 0), "")
        ui.write_over(what)
    elif imgui.button("Load again", (-1, 0)):
        actions.add("load again")
    ui.tip(
        "Read the scene's files once more. What you have set and moved stays; this picture stays until the new one is "
        "there, or if it cannot be. Key F5. To open another scene, drop its file on the window."
    )
    if facts.load_problem:
        imgui.push_style_color(imgui.Col_.text, (*theme.ERROR, 1.0))
        imgui.text_wrapped(facts.load_problem)
        imgui.pop_style_color()
    return s
