"""Arguments that are told what is wrong with them in one line, with the word that was probably meant."""

from __future__ import annotations

import argparse
import difflib
from collections.abc import Iterable
from pathlib import Path

from app.cli import values

ALIKE = 0.6  # of 1: what is less alike was not mistyped


class Parser(argparse.ArgumentParser):
    """As argparse's, but an error is one line and says where help is."""

    def error(self, message: str):
        meant = [m for word in message.split() if word.startswith("--") for m in self._meant(word)]
        unknown = message.startswith("unrecognized")
        hint = f"; did you mean {meant[0]}?" if meant and unknown else ""
        if unknown and Path(message.split()[-1]).suffix.lower() in values.SCENES:
            hint = "; one scene at a time: a thing to move is given by --mobile FILE"
        self.exit(2, f"{self.prog}: {message}{hint}; `{self.prog} --help` lists what there is\n")

    def _meant(self, word: str) -> list[str]:
        return did_you_mean(word.partition("=")[0], self._option_string_actions)


def did_you_mean(word: str, words: Iterable[str]) -> list[str]:
    """Return the words that a mistyped one may have been, the likeliest first."""
    return difflib.get_close_matches(word, list(words), 3, ALIKE)
