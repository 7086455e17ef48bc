"""Sections about the method."""

from __future__ import annotations

import math
from dataclasses import replace

from imgui_bundle import imgui

from app import values
from app.rest.results import GatherProgress
from app.settings import CLICKED, POINTED, Settings
from app.window.panel import widgets as ui
from app.window.parts import Window
from gi_core.discs.search import SEARCHES
from gi_core.rays.structures import DEFAULT, STRUCTURES

SWITCHES = {  # field -> estimator, name, explanation
    "control": (
        "tangent_plane",
        "Artifact control",
        "light counts only on the part of a disc that light can reach past other objects.\n"
        "Off: slightly faster, but corners and contacts darken and light leaks through thin walls.",
    ),
    "border_correction": (
        "photon_map",
        "Border correction",
        "a vertex on a border or a crease counts hits on its own surface alone, divided by the part of the disc that "
        "this surface covers. Vertices beside a border are not corrected.\n"
        "Off: free borders are dark; at creases, hits on the other surface count too.",
    ),
    "textbook": (
        "photon_map",
        "Count k-th hit",
        "the k-th hit counts too, as in the report. Light is too bright by the factor k / (k - 1).",
    ),
}
LABELS = {"bvh": "BVH", "grid3d": "3D grid", "bsp": "BSP tree"}
GLOSS_NAMES = {"quadtree": "QuadTree (summarised)", "list": "List", "all_rays": "QuadTree (all rays)"}
LIGHT_NAMES = {"best": "Best available", "photons": "Photons only"}


def motion(s: Settings, window: Window, actions: set[str]) -> Settings:
    """The time budget of a frame while something moves."""
    snapshot = window.session.light.snapshot
    low, high = 8, 100  # [ms]; 101: off
    value = round(s.budget) if s.budget > 0 else high + 1
    with ui.idle("" if snapshot.poses else "the scene has no movable object"):
        changed, value = ui.slider("Time budget", value, low, high + 1, f"{value} ms" if value <= high else "off")
        if changed:
            s = replace(s, budget=float(value) if value <= high else 0.0)
        ui.tip(
            "Time for computing light per frame while something moves. It limits photons and paths; at rest all are "
            "used.\nOff: every frame uses all photons."
        )
    shown = f"{ui.thousands(snapshot.photons)} of {ui.thousands(snapshot.photons_at_rest)}"
    ui.number("Photons shown", shown, "Photons in this picture, of those in the picture at rest.")
    paths = ui.thousands(snapshot.paths) if snapshot.paths else ui.DASH
    ui.number("Paths per vertex", paths, "Paths traced per vertex of objects that move. A dash: photons light them.")
    return s


def artifacts(s: Settings, window: Window, actions: set[str]) -> Settings:
    """Bias correction: switches of the estimators, and the receivers that artifact control concerns."""
    for field, (of, name, about) in SWITCHES.items():
        with ui.idle(ui.only(of, s)):
            s = ui.switch(s, name, field, f"{of}: {about}")
    snapshot = window.session.light.snapshot
    control = snapshot.control
    ui.number(
        "Clipped discs",
        f"{100 * control.share:.1f} %",
        "Receivers with a wall or an edge in their disc; for photon_map, on a border.",
    )
    ui.number("   stale", ui.thousands(control.stale),
              "Static receivers with a movable object in their disc. The last frame estimated them again.")  # fmt: skip
    ui.number("   on mobiles", ui.thousands(control.on_mobiles), "Mobile receivers with another object in their disc.")
    cost = snapshot.timings.get("contact")
    ui.number("   contact time", ui.DASH if cost is None else ui.ms(cost), "Time to find these in the last frame.")
    return s


def search(s: Settings, window: Window, actions: set[str]) -> Settings:
    """Disc search of tangent_plane: choice, time, size of the index."""
    s = ui.choice(s, "Search", "search", {key: ui.title(key) for key in SEARCHES},
                  "Method that finds path segments through a disc: a grid of discs, spheres, or all pairs.\n"
                  "It changes the time, not the picture.")  # fmt: skip
    snapshot = window.session.light.snapshot
    cost = snapshot.timings.get("estimate")
    ui.number("Estimate time", ui.DASH if cost is None else ui.ms(cost),
              "Time to find and sum disc intersections in the last frame.")  # fmt: skip
    ui.wrapped(snapshot.search_summary)
    return s


def rays(s: Settings, window: Window, actions: set[str]) -> Settings:
    """The structure that traces rays: choice, and its cells over the picture."""
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


def timings(s: Settings, window: Window, actions: set[str]) -> Settings:
    """Times of a frame and of its stages."""
    session, frame = window.session, window.frame_seconds.value
    gi_seconds = session.light.gi_seconds.value
    fps = f" ({1 / frame:.0f} fps)" if frame > 0 else ""
    ui.number("Frame", ui.ms(frame) + fps, "Of frames with a new picture, including drawing and display.")
    gi = ui.ms(gi_seconds) if gi_seconds > 0 else ui.DASH
    ui.number("GI update", gi, "Time from new poses to irradiance: median of the last moves.")
    for stage, seconds in session.light.snapshot.timings.items():
        ui.number("   " + stage, ui.ms(seconds), f"Time of the stage '{stage}' in the last update.")
    return s


