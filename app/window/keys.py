"""Keys and mouse: what each does, in the table that the help window shows and the viewer obeys."""

from __future__ import annotations

from typing import NamedTuple

from imgui_bundle import imgui

K = imgui.Key


class Shortcut(NamedTuple):
    action: str
    chords: tuple[int, ...]  # any of them
    shown: str  # how the help window writes them
    text: str


SHORTCUTS = (
    Shortcut("play", (K.space,), "Space", "play or pause the path"),
    Shortcut("reset all", (K.r,), "R", "mobiles and view as at the start"),
    Shortcut("reset view", (K.home,), "Home", "view as at the start"),
    Shortcut("cancel", (K.escape,), "Esc", "put back what is being dragged"),
    Shortcut("undo", (K.mod_ctrl | K.z,), "Ctrl+Z", "undo the last move"),
    Shortcut("redo", (K.mod_ctrl | K.mod_shift | K.z, K.mod_ctrl | K.y), "Ctrl+Shift+Z", "redo it"),
    Shortcut("reference", (K._0,), "0", "show the reference instead of the estimate, and back"),
    Shortcut("meter", (K.a,), "A", "choose the exposure for what is in view"),
    Shortcut("load again", (K.f5,), "F5", "load the scene's files again"),
    Shortcut("toggle panel", (K.tab,), "Tab", "hide or show the panel"),
    Shortcut("screenshot", (K.p, K.f12), "P, F12", "save the picture, with its parameters, in the current folder"),
    Shortcut("help", (K.h,), "H", "this help"),
    Shortcut("quit", (K.mod_ctrl | K.q,), "Ctrl+Q", "quit"),
)

ESTIMATOR_KEYS = (K._1, K._2, K._3, K._4, K._5, K._6, K._7, K._8, K._9)

MOUSE = (
    ("Drag an object", "slide it at its height"),
    ("Shift + drag it", "move it up and down"),
    ("Alt or right drag it", "move it in the plane of the picture"),
    ("Ctrl + drag it", "turn it about the vertical"),
    ("Drag empty space", "orbit"),
    ("Shift or middle drag", "pan"),
    ("Wheel", "go nearer, go away"),
    ("Double-click", "turn about this point from now on"),
)


class Keyboard:
    """Tells which actions the keys ask for."""

    def __init__(self) -> None:
        self._held = 0  # modifiers of the last frame

    def pressed(self) -> list[str]:
        """Return the actions whose keys went down in this frame; none while a text is being typed."""
        io = imgui.get_io()
        # A quick hand lets go of Ctrl in the frame in which Q goes down: what was held just before counts too.
        held, self._held = int(io.key_mods) | self._held, int(io.key_mods)
        if io.want_text_input:
            return []
        if imgui.is_key_pressed(K.escape, repeat=False) and imgui.is_popup_open("", imgui.PopupFlags_.any_popup):
            # An open list goes first; without keyboard navigation ImGui leaves that to us.
            imgui.internal.close_popup_to_level(0, True)
            return []
        actions = [s.action for s in SHORTCUTS if any(_is_pressed(chord, held) for chord in s.chords)]
        actions += [f"estimator {k}" for k, key in enumerate(ESTIMATOR_KEYS) if _is_pressed(key, held)]
        return actions


def _is_pressed(chord: int, held: int) -> bool:
    """Tell whether a chord went down with exactly its own modifiers."""
    modifiers = int(chord) & int(K.mod_mask_)
    key = K(int(chord) & ~int(K.mod_mask_))
    return held == modifiers and imgui.is_key_pressed(key, repeat=False)


def draw_help(estimators: list[str], area: tuple[float, float, float, float], is_open: bool) -> bool:
    """Show the help window in the middle of an area (x, y, width, height); return whether it stays open."""
    em = imgui.get_font_size()
    x, y, w, h = area
    imgui.set_next_window_size_constraints((10 * em, 5 * em), (max(w, 10 * em), max(h, 5 * em)))
    imgui.set_next_window_pos((x + w / 2, y + h / 2), imgui.Cond_.appearing, (0.5, 0.5))
    flags = imgui.WindowFlags_
    shown, is_open = imgui.begin(
        "Help###Help",
        is_open,
        flags.no_docking | flags.always_auto_resize | flags.no_collapse | flags.no_saved_settings,
    )
    if shown:
        imgui.separator_text("Mouse")
        _table("mouse", MOUSE, em)
        imgui.separator_text("Keys")
        numbers = [(str(k + 1), name.replace("_", " ")) for k, name in enumerate(estimators)]
        _table("keys", [*((s.shown, s.text) for s in SHORTCUTS), *numbers], em)
    imgui.end()
    return is_open


def _table(name: str, rows, em: float) -> None:
    if imgui.begin_table(name, 2, imgui.TableFlags_.sizing_fixed_fit):
        imgui.table_setup_column("what", imgui.TableColumnFlags_.width_fixed, 9 * em)
        imgui.table_setup_column("does", imgui.TableColumnFlags_.width_fixed, 24 * em)
        for left, right in rows:
            imgui.table_next_row()
            imgui.table_next_column()
            imgui.text(left)
            imgui.table_next_column()
            imgui.text_disabled(right)
        imgui.end_table()
