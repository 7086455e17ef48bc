"""How light is estimated: estimator, photons, radius, neighbours."""

from __future__ import annotations

from dataclasses import replace

from imgui_bundle import imgui

from app.settings import Settings
from app.window.panel import widgets as ui
from app.window.panel.facts import Facts

RADIUS_RANGE = (0.002, 0.2)  # of the scene size
PHOTONS_RANGE = (1_000, 10_000_000)
NEIGHBOURS_RANGE = (2, 1_000)
LIGHT_NAMES = {"best": "Best available", "photons": "Photons only (as in the report)"}


def draw(s: Settings, facts: Facts, actions: set[str]) -> Settings:
    keys = list(facts.estimators)
    ui.label("Estimator")
    if imgui.begin_combo("##Estimator", ui.title(s.estimator)):
        for k, key in enumerate(keys):
            if imgui.selectable(ui.title(key), key == s.estimator)[0]:
                s = s.of_estimator(key)
            ui.tip(f"{facts.estimators[key]}\nKey {k + 1}")
        imgui.end_combo()
    else:
        ui.tip(f"How irradiance is estimated from the photons' paths. Nothing is traced again. Keys 1 to {len(keys)}.")

    ui.label("Photons")
    changed, photons = imgui.slider_int(
        "##Photons", s.photons, *PHOTONS_RANGE, ui.thousands(s.photons), imgui.SliderFlags_.logarithmic
    )
    if changed:
        s = replace(s, photons=ui.rounded(max(photons, 1)))
    ui.tip("Photons to trace. More: less noise, slower frames. Those traced already are kept.")

    ui.label("Radius")
    size = facts.scene_size
    low, high = (share * size for share in RADIUS_RANGE)
    percent = f"{100 * s.radius / size:.2g}"
    changed, radius = imgui.slider_float(
        "##Radius", s.radius, low, high, f"%.3g m   ({percent} %%)", imgui.SliderFlags_.logarithmic
    )
    if changed and radius > 0:
        s = replace(s, radius=float(f"{radius:.3g}"))
    ui.tip(
        "Radius of the disc that gathers light around a point, in metres and as a share of the scene size.\n"
        "Larger: smoother, and shadow edges blur over that length. For photon_map it is the largest radius.\n"
        "Ctrl+click to type a value."
    )

    ui.label("k")
    changed, k = imgui.slider_int("##k", s.neighbours, *NEIGHBOURS_RANGE, "%d", imgui.SliderFlags_.logarithmic)
    if changed:
        s = replace(s, neighbours=max(k, 1))
    ui.tip("How many of the nearest photon hits photon_map averages over. The other estimators do not use it.")
    return _light(s, facts)


def _light(s: Settings, facts: Facts) -> Settings:
    s = ui.choice(s, "Light", "light", LIGHT_NAMES,
                  "Best available: mobiles gather light along paths in each frame. So does the static part while "
                  "everything rests; gathered light is shown once it is better than photons, and kept on disk.\n"
                  "Photons only: the chosen estimator lights everything. Set by choosing an estimator.")  # fmt: skip
    if (g := facts.gathered) is not None:
        ui.label("")
        imgui.progress_bar(g.fraction, (-1, 0), "")
        use = "in use" if g.used else "photons are better still"
        ui.write_over(f"noise {100 * g.noise:.1f} %, {use}" if g.noise < 1 else "gathering, no answer yet")
        ui.tip("Noise of the gathered static light. Gathering stops at 0.7 %.")
    return s
