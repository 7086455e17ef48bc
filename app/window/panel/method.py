"""Estimation of light: estimator, photons, radius, neighbours, path tracing."""

from __future__ import annotations

from dataclasses import replace

from imgui_bundle import imgui

from app.rest.results import GatherProgress
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
                actions.add(f"estimator {k}")
            ui.tip(f"{facts.estimators[key]}\nKey {k + 1}")
        imgui.end_combo()
    else:
        ui.tip(f"Method that computes the light on surfaces from photon paths. Keys 1 to {len(keys)}.")

    ui.label("Photons")
    changed, photons = imgui.slider_int(
        "##Photons", s.photons, *PHOTONS_RANGE, ui.thousands(s.photons), imgui.SliderFlags_.logarithmic
    )
    if changed:
        s = replace(s, photons=ui.rounded(max(photons, 1)))
    ui.tip("Number of photons. More photons give less noise and slower frames.")

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
        "Radius around each vertex within which photon paths count, also in percent of the scene size. For photon_map: "
        "the largest radius.\n"
        "A larger radius gives less noise and blurs shadow edges over that length. Ctrl+click to type a value."
    )

    ui.label("Neighbours k")
    changed, k = imgui.slider_int(
        "##Neighbours k", s.neighbours, *NEIGHBOURS_RANGE, "%d", imgui.SliderFlags_.logarithmic
    )
    if changed:
        s = replace(s, neighbours=max(k, 1))
    ui.tip("Nearest photon hits per estimate of photon_map. Other estimators ignore it.")
    return _light(s, facts)


def _light(s: Settings, facts: Facts) -> Settings:
    s = ui.choice(s, "Light", "light", LIGHT_NAMES,
                  "Best available: path tracing lights movable objects in each frame. It lights the static part once "
                  "its noise is below the photons'.\n"
                  "Photons only: the estimator lights everything. Choosing another estimator selects this mode; each "
                  "estimator keeps its own mode.")  # fmt: skip
    if (g := facts.gathered) is not None:
        ui.label("")
        imgui.progress_bar(g.fraction, (-1, 0), "")
        use = "shown" if g.used else "photons are better"
        ui.write_over(f"error {100 * g.error:.1f} %, {use}" if g.error < 1 else "gathering light")
        ui.tip("Error of the gathered light on the static part. Gathering ends at 0.7 %.")
        if facts.mobiles:
            g = facts.at_poses or GatherProgress()
            ui.label("")
            imgui.progress_bar(g.fraction if g.error < 1 else 0.0, (-1, 0), "")
            use = "shown" if g.used else "frames are better"
            ui.write_over(f"noise at mobiles {100 * g.error:.1f} %, {use}" if g.error < 1 else "gathering at mobiles")
            ui.tip("Noise of the light on mobiles and of the light that they change, gathered while they rest. "
                   "Gathering ends at 0.7 %, or after 47 rounds of paths.")  # fmt: skip
    return s
