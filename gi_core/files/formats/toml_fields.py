"""Typed reading of TOML tables. Every error gives place, rule, value found, value to write."""

from __future__ import annotations

import datetime
import difflib
import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from gi_core.files.formats.boundary import MOST_KEY_PARTS, Boundary, text_of
from gi_core.scene.errors import SceneError, shown
from gi_core.scene.rules import BIGGEST, Rule, is_direction, is_number

REQUIRED = object()  # default of a key that must be there
_QUOTED = re.compile(r"""\"(?:\\.|[^"\\\n])*\"|'[^'\n]*'|#[^\n]*""")
_DEEP = re.compile(rf"(?:\.[ \t]*[\w-]+[ \t]*){{{MOST_KEY_PARTS}}}")


class Field(NamedTuple):
    """How the value of a key is read: a method of Table, and its arguments besides the key."""

    read: str
    rule: dict[str, Any]


Schema = Mapping[str, Field]  # by key


def of(read: str, **rule: Any) -> Field:
    """Return the field that a method of Table reads by a rule."""
    return Field(read, rule)


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

    def fields(self) -> dict[str, Any]:
        """Return the value of each key of the schema, defaults included."""
        schema: Any = self.keys
        return {key: getattr(self, field.read)(key, **field.rule) for key, field in schema.items()}

    def value(self, key: str, rule: Rule, default=REQUIRED) -> Any:
        """Return a value that holds to a rule."""
        value = self._get(key, default, rule.example)
        return value if value is default else rule.check(f"{self.where}: {key}", value)

    def text(self, key: str, default=REQUIRED, choices: tuple[str, ...] = ()) -> str:
        """Return a string, one of `choices` if there are any."""
        listed = ", ".join(f'"{c}"' for c in choices)
        rule = f"must be one of {listed}" if choices else "must be a text in quotes, not empty"
        self._get(key, default, f'"{(*choices, "...")[0]}"')
        return self._value(key, default, rule, lambda v: isinstance(v, str) and (v in choices or (v and not choices)))

    def texts(self, key: str, default=REQUIRED) -> list[str]:
        """Return one or more strings; a single one may stand without brackets."""
        value = self._get(key, default, '"..."')
        if value is default:
            return value
        listed = [value] if isinstance(value, str) else value
        if not isinstance(listed, list) or not listed or not all(isinstance(v, str) and v for v in listed):
            self._fail(key, "must be a text in quotes, not empty, or a list of them", value)
        return listed

    def flag(self, key: str, default: bool) -> bool:
        """Return true or false."""
        return self._value(key, default, "must be true or false", lambda v: isinstance(v, bool))

    def count(self, key: str, default=None, most: float = math.inf) -> int | None:
        """Return a whole number from 1 to `most`."""
        rule = f"must be a whole number {'>= 1' if most == math.inf else f'from 1 to {most}'}"
        return self._value(key, default, rule, lambda v: type(v) is int and 1 <= v <= most)

    def number(self, key: str, default=REQUIRED, above: float = -math.inf, below: float = math.inf, least=-math.inf):
        """Return a finite number: above < x < below, least <= x."""
        value = self._get(key, default, "1.0")
        return value if value is default else self._numbers(key, value, None, least, below, above)

    def vector(self, key: str, n=3, default=REQUIRED, least=-math.inf, below: float = math.inf, above=-math.inf):
        """Return n finite numbers, each >= `least`, > `above` and < `below`."""
        value = self._get(key, default, [1] * n)
        return value if value is default else self._numbers(key, value, n, least, below, above)

    def direction(self, key: str, default=REQUIRED):
        """Return three finite numbers that are not all zero."""
        value = self.vector(key, 3, default)
        if value is not default and not is_direction(value):
            self._fail(key, "must be three numbers that are not all 0", list(value))
        return value

    def date(self, key: str) -> str:
        """Return a day from 1901 to 2099, such as "2026-03-21"; TOML has dates of its own too."""
        value = self._get(key, REQUIRED, "2026-03-21")
        try:
            day = datetime.date.fromisoformat(str(value))
        except ValueError:
            day = datetime.date.min
        if not 1901 <= day.year <= 2099:
            self._fail(key, "must be a day from 1901 to 2099 such as 2026-03-21", value)
        return day.isoformat()

    def place(self, key: str) -> tuple[float, float]:
        """Return latitude and longitude [degrees]."""

        def holds(v) -> bool:
            return isinstance(v, list) and len(v) == 2 and is_number(v[0], -90, 90) and is_number(v[1], -180, 180)

        rule = "must be latitude from -90 to 90 and longitude from -180 to 180, north and east positive"
        latitude, longitude = self._value(key, REQUIRED, rule, holds, "[40.4, -3.7]")
        return float(latitude), float(longitude)

    def vectors(self, key: str, n: int, count: int | None = None):
        """Return a list of `count` vectors of n finite numbers, None: three or more."""
        value = self._get(key, REQUIRED, [[1] * n] * (count or 3))
        if not isinstance(value, list) or (len(value) != count if count is not None else len(value) < 3):
            value_text = f"a list of {len(value)}" if isinstance(value, list) else shown(value)
            want = f"a list with {'three or more' if count is None else count} entries of {_word(n)} numbers"
            raise SceneError(f"{self.where}: {key} must be {want}, got {value_text}")
        return [self._numbers(f"{key}[{i}]", v, n) for i, v in enumerate(value)]

    def numbers(self, key: str) -> list[float]:
        """Return a list of finite numbers."""
        rule = "must be a list of finite numbers"
        value = self._value(key, REQUIRED, rule, lambda v: isinstance(v, list) and v and all(map(is_number, v)))
        return [float(v) for v in value]

    def tables(self, key: str, what: str) -> list[dict]:
        """Return the list of tables written as [[key]]."""
        value = self._get(key, [])
        if not isinstance(value, list) or not all(isinstance(v, dict) for v in value):
            raise SceneError(f"{self.where}: a {what} is written as a table [[{key}]], got {shown(value)}")
        return value

    def counts(self, key: str, n: int, most: int) -> tuple[int, ...] | None:
        """Return n whole numbers from 1 to `most`, None without the key."""

        def holds(v) -> bool:
            return isinstance(v, list) and len(v) == n and all(is_number(x, 1, most) and x == int(x) for x in v)

        value = self._value(key, None, f"must be {_word(n)} whole numbers from 1 to {most}", holds)
        return value and tuple(map(int, value))

    def numbers_by(self, key: str, keys: tuple[str, ...]) -> tuple[tuple[str, float], ...]:
        """Return the numbers > 0 of a table of these keys, in their order."""
        table = self.section(key, keys)
        return tuple((name, table.number(name, above=0)) for name in keys if name in table)

    def table(self, key: str) -> dict:
        """Return a table inside this one."""
        return self._value(key, REQUIRED, "must be a table", lambda v: isinstance(v, dict), "{ ... }")

    def _numbers(self, key, value, n: int | None, least=-math.inf, below=math.inf, above=-math.inf):
        """Return n numbers within bounds, or one number for None. Raises SceneError."""
        values = [value] if n is None else value
        good = isinstance(values, list) and len(values) == (n or 1) and all(map(is_number, values))
        if not (good and all(least <= v < below and v > above for v in values)):
            bound = f" >= {least:g}" if least > -math.inf else f" > {above:g}" if above > -math.inf else ""
            kind = f"{_word(n)}{'' if bound else ' finite'} numbers" if n else f"a{'' if bound else ' finite'} number"
            less = "<" if float(f"{below:g}") == below else "<="  # below the next number after a bound
            limit = f" and {less} {below:g}" if bound and below < math.inf else ""
            self._fail(key, f"must be {kind}{bound}{limit}{_largest(values, below)}", value)
        made = tuple(map(float, values))
        return made if n else made[0]

    def _value(self, key: str, default, rule: str, holds: Callable[[Any], Any], example: str = "[0, 1]"):
        """Return a value that holds to a rule, or the default. Raises SceneError."""
        value = self._get(key, default, example)
        if value is not default and not holds(value):
            self._fail(key, rule, value)
        return value

    def _get(self, key, default, example=""):
        if key in self.values:
            return self.values[key]
        if default is REQUIRED:
            raise SceneError(f"{self.where}: {key} is missing; write {key} = {example}")
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


def _largest(values, below: float) -> str:
    """Return the further rule of values that are too large, "" for others."""
    numbers = values if isinstance(values, list) and below == math.inf else []
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
