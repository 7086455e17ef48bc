"""Commands: the module of each one and its line of help; a module is imported when its command is called.

A command module has `add_options(parser)` and `run(arguments)`, which returns the exit code. A new command is one file
and one line in COMMANDS. Command modules import nothing heavy at the top, so that `--help` answers at once.
"""

from __future__ import annotations

from typing import NamedTuple


class Command(NamedTuple):
    """A command before it is imported."""

    module: str
    summary: str


VIEW = Command(
    "app.commands.view",
    "Real-time global illumination: drag an object and shadow, colour bleeding and its own shading follow.",
)
COMMANDS = {
    "render": Command("app.commands.render", "draw one picture, or --frames along the mobile's path, without a window"),
    "bake": Command("app.commands.bake", "write a GLB file with light in its vertices, for other programs"),
    "bench": Command("app.commands.bench", "move the mobile along its path and time every frame"),
    "tune": Command(
        "app.commands.tune", "try settings on this scene and machine; print the best for a frame time or an error"
    ),
    "info": Command("app.commands.info", "print the contents of a scene, its default settings and their reasons"),
    "measure": Command(
        "app.commands.measure", "illuminance on calculation surfaces and at probes: mean, minimum, uniformity, targets"
    ),
    "report": Command("app.commands.report", "luminaires, surfaces with targets, pictures and power as one page"),
    "reference": Command(
        "app.commands.reference", "path trace the unbiased light of a scene and keep it; resumes a run that was stopped"
    ),
    "chart": Command(
        "app.commands.chart",
        "error against frame time of many settings: table, chart and page; resumes a run that was stopped",
    ),
    "atlas": Command("app.commands.atlas", "failures of each method with prediction, measurement and remedy: a page"),
}
