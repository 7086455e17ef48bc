"""The one exception that bad input raises."""

from __future__ import annotations


class SceneError(ValueError):
    """Input that cannot be used.

    The message is one sentence: where, the rule, what was found, what to write instead, e.g.
    ``scenes/cornell.toml: light "ceiling": flux must be three numbers >= 0, got [-1, 0, 2]``.
    """
