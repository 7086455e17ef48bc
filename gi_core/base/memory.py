"""Available memory: photons are refused before the process is killed or the machine swaps."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path, PurePosixPath

_ROOT = Path("/")  # of /proc and /sys
# Of control groups of version 2 and 1: folder below /sys/fs/cgroup, limit, usage, and file cache that can be freed.
_GROUPS = {
    "": ("", "memory.max", "memory.current", "inactive_file"),
    "memory": ("memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
}


def available() -> int | None:
    """Return the bytes that can be allocated without swapping; None where the system does not say (not Linux).

    The least of the machine's memory, of control groups (containers), and of RLIMIT_AS (`ulimit -v`).
    """
    of_machine = (1024 * n for n in _numbers("proc/meminfo", "MemAvailable:"))
    return min((*of_machine, *_of_groups(), *_of_process()), default=None)


def sentence(problem: MemoryError) -> str:
    """Return an allocation that failed, in one sentence with its remedy."""
    return f"memory is full ({str(problem) or 'an allocation failed'}): take fewer photons, or simplify the scene"


def _of_groups() -> Iterator[int]:
    """Yield the rest [bytes] below the limit of the process's control group and of each group around it."""
    for line in _lines("proc/self/cgroup"):
        _, controllers, group = line.split(":", 2)
        for version in set(controllers.split(",")) & set(_GROUPS):
            folder, limit, usage, freeable = _GROUPS[version]
            for path in (PurePosixPath(group), *PurePosixPath(group).parents):
                place = f"sys/fs/cgroup/{folder}/{path}"
                for most, used in zip(_numbers(f"{place}/{limit}"), _numbers(f"{place}/{usage}"), strict=False):
                    yield max(most - used + sum(_numbers(f"{place}/memory.stat", freeable)), 0)


def _of_process() -> Iterator[int]:
    """Yield the address space [bytes] that RLIMIT_AS leaves."""
    try:
        import resource
    except ImportError:  # Windows
        return
    most = resource.getrlimit(resource.RLIMIT_AS)[0]
    if most != resource.RLIM_INFINITY:
        yield from (max(most - pages * resource.getpagesize(), 0) for pages in _numbers("proc/self/statm"))


def _numbers(file: str, name: str = "") -> Iterator[int]:
    """Yield the number in the line of a file that begins with a name, nothing if there is none ("max": no limit)."""
    for line in _lines(file):
        words = line.removeprefix(name).split()
        if line.split()[: bool(name)] == [name][: bool(name)] and words and words[0].isdecimal():
            yield int(words[0])


def _lines(file: str) -> list[str]:
    try:
        return (_ROOT / file).read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return []
