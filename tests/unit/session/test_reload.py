"""Progress of a scene that opens behind the picture."""

from __future__ import annotations

from types import SimpleNamespace

from app.session.opening import COMPILING
from app.session.reload import QUIET, Reload
from app.session.session import Asked
from gi_core.instruments.compile_ahead import SURFACES


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
