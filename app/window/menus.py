"""Menu bar, keyboard and help, from the table of actions."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from imgui_bundle import hello_imgui, imgui

from app.session.session import Session
from app.window.actions import ACTIONS, ESTIMATOR_KEYS
from app.window.actions.objects import SHAPES
from app.window.dialogs import UNSAVED
from app.window.files import Files
from gi_core.estimators import ESTIMATORS
from gi_core.files.find import shipped_scenes

SHIPPED, RECENT, WATCHES, VIEWS, LINE = "Shipped scenes", "Open recent", "Reload changed files", "Kept views", ""
SIZE, SHAPE = "Interface size", "Insert shape"
MENUS: dict[str, tuple[str, ...]] = {  # names of actions, or one of the seven above
    "File": (
        "open", SHIPPED, RECENT, "reload", WATCHES, LINE, "save", "save as", "copy command", LINE,
        "save picture", "save picture as", "export", "report", LINE, "quit",
    ),
    "Edit": (
        "undo", "redo", LINE, "select all", "insert", SHAPE, "insert luminaire", "duplicate", "remove", LINE,
        "promote", "freeze", LINE,
        "pin", "ask", "unpin", LINE, "rest", "reset poses", "reset settings",
    ),
    "View": (
        "reset view", "frame", "top", "front", "side", "parallel", LINE, "bookmark", VIEWS, LINE,
        "meter", "reference", "lamp marks", LINE, "show paths", "show disc", "show recomputed", LINE,
        "toggle panel", "full screen", SIZE,
    ),
    "Help": ("help",),
}  # fmt: skip
PREFERENCE = "interface size"  # in the window's ini file
INTERFACE_SIZES = (0.8, 1.0, 1.25, 1.5, 2.0)  # of font and layout, besides the screen's own scale


class Menus:
    """`load_preferences` after the window opens, `draw` once per frame, `save_preferences` before it closes."""

    def __init__(self, files: Files, do: Callable[[str], None], open_scene: Callable[[str], None]) -> None:
        self._files, self._do, self._open = files, do, open_scene
        self._size = 1.0  # of the interface

    def load_preferences(self) -> None:
        with suppress(ValueError):
            size = float(hello_imgui.load_user_pref(PREFERENCE) or 1.0)
            self._size = size if size in INTERFACE_SIZES else 1.0

    def save_preferences(self) -> None:
        hello_imgui.save_user_pref(PREFERENCE, f"{self._size:g}")

    def draw(self, session: Session) -> None:
        """Draw the menu bar."""
        imgui.get_style().font_scale_main = self._size
        for title, entries in MENUS.items():
            if imgui.begin_menu(title):
                for entry in entries:
                    self._entry(entry, session)
                imgui.end_menu()

    def _entry(self, entry: str, session: Session) -> None:
        if entry == LINE:
            imgui.separator()
        elif entry == SHIPPED:
            if imgui.begin_menu(SHIPPED):
                for name in shipped_scenes():
                    if imgui.menu_item(name, "", False)[0]:
                        self._open(name)
                imgui.end_menu()
        elif entry == RECENT:
            if imgui.begin_menu(RECENT, bool(self._files.recent)):
                for k, path in enumerate(self._files.recent):
                    if imgui.menu_item(f"{Path(path).name}##{k}", "", False)[0]:
                        self._open(path)
                    imgui.set_item_tooltip(path)
                imgui.end_menu()
        elif entry == VIEWS:
            if imgui.begin_menu(VIEWS, bool(session.settings.cameras)):
                self._views(session)
                imgui.end_menu()
        elif entry == SIZE:
            if imgui.begin_menu(SIZE):
                self._sizes()
                imgui.end_menu()
        elif entry == SHAPE:
            if imgui.begin_menu(SHAPE, session.ready):
                for kind in SHAPES:
                    self._entry(f"insert {kind}", session)
                imgui.end_menu()
        elif entry == WATCHES:
            _, self._files.watches = imgui.menu_item(WATCHES, "", self._files.watches)
        else:
            action = ACTIONS[entry]
            shortcut = action.keys.partition(",")[0]
            if imgui.menu_item(action.label, shortcut, False, session.ready or not action.needs_scene)[0]:
                self._do(entry)
            if action.help:
                imgui.set_item_tooltip(f"{action.help[0].upper()}{action.help[1:]}.")

    def _views(self, session: Session) -> None:
        """Draw the kept views, and a menu that removes them."""
        views = session.settings.cameras
        for k, (name, _) in enumerate(views):
            if imgui.menu_item(f"{name}##{k}", f"Ctrl+{k + 1}" if k < 9 else "", False)[0]:
                self._do(f"view {k}")
        imgui.separator()
        if imgui.begin_menu("Remove"):
            for k, (name, _) in enumerate(views):
                if imgui.menu_item(f"{name}##{k}", "", False)[0]:
                    session.edit(cameras=views[:k] + views[k + 1 :])
            imgui.end_menu()

    def _sizes(self) -> None:
        """Draw the sizes of font and layout."""
        for size in INTERFACE_SIZES:
            if imgui.menu_item(f"{100 * size:.0f} %", "", self._size == size)[0]:
                self._size = size


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
    ("Drop files", "open a scene; on the picture, meshes become objects, photometric files lamps"),
)


INPUT_EM = 10.5  # width of the help's left column


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
    width = min((INPUT_EM + 25.0) * em + 2 * style.window_padding.x + style.scrollbar_size, room)
    imgui.set_next_window_size_constraints((width, 5 * em), (width, max(h, 5 * em)))
    left = min(max(x + (w - width) / 2, low), low + room - width)
    imgui.set_next_window_pos((left, y + h / 2), imgui.Cond_.appearing, (0.0, 0.5))
    F = imgui.WindowFlags_
    flags = F.no_docking | F.always_auto_resize | F.no_collapse | F.no_saved_settings
    shown, is_open = imgui.begin("Help###Help", is_open, flags)
    if shown:
        imgui.separator_text("Mouse")
        _table("mouse", MOUSE, em)
        imgui.separator_text("Keys")
        numbers = []
        if is_ready:
            names = list(ESTIMATORS)[: len(ESTIMATOR_KEYS)]
            numbers = [(str(k), f"estimator: {name.replace('_', ' ')}") for k, name in enumerate(names, 1)]
        numbers.append(("Ctrl+1 to Ctrl+9", "show a kept view"))
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
