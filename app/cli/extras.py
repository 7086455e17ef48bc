"""Libraries that a few commands alone need: extras of the package."""

from __future__ import annotations

from importlib import import_module

from app.settings import UsageError


def need(module: str, purpose: str, package: str = "") -> None:
    """Raise UsageError, one sentence with the remedy, where a module cannot be imported."""
    try:
        import_module(module)
    except ImportError:
        package = package or module
        raise UsageError(f"{package}, which {purpose}, is not installed: pip install {package}") from None
