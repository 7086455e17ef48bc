"""Dialogs: the system's for files, or a list of files where it has none; and the question about unsaved changes."""

from __future__ import annotations

import fnmatch
import os
import shutil
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress

from imgui_bundle import imgui
from imgui_bundle import portable_file_dialogs as native

from app.window import theme
from gi_core.scene.errors import utf8

NATIVE_LINUX = ("zenity", "kdialog", "matedialog", "qarma")  # programs that portable-file-dialogs runs
SCENES = ["Scenes", "*.toml *.glb *.gltf *.obj *.ply *.stl", "All files", "*"]
SAVED = ["Saved scenes", "*.toml"]
TABLES = ["Tables", "*.csv"]
MESHES = ["Meshes", "*.glb *.gltf *.obj *.ply *.stl", "All files", "*"]
LUMINAIRES = ["Photometric files", "*.ies *.ldt *.IES *.LDT", "All files", "*"]
PAGES = ["Pages", "*.html"]
PICTURES = ["Pictures", "*.png"]
FIELD_EM = 32
UNSAVED = "Unsaved changes"
RETURN = imgui.Key.enter, imgui.Key.keypad_enter


def has_native() -> bool:
    """Return whether the system has file dialogs."""
    return not sys.platform.startswith("linux") or any(map(shutil.which, NATIVE_LINUX))


def fits(name: str, filters: Sequence[str]) -> bool:
    """Return whether a file is of the kind that filters are for, by its suffix."""
    return any(fnmatch.fnmatch(name.lower(), pattern.lower()) for pattern in filters[1].split())


def entries_of(folder: str, filters: Sequence[str]) -> tuple[str, ...]:
    """Return a folder's folders, with a slash, then its files that fit; hidden ones and unreadable not."""
    folders, files = [], []
    with suppress(OSError), os.scandir(folder or ".") as entries:
        for entry in entries:
            name = entry.name
            if name.startswith(".") or not name.isprintable():
                continue
            if entry.is_dir():
                folders.append(f"{name}/")
            elif fits(name, filters):
                files.append(name)
    return *sorted(folders, key=str.lower), *sorted(files, key=str.lower)


