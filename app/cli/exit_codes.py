"""Exit codes, and the one line on stderr that comes with them."""

from __future__ import annotations

import sys

OK, USAGE, SCENE, NO_GL = 0, 2, 3, 4


def fail(error: object, code: int) -> int:
    """Say what is wrong in one line on stderr."""
    print("gi-viewer: " + " ".join(str(error).split()), file=sys.stderr)
    return code
