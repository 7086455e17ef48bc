"""Values quoted in messages."""

from __future__ import annotations

LONGEST_QUOTATION = 60  # characters of a quoted value


def shown(value) -> str:
    """Return a value as it was written, cut short."""
    try:
        text = repr(value)
    except ValueError:  # more digits than Python converts
        text = "a number of thousands of digits"
    return text if len(text) <= LONGEST_QUOTATION else text[: LONGEST_QUOTATION - 3] + "..."
