"""How kernels are compiled: once a machine, cached on disk, without the GIL, IEEE arithmetic.

`kernel` is the decorator in use, `allocating` where arrays are made. fastmath is never on: it flips disc crossings by
position in a slice. `error_model="numpy"` lets a division by zero give inf, which LLVM can vectorise.
The cache folder carries a hash of our sources, because numba's own check sees the file of a kernel
but not the files of the functions that it inlines.
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
    """Return a short hash of every file of gi_core that holds kernels, of where they are, and of numba's version.

    numba files kernels by the path of their source: another checkout must compile its own.
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
    """Return why kernels cannot be kept in a folder, "" if they can; if not, let them go where this process ends.

    The environment tells the processes that it starts, so that they share what one of them compiles.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except OSError as error:
        elsewhere = tempfile.mkdtemp(prefix="gi-viewer-")
        atexit.register(shutil.rmtree, elsewhere, ignore_errors=True)
        os.environ["NUMBA_CACHE_DIR"] = elsewhere
        return f"{folder} cannot be written ({error.strerror or error}): kernels are compiled anew at every start"


CACHE_PROBLEM = _cache_elsewhere(cache_folder())
numba.config.CACHE_DIR = str(cache_folder())

# numba counts who holds an array whenever a loop names it, by calls that cost more than most loops: of a ray's 900 ns
# 300, and more where two threads count the same one. What makes no array can do without; numba refuses what does.
kernel = numba.njit(cache=True, nogil=True, error_model="numpy", _nrt=False)

allocating = numba.njit(cache=True, nogil=True, error_model="numpy")

# For the few lines that run for every crossing: calls that pass six arrays cost 60 ns each.
inlined = numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
