"""The version of the program."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path


def version() -> str:
    """Return the installed version; in a checkout that was never installed, that of pyproject.toml."""
    try:
        return metadata.version("gi-viewer")
    except metadata.PackageNotFoundError:
        import tomllib

        with open(Path(__file__).parents[2] / "pyproject.toml", "rb") as file:
            return tomllib.load(file)["project"]["version"]
