"""Decorators of compiled kernels: cached on disk per machine, without the GIL, with IEEE arithmetic.

`kernel` is the usual decorator, `allocating` that of kernels which create arrays. fastmath is never on: results of disc
tests would depend on the position in a slice. `error_model="numpy"` turns a division by zero into inf, which LLVM can
vectorise. The cache folder carries a hash of the sources: numba checks the file of a kernel, but not the files of the
functions that it inlines.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import shutil
import tempfile
from functools import cache
from pathlib import Path

import numba
import platformdirs

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
    """Return the folder that holds compiled kernels."""
    if "NUMBA_CACHE_DIR" in os.environ:
        return Path(os.environ["NUMBA_CACHE_DIR"])
    return Path(platformdirs.user_cache_dir("gi-viewer", appauthor=False)) / f"kernels-{source_hash()}"


def _cache_elsewhere(folder: Path) -> str:
    """Return "" if a folder can be written, else the reason; then cache kernels in a temporary folder.

    Child processes share the temporary folder through NUMBA_CACHE_DIR. It is deleted when this process ends.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except OSError as error:
        elsewhere = tempfile.mkdtemp(prefix="gi-viewer-")
        atexit.register(shutil.rmtree, elsewhere, ignore_errors=True)
        os.environ["NUMBA_CACHE_DIR"] = elsewhere
        return f"{folder} cannot be written ({error.strerror or error}): kernels are compiled at every start"


CACHE_PROBLEM = _cache_elsewhere(cache_folder())
numba.config.CACHE_DIR = str(cache_folder())

# numba reference-counts every array used in a loop: 300 of a ray's 900 ns, more where threads share the array.
# Kernels that create no arrays need no counting; numba rejects _nrt=False for the others.
kernel = numba.njit(cache=True, nogil=True, error_model="numpy", _nrt=False)

allocating = numba.njit(cache=True, nogil=True, error_model="numpy")

# For short functions of inner loops: a call that passes six arrays costs 60 ns.
inlined = numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
