"""Rules for the values of records and settings: the valid range of each, in words and as a test."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from numbers import Integral, Real
from os import PathLike
from typing import Any, NamedTuple

import numpy as np

from gi_core.scene.errors import SceneError, shown

TINIEST, BIGGEST = 1e-15, 1e15  # float32 holds their squares
BELOW_ONE = float(np.nextafter(1, 0))
MOST_IOR = 10.0


class Rule(NamedTuple):
    """A condition of a value; `make` turns a value that holds into the type that the program uses."""

    text: str  # completes "flux must be ..."
    holds: Callable[[Any], bool]
    make: Callable[[Any], Any] = lambda value: value
    example: str = "1.0"  # as a scene file has it

    def check(self, where: str, value):
        """Return the value. Raises SceneError, one sentence, if the value breaks the rule."""
        if not self.holds(value):
            raise SceneError(f"{where} must be {self.text}, got {shown(value)}")
        return self.make(value)


def is_number(value, low: float = -BIGGEST, high: float = BIGGEST) -> bool:
    """Return whether a value is a number from `low` to `high`; True and False are none."""
    return isinstance(value, Real) and not isinstance(value, bool) and bool(low <= value <= high)  # type: ignore[operator]


def is_array(values, shape: tuple, low: float = -BIGGEST, high: float = BIGGEST, kinds: str = "iuf") -> bool:
    """Return whether values are an array of numbers from `low` to `high`; a None in its shape is any length."""
    try:
        array = np.asarray(values)
    except ValueError:  # rows of several lengths
        return False
    if array.ndim == 1 and not isinstance(values, np.ndarray) and any(isinstance(v, bool) for v in values):
        return False  # beside numbers True would become 1
    fits = array.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, array.shape, strict=True))
    return fits and array.dtype.kind in kinds and bool(((low <= array) & (array <= high)).all())


def is_direction(values) -> bool:
    """Return whether values are three numbers that can be made a unit vector."""
    return is_array(values, (3,)) and bool(np.abs(values).max() >= TINIEST)


def vector(text: str, holds: Callable[[Any], bool], n: int = 3) -> Rule:
    """Return the rule of n numbers, which become a tuple; None stays where it holds."""
    return Rule(text, holds, lambda values: values if values is None else tuple(map(float, values)), str([1] * n))


def number(text: str, low: float = -BIGGEST, high: float = BIGGEST) -> Rule:
    """Return the rule of a number from `low` to `high`."""
    return Rule(f"a number {text}", lambda value: is_number(value, low, high), float)


def numbers(n: int) -> Rule:
    """Return the rule of n finite numbers."""
    return vector(f"{n} finite numbers", lambda values: is_array(values, (n,)), n)


def rows(n: int, of: int) -> Rule:
    """Return the rule of a list of n lists of finite numbers, each of a length."""
    return Rule(f"a list of {n} lists of {of} finite numbers", lambda values: is_array(values, (n, of)))


def word(values: tuple[str, ...]) -> Rule:
    """Return the rule of a word out of several."""
    listed = ", ".join(f'"{value}"' for value in values)
    return Rule(f"one of {listed}", lambda value: isinstance(value, str) and value in values, example=f'"{values[0]}"')


def whole(low: int, high: int) -> Rule:
    """Return the rule of a whole number from `low` to `high`."""
    text = f"a whole number from {low} to {high}"
    return Rule(text, lambda value: is_number(value, low, high) and value == int(value), int)


def one_of(values: Iterable[str | int]) -> Rule:
    """Return the rule of a name, or a whole number, out of several."""
    values = tuple(values)
    return Rule(
        f"one of {', '.join(map(str, values))}", lambda value: isinstance(value, str | Integral) and value in values
    )


TEXT = Rule("a text", lambda value: isinstance(value, str))
NAME = Rule("a text in quotes, not empty", lambda value: isinstance(value, str) and value != "", example='"..."')
TABLE = Rule("a table", lambda value: isinstance(value, dict), example="{ ... }")
FLAG = Rule("true or false", lambda value: isinstance(value, bool | np.bool_), bool)
FILE = Rule("the name of a file", lambda value: isinstance(value, str | PathLike))
NUMBER = Rule("a finite number", is_number, float)
LENGTH = Rule(f"a finite number > 0, from {TINIEST:g} to {BIGGEST:g}", lambda value: is_number(value, TINIEST), float)
PLACE = vector(f"three finite numbers of at most {BIGGEST:g}", lambda value: is_array(value, (3,)))
DIRECTION = vector(f"three numbers that are not all 0, the largest {TINIEST:g} to {BIGGEST:g}", is_direction)
STRENGTH = vector(f"three numbers >= 0 and <= {BIGGEST:g}", lambda value: is_array(value, (3,), 0))
INDEX = number(f"from 1 to {MOST_IOR:g}", 1, MOST_IOR)
LEVEL = number(">= 0", 0)
SHARE = number("from 0 to 1", 0, 1)
SHARES = vector("three numbers from 0 to 1", lambda value: is_array(value, (3,), 0, 1))
REFLECTANCE = vector("three numbers in [0, 1)", lambda value: is_array(value, (3,), 0, BELOW_ONE))
