"""The version of the program, and its commit."""

from __future__ import annotations

import functools
import os
import subprocess
from importlib import import_module, metadata
from pathlib import Path

from app.settings import UsageError


def need(module: str, purpose: str) -> None:
    """Raise UsageError, one sentence with the remedy, where a module cannot be imported."""
    try:
        import_module(module)
    except ImportError:
        raise UsageError(f"{module}, which {purpose}, is not installed: pip install {module}") from None


def version() -> str:
    """Return the installed version; in a checkout that was never installed, that of pyproject.toml."""
    try:
        return metadata.version("gi-viewer")
    except metadata.PackageNotFoundError:
        import tomllib

        with open(Path(__file__).parents[2] / "pyproject.toml", "rb") as file:
            return tomllib.load(file)["project"]["version"]


@functools.cache
def commit() -> str | None:
    """Return the commit of the checkout, "-dirty" if its files differ; None outside a checkout."""
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():  # installed: a repository around the environment is another project
        return None
    command = ["git", "-C", os.fspath(root), "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip() or None
    except (OSError, subprocess.SubprocessError):
        return None
