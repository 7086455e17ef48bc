"""Typed reading of TOML tables. Every error gives place, rule, value found, value to write."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from gi_core.files.formats.boundary import MOST_KEY_PARTS, Boundary, text_of
from gi_core.scene.errors import SceneError, nearest, shown
from gi_core.scene.rules import Rule

REQUIRED = object()  # default of a key that must be there
_QUOTED = re.compile(r"""\"(?:\\.|[^"\\\n])*\"|'[^'\n]*'|#[^\n]*""")
_DEEP = re.compile(rf"(?:\.[ \t]*[\w-]+[ \t]*){{{MOST_KEY_PARTS}}}")


Schema = Mapping[str, Rule]  # by key


class Table:
    """One table of a scene file; an unknown key is an error."""

    def __init__(self, values, where: str, keys: Collection[str] | None, more: Collection[str] = ()):
        """keys: those that may occur, those of a Schema for `fields`; None: any; more: beside these."""
        self.where, self.keys = where, keys
        if not isinstance(values, dict):
            raise SceneError(f"{where} must be a table of keys, got {shown(values)}")
        self.values = values
        for key in values:
            if keys is not None and key not in keys and key not in more:
                raise SceneError(f"{where}: unknown key {key!r}; {nearest(key, (*keys, *more))}")

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def section(self, key: str, keys: Collection[str] | None = None) -> Table:
        """Return the table [key], an empty one if it is missing."""
        return Table(self.values.get(key, {}), f"{self.where}: [{key}]", keys)

    def fields(self, defaults: Mapping[str, Any]) -> dict[str, Any]:
        """Return the value of each key of the schema; those of `defaults` may be missing."""
        schema: Any = self.keys
        return {key: self.value(key, rule, defaults.get(key, REQUIRED)) for key, rule in schema.items()}

    def value(self, key: str, rule: Rule, default=REQUIRED) -> Any:
        """Return a value that holds to a rule, or the default."""
        if key in self.values:
            return rule.check(f"{self.where}: {key}", self.values[key])
        if default is REQUIRED:
            raise SceneError(f"{self.where}: {key} is missing; write {key} = {rule.example}")
        return default

    def tables(self, key: str, what: str) -> list[dict]:
        """Return the list of tables written as [[key]]."""
        value = self.values.get(key, [])
        if not isinstance(value, list) or not all(isinstance(v, dict) for v in value):
            raise SceneError(f"{self.where}: a {what} is written as a table [[{key}]], got {shown(value)}")
        return value


def read_toml(path: Path, where: str, boundary: Boundary) -> dict:
    """Return the tables of a TOML file."""
    import tomllib

    try:
        text = text_of(boundary.read(path, where, small=True))
        if _DEEP.search(_QUOTED.sub("a", text)):  # tomllib takes a time that grows with the square of the depth
            raise SceneError(f"{where}: a key must have no more than {MOST_KEY_PARTS} parts between dots; nest it less")
        return tomllib.loads(text)
    except SceneError:
        raise
    except RecursionError:
        raise SceneError(f"{where}: a scene file must not nest brackets hundreds deep") from None
    except ValueError as error:  # of TOML, of its encoding, or a number of thousands of digits
        raise SceneError(f"{where}: a scene file must be TOML, which this is not: {error}") from None


def as_table(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    """Return the keys and values of an edit as a table: lists in place of tuples, tables in place of pairs."""
    return {key: _plain(value) for key, value in pairs}


def _plain(value: Any) -> Any:
    if not isinstance(value, tuple):
        return value
    pairs = value and all(isinstance(v, tuple) and len(v) == 2 and isinstance(v[0], str) for v in value)
    return as_table(value) if pairs else list(map(_plain, value))
