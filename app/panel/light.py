"""How light is estimated: estimator, photons, radius, neighbours."""

from __future__ import annotations

from dataclasses import replace

from imgui_bundle import imgui

from app.panel import widgets as ui
from app.panel.facts import Facts
from app.settings import Settings

RADIUS_RANGE = (0.002, 0.2)  # of the scene size
PHOTONS_RANGE = (1_000, 10_000_000)
NEIGHBOURS_RANGE = (2, 1_000)
MOBILE_LIGHT_NAMES = {"photons": "By photons", "gathered": "Gathered each frame"}
STATIC_LIGHT_NAMES = {"all": "All photons", "prefix": "Photons in use", "gathered": "Gathered at rest"}


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
    return _static_light(s, facts)


def _static_light(s: Settings, facts: Facts) -> Settings:
    s = ui.choice(s, "Static light", "static_light", STATIC_LIGHT_NAMES,
                  "What walls and furniture that stay are lit from, before the mobiles change it.\n"
                  "All photons: also while something moves and few are in use, so that walls stay clean.\n"
                  "Photons in use: only those of the frame, as the report does.\n"
                  "Gathered: along paths, without bias, while everything rests; used once it is better than photons, "
                  "and kept on disk. Whoever chooses an estimator sees that one's own light on walls too.")  # fmt: skip
    if (g := facts.gathered) is not None:
        ui.label("")
        imgui.progress_bar(g.fraction, (-1, 0), "")
        use = "in use" if g.used else "photons are better still"
        ui.write_over(f"noise {100 * g.noise:.1f} %, {use}" if g.noise < 1 else "gathering, no answer yet")
        ui.tip("How well the static light is known; it is gathered until its noise is 0.7 %.")
    imgui.begin_disabled(facts.mobiles == 0)
    s = ui.choice(s, "Mobile light", "mobile_light", MOBILE_LIGHT_NAMES,
                  "What mobiles are lit from.\n"
                  "By photons: the estimator's own light; few photons meet a small thing.\n"
                  "Gathered: in each frame from lamps and the static part, along a few paths a vertex: as many as fit "
                  "the budget while something moves, more at rest.")  # fmt: skip
    imgui.end_disabled()
    return s
