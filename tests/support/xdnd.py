"""A source of drag and drop on X11: it gives files to the window under a point, by the XDND protocol, version 5.

Run: python -m tests.support.xdnd X Y FILE ... (pixels of the screen); exit code 0 once the window has taken them.
"""

import ctypes
import ctypes.util
import sys
from pathlib import Path

CLIENT_MESSAGE, SELECTION_REQUEST, SELECTION_NOTIFY = 33, 30, 31
VERSION = 5
EVENTS = 2000  # at most, before the other side counts as dead; each is waited for by `Source._next`
LONG, ULONG, INT, POINTER = ctypes.c_long, ctypes.c_ulong, ctypes.c_int, ctypes.c_void_p


class ClientMessage(ctypes.Structure):
    _fields_ = [
        ("type", INT), ("serial", ULONG), ("send_event", INT), ("display", POINTER), ("window", ULONG),
        ("message", ULONG), ("format", INT), ("data", LONG * 5),
    ]  # fmt: skip


class SelectionRequest(ctypes.Structure):
    _fields_ = [
        ("type", INT), ("serial", ULONG), ("send_event", INT), ("display", POINTER), ("owner", ULONG),
        ("requestor", ULONG), ("selection", ULONG), ("target", ULONG), ("property", ULONG), ("time", ULONG),
    ]  # fmt: skip


class SelectionNotify(ctypes.Structure):
    _fields_ = [
        ("type", INT), ("serial", ULONG), ("send_event", INT), ("display", POINTER), ("requestor", ULONG),
        ("selection", ULONG), ("target", ULONG), ("property", ULONG), ("time", ULONG),
    ]  # fmt: skip


class Event(ctypes.Union):
    _fields_ = [
        ("type", INT), ("client", ClientMessage), ("request", SelectionRequest), ("notify", SelectionNotify),
        ("pad", LONG * 24),
    ]  # fmt: skip


class Source:
    """A window that owns the dragged files."""

    def __init__(self) -> None:
        self.x = ctypes.CDLL(ctypes.util.find_library("X11") or "libX11.so.6")
        for name in ("XOpenDisplay", "XDefaultRootWindow", "XInternAtom", "XCreateSimpleWindow"):
            getattr(self.x, name).restype = POINTER if name == "XOpenDisplay" else ULONG
        self.display = POINTER(self.x.XOpenDisplay(None))
        assert self.display, "no X display"
        self.root = ULONG(self.x.XDefaultRootWindow(self.display))
        self.own = ULONG(self.x.XCreateSimpleWindow(self.display, self.root, 0, 0, 1, 1, 0, ULONG(0), ULONG(0)))

    def atom(self, name: str) -> int:
        return self.x.XInternAtom(self.display, name.encode(), False)

    def target(self) -> int:
        """Return the topmost window that takes drops."""
        found, queue = 0, [self.root.value]
        while queue:
            window = queue.pop(0)
            kind, form, count, left, data = ULONG(), INT(), ULONG(), ULONG(), POINTER()
            given = self.display, ULONG(window), ULONG(self.atom("XdndAware")), LONG(0), LONG(1), False, ULONG(0)
            self.x.XGetWindowProperty(*given, *map(ctypes.byref, (kind, form, count, left, data)))
            found = window if count.value else found
            root, parent, children, n = ULONG(), ULONG(), ctypes.POINTER(ULONG)(), ctypes.c_uint()
            out = map(ctypes.byref, (root, parent, children, n))
            if self.x.XQueryTree(self.display, ULONG(window), *out):
                queue += [children[k] for k in range(n.value)]
        return found

    def drop(self, x: int, y: int, files: list[str]) -> bool:
        """Drop files at a point of the screen; return whether the window took them."""
        window, uris = self.target(), "".join(f"{Path(f).resolve().as_uri()}\r\n" for f in files).encode()
        assert window, "no window takes drops"
        selection, kind = self.atom("XdndSelection"), self.atom("text/uri-list")
        self.x.XSetSelectionOwner(self.display, ULONG(selection), self.own, ULONG(0))
        self._send(window, "XdndEnter", VERSION << 24, kind, 0, 0)
        self._send(window, "XdndPosition", 0, x << 16 | y, 0, self.atom("XdndActionCopy"))
        if not self._until("XdndStatus").data[1] & 1:
            self._send(window, "XdndLeave", 0, 0, 0, 0)
            return False
        self._send(window, "XdndDrop", 0, 0, 0, 0)
        self._until("XdndFinished", uris)  # its flag is the number of bytes in GLFW
        return True

    def _send(self, window: int, message: str, *data: int) -> None:
        event = Event()
        event.client = ClientMessage(
            CLIENT_MESSAGE, 0, True, self.display, window, self.atom(message), 32, (LONG * 5)(self.own.value, *data)
        )
        self.x.XSendEvent(self.display, ULONG(window), False, LONG(0), ctypes.byref(event))
        self.x.XFlush(self.display)

    def _until(self, message: str, uris: bytes = b"") -> ClientMessage:
        """Return the next message of a kind; hand the files over meanwhile."""
        for _ in range(EVENTS):
            event = Event()
            self.x.XNextEvent(self.display, ctypes.byref(event))
            if event.type == SELECTION_REQUEST:
                self._give(event.request, uris)
            if event.type == CLIENT_MESSAGE and event.client.message == self.atom(message):
                return event.client
        raise AssertionError(f"no {message}")

    def _give(self, r: SelectionRequest, uris: bytes) -> None:
        to = self.display, ULONG(r.requestor)
        self.x.XChangeProperty(*to, ULONG(r.property), ULONG(r.target), 8, 0, uris, len(uris))
        event = Event()
        event.notify = SelectionNotify(
            SELECTION_NOTIFY, 0, True, self.display, r.requestor, r.selection, r.target, r.property, r.time
        )
        self.x.XSendEvent(*to, False, LONG(0), ctypes.byref(event))
        self.x.XFlush(self.display)


if __name__ == "__main__":
    x, y, *files = sys.argv[1:]
    sys.exit(0 if Source().drop(int(x), int(y), files) else 1)
