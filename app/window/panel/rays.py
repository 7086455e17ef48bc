"""The structure that traces rays: choice, and its cells over the picture."""

from __future__ import annotations

from dataclasses import replace

from app.settings import CLICKED, POINTED, Settings
from app.window.panel import widgets as ui
from app.window.parts import Window

LABELS = {"bvh": "BVH", "grid3d": "3D grid", "bsp": "BSP tree"}


def draw(s: Settings, window: Window, actions: set[str]) -> Settings:
    from gi_core.rays.structures import DEFAULT, STRUCTURES  # already loaded here

    shown = replace(s, rays=s.rays or DEFAULT)
    chosen = ui.choice(shown, "Structure", "rays", {key: LABELS.get(key, ui.title(key)) for key in STRUCTURES},
                       "Space partitioning that traces rays. A change opens the scene again;\n"
                       "the first time, kernels are compiled for half a minute.\n"
                       "It changes the time, not the light.")  # fmt: skip
    if chosen.rays != shown.rays:
        actions.add("reload")
        s = chosen
    return ui.choice(s, "Cells", "cells", {"": "Hidden", POINTED: "Ray under the cursor", CLICKED: "Ray of a click"},
                     "Leaf cells of the structure over the picture: grey near the point under the cursor,\n"
                     "yellow where its ray passes, dim where they are empty. The ray of a click stays:\n"
                     "click a surface, then orbit. Embree does not show its own.")  # fmt: skip
