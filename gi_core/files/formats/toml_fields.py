"""Typed reading of TOML tables. Every error gives place, rule, value found, value to write."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gi_core.files.formats.boundary import MOST_KEY_PARTS, Boundary, text_of
from gi_core.scene.errors import SceneError, shown
from gi_core.scene.rules import BIGGEST, is_direction, is_number

REQUIRED = object()  # default of a key that must be there
_QUOTED = re.compile(r"""\"(?:\\.|[^"\\\n])*\"|'[^'\n]*'|#[^\n]*""")
_DEEP = re.compile(rf"(?:\.[ \t]*[\w-]+[ \t]*){{{MOST_KEY_PARTS}}}")


class Table:
    """One table of a scene file; an unknown key is an error."""

    def __init__(self, values, where: str, keys: tuple[str, ...] | None):
        """keys: those that may occur; None: any."""
        self.where = where
        if not isinstance(values, dict):
            raise SceneError(f"{where} must be a table of keys, got {shown(values)}")
        self.values = values
        for key in values:
            if keys is not None and key not in keys:
                raise SceneError(f"{where}: unknown key {key!r}; {nearest(key, keys)}")

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def text(self, key: str, default=REQUIRED, choices: tuple[str, ...] = ()) -> str:
        """Return a string, one of `choices` if there are any."""
        value = self._get(key, default)
        if value is default:
            return value
        if choices and value not in choices:
            self._fail(key, "must be one of " + ", ".join(f'"{c}"' for c in choices), value)
        if not isinstance(value, str) or not value:
            self._fail(key, "must be a text in quotes", value)
        return value

    def texts(self, key: str) -> list[str]:
        """Return one or more strings; a single one may stand without brackets."""
        value = self._get(key, REQUIRED)
        listed = [value] if isinstance(value, str) else value
        if not isinstance(listed, list) or not listed or not all(isinstance(v, str) and v for v in listed):
            self._fail(key, "must be a text in quotes, or a list of them", value)
        return listed

    def flag(self, key: str, default: bool) -> bool:
        """Return true or false."""
        value = self._get(key, default)
        if not isinstance(value, bool):
            self._fail(key, "must be true or false", value)
        return value

    def number(self, key: str, default=REQUIRED, above: float = -math.inf, below: float = math.inf, least=None):
        """Return a finite number: above < x < below, or least <= x."""
        value = self._get(key, default)
        if value is default:
            return value
        if not is_number(value) or not above < value < below or (least is not None and value < least):
            rule = "must be a finite number"
            if least is not None:
                rule = f"must be a number >= {least:g}" + (f" and < {below:g}" if below < math.inf else "")
            elif above > -math.inf:
                rule = f"must be a number > {above:g}" + (f" and < {below:g}" if below < math.inf else "")
            self._fail(key, rule + _largest([value], below), value)
        return float(value)

    def count(self, key: str, default=None) -> int | None:
        """Return a whole number >= 1."""
        value = self._get(key, default)
        if value is default:
            return value
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            self._fail(key, "must be a whole number >= 1", value)
        return value

    def vector(self, key: str, n: int = 3, default=REQUIRED, least: float | None = None, below: float | None = None):
        """Return n finite numbers, each >= `least` and < `below` if given; not all zero if they are a direction."""
        value = self._get(key, default)
        if value is default:
            return value
        return self._vector(key, value, n, least, below)

    def direction(self, key: str, default=REQUIRED):
        """Return three finite numbers that are not all zero."""
        value = self.vector(key, 3, default)
        if value is not default and not is_direction(value):
            self._fail(key, "must be three numbers that are not all 0", list(value))
        return value

    def vectors(self, key: str, n: int, count: int):
        """Return a list of `count` vectors of n finite numbers."""
        value = self._get(key, REQUIRED)
        if not isinstance(value, list) or len(value) != count:
            value_text = f"a list of {len(value)}" if isinstance(value, list) else shown(value)
            want = f"a list with {count} entries of {_word(n)} numbers"
            raise SceneError(f"{self.where}: {key} must be {want}, got {value_text}")
        return [self._vector(f"{key}[{i}]", v, n, None, None) for i, v in enumerate(value)]

    def numbers(self, key: str) -> list[float]:
        """Return a list of finite numbers."""
        value = self._get(key, REQUIRED)
        if not isinstance(value, list) or not value or not all(is_number(v) for v in value):
            self._fail(key, "must be a list of finite numbers", value)
        return [float(v) for v in value]

    def tables(self, key: str, what: str) -> list[dict]:
        """Return the list of tables written as [[key]]."""
        value = self._get(key, [])
        if not isinstance(value, list) or not all(isinstance(v, dict) for v in value):
            raise SceneError(f"{self.where}: a {what} is written as a table [[{key}]], got {shown(value)}")
        return value

    def table(self, key: str) -> dict:
        """Return a table inside this one."""
        value = self._get(key, REQUIRED)
        if not isinstance(value, dict):
            self._fail(key, "must be a table", value)
        return value

    def _vector(self, key, value, n, least, below):
        good = isinstance(value, list) and len(value) == n and all(is_number(v) for v in value)
        if good and least is not None:
            good = min(value) >= least
        if good and below is not None:
            good = max(value) < below
        if not good:
            rule = f"must be {_word(n)} finite numbers"
            if least is not None:
                rule = f"must be {_word(n)} numbers >= {least:g}" + (f" and < {below:g}" if below is not None else "")
            self._fail(key, rule + _largest(value, below), value)
        return tuple(float(v) for v in value)

    def _get(self, key, default):
        if key in self.values:
            return self.values[key]
        if default is REQUIRED:
            raise SceneError(f"{self.where}: {key} is missing; write {key} = ...")
        return default

    def _fail(self, key, rule, value):
        raise SceneError(f"{self.where}: {key} {rule}, got {shown(value)}")


def nearest(word: str, words) -> str:
    """Return a hint: the nearest known word, or all of them."""
    close = difflib.get_close_matches(word, words, 1, 0.5)
    return f"did you mean {close[0]!r}?" if close else "known here are " + ", ".join(sorted(words))


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
    except OSError as error:
        raise SceneError(f"{where}: the scene file cannot be read: {error.strerror or error}") from None
    except RecursionError:
        raise SceneError(f"{where}: a scene file must not nest brackets hundreds deep") from None
    except ValueError as error:  # of TOML, of its encoding, or a number of thousands of digits
        raise SceneError(f"{where}: a scene file must be TOML, which this is not: {error}") from None


def _largest(values, below: float | None) -> str:
    """Return the further rule of values that are too large, "" for others."""
    numbers = values if isinstance(values, list) and below in (None, math.inf) else []
    large = (is_number(v, -math.inf, math.inf) and BIGGEST < abs(v) < math.inf for v in numbers)
    return f", at most {BIGGEST:g}" if any(large) else ""


def _word(n: int) -> str:
    return {3: "three", 4: "four"}.get(n, str(n))


def as_table(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    """Return the keys and values of an edit as a table: lists in place of tuples, tables in place of pairs."""
    return {key: _plain(value) for key, value in pairs}


def _plain(value: Any) -> Any:
    if not isinstance(value, tuple):
        return value
    pairs = value and all(isinstance(v, tuple) and len(v) == 2 and isinstance(v[0], str) for v in value)
    return as_table(value) if pairs else list(map(_plain, value))
