"""Which segments cross which discs. A new search is one file that follows `base.Search`, and one line here."""

from gi_core.discs.search.base import Search
from gi_core.discs.search.brute_force import BruteForce
from gi_core.discs.search.disc_index import DiscIndex
from gi_core.discs.search.pretest import PRETESTS
from gi_core.discs.search.ray_cache import RayCache

__all__ = ["DEFAULT", "PRETESTS", "SEARCHES", "Search"]

DEFAULT = "disc_index"

SEARCHES: dict[str, type[Search]] = {
    "disc_index": DiscIndex,
    "ray_cache": RayCache,
    "brute_force": BruteForce,
}
