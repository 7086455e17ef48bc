"""Read-outs: irradiance at the probes of the scene file."""

from __future__ import annotations

from imgui_bundle import imgui

from app.settings import Settings
from app.window.panel import widgets as ui
from app.window.panel.facts import Facts
from gi_core.geometry.error import luminance


def draw(s: Settings, facts: Facts, actions: set[str]) -> Settings:
    unit = "lx" if facts.photometric else "W/m²"
    for name, E in facts.probes.items():
        red, green, blue = (f"{float(c):.4g}" for c in E)
        tip = f"Irradiance at the probe: red {red}, green {green}, blue {blue}."
        ui.number(name, f"{float(luminance(E)):.4g} {unit}", tip)
    imgui.push_style_color(imgui.Col_.text, imgui.get_style_color_vec4(imgui.Col_.text_disabled))
    imgui.text_wrapped("Point at a surface: the status line shows its light.")
    imgui.pop_style_color()
    return s
