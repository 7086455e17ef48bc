"""Exit codes and the line on stderr that accompanies them."""

from __future__ import annotations

import re
import sys

OK, INCOMPLETE, USAGE, SCENE, NO_GL, STOPPED = 0, 1, 2, 3, 4, 130
UNREAD = 141  # closed pipe: 128 + SIGPIPE, the shell's convention


def fail(error: object, code: int) -> int:
    """Print an error as one line on stderr; return `code`."""
    print("gi-viewer: " + re.sub(r"\s*[^\S ]\s*", " ", str(error).strip()), file=sys.stderr)
    return code
