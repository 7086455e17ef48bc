"""Undo and redo of poses and of settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

Step = tuple[dict[Any, Any], dict[Any, Any]]  # values before and after


class Field(NamedTuple):
    """The key of a field of Settings in a step; the key of a pose is the name of its mobile."""

    name: str


class History:
    """Steps of ({key: value before}, {key: value after}); a key is the name of a mobile, or a Field."""

    def __init__(self) -> None:
        self._done: list[Step] = []
        self._undone: list[Step] = []
        self.before: dict[Field, Any] = {}  # fields when the edit under way, or the last one, began

    def push(self, before: Mapping[Any, Any], after: Mapping[Any, Any]) -> None:
        """Record a change; undone steps can then no longer be redone."""
        before = {key: value for key, value in before.items() if after.get(key, value) != value}
        if not before:
            return
        self._done = [*self._done[-199:], (before, {key: after[key] for key in before})]  # 200 steps at most
        self._undone.clear()

    def undo(self) -> dict[Any, Any]:
        """Return the values before the last step; empty without one."""
        if not self._done:
            return {}
        self._undone.append(self._done.pop())
        return self._undone[-1][0]

    def redo(self) -> dict[Any, Any]:
        if not self._undone:
            return {}
        self._done.append(self._undone.pop())
        return self._done[-1][1]

    def extend(self, before: Mapping[Any, Any], after: Mapping[Any, Any]) -> None:
        """Record a change as part of the last step, if that step ended in the values before; else push it."""
        if self._done and all(self._done[-1][1].get(key) == value for key, value in before.items()):
            self._done[-1] = self._done[-1][0], {**self._done[-1][1], **after}
        else:
            self.push(before, after)

    def change(self, key: Field, new: Callable[[Any], Any]) -> None:
        """Put new values of a field into all steps; steps that then leave it as it is are dropped."""
        self._done, self._undone = _changed(self._done, key, new), _changed(self._undone, key, new)


def _changed(steps: list[Step], key: Field, new: Callable[[Any], Any]) -> list[Step]:
    """Return steps with new values of a field, without those that then leave it as it is."""
    out = []
    for before, after in steps:
        if key not in before:
            out.append((before, after))
        elif new(before[key]) != new(after[key]):
            out.append(({**before, key: new(before[key])}, {**after, key: new(after[key])}))
    return out
