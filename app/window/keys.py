"""Keyboard input and the help window, both from the table of actions."""

from __future__ import annotations

from imgui_bundle import imgui

from app.window.actions import ACTIONS
from app.window.dialogs import UNSAVED

K = imgui.Key

MOUSE = (
    ("Drag an object", "slide it at constant height"),
    ("Shift + drag it", "move it up and down"),
    ("Alt or right drag it", "move it in the image plane"),
    ("Ctrl + drag it", "turn it about the vertical axis"),
    ("Ctrl or Shift + click it", "select several objects, which then move as one"),
    ("Drag a lamp's mark", "move the lamp, with the same keys; drag its ring to aim it"),
    ("Drag empty space", "orbit"),
    ("Right drag empty space", "look around; with W A S D fly, Q and E down and up, Shift faster"),
    ("Shift or middle drag", "pan"),
    ("Wheel", "move the camera nearer or farther"),
    ("Double-click", "make this point the orbit centre"),
    ("Drag a comparison", "move the line between two pictures"),
    ("Drop files", "open a scene; further files become objects"),
)


INPUT_EM, EFFECT_EM = 10.5, 25.0  # width of the help's columns


class Keyboard:
    """Keys of the current frame, as names of actions."""

    def __init__(self) -> None:
        self._held = 0  # modifiers of the last frame
        self._used = False  # a key went down with them

    def pressed(self) -> list[str]:
        """Return the actions whose keys went down in this frame; none during text input.

        Behind the question about unsaved changes Ctrl+Q alone acts, behind other dialogs no key.
        """
        io = imgui.get_io()
        # A fast typist releases Ctrl in the frame in which Q goes down: the last frame's modifiers count too, unless
        # they had their key. Then Ctrl was released before the next key.
        now = int(io.key_mods)
        held = now if self._used else now | self._held
        went_down = any(imgui.is_key_pressed(key, repeat=False) for key in _KEYS)
        self._held, self._used = now, now != 0 and (self._used or went_down)
        if io.want_text_input:
            return []
        if imgui.is_key_pressed(K.escape, repeat=False) and imgui.is_popup_open("", imgui.PopupFlags_.any_popup):
            # Esc closes an open list first; without keyboard navigation ImGui leaves that to the program.
            imgui.internal.close_popup_to_level(0, True)
            return []
        names = [name for name, action in ACTIONS.items() if any(_is_pressed(chord, held) for chord in action.chords)]
        dialog = imgui.internal.get_top_most_popup_modal()
        return [name for name in names if dialog is None or (name == "quit" and dialog.name == UNSAVED)]


_KEYS = {K(int(chord) & ~int(K.mod_mask_)) for action in ACTIONS.values() for chord in action.chords}


def _is_pressed(chord: int, held: int) -> bool:
    """Return whether a chord went down with exactly its own modifiers."""
    modifiers = int(chord) & int(K.mod_mask_)
    key = K(int(chord) & ~int(K.mod_mask_))
    return held == modifiers and imgui.is_key_pressed(key, repeat=False)


def draw_help(is_ready: bool, area: tuple[float, float, float, float], is_open: bool) -> bool:
    """Draw the help window in the middle of an area (x, y, width, height), over its sides where the area is narrow.

    Return whether it stays open. is_ready: a scene is on show, so estimators are loaded.
    """
    em, style, screen = imgui.get_font_size(), imgui.get_style(), imgui.get_main_viewport()
    x, y, w, h = area
    low, room = screen.work_pos.x, screen.work_size.x
    width = min((INPUT_EM + EFFECT_EM) * em + 2 * style.window_padding.x + style.scrollbar_size, room)
    imgui.set_next_window_size_constraints((width, 5 * em), (width, max(h, 5 * em)))
    left = min(max(x + (w - width) / 2, low), low + room - width)
    imgui.set_next_window_pos((left, y + h / 2), imgui.Cond_.appearing, (0.0, 0.5))
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
        numbers = []
        if is_ready:
            from gi_core.estimators import ESTIMATORS

            numbers = [(str(k), f"estimator: {name.replace('_', ' ')}") for k, name in enumerate(ESTIMATORS, 1)]
        numbers += [("Ctrl+1 to Ctrl+9", "show a kept view"), ("Ctrl + drag a handle", "snap")]
        _table("keys", [*((a.keys, a.help) for a in ACTIONS.values() if a.keys), *numbers], em)
    imgui.end()
    return is_open


def _table(name: str, rows, em: float) -> None:
    if imgui.begin_table(name, 2):
        imgui.table_setup_column("input", imgui.TableColumnFlags_.width_fixed, INPUT_EM * em)
        imgui.table_setup_column("effect", imgui.TableColumnFlags_.width_stretch)
        for left, right in rows:
            imgui.table_next_row()
            imgui.table_next_column()
            imgui.text(left)
            imgui.table_next_column()
            imgui.push_style_color(imgui.Col_.text, imgui.get_style_color_vec4(imgui.Col_.text_disabled))
            imgui.text_wrapped(right)
            imgui.pop_style_color()
        imgui.end_table()
