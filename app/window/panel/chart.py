"""Error against GI frame time of the settings measured so far: a log-log chart."""

from __future__ import annotations

import math

import numpy as np
from imgui_bundle import ImVec4, imgui, implot

from app.rest.results import MeasuredPoint
from app.settings import Settings
from app.window import theme
from app.window.panel import widgets as ui
from app.window.parts import Window
from gi_core.estimators import ESTIMATORS

FRAME_MS = 1000 / 60  # a frame at 60 Hz
COLOURS = ((0.918, 0.655, 0.298), (0.400, 0.700, 0.950), (0.560, 0.800, 0.450), (0.850, 0.550, 0.850))
MARKERS = (implot.Marker_.circle, implot.Marker_.square, implot.Marker_.diamond, implot.Marker_.up)
TIMES_MS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 50, 100, 200, 500, 1000, 2000, 5000, 10000)  # 20 would overlap 16.7


def draw(s: Settings, window: Window, actions: set[str]) -> Settings:
    points = window.session.points.all
    if not points:
        imgui.text_wrapped("Each setting adds a point once its error is measured at rest.")
        return s
    em = imgui.get_font_size()
    flags = implot.Flags_.no_menus | implot.Flags_.no_mouse_text | implot.Flags_.no_box_select
    if implot.begin_plot("##Error against time", (-1, 15.0 * em), flags):
        _axes(points)
        _draw_budget()
        for k, estimator in enumerate(ESTIMATORS):
            _draw_points(k, estimator, [p for p in points if p.setting.estimator == estimator])
        _draw_latest(points[-1])
        near = _under_mouse(points, 0.8 * em) if implot.is_plot_hovered() else None  # 0.8 em around the cursor
        implot.end_plot()
        if near is not None:
            imgui.set_tooltip(caption(near))
    imgui.text_disabled("Lower left is better. Line: 60 frames per second.")
    ui.buttons(actions, ui.Button("clear chart", "Clear chart", "Remove all points."))
    return s


def caption(point: MeasuredPoint) -> str:
    """Return the tooltip of a point: its setting, error and frame time."""
    error = f"error {100 * point.error:.2g} % (reference noise ±{100 * point.reference_noise:.1g} %)"
    return f"{point.label}\n{error}\nGI frame {ui.ms(point.seconds)}"


def limits(values: list[float]) -> tuple[float, float]:
    """Return the ends of a logarithmic axis around all values."""
    return min(values) / 2, max(values) * 2


def _axes(points: tuple[MeasuredPoint, ...]) -> None:
    x, y = (int(axis) for axis in (implot.ImAxis_.x1, implot.ImAxis_.y1))
    implot.setup_axis(x, "GI frame time, all photons [ms]")
    implot.setup_axis(y, "error [%]")
    for axis, ticks, values in (
        (x, TIMES_MS, [*(1e3 * p.seconds for p in points), FRAME_MS]),
        (y, (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500), [100 * p.error for p in points]),
    ):
        implot.setup_axis_scale(axis, int(implot.Scale_.log10))
        implot.setup_axis_limits(axis, *limits(values), int(implot.Cond_.always))
        implot.setup_axis_ticks(axis, list(map(float, ticks)), [f"{t:g}" for t in ticks])
    implot.setup_legend(int(implot.Location_.north_east), int(implot.LegendFlags_.none))


def _draw_budget() -> None:
    spec = implot.Spec()
    spec.line_color = ImVec4(*theme.WARNING, 0.6)
    implot.plot_inf_lines("##16.7 ms", np.array([FRAME_MS]), spec)
    implot.tag_x(FRAME_MS, ImVec4(*theme.FRAME_ACTIVE, 1.0), "16.7")


def _draw_points(k: int, estimator: str, points: list[MeasuredPoint]) -> None:
    if not points:
        return
    colour = ImVec4(*COLOURS[k % len(COLOURS)], 1.0)
    spec = implot.Spec()
    spec.marker = int(MARKERS[k % len(MARKERS)])
    spec.marker_size = 0.3 * imgui.get_font_size()
    spec.marker_fill_color = spec.marker_line_color = spec.line_color = colour
    xs, ys = (np.array(column) for column in zip(*((1e3 * p.seconds, 100 * p.error) for p in points), strict=True))
    implot.plot_scatter(ui.title(estimator), xs, ys, spec)


def _draw_latest(point: MeasuredPoint) -> None:
    """Circle the current setting."""
    at = pixel_of(point)
    implot.push_plot_clip_rect()
    em = imgui.get_font_size()
    implot.get_plot_draw_list().add_circle(at, 0.55 * em, imgui.get_color_u32((*theme.TEXT, 0.9)), 0, 0.1 * em)
    implot.pop_plot_clip_rect()


def pixel_of(point: MeasuredPoint):
    """Return the screen position of a point of the current plot."""
    return implot.plot_to_pixels(1e3 * point.seconds, 100 * point.error)


def _under_mouse(points: tuple[MeasuredPoint, ...], reach: float) -> MeasuredPoint | None:
    mouse = imgui.get_mouse_pos()

    def distance(point: MeasuredPoint) -> float:
        at = pixel_of(point)
        return math.hypot(at.x - mouse.x, at.y - mouse.y)

    nearest = min(points, key=distance)
    return nearest if distance(nearest) <= reach else None
