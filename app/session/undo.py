"""Undo and redo of poses."""

from __future__ import annotations

from gi_core.scene import Pose

DEPTH = 200


class History:
    """Steps of ({name: pose before}, {name: pose after})."""

    def __init__(self) -> None:
        self._done: list[tuple[dict[str, Pose], dict[str, Pose]]] = []
        self._undone: list[tuple[dict[str, Pose], dict[str, Pose]]] = []

    def push(self, before: dict[str, Pose], after: dict[str, Pose]) -> None:
        """Record a change; undone steps can then no longer be redone."""
        before = {name: pose for name, pose in before.items() if after.get(name, pose) != pose}
        if not before:
            return
        self._done = [*self._done[-DEPTH + 1 :], (before, {name: after[name] for name in before})]
        self._undone.clear()

    def undo(self) -> dict[str, Pose]:
        """Return the poses before the last step; empty without one."""
        if not self._done:
            return {}
        self._undone.append(self._done.pop())
        return self._undone[-1][0]

    def redo(self) -> dict[str, Pose]:
        if not self._undone:
            return {}
        self._done.append(self._undone.pop())
        return self._done[-1][1]
