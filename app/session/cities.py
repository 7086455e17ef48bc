"""Cities of the IANA time zone database: where they lie, and their clocks."""

from __future__ import annotations

import datetime
import importlib.util
import re
import zoneinfo
from functools import lru_cache
from pathlib import Path

FILE = "zone.tab"  # of the database; its columns: country, place by ISO 6709, zone


@lru_cache(maxsize=1)
def cities() -> dict[str, tuple[float, float]]:
    """Return latitude and longitude [degrees] by zone, such as "Europe/Madrid"; empty without the database."""
    module = importlib.util.find_spec("tzdata")
    own = [str(Path(folder) / "zoneinfo") for folder in (module.submodule_search_locations or ())] if module else []
    file = next((path for folder in (*zoneinfo.TZPATH, *own) if (path := Path(folder) / FILE).is_file()), None)
    if file is None:
        return {}
    rows = (line.split("\t") for line in file.read_text(encoding="utf-8").splitlines() if not line.startswith("#"))
    return {row[2]: _place(row[1]) for row in sorted(rows, key=lambda row: name_of(row[2]))}


def _place(text: str) -> tuple[float, float]:
    """Return latitude and longitude [degrees] of ISO 6709: +DDMM+DDDMM, or with seconds."""
    latitude, longitude = re.findall(r"[+-]\d+", text)
    return _degrees(latitude, 2), _degrees(longitude, 3)


def _degrees(text: str, digits: int) -> float:
    parts = text[1 : 1 + digits], text[1 + digits : 3 + digits], text[3 + digits :] or "0"
    value = sum(float(part) / 60**k for k, part in enumerate(parts))
    return round(-value if text[0] == "-" else value, 4)


def name_of(zone: str) -> str:
    """Return the name of a city: Buenos Aires, Argentina of "America/Argentina/Buenos_Aires"."""
    _, *area, city = zone.replace("_", " ").split("/")
    return ", ".join((city, *area))


def zone_at(place: tuple[float, float]) -> str:
    """Return the zone of a city that lies exactly at a place, "" for none."""
    return next((zone for zone, at in cities().items() if at == place), "")


def utc_offset(zone: str, date: str, hour: float) -> float:
    """Return the hours that the clock of a zone is ahead of UTC at an hour of a day; summer time included."""
    when = datetime.datetime.fromisoformat(date) + datetime.timedelta(hours=hour)
    ahead = when.replace(tzinfo=zoneinfo.ZoneInfo(zone)).utcoffset()
    return ahead.total_seconds() / 3600 if ahead is not None else 0.0
