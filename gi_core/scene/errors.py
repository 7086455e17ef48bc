"""The exception for bad input, and safe quotation of text from files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

from gi_core.base.quotation import nearest, shown

__all__ = ["SENTENCE", "SceneError", "named", "nearest", "one_line", "printable", "shown", "utf8"]
_BREAK = re.compile(r"\s*[^\S ]\s*")
_HALF = re.compile("[\ud800-\udfff]")
SENTENCE = 500  # characters of a sentence


def utf8(text: str) -> str:
    """Return a name that UTF-8 can hold: of a file, or in a file, it may have halves of characters."""
    return _HALF.sub("\ufffd", text)


def printable(text: str) -> str:
    """Return a text with all but printable characters escaped, as repr() does: names may hold terminal commands."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def one_line(text: str) -> str:
    """Return a text as one printable line of at most SENTENCE characters; several spaces stay: names may have them."""
    line = printable(_BREAK.sub(" ", text.strip()))
    half = SENTENCE // 2  # the place at the front and the rule at the end both stay
    return line if len(line) <= SENTENCE else f"{line[: half - 5]} ... {line[-half:]}"


@contextmanager
def named(*places: str) -> Iterator[None]:
    """Let every SceneError within name its place: the first of `places`, unless it names one of them already."""
    try:
        yield
    except SceneError as error:
        if any(one_line(place) in str(error) for place in places):
            raise
        raise SceneError(f"{places[0]}: {error}") from None


class SceneError(ValueError):
    """Input that cannot be used.

    The message is one sentence: place, rule, value found, value to write instead, e.g.
    ``scenes/cornell.toml: light "ceiling": flux must be three numbers >= 0, got [-1, 0, 2]``.
    """

    def __init__(self, message: str):
        super().__init__(one_line(message))
