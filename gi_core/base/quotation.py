"""Values quoted in messages."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


def shown(value) -> str:
    """Return a value as it was written, cut short."""
    longest_quotation = 60  # characters of a quoted value
    try:
        text = repr(value)
    except ValueError:  # more digits than Python converts
        text = "a number of thousands of digits"
    return text if len(text) <= longest_quotation else text[: longest_quotation - 3] + "..."


def nearest(word: str, words: Iterable[str]) -> str:
    """Return a hint: the known word most like a mistyped one, or all of them."""
    choices = list(dict.fromkeys(words))
    if close := get_close_matches(word, choices, 1):
        return f"did you mean {shown(close[0])}?"
    return "there is " + (", ".join(f'"{choice}"' for choice in choices) or "none")
