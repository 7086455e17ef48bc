"""The program around `gi_core`: window, command line, pictures. For Python: `app.render`, `app.show`."""

import os
from importlib import import_module

# OpenBLAS keeps one spinning thread per core once it is loaded. Products here have three numbers, and the cores trace
# photons. A value set by the user stays.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def __getattr__(name: str):
    """Import `render` and `show` at their first use, so that `--help` stays instant."""
    if name in ("render", "show"):
        return getattr(import_module("app.interactive"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
