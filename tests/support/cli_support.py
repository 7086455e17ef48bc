"""Helpers of the command-line tests."""

FAST = ["cornell", "--photons", "2000"]


def one_line(text: str) -> str:
    """Check that an error is one line without a traceback, and return it."""
    assert len(text.splitlines()) == 1 and "Traceback" not in text, text
    return text
