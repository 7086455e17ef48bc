"""Progress of a scene that opens behind the picture."""

from __future__ import annotations

from types import SimpleNamespace

from app.session.opening import COMPILING
from app.session.reload import QUIET, Reload, words_of
from app.session.session import Asked
from app.settings import Settings
from gi_core.files.edits import Duplicate, Finish, Freeze, Insert, Promote, Remove
from gi_core.instruments.compile_ahead import SURFACES
from gi_core.scene import Pose


def test_an_edit_that_compiles_kernels_says_so_at_once():
    """The first gloss compiles for tens of seconds; other phases of an edit flash, so they show after QUIET."""
    opening = SimpleNamespace(phase="loading scene", progress=("loading scene", None))
    reload, now = Reload(lambda settings: None), [0.0]
    reload.coming, reload._edited = SimpleNamespace(opening=opening, clock=lambda: now[0]), Asked((), {})
    assert reload.is_editing and reload.progress is None
    for kind in SURFACES:
        opening.phase, opening.progress = COMPILING[kind], (f"{COMPILING[kind]}: about 30 s left", 0.3)
        assert reload.progress == opening.progress
    opening.phase, now[0] = "tracing", QUIET
    assert reload.progress == opening.progress
    assert COMPILING["gloss"] == "compiling kernels for gloss, once per machine"


def test_the_log_says_what_was_edited():
    red, green = Finish("white", (("reflectance", (0.5, 0, 0)),)), Finish("white", (("reflectance", (0, 0.5, 0)),))
    seat, chair = Finish("chair", (), "seat"), Insert("armchair", "armchair.glb")
    gone = Remove("cat"), Remove("stone")
    copy, free, fixed = Duplicate("chair 2", "chair", Pose()), Promote("desk", (0, 0, 0)), Freeze("desk", Pose())
    assert words_of((), (red,)) == "edited: material white"
    assert words_of((red,), (green,)) == "edited: material white"
    assert words_of((red,), (red, seat)) == "edited: seat of chair"
    assert words_of((), (chair,)) == "inserted: armchair"
    assert words_of((chair,), (chair, *gone)) == "removed: cat, stone"
    assert words_of((chair, *gone), (chair,)) == "undone: removed: cat, stone"
    assert words_of((), (copy, free)) == "duplicated: chair; made movable: desk"
    assert words_of((), (fixed,)) == "made static: desk"
    assert words_of((red,), (red,)) == ""


def test_an_edit_undone_before_it_opened_has_no_line_in_the_log():
    shown = SimpleNamespace(settings=Settings(scene="cornell"))
    reload = Reload(lambda settings: None)
    reload.same, reload._before = True, shown.settings
    assert reload.news(shown) == "reloaded: cornell"
    reload._edited = Asked((), {})
    assert reload.news(shown) == ""
    shown.settings = Settings(scene="cornell", edits=(Remove("pawn"),))
    assert reload.news(shown) == "removed: pawn"
