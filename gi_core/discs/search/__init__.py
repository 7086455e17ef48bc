"""Which segments cross which discs: searches of identical shape, each a superset of the same test.

A search is made from the `Discs` of one object and serves every frame. For the report's tables alone, all take a
pre-test, a key of PRETESTS, and `RayCache` can leave the discs unsorted: both only cost time.
`splat(lines, sign, sums, part, parts)` adds sign x flux of lines (`Lines`, in the discs' space) to the sums of the
discs they cross, and returns the number of crossings. It does one of `parts` shares of that work; several
threads may do one each, with sums of their own. Where `parts_share_lines`, a share is some of the discs with all
lines; where not, it is some of the lines: whoever makes lines ready need make ready only those of the share.
`told()` says in words what was built.
"""

from gi_core.discs.search.brute_force import BruteForce
from gi_core.discs.search.disc_index import DiscIndex
from gi_core.discs.search.pretest import PRETESTS
from gi_core.discs.search.ray_cache import RayCache

__all__ = ["PRETESTS", "SEARCHES"]

SEARCHES = {
    "disc_index": DiscIndex,
    "ray_cache": RayCache,
    "brute_force": BruteForce,
}
