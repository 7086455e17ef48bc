"""The movable objects: list, playback, resets."""

from __future__ import annotations

from imgui_bundle import imgui

from app.settings import Settings
from app.window.panel import widgets as ui
from app.window.panel.facts import Facts


def draw(s: Settings, facts: Facts, actions: set[str]) -> Settings:
    for name in facts.mobiles:
        imgui.text(name)
    if not facts.mobiles:
        imgui.text_disabled("No movable object: add one with --mobile FILE.")
    half = (imgui.get_content_region_avail().x - imgui.get_style().item_spacing.x) / 2
    imgui.begin_disabled(not facts.mobiles)
    if imgui.button(("Pause" if facts.playing else "Play") + "###Play", (half, 0)):
        actions.add("play")
    ui.tip("Move the objects along their paths, or one on a circle. Key Space.")
    imgui.same_line()
    if imgui.button("Reset poses", (half, 0)):
        actions.add("reset poses")
    ui.tip("Return every object to its start pose. Key R resets the view too.")
    imgui.end_disabled()
    return s