def statistics(s: Settings, window: Window, actions: set[str]) -> Settings:
    """Counts: photons, path segments changed by mobiles, triangles, receivers."""
    session, snapshot = window.session, window.session.light.snapshot
    traced, goal, changes = snapshot.photons_at_rest, session.settings.photons, snapshot.changes
    ui.label("Photons traced")
    share = traced / goal if goal else 1.0
    imgui.progress_bar(min(share, 1.0), (-1, 0), "")
    ui.write_over(f"{ui.thousands(traced)} of {ui.thousands(goal)}")
    ui.tip(f"Photons traced, of those requested. They have {ui.thousands(snapshot.segments)} path segments.")
    n = max(snapshot.photons, 1)
    ui.number("Photons cut", f"{ui.thousands(changes.photons_cut)}   ({100 * changes.photons_cut / n:.2g} %)",
              "Photons with a path that a movable object blocks. Only these are traced again.")  # fmt: skip
    ui.number(
        "Segments removed", ui.thousands(changes.old_segments), "Path segments behind such an object, subtracted."
    )
    ui.number("Segments added", ui.thousands(changes.new_segments), "Path segments from such an object on, added.")
    triangles = sum(len(mesh.triangles) for mesh in session.meshes)
    ui.number("Triangles", ui.thousands(triangles), "Triangles of the static part and the mobiles.")
    ui.number("Receivers", ui.thousands(len(snapshot.irradiance)), "Sides of vertices; each stores irradiance.")
    return s


def method(s: Settings, window: Window, actions: set[str]) -> Settings:
    """Parameters of the method: photons, radius, neighbours, path tracing."""
    session, snapshot = window.session, window.session.light.snapshot
    n = ui.thousands(s.photons)
    changed, photons = ui.slider("Photons", s.photons, 1_000, 10_000_000, n, logarithmic=True, read=values.photons)
    if changed:
        s = replace(s, photons=ui.rounded(photons))
    ui.tip("Number of photons. More photons give less noise and slower frames.")

    size = session.chosen.scene_size
    low, high = (share * size for share in (0.002, 0.2))  # of the scene size
    shown = f"{s.radius:.3g} m"
    changed, radius = ui.slider("Radius", s.radius, low, high, shown, logarithmic=True, read=values.positive)
    if changed:
        s = replace(s, radius=float(f"{radius:.3g}"))
    ui.tip(
        "Radius around each vertex within which photon paths count. For photon_map: the largest radius. "
        "Impact_count uses it only in motion, to smooth changes.\n"
        f"Now {100 * s.radius / size:.2g} % of the scene size.\n"
        "A larger radius gives less noise and blurs shadow edges over that length. Ctrl+click to type a value."
    )

    with ui.idle(ui.only("photon_map", s)):
        k_now = f"{s.neighbours}"
        changed, k = ui.slider("Neighbours k", s.neighbours, 2, 1_000, k_now, logarithmic=True, read=values.neighbours)
        if changed:
            s = replace(s, neighbours=k)
        ui.tip("Nearest photon hits per estimate of photon_map.")
    s = ui.choice(s, "Light", "light", LIGHT_NAMES,
                  "Best available: path tracing lights movable objects in each frame. It lights the static part "
                  "once its noise is below the photons'.\n"
                  "Photons only, as in the report: the estimator lights everything. Choosing another estimator "
                  "selects this mode; each estimator keeps its own mode.")  # fmt: skip
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


def error(s: Settings, window: Window, actions: set[str]) -> Settings:
    """Error against the unbiased reference, measured at rest."""
    r = window.session.light.snapshot.rest.report
    about = "Measure errors while nothing moves. A drag interrupts the measurement."
    s = ui.switch(s, "Measure errors", "measure_errors", about)
    imgui.begin_disabled(not window.session.is_current)  # numbers of the light before
    at = ui.DASH if r is None else f"{ui.thousands(r.receivers)} of {ui.thousands(r.of)}"
    receivers = "Receivers store light, one per vertex and side. A large scene is measured at a random sample of them."
    ui.number("Receivers", at, receivers)
    ui.number(
        "Total",
        _percent(r and r.total),
        "Mean error of irradiance against the unbiased reference, relative to the mean irradiance. Absolute values, in "
        "luminance, weighted by area. Places brighter than the view count less, by their light.",
    )
    ui.number(
        "   noise",
        _percent(r and r.noise, "up to "),
        "Error that more photons remove: an upper bound, from the difference to a subset of the photons.\n"
        "For photon_map it includes the effect of the changed search radius.",
    )
    ui.number(
        "   bias",
        _percent(r and r.bias, "at least "),
        "Error that more photons do not remove, such as blur over the radius: a lower bound.\nbias² = total² - noise².",
    )
    ui.number(
        "Clouds",
        ui.DASH if r is None or math.isnan(r.clouds[0]) else " / ".join(f"{100 * c:.1f}" for c in r.clouds) + " %",
        "Local deviation: of irradiance over the reference, within a tenth of the scene, mean removed. Median and 90th "
        "percentile of places.",
    )
    paths = "" if r is None else f" So far: {ui.thousands(round(r.paths))} paths per receiver."
    ui.number(
        "Reference noise",
        _percent(r and r.reference_noise, "±"),
        f"Noise of the reference, included in the total.{paths}",
    )
    imgui.end_disabled()
    return ui.switch(s, "Show reference", "reference", "Show the reference in place of the estimate. Key 0.")


def _percent(value: float | None, bound: str = "") -> str:
    """Return a share in percent, a dash for an unknown one."""
    if value is None or math.isnan(value):
        return ui.DASH
    if value <= 0:
        return "not measurable"
    return f"{bound}{100 * value:.{1 if value >= 0.00995 else 2}f} %"
