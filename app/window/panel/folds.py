"""Folded and unfolded sections of the panel, kept from one start of the program to the next."""

from __future__ import annotations

from imgui_bundle import hello_imgui, imgui

from app.window.panel import widgets as ui

PREFERENCE = "sections"  # in the window's ini file
FOLDED, UNFOLDED = "-", "+"


class Folds:
    """Fold state per section: `load` after the window opens, `header` per section, `save` before it closes."""

    def __init__(self) -> None:
        self._unfolded: dict[str, bool] = {}
        self._just_unfolded = ""

    def load(self) -> None:
        """Read the state that the last session saved; other sections keep their default."""
        for line in hello_imgui.load_user_pref(PREFERENCE).splitlines():
            if line[:1] in (FOLDED, UNFOLDED):
                self._unfolded[line[1:]] = line[:1] == UNFOLDED

    def save(self) -> None:
        lines = [(UNFOLDED if unfolded else FOLDED) + title for title, unfolded in self._unfolded.items()]
        hello_imgui.save_user_pref(PREFERENCE, "\n".join(lines))

    def header(self, title: str, unfolded: bool) -> bool:
        """Draw a header; return whether its section is unfolded. `unfolded`: the default."""
        imgui.set_next_item_open(self._unfolded.setdefault(title, unfolded), imgui.Cond_.once)
        before, now = self._unfolded[title], imgui.collapsing_header(title)
        self._unfolded[title] = now
        if now and not before:
            self._just_unfolded = title
        return now

    def switch(self, title: str, about: str) -> bool:
        """Draw a switch of more sections; return whether they are shown."""
        changed, on = imgui.checkbox(title, self._unfolded.setdefault(title, False))
        ui.tip(about)
        self._unfolded[title] = on
        return on

    def show_whole(self, title: str) -> None:
        """Scroll to the end of the section just drawn if the user has just unfolded it."""
        if self._just_unfolded == title:
            self._just_unfolded = ""
            imgui.set_scroll_here_y(1.0)
