"""Argument parser with one-line errors that suggest the nearest known word."""

from __future__ import annotations

import argparse
import difflib
import re
from collections.abc import Iterable
from pathlib import Path

from app import values

LEAST_SIMILARITY = 0.6  # 0 .. 1, of a typing error


class Parser(argparse.ArgumentParser):
    """argparse's parser; an error is one line that names --help. A list of numbers may begin with a negative one."""

    def __init__(self, *given, **others):
        super().__init__(*given, **others)
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
    return difflib.get_close_matches(word, list(words), 3, LEAST_SIMILARITY)
