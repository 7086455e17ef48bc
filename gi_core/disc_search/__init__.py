"""Which segments cross which discs: searches of identical shape, each a superset of the same test."""

from gi_core.disc_search.brute_force import BruteForce
from gi_core.disc_search.disc_index import DiscIndex

SEARCHES = {"disc_index": DiscIndex, "brute_force": BruteForce}