class FileDialog:
    """One dialog at a time: `open` or `save`; `poll` and `draw` once per frame."""

    def __init__(self) -> None:
        self._native: native.open_file | native.save_file | None = None
        self._answered: Callable[[str], str | None] | None = None
        self._problem = ""  # why the last answer will not do
        self._title, self._path, self._appears = "", "", False
        self._suffix = ""  # that `answered` appends to a path without it; "": the file is read
        self._sure = ""  # path of a file that may be replaced
        self._answers: dict[str, str] = {}  # paths, the last one by title
        self._filters: Sequence[str] = ()  # name and patterns of files that are listed
        self._listed: tuple[str, float] = "", 0.0  # folder, and when it was read [s]
        self._entries: tuple[str, ...] = ()  # of that folder: folders, with a slash, then files

    @property
    def is_open(self) -> bool:
        return self._answered is not None

    def open(self, title: str, beside: str, filters: Sequence[str], answered: Callable[[str], None]) -> None:
        """Ask for a file that exists, beside the last answer to this title; `answered` receives its path."""
        folder = os.path.abspath(os.path.dirname(self._answers.get(title, beside)))
        self._begin(title, os.path.join(folder, ""), filters, answered)
        if has_native():
            self._native = native.open_file(title, folder, list(filters))

    def save(
        self, title: str, path: str, filters: Sequence[str], answered: Callable[[str], str | None], problem: str = ""
    ) -> None:
        """Ask for a file to write, and again where it exists.

        `answered` receives its path. What it returns is the problem with that path, and the dialog stays;
        problem: of the path that it begins with.
        """
        self._begin(title, os.path.abspath(path), filters, answered)
        self._suffix = filters[1].removeprefix("*")
        self._problem = problem
        if has_native() and not problem:
            self._native = native.save_file(title, path, list(filters))

    def _begin(self, title: str, path: str, filters: Sequence[str], answered: Callable[[str], str | None]) -> None:
        self._filters, self._listed = filters, ("", 0.0)
        self._native, self._answered, self._title, self._path, self._appears = None, answered, title, path, True
        self._suffix = self._sure = self._problem = ""

    def _end(self, path: str) -> None:
        answered, self._answered, self._native = self._answered, None, None
        self._answers |= {self._title: path} if path else {}
        if path and answered is not None and (problem := answered(path)):
            self._answered, self._path, self._problem, self._appears = answered, path, problem, True

    def poll(self) -> None:
        """Take the system's answer, if there is one."""
        if self._native is not None and self._native.ready(0):
            answer = self._native.result()
            self._end(answer if isinstance(answer, str) else answer[0] if answer else "")

    def draw(self) -> None:
        """Draw the field for a path, and the files of its folder, where the system has no dialog."""
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
        chosen, done = self._draw_list()
        imgui.set_next_item_width(FIELD_EM * imgui.get_font_size())
        if self._appears:
            imgui.set_keyboard_focus_here()
        elif chosen is not None:
            self._path = chosen
        self._appears = False
        entered, self._path = imgui.input_text("##path", self._path, imgui.InputTextFlags_.enter_returns_true)
        imgui.set_item_tooltip("A path. ~ is your home folder.")
        entered = entered or any(imgui.is_key_pressed(key, repeat=False) for key in RETURN)  # the field may lack focus
        replaced = self._replaced
        if replaced and self._sure == self._path:
            imgui.text_wrapped(f"{replaced} exists. OK replaces it.")
        done = imgui.button("OK") or entered or done
        if done and os.path.isdir(folder := os.path.expanduser(self._path.strip())):
            done, self._path = False, os.path.join(folder, "")  # its files are listed
            imgui.set_keyboard_focus_here(-1)
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

    def _draw_list(self) -> tuple[str | None, bool]:
        """Draw the folder of the path: folders, then files whose names go on as typed.

        Return a path clicked on, and whether it was clicked twice.
        """
        path = os.path.expanduser(self._path.strip())
        folder, typed = os.path.split(path)
        now, chosen, twice = imgui.get_time(), None, False
        if self._listed[0] != folder or now - self._listed[1] > 1.0:
            self._listed, self._entries = (folder, now), entries_of(folder, self._filters)
        typed = "" if self._suffix else typed.lower()  # a new name
        rows = ["../", *(name for name in self._entries if name.lower().startswith(typed))]
        height = 12 * imgui.get_text_line_height_with_spacing()
        imgui.begin_child("##files", (FIELD_EM * imgui.get_font_size(), height))
        clipper = imgui.ListClipper()
        clipper.begin(len(rows))
        while clipper.step():
            for name in rows[clipper.display_start : clipper.display_end]:
                flags = imgui.SelectableFlags_.allow_double_click
                if not imgui.selectable(name, name == os.path.basename(path), flags)[0]:
                    continue
                twice = imgui.is_mouse_double_clicked(0) and not name.endswith("/")
                chosen = os.path.join(os.path.dirname(folder), "") if name == "../" else os.path.join(folder, name)
        imgui.end_child()
        if chosen is not None and chosen.endswith("/") and self._suffix:
            chosen += os.path.basename(path)  # the name to save stays
        return chosen, twice

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
        self.go_on: Callable[[], None] = lambda: None  # the action that waits for the answer
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
        appears, self._appears = self._appears, False
        if shown:
            imgui.text(f"Objects or settings of {utf8(name)} have changed.")
            for word, label in (("save", "Save"), ("discard", self._otherwise), ("cancel", "Cancel")):
                if imgui.button(label):
                    answer = word
                imgui.same_line()
            # A Return that ended the dialog before has its answer.
            if not answer and not appears and any(imgui.is_key_pressed(key, repeat=False) for key in RETURN):
                answer = "save"
            if answer:
                imgui.close_current_popup()
            imgui.end_popup()
        self.is_open = not answer
        return answer


def _centre() -> None:
    """Put the next window in the middle of the screen, whose size may change."""
    imgui.set_next_window_pos(imgui.get_main_viewport().get_center(), imgui.Cond_.always, (0.5, 0.5))
