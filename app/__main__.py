"""The command line: `gi-viewer [SCENE]`, and the commands that need no window.

Nothing heavy is imported before the arguments are known to be good: `--help` answers at once.
Exit codes are those of `app.cli.terminal.Exit`.
"""

from __future__ import annotations

import argparse
import difflib
import re
import sys
import warnings
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path

from app import values
from app.cli.terminal import Exit, fail, guarded
from app.commands import COMMANDS, VIEW
from app.settings import UsageError
from gi_core.files.find import shipped_scenes
from gi_core.scene import SceneError


class Parser(argparse.ArgumentParser):
    """argparse's parser; an error is one line that names --help. A list of numbers may begin with a negative one."""

    def __init__(self, *arguments, **options):
        super().__init__(*arguments, **options)
        self._negative_number_matcher = re.compile(r"-\.?\d")  # argparse's own takes -1,2 for an option

    def error(self, message: str):
        meant = [m for word in message.split() if word.startswith("--") for m in self._nearest_options(word)]
        unknown = message.startswith("unrecognized")
        hint = f"; did you mean {meant[0]}?" if meant and unknown else ""
        if unknown and Path(message.split()[-1]).suffix.lower() in values.SCENE_SUFFIXES:
            hint = "; only one scene; write --mobile FILE to add a mobile"
        self.exit(2, f"{self.prog}: {message}{hint}; `{self.prog} --help` lists the options\n")

    def _nearest_options(self, word: str) -> list[str]:
        names = {option.lstrip("-"): option for option in self._option_string_actions}
        return [names[name] for name in did_you_mean(word.partition("=")[0].lstrip("-"), names)]


def did_you_mean(word: str, words: Iterable[str]) -> list[str]:
    """Return up to 3 known words similar to a mistyped one, the most similar first."""
    return difflib.get_close_matches(word, list(words))


def main(argv: list[str] | None = None) -> int:
    """Run the program; return its exit code. Python's warnings, words of libraries, stay off the terminal."""
    if not sys.warnoptions:  # of `python -W`
        warnings.simplefilter("ignore")
    return guarded(lambda: _run(sys.argv[1:] if argv is None else argv))


def _run(argv: list[str]) -> int:
    try:
        arguments = parse(argv)
    except SystemExit as stop:  # argparse has printed the reason
        return int(stop.code or 0)

    from gi_core.base.memory import sentence

    try:
        return arguments.run(arguments)
    except SceneError as error:
        return fail(error, Exit.SCENE)
    except UsageError as error:
        return fail(error, Exit.USAGE)
    except MemoryError as error:
        return fail(sentence(error), Exit.USAGE)
    except KeyboardInterrupt as stop:
        return fail(str(stop) or "stopped", Exit.STOPPED)


def _is_scene(name: str) -> bool:
    return Path(name).exists() or name in shipped_scenes()


def parse(argv: list[str]) -> argparse.Namespace:
    """Return the checked arguments; `.run(arguments)` carries them out. Raises SystemExit like argparse."""
    if argv and argv[0] in COMMANDS:
        parser = Parser(prog=f"gi-viewer {argv[0]}", description=COMMANDS[argv[0]])
        return _filled(parser, argv[0]).parse_args(argv[1:])
    lines = [f"  gi-viewer {name:<10}{summary}" for name, summary in COMMANDS.items()]
    epilog = "commands without a window (each has its own --help):\n" + "\n".join(lines)
    layout = argparse.RawDescriptionHelpFormatter
    parser = _filled(Parser(prog="gi-viewer", description=VIEW, epilog=epilog, formatter_class=layout), "view")
    if argv and not argv[0].startswith("-") and not Path(argv[0]).suffix and len(argv) > 1:
        # Two words, the first of them no command: probably a mistyped one.
        meant = did_you_mean(argv[0], COMMANDS)
        if meant and not argv[1].startswith("-"):
            parser.error(f"there is no command {argv[0]}; did you mean {meant[0]}?")
        if Path(argv[1]).suffix.lower() in values.SCENE_SUFFIXES and not _is_scene(argv[0]):
            parser.error(f"there is no command {argv[0]}; there are {', '.join(COMMANDS)}")
    return parser.parse_args(argv)


def _filled(parser: Parser, command: str) -> Parser:
    module = import_module(f"app.commands.{command}")
    module.add_options(parser)
    parser.set_defaults(run=module.run)
    return parser


if __name__ == "__main__":
    sys.exit(main())
