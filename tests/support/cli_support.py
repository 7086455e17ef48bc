"""Helpers of the command-line tests."""

FEW = ["cornell", "--photons", "2000"]
FAST = [*FEW, "--light", "photons"]


def one_line(text: str) -> str:
    """Check that an error is one line without a traceback, and return it."""
    assert len(text.splitlines()) == 1 and "Traceback" not in text, text
    return text
