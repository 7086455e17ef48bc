"""Parameters of the method: photons, radius, neighbours, path tracing."""

from __future__ import annotations

from dataclasses import replace

from app.rest.results import GatherProgress
from app.settings import REFERENCE, Settings
from app.window.panel import widgets as ui
from app.window.parts import Window

RADIUS_RANGE = (0.002, 0.2)  # of the scene size
PHOTONS_RANGE = (1_000, 10_000_000)
NEIGHBOURS_RANGE = (2, 1_000)
GLOSS_NAMES = {"quadtree": "QuadTree (summarised)", "list": "List", "all_rays": "QuadTree (all rays)"}
LIGHT_NAMES = {"best": "Best available", "photons": "Photons only"}


def draw(s: Settings, window: Window, actions: set[str]) -> Settings:
    session, snapshot = window.session, window.session.light.snapshot
    changed, photons = ui.int_slider("Photons", s.photons, *PHOTONS_RANGE, ui.thousands(s.photons), logarithmic=True)
    if changed:
        s = replace(s, photons=ui.rounded(max(photons, 1)))
    ui.tip("Number of photons. More photons give less noise and slower frames.")

    size = session.chosen.scene_size
    low, high = (share * size for share in RADIUS_RANGE)
    changed, radius = ui.float_slider("Radius", s.radius, low, high, f"{s.radius:.3g} m", logarithmic=True)
    if changed and radius > 0:
        s = replace(s, radius=float(f"{radius:.3g}"))
    ui.tip(
        "Radius around each vertex within which photon paths count. For photon_map: the largest radius. "
        "Impact_count uses it only in motion, to smooth changes.\n"
        f"Now {100 * s.radius / size:.2g} % of the scene size.\n"
        "A larger radius gives less noise and blurs shadow edges over that length. Ctrl+click to type a value."
    )

    with ui.idle(ui.only("photon_map", s)):
        k_now = f"{s.neighbours}"
        changed, k = ui.int_slider("Neighbours k", s.neighbours, *NEIGHBOURS_RANGE, k_now, logarithmic=True)
        if changed:
            s = replace(s, neighbours=max(k, 1))
        ui.tip("Nearest photon hits per estimate of photon_map.")
    compared = s.compare not in ("", REFERENCE)
    with ui.idle("a comparison with an estimator shows the light of photons alone" if compared else ""):
        chosen = ui.choice(replace(s, light="photons") if compared else s, "Light", "light", LIGHT_NAMES,
                      "Best available: path tracing lights movable objects in each frame. It lights the static part "
                      "once its noise is below the photons'.\n"
                      "Photons only, as in the report: the estimator lights everything. Choosing another estimator "
                      "selects this mode; each estimator keeps its own mode.")  # fmt: skip
        s = s if compared else chosen
    if snapshot.gloss is not None:
        s = ui.choice(s, "Gloss", "gloss", GLOSS_NAMES,
                      "How rays at glossy vertices are kept.\n"
                      "QuadTree (summarised): sums in 64 cells of directions; the graphics card evaluates them.\n"
                      "List: every ray, as in the report; every ray is evaluated for each view.\n"
                      "QuadTree (all rays): single rays only in cells where the lobe is bright.")  # fmt: skip
    _progress("Static part", session.gathered, "photons are better",
              "Error of the gathered light on the static part. Gathering ends at 0.7 %.")  # fmt: skip
    _progress("At mobiles", snapshot.rest.at_poses if session.gathered is not None else None, "frames are better",
              "Noise of the light on mobiles and of the light that they change, gathered while they rest. "
              "Gathering ends at 0.7 %, or after 47 rounds of paths.")  # fmt: skip
    return s


def _progress(name: str, g: GatherProgress | None, otherwise: str, about: str) -> None:
    """Write the error of gathered light and whether the picture shows it."""
    if g is None or g.error >= 1:
        text = ui.DASH if g is None else "gathering"
    else:
        text = f"{100 * g.error:.1f} %, {'shown' if g.used else otherwise}"
    ui.number(name, text, about)
