"""Menu bar, from the table of actions; pictures of the shipped scenes."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from importlib import resources
from pathlib import Path

import moderngl
import numpy as np
from imgui_bundle import hello_imgui, imgui
from PIL import Image

from app.session.session import Session
from app.window.actions import ACTIONS
from app.window.files import Files

SHIPPED, RECENT, WATCHES, VIEWS, LINE = "Shipped scenes", "Open recent", "Reload changed files", "Kept views", ""
SIZE = "Interface size"
MENUS: dict[str, tuple[str, ...]] = {  # names of actions, or one of the six above
    "File": (
        "open", SHIPPED, RECENT, "reload", WATCHES, LINE, "save", "save as", "copy command", LINE,
        "save picture", "save picture as", "export", LINE, "quit",
    ),
    "Edit": (
        "undo", "redo", LINE, "select all", "insert", "insert luminaire", "duplicate", "remove", LINE,
        "promote", "freeze", LINE,
        "pin", "unpin", LINE, "gizmo", "rest", "reset poses", "reset settings",
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
THUMBNAIL_EM = (6.5, 4.06)


class Menus:
    """`load_preferences` after the window opens, `draw` once per frame, both others before it closes."""

    def __init__(self, files: Files, do: Callable[[str], None], open_scene: Callable[[str], None]) -> None:
        self._files, self._do, self._open = files, do, open_scene
        self._thumbnails: dict[str, moderngl.Texture] = {}
        self._size = 1.0  # of the interface

    def load_preferences(self) -> None:
        with suppress(ValueError):
            size = float(hello_imgui.load_user_pref(PREFERENCE) or 1.0)
            self._size = size if size in INTERFACE_SIZES else 1.0

    def save_preferences(self) -> None:
        hello_imgui.save_user_pref(PREFERENCE, f"{self._size:g}")

    def draw(self, ctx: moderngl.Context | None, session: Session) -> None:
        """Draw the menu bar."""
        imgui.get_style().font_scale_main = self._size
        for title, entries in MENUS.items():
            if imgui.begin_menu(title):
                for entry in entries:
                    self._entry(entry, ctx, session)
                imgui.end_menu()

    def _entry(self, entry: str, ctx: moderngl.Context | None, session: Session) -> None:
        if entry == LINE:
            imgui.separator()
        elif entry == SHIPPED:
            if imgui.begin_menu(SHIPPED):
                self._shipped(ctx)
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

    def _shipped(self, ctx: moderngl.Context | None) -> None:
        from gi_core.files.find import shipped_scenes

        em = imgui.get_font_size()
        width, height = (n * em for n in THUMBNAIL_EM)
        for name in shipped_scenes():
            gap = 0.4 * em
            if imgui.selectable(f"##{name}", False, 0, (width + 9 * em, height + 2 * gap))[0]:
                self._open(name)
            drawing, corner = imgui.get_window_draw_list(), imgui.get_item_rect_min()
            left, top = corner.x + gap, corner.y + gap
            if (texture := self._thumbnail(ctx, name)) is not None:
                drawing.add_image(imgui.ImTextureRef(texture.glo), (left, top), (left + width, top + height))
            colour = imgui.get_color_u32(imgui.Col_.text)
            drawing.add_text((left + width + em, top + height / 2 - em / 2), colour, name)

    def _thumbnail(self, ctx: moderngl.Context | None, name: str) -> moderngl.Texture | None:
        """Return the picture of a shipped scene, None without one."""
        file = resources.files("scenes") / "thumbnails" / f"{name}.png"
        if ctx is None or not file.is_file():
            return None
        if name not in self._thumbnails:
            with file.open("rb") as stream:
                pixels = np.asarray(Image.open(stream, formats=("PNG",)).convert("RGB"))
            texture = ctx.texture((pixels.shape[1], pixels.shape[0]), 3, pixels.tobytes(), alignment=1)
            self._thumbnails[name] = texture
        return self._thumbnails[name]

    def release(self) -> None:
        for texture in self._thumbnails.values():
            texture.release()
        self._thumbnails.clear()
