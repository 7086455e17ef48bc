"""How tangent_plane finds the segments that cross its discs: the picture is the same, the times are not."""

from __future__ import annotations

from app.panel import widgets as ui
from app.panel.facts import Facts
from app.settings import Settings


def draw(s: Settings, facts: Facts, actions: set[str]) -> Settings:
    from gi_core.disc_search import SEARCHES  # loaded long since; at the top it would hold the window up

    return ui.choice(s, "Search", "search", {key: ui.title(key) for key in SEARCHES},
                     "How tangent_plane finds the segments that cross a disc: discs in a grid that segments walk "
                     "through, segments in spheres around receivers, or every pair. The picture is the same, bit for "
                     "bit; see Time.")  # fmt: skip
