"""Decorators of compiled kernels: cached on disk per machine, without the GIL, with IEEE arithmetic.

`kernel` is the usual decorator, `allocating` that of kernels which create arrays. fastmath is never on: results of disc
tests would depend on the position in a slice. `error_model="numpy"` turns a division by zero into inf, which LLVM can
vectorise. The cache folder carries a hash of the sources: numba checks the file of a kernel, but not the files of the
functions that it inlines.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import numba
import numpy as np
import platformdirs
from numba import types
from numba.extending import overload

from gi_core.base.kernel_cache import KernelCache, usable_folder

_ROOT = Path(__file__).parent.parent


@cache
def source_hash() -> str:
    """Return a hash (12 hex digits) of gi_core's kernel sources, of their location and of numba's version.

    numba indexes kernels by the path of their source, so each checkout compiles its own.
    """
    digest = hashlib.sha256(f"{numba.__version__} {_ROOT}".encode())
    for path in sorted(_ROOT.rglob("*.py")):
        source = path.read_bytes()
        if b"gi_core.base.jit" in source:
            digest.update(path.relative_to(_ROOT).as_posix().encode() + source)
    return digest.hexdigest()[:12]


def cache_folder() -> Path:
    """Return the folder that holds compiled kernels: NUMBA_CACHE_DIR, or one of the user if that is unset or empty."""
    if folder := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(folder)
    return Path(platformdirs.user_cache_dir("gi-viewer", appauthor=False)) / f"kernels-{source_hash()}"


numba.config.CACHE_DIR = str(usable_folder(cache_folder()))


def _without_literals(resolve: Callable, args: tuple, kws: dict):
    """Resolve a call between kernels by the types of its arguments: numba compiles a version per integer constant."""
    return resolve(
        tuple(types.unliteral(a) if isinstance(a, types.IntegerLiteral) else a for a in args),
        {k: types.unliteral(a) if isinstance(a, types.IntegerLiteral) else a for k, a in kws.items()},
    )


def _decorator(**options) -> Callable[[Callable], Any]:
    def decorated(function: Callable):
        dispatcher = numba.njit(nogil=True, error_model="numpy", **options)(function)
        dispatcher.get_call_template = partial(_without_literals, dispatcher.get_call_template)
        dispatcher._cache = KernelCache(function)  # in place of `cache=True`
        return dispatcher

    return decorated


# numba reference-counts every array used in a loop: 300 of a ray's 900 ns, more where threads share the array.
# Kernels that create no arrays need no counting; numba rejects _nrt=False for the others.
kernel = _decorator(_nrt=False)

allocating = _decorator()

# For short functions of inner loops: a call that passes six arrays costs 60 ns.
inlined = _decorator(inline="always")

_DE_BRUIJN = np.uint64(0x077CB531)
_PLACE = np.zeros(32, np.int64)
_PLACE[[(0x077CB531 << k & 0xFFFFFFFF) >> 27 for k in range(32)]] = np.arange(32)


@inlined
def lowest_bit(bits):
    """Return the index of the lowest bit set in a uint32 that is not 0 (Leiserson et al. 1998)."""
    lowest = np.uint64(bits ^ (bits & (bits - np.uint32(1))))
    return _PLACE[(np.uint32(lowest * _DE_BRUIJN)) >> np.uint32(27)]


def by_type(functions: dict[type, Callable], otherwise: Callable | None = None, inline: bool = False) -> Callable:
    """Return a function that kernels call for the one of `functions` of the class of its first argument, a NamedTuple.

    All take the same arguments; those that are no kernels are compiled with each caller, in half the time. inline: take
    them into the caller, where they are short and no kernels.
    """

    def query(first, *rest):
        raise NotImplementedError  # outside of kernels

    @overload(query, strict=False, inline="always" if inline else "never")
    def _(first, *rest):
        kind = getattr(first, "instance_class", None)
        chosen = functions.get(kind, otherwise)
        code = getattr(chosen, "py_func", chosen).__code__
        call = (lambda first, *rest: chosen(first, *rest)) if hasattr(chosen, "py_func") else chosen
        # A name of its own: LLVM may take equal names of kernels that two processes have cached for one function.
        call.__qualname__ = f"{code.co_name}_{code.co_firstlineno}_{getattr(kind, '__name__', '')}"
        return call

    return query
