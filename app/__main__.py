"""The command line: `gi-viewer [SCENE]`, and the commands that need no window.

Nothing heavy is imported before the arguments are known to be good: `--help` answers at once.
Exit codes: 0 done, 1 done in part, 2 usage, 3 the scene cannot be used, 4 no OpenGL window (only with --no-fallback).
"""

from __future__ import annotations

import argparse
import sys
from importlib import import_module
from pathlib import Path

from app import values
from app.cli.exit_codes import SCENE, STOPPED, USAGE, fail
from app.cli.parser import Parser, did_you_mean
from app.cli.terminal import guarded
from app.commands import COMMANDS, VIEW, Command
from app.settings import UsageError


def main(argv: list[str] | None = None) -> int:
    """Run the program; return its exit code."""
    return guarded(lambda: _run(sys.argv[1:] if argv is None else argv))


def _run(argv: list[str]) -> int:
    try:
        arguments = parse(argv)
    except SystemExit as stop:  # argparse has printed the reason
        return int(stop.code or 0)

    from gi_core.base.memory import sentence
    from gi_core.scene import SceneError

    try:
        return arguments.run(arguments)
    except SceneError as error:
        return fail(error, SCENE)
    except UsageError as error:
        return fail(error, USAGE)
    except MemoryError as error:
        return fail(sentence(error), USAGE)
    except KeyboardInterrupt as stop:
        return fail(str(stop) or "stopped", STOPPED)


def _is_scene(name: str) -> bool:
    from gi_core.files.find import shipped_scenes

    return Path(name).exists() or name in shipped_scenes()


def parse(argv: list[str]) -> argparse.Namespace:
    """Return the checked arguments; `.run(arguments)` carries them out. Raises SystemExit like argparse."""
    if argv and argv[0] in COMMANDS:
        command = COMMANDS[argv[0]]
        return _filled(Parser(prog=f"gi-viewer {argv[0]}", description=command.summary), command).parse_args(argv[1:])
    lines = [f"  gi-viewer {name:<10}{command.summary}" for name, command in COMMANDS.items()]
    epilog = "commands without a window (each has its own --help):\n" + "\n".join(lines)
    layout = argparse.RawDescriptionHelpFormatter
    parser = _filled(Parser(prog="gi-viewer", description=VIEW.summary, epilog=epilog, formatter_class=layout), VIEW)
    if argv and not argv[0].startswith("-") and not Path(argv[0]).suffix and len(argv) > 1:
        # Two words, the first of them no command: probably a mistyped one.
        meant = did_you_mean(argv[0], COMMANDS)
        if meant and not argv[1].startswith("-"):
            parser.error(f"there is no command {argv[0]}; did you mean {meant[0]}?")
        if Path(argv[1]).suffix.lower() in values.SCENE_SUFFIXES and not _is_scene(argv[0]):
            parser.error(f"there is no command {argv[0]}; there are {', '.join(COMMANDS)}")
    return parser.parse_args(argv)


def _filled(parser: Parser, command: Command) -> Parser:
    module = import_module(command.module)
    module.add_options(parser)
    parser.set_defaults(run=module.run)
    return parser


if __name__ == "__main__":
    sys.exit(main())
