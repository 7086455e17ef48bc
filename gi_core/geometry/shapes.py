"""Results that depend on the shape of one object alone: an edit of its material, or of other objects, keeps them.

A model holds them by kind and object. Each also states the numbers that it was computed with; for others it is
computed again. docs/decisions/042-results-of-shapes.md has the measurements.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple


class Kept(NamedTuple):
    """A result, and the numbers that it was computed with."""

    given: tuple[float, ...]
    result: Any


class Shapes:
    """Results of the objects of a model."""

    def __init__(self) -> None:
        self._kept: dict[tuple[str, int], Kept] = {}

    def find(self, kind: str, o: int, *given: float) -> Any | None:
        """Return the result of a kind for object o and these numbers, which callers must not write to; or None."""
        kept = self._kept.get((kind, o))
        return kept.result if kept is not None and kept.given == given else None

    def keep(self, kind: str, o: int, result: Any, *given: float) -> None:
        """Keep a result for object o and these numbers, in place of the last one of its kind."""
        self._kept[kind, o] = Kept(given, result)

    def take_over(self, earlier: Shapes, objects: Mapping[int, int]) -> None:
        """Keep the results of another model for objects that have the same shape; objects: its number of each."""
        known = list(earlier._kept.items())  # that model may go on
        for o, there in objects.items():
            self._kept |= {(kind, o): kept for (kind, of), kept in known if of == there}
