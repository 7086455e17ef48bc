"""Actions on files: open, save, copy as command line, export, save the picture."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from imgui_bundle import imgui

from app.cli.saved_scene import command_line
from app.cli.version import version
from app.cli.writable import write_whole
from app.draw.picture_files import next_free, png, screenshot
from app.rest.calculation_surface import NOISE
from app.session.log import WARNING
from app.session.report import Content, page
from app.settings import UsageError
from app.window import dialogs, readout_marks, view_content
from app.window.actions.lamps import use_file
from app.window.actions.objects import insert
from app.window.parts import Window
from app.window.window import rename


def choose_scene(window: Window) -> None:
    beside = window.files.suggestion(window.session)
    window.files.dialog.open("Open a scene", beside, dialogs.SCENES, window.open_scene)


def open_files(window: Window, names: list[str]) -> None:
    """Open a scene, and further files as objects in it, after the question about unsaved changes.

    Behind the first scene, whose kernels two processes would compile, they wait for it.
    """
    if window.session.opening is not None:
        window.reload.waiting = names
        return

    def other() -> None:
        window.reload.other(window.session, names)

    if window.files.has_changed(window.session):
        window.files.question.ask("Open without saving", other)
    else:
        other()


def drop(window: Window, names: list[str]) -> None:
    """Insert mesh and photometric files dropped on the picture; open others, and those dropped elsewhere, as a scene.

    A photometric file on the mark of a lamp is for this lamp.
    """
    is_photometric = partial(dialogs.fits, filters=dialogs.LUMINAIRES)
    at = window.viewport.place_at(imgui.get_mouse_pos()) if window.session.ready else None
    if at is None or not all(is_photometric(name) or dialogs.fits(name, dialogs.MESHES) for name in names):
        open_files(window, names)
        return
    for name in names:
        if is_photometric(name):
            use_file(window, window.viewport.lamps.under_cursor, name, at.point)
        else:
            insert(window, name, at.point)


def save(window: Window) -> None:
    document = window.session.settings.document
    problem = _write(window, document) if document else ""
    if problem or not document:
        save_as(window, problem)


def save_as(window: Window, problem: str = "") -> None:
    """Ask for a file and save the scene; problem: why it could not be saved where it was."""
    suggestion = window.files.suggestion(window.session)
    window.files.dialog.save("Save the scene", suggestion, dialogs.SAVED, partial(_write, window), problem)


def _write(window: Window, path: str) -> str:
    """Save the scene; return the problem, "" without one."""
    try:
        pending = ", with an edit that is still being prepared" if window.session.is_editing else ""
        file, copies = window.files.save(window.session, window.viewport, path)
        beside = f", with copies beside it: {', '.join(copy.name for copy in copies)}" if copies else ""
        window.log(f"saved {file}{pending}{beside}")
        rename(str(file))
        return ""
    except (UsageError, OSError) as problem:
        return _not_saved(window, problem, path)


def _not_saved(window: Window, problem: Exception, path: str | Path) -> str:
    """Log a problem with a file, and return it as a sentence."""
    reason = str(problem)
    if isinstance(problem, OSError):
        reason = f"{path} cannot be written ({problem.strerror or problem}); name a file in another folder"
    sentence = f"not saved: {reason}"
    window.log(sentence, WARNING)
    return sentence


def copy_command(window: Window) -> None:
    imgui.set_clipboard_text(command_line(window.files.settings_now(window.session, window.viewport)))
    without = ", without its edits: save the scene for these" if window.session.edits else ""
    window.log(f"copied the command that opens this view{without}")


def _saved(window: Window, path: str | Path, suffix: str, content: Callable[[], str | bytes]) -> str:
    """Write a file, whose name gets a suffix where it has none in any case; return the problem, "" without one."""
    file = Path(path)
    file = file if file.suffix.lower() == suffix else file.with_name(file.name + suffix)
    try:
        write_whole(file, content())
        window.log(f"saved {file}")
        return ""
    except OSError as problem:
        return _not_saved(window, problem, file)


def _read_outs(window: Window) -> str:
    return view_content.readouts_csv(window.session, window.viewport.pins.shown)


def export(window: Window) -> None:
    """Write the read-outs into a table."""
    if len(_read_outs(window).splitlines()) < 2:
        window.log("there is nothing to export: key I pins a read-out, or add a calculation surface", WARNING)
        return
    suggestion = str(Path(window.files.suggestion(window.session)).with_suffix(".csv"))
    write = partial(_saved, window, suffix=".csv", content=partial(_read_outs, window))
    window.files.dialog.save("Export the read-outs", suggestion, dialogs.TABLES, write)


def save_picture(window: Window, path: str | Path | None = None) -> str:
    """Save the picture with its parameters; return the problem, "" without one.

    path: None for the next free name in the working folder.
    """

    def content() -> bytes:
        metadata = window.viewport.picture.metadata(window.session.light.snapshot)
        return png(_picture(window, window.session.settings.picture_scale), metadata)

    return _saved(window, path or next_free(Path.cwd()), ".png", content)


def _picture(window: Window, scale: int = 1) -> np.ndarray:
    """Return the picture on show, (h, w, 3) uint8."""
    viewport, renderer = window.viewport, window.painter.renderer
    marks, pixels = readout_marks.marks(viewport), renderer.size[1] / viewport.view.size[1]
    try:
        return screenshot(renderer, viewport.look(outlined=False), viewport.legend, scale, marks, pixels)
    finally:
        viewport.redraw()


def report(window: Window) -> None:
    """Write a report of the light on show, with the surfaces as far as they are measured."""

    def content() -> str:
        s = window.session
        rest = s.light.snapshot.rest.surfaces
        return page(Content(
            s.model, window.files.settings_now(s, window.viewport), s.light.snapshot.levels, s.level,
            [x for x in rest if x.is_current], s.power, [("Picture", png(_picture(window)))], version(), NOISE,
        ))  # fmt: skip

    suggestion = str(Path(window.files.suggestion(window.session)).with_suffix(".html"))
    write = partial(_saved, window, suffix=".html", content=content)
    window.files.dialog.save("Write a report", suggestion, dialogs.PAGES, write)


def save_picture_as(window: Window) -> None:
    write = partial(save_picture, window)
    window.files.dialog.save("Save the picture", str(next_free(Path.cwd())), dialogs.PICTURES, write)
