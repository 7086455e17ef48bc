"""Memory of this process as the system and the C library see it. Linux alone (it reads /proc)."""

import ctypes
import os
from typing import NamedTuple


class MemoryUse(NamedTuple):
    """All in MB; resident memory outside malloc is code and other mappings."""

    resident: float
    held: float  # handed out by malloc and not yet given back, nan without glibc's mallinfo2
    free: float  # kept by malloc for later, not the program's

    def __str__(self) -> str:
        return f"{self.resident:.1f} MB, of malloc {self.held:.1f} held, {self.free:.1f} free"


class _Mallinfo2(ctypes.Structure):
    _fields_ = [
        (name, ctypes.c_size_t)
        for name in "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost".split()
    ]


def resident() -> float:
    """Return the memory of this process [MB]."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGESIZE") / 1e6


def memory_use() -> MemoryUse:
    """Return resident memory, and the part in use inside malloc."""
    try:
        call = ctypes.CDLL(None).mallinfo2
    except AttributeError:
        return MemoryUse(resident(), float("nan"), float("nan"))
    call.restype = _Mallinfo2
    heap = call()
    return MemoryUse(resident(), 1e-6 * (heap.uordblks + heap.hblkhd), 1e-6 * heap.fordblks)


def trim() -> None:
    """Make malloc return free memory to the system."""
    ctypes.CDLL(None).malloc_trim(0)
