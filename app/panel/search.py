"""How tangent_plane finds the segments that cross its discs: the picture is the same, the times are not."""

from __future__ import annotations

from app.panel import widgets as ui
from app.panel.facts import Facts
from app.settings import Settings

PRETEST_NAMES = {
    "none": "None",
    "badouel": "Badouel",
    "pluecker": "Plücker",
    "moeller_trumbore": "Möller-Trumbore",
}


def draw(s: Settings, facts: Facts, actions: set[str]) -> Settings:
    from gi_core.disc_search import PRETESTS, SEARCHES  # loaded long since; at the top it would hold the window up

    s = ui.choice(s, "Search", "search", {key: ui.title(key) for key in SEARCHES},
                  "How tangent_plane finds the segments that cross a disc: discs in a grid that segments walk "
                  "through, segments in spheres around receivers, every pair of them, or (auto) whichever of the first "
                  "two has taken less time. The picture is the same, bit for bit; see Time.\n"
                  f"{facts.search_told}")  # fmt: skip
    return ui.choice(s, "Pre-test", "pretest", {key: PRETEST_NAMES.get(key, key) for key in PRETESTS},
                     "A triangle around each disc, tried before the disc itself. It was worth its time where a disc "
                     "test was slow; here it is not.")  # fmt: skip
