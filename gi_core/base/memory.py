"""Available memory: photons are refused before the process is killed or the machine swaps."""

from __future__ import annotations

from pathlib import Path

_MACHINE = Path("/proc/meminfo")
_GROUP = Path("/sys/fs/cgroup")


def available() -> int | None:
    """Return the bytes that can be allocated without swapping; None where the system does not say (not Linux)."""
    left = [n for n in (_of_machine(), _of_group()) if n is not None]
    return min(left, default=None)


def _of_machine() -> int | None:
    try:
        lines = _MACHINE.read_text(encoding="ascii").splitlines()
        return next(int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable:"))
    except (OSError, StopIteration, ValueError, IndexError):
        return None


def _of_group() -> int | None:
    """Return the limit of the control group (a container) minus its usage [bytes]; None without a limit."""
    try:
        limit, held = ((_GROUP / name).read_text(encoding="ascii").strip() for name in ("memory.max", "memory.current"))
        return max(int(limit) - int(held), 0)
    except (OSError, ValueError):  # "max": no limit
        return None
