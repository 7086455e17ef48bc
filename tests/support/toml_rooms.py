"""Scene files of rooms, written by tests: z is up, the floor at 0, the middle of the floor at the origin."""

import json
from pathlib import Path
from typing import Any


def value(v: Any) -> str:
    """Return a value as TOML."""
    if isinstance(v, dict):
        return "{ " + ", ".join(f"{json.dumps(k)} = {value(x)}" for k, x in v.items()) + " }"
    return f"[{', '.join(map(value, v))}]" if isinstance(v, list | tuple) else json.dumps(v)


def table(name: str, /, **keys: Any) -> str:
    """Return an entry of an array of tables."""
    return "\n".join((f"[[{name}]]", *(f"{k} = {value(v)}" for k, v in keys.items()), ""))


def room_file(folder: Path, size, *tables: str, reflectance: float = 0.5, room: Any = (), **keys: Any) -> Path:
    """Write room.toml: a room of width, depth and height [m], with tables; room, keys: further keys of both.

    Edges stay as they are.
    """
    head = {"up": "z", "units": "photometric", "static": {"max_edge": 100}}
    head |= {"materials": {"room": {"reflectance": (reflectance,) * 3}}} | keys
    walls = table("shape", type="room", name="room", size=size, **dict(room))
    path = folder / "room.toml"
    path.write_text("\n".join((*(f"{k} = {value(v)}" for k, v in head.items()), walls, *tables)))
    return path
