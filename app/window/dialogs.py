"""Dialogs: the system's for files, or a field for a path where it has none; and the question about unsaved changes."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable, Sequence

from imgui_bundle import imgui
from imgui_bundle import portable_file_dialogs as native

from app.window import theme

NATIVE_LINUX = ("zenity", "kdialog", "matedialog", "qarma")  # programs that portable-file-dialogs runs
SCENES = ["Scenes", "*.toml *.glb *.gltf *.obj *.ply *.stl", "All files", "*"]
SAVED = ["Saved scenes", "*.toml"]
TABLES = ["Tables", "*.csv"]
MESHES = ["Meshes", "*.glb *.gltf *.obj *.ply *.stl", "All files", "*"]
LUMINAIRES = ["Photometric files", "*.ies *.ldt *.IES *.LDT", "All files", "*"]
PICTURES = ["Pictures", "*.png"]
FIELD_EM = 32
UNSAVED = "Unsaved changes"
RETURN = imgui.Key.enter, imgui.Key.keypad_enter


def has_native() -> bool:
    """Return whether the system has file dialogs."""
    return not sys.platform.startswith("linux") or any(map(shutil.which, NATIVE_LINUX))


class FileDialog:
    """One dialog at a time: `open` or `save`; `poll` and `draw` once per frame."""

    def __init__(self) -> None:
        self._native: native.open_file | native.save_file | None = None
        self._answered: Callable[[str], str | None] | None = None
        self._problem = ""  # why the last answer will not do
        self._title, self._path, self._appears = "", "", False
        self._suffix = ""  # that `answered` appends to a path without it; "": the file is read
        self._sure = ""  # path of a file that may be replaced

    @property
    def is_open(self) -> bool:
        return self._answered is not None

    def open(self, title: str, folder: str, filters: Sequence[str], answered: Callable[[str], None]) -> None:
        """Ask for a file that exists; `answered` receives its path."""
        self._begin(title, "", answered)
        if has_native():
            self._native = native.open_file(title, folder, list(filters))

    def save(
        self, title: str, path: str, filters: Sequence[str], answered: Callable[[str], str | None], problem: str = ""
    ) -> None:
        """Ask for a file to write, and again where it exists.

        `answered` receives its path. What it returns is the problem with that path, and the dialog stays;
        problem: of the path that it begins with.
        """
        self._begin(title, path, answered)
        self._suffix = filters[1].removeprefix("*")
        self._problem = problem
        if has_native() and not problem:
            self._native = native.save_file(title, path, list(filters))

    def _begin(self, title: str, path: str, answered: Callable[[str], str | None]) -> None:
        self._native, self._answered, self._title, self._path, self._appears = None, answered, title, path, True
        self._suffix = self._sure = self._problem = ""

    def _end(self, path: str) -> None:
        answered, self._answered, self._native = self._answered, None, None
        if path and answered is not None and (problem := answered(path)):
            self._answered, self._path, self._problem, self._appears = answered, path, problem, True

    def poll(self) -> None:
        """Take the system's answer, if there is one."""
        if self._native is not None and self._native.ready(0):
            answer = self._native.result()
            self._end(answer if isinstance(answer, str) else answer[0] if answer else "")

    def draw(self) -> None:
        """Draw the field for a path, where the system has no dialog."""
        if self._answered is None or self._native is not None:
            return
        name = f"{self._title}###File"
        if self._appears:
            imgui.open_popup(name)
        _centre()
        shown, _ = imgui.begin_popup_modal(name, None, imgui.WindowFlags_.always_auto_resize)
        if not shown:
            if not self._appears:
                self._end("")  # Esc
            return
        if self._problem:
            imgui.push_text_wrap_pos(FIELD_EM * imgui.get_font_size())
            imgui.text_colored((*theme.WARNING, 1.0), self._problem)
            imgui.pop_text_wrap_pos()
        else:
            imgui.text_disabled("No file dialog is installed (zenity or kdialog): write a path.")
        imgui.set_next_item_width(FIELD_EM * imgui.get_font_size())
        if self._appears:
            imgui.set_keyboard_focus_here()
        self._appears = False
        entered, self._path = imgui.input_text("##path", self._path, imgui.InputTextFlags_.enter_returns_true)
        entered = entered or any(imgui.is_key_pressed(key, repeat=False) for key in RETURN)  # the field may lack focus
        replaced = self._replaced
        if replaced and self._sure == self._path:
            imgui.text_wrapped(f"{replaced} exists. OK replaces it.")
        done = entered or imgui.button("OK")
        imgui.same_line()
        # The first Esc would only leave the field.
        cancelled = imgui.button("Cancel") or imgui.is_key_pressed(imgui.Key.escape, repeat=False)
        if done and not cancelled and replaced and self._sure != self._path:
            done, self._sure = False, self._path
            if entered:
                imgui.set_keyboard_focus_here(-1)  # Return answers too
        if done or cancelled:
            imgui.close_current_popup()
        imgui.end_popup()
        if done or cancelled:  # last, as it may raise
            self._end(os.path.expanduser(self._path.strip()) if done else "")

    @property
    def _replaced(self) -> str:
        """Name of the file that the answer would replace; "": none."""
        path = os.path.expanduser(self._path.strip())
        names = (path, path + self._suffix) if self._suffix and path else ()
        return next((os.path.basename(name) for name in names if os.path.isfile(name)), "")


class Question:
    """The question about unsaved changes: `ask`, then `draw` once per frame."""

    def __init__(self) -> None:
        self.is_open = False
        self.go_on: Callable[[], None] = lambda: None  # what the changes are in the way of
        self._otherwise = ""
        self._appears = False

    def ask(self, otherwise: str, go_on: Callable[[], None]) -> None:
        """Ask before `go_on`; otherwise: the words for doing it without saving."""
        self.is_open = self._appears = True
        self._otherwise, self.go_on = otherwise, go_on

    def draw(self, name: str) -> str:
        """Draw the question about the scene `name`; return the answer: "save", "discard", "cancel", "": none yet."""
        if not self.is_open:
            return ""
        if self._appears:
            imgui.open_popup(UNSAVED)
        _centre()
        shown, _ = imgui.begin_popup_modal(UNSAVED, None, imgui.WindowFlags_.always_auto_resize)
        answer = "" if shown or self._appears else "cancel"  # Esc
        self._appears = False
        if shown:
            imgui.text(f"Objects or settings of {name} have changed.")
            for word, label in (("save", "Save"), ("discard", self._otherwise), ("cancel", "Cancel")):
                if imgui.button(label):
                    answer = word
                imgui.same_line()
            if answer:
                imgui.close_current_popup()
            imgui.end_popup()
        self.is_open = not answer
        return answer


def _centre() -> None:
    """Put the next window in the middle of the screen, whose size may change."""
    imgui.set_next_window_pos(imgui.get_main_viewport().get_center(), imgui.Cond_.always, (0.5, 0.5))
