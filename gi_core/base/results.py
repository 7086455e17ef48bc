"""Results by the digest of their inputs: an edit of a scene, and its undo, find all results that still hold.

Solvers of a scene's versions share one store. A key is a digest of all inputs of a result. A result that an edit
changes has another key, so no rule about edits is needed. A growing result is kept as a copy, so that the solver it
comes from may go on.
"""

from __future__ import annotations

import hashlib
import threading
from typing import Any

import numpy as np

KEPT = 8  # results of a kind: of versions of a scene, or of poses


def digest(*inputs: object) -> str:
    """Return a hash, 24 hex digits, of arrays and of values that differ by their repr()."""
    out = hashlib.sha256()
    for value in inputs:
        if isinstance(value, np.ndarray):
            out.update(repr((value.dtype.str, value.shape)).encode() + np.ascontiguousarray(value).tobytes())
        else:
            out.update(repr(value).encode())
    return out.hexdigest()[:24]


class Results:
    """The last results of each kind, by key; "" where one stands for all. Thread safe; nothing in it is written to."""

    def __init__(self) -> None:
        self._kept: dict[str, dict[str, Any]] = {}  # by kind, newest last
        self._lock = threading.Lock()

    def get(self, kind: str, key: str) -> Any | None:
        """Return a result, which then counts as the newest of its kind; None if it is not known."""
        with self._lock:
            of_kind = self._kept.get(kind, {})
            if key not in of_kind:
                return None
            of_kind[key] = of_kind.pop(key)
            return of_kind[key]

    def keep(self, kind: str, key: str, result: Any, most: int) -> None:
        """Keep a result in place of that with the same key, and at most so many of its kind."""
        with self._lock:
            of_kind = {k: r for k, r in self._kept.get(kind, {}).items() if k != key}
            self._kept[kind] = dict([*of_kind.items(), (key, result)][-most:])

    def take(self, kind: str, key: str) -> Any | None:
        """Return a result that grows, and forget it; None if it is not known."""
        with self._lock:
            return self._kept.get(kind, {}).pop(key, None)

    def of(self, *kinds: str) -> Results:
        """Return a store of these kinds alone."""
        other = Results()
        with self._lock:
            other._kept = {kind: dict(self._kept[kind]) for kind in kinds if kind in self._kept}
        return other
