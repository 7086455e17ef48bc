"""Cities: place and clock by the time zone database."""

import zoneinfo

import pytest

from app.session.cities import cities, name_of, utc_offset, zone_at


def test_a_city_has_its_place_and_its_clock():
    assert cities()["Europe/Madrid"] == pytest.approx((40.4, -3.6833)) and len(cities()) > 300
    assert cities()["America/Los_Angeles"] == (34.0522, -118.2428), "this one has seconds"
    assert all(abs(a) <= 90 and abs(b) <= 180 for a, b in cities().values())
    assert utc_offset("Europe/Madrid", "2026-03-21", 9.0) == 1.0
    assert utc_offset("Europe/Madrid", "2026-06-21", 9.0) == 2.0, "summer time"
    assert utc_offset("Asia/Kolkata", "2026-06-21", 9.0) == 5.5
    assert zone_at(cities()["Europe/Madrid"]) == "Europe/Madrid" and zone_at((40.4, -3.7)) == ""
    assert name_of("America/Argentina/Buenos_Aires") == "Buenos Aires, Argentina"
    names = [name_of(zone) for zone in cities()]
    assert names == sorted(names)


def test_without_a_database_there_are_no_cities(monkeypatch):
    cities.cache_clear()
    monkeypatch.setattr(zoneinfo, "TZPATH", ())
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    try:
        assert cities() == {} and zone_at((40.4, -3.7)) == ""
    finally:
        cities.cache_clear()
