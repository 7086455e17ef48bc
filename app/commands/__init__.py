"""Commands by name, with their line of help; the module of that name is imported when a command is called.

A command module has `add_options(parser)` and `run(arguments)`, which returns the exit code. A new command is one file
and one line in COMMANDS. Command modules import nothing heavy at the top, so that `--help` answers at once.
"""

VIEW = "Real-time global illumination: drag an object and shadow, colour bleeding and its own shading follow."
COMMANDS = {
    "render": "draw one picture, or --frames along the mobile's path, without a window",
    "bake": "write a GLB file with light in its vertices, for other programs",
    "bench": "move the mobile along its path and time every frame",
    "info": "print the contents of a scene, its default settings and their reasons",
    "measure": "illuminance on calculation surfaces and at probes: mean, minimum, uniformity, targets",
    "report": "luminaires, surfaces with targets, pictures and power as one page",
    "reference": "path trace the unbiased light of a scene and keep it; resumes a run that was stopped",
    "chart": "error against frame time of many settings: table, chart and page",
    "atlas": "failures of each method with prediction, measurement and remedy: a page",
}
