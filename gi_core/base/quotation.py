"""Values quoted in messages."""

from __future__ import annotations


def shown(value) -> str:
    """Return a value as it was written, cut short."""
    longest_quotation = 60  # characters of a quoted value
    try:
        text = repr(value)
    except ValueError:  # more digits than Python converts
        text = "a number of thousands of digits"
    return text if len(text) <= longest_quotation else text[: longest_quotation - 3] + "..."
