"""Colours and font of the GUI: dark and neutral, so that they do not bias the scene's colours."""

from __future__ import annotations

from imgui_bundle import hello_imgui, imgui

from app.draw.legend import LINE, TEXT

WINDOW = (0.110, 0.114, 0.122)
PANEL = (0.130, 0.134, 0.144)
FRAME = (0.190, 0.196, 0.210)
FRAME_ACTIVE = (0.270, 0.282, 0.310)
ACCENT = LINE  # lamp light
DIM_TEXT = (0.580, 0.595, 0.620)
WARNING = (0.950, 0.760, 0.350)
GOOD = (0.480, 0.800, 0.480)
ERROR = (0.960, 0.450, 0.400)
FONT_PIXELS = 16.0  # at 96 dots per inch; HelloImGui scales it with the screen


def pixels(n: float) -> float:
    """Return a length of n pixels at 96 dots per inch on this screen and at interface size 1 [points]."""
    return n * imgui.get_style().font_scale_dpi * imgui.get_style().font_scale_main


def load_fonts() -> None:
    hello_imgui.load_font_ttf("fonts/Roboto/Roboto-Regular.ttf", FONT_PIXELS)


def set_config() -> None:
    hello_imgui.imgui_default_settings.setup_default_imgui_config()
    io = imgui.get_io()
    # Space, Tab and arrow keys are shortcuts, not focus navigation.
    io.config_flags &= ~imgui.ConfigFlags_.nav_enable_keyboard
    io.config_flags &= ~imgui.ConfigFlags_.viewports_enable
    io.config_drag_click_to_input_text = False


def set_style() -> None:
    imgui.style_colors_dark()
    style = imgui.get_style()
    style.window_rounding, style.child_rounding, style.popup_rounding = 0.0, 4.0, 4.0
    style.frame_rounding, style.grab_rounding, style.tab_rounding = 4.0, 4.0, 4.0
    style.window_border_size, style.frame_border_size, style.popup_border_size = 0.0, 0.0, 1.0
    style.window_padding, style.frame_padding = (12, 10), (8, 4)
    style.item_spacing, style.item_inner_spacing = (8, 5), (6, 4)
    style.scrollbar_size, style.grab_min_size = 10.0, 4.0  # a thin slider grab leaves the number readable
    style.separator_text_border_size, style.separator_text_padding = 1.0, (0, 4)
    style.docking_separator_size = 1.0
    style.hover_stationary_delay, style.hover_delay_normal = 0.15, 0.45
    C = imgui.Col_
    clear, hovered = (0.0, 0.0, 0.0, 0.0), (0.235, 0.243, 0.262)
    grab = (0.560, 0.420, 0.225)  # the accent, dark enough for white text
    colours = {
        C.text: TEXT,
        C.text_disabled: DIM_TEXT,
        C.window_bg: PANEL,
        C.child_bg: clear,
        C.popup_bg: (0.150, 0.154, 0.165),
        C.border: (0.260, 0.268, 0.285),
        C.frame_bg: FRAME,
        C.frame_bg_hovered: hovered,
        C.frame_bg_active: FRAME_ACTIVE,
        C.title_bg: WINDOW,
        C.title_bg_active: FRAME,
        C.check_mark: ACCENT,
        C.checkbox_selected_bg: FRAME,
        C.slider_grab: grab,
        C.slider_grab_active: (0.680, 0.500, 0.250),
        C.button: FRAME,
        C.button_hovered: hovered,
        C.button_active: FRAME_ACTIVE,
        C.header: FRAME,
        C.header_hovered: hovered,
        C.header_active: FRAME_ACTIVE,
        C.separator: (0.235, 0.242, 0.258),
        C.plot_histogram: grab,
        C.tab: WINDOW,
        C.tab_selected: FRAME,
        C.tab_hovered: hovered,
        C.docking_empty_bg: WINDOW,
        C.modal_window_dim_bg: (0.0, 0.0, 0.0, 0.45),
        C.scrollbar_bg: clear,
        C.text_selected_bg: (*ACCENT, 0.35),
    }
    for which, colour in colours.items():
        style.set_color_(which, colour if len(colour) == 4 else (*colour, 1.0))
