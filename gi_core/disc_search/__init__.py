"""Which segments cross which discs: searches of identical shape, each a superset of the same test.

A search is made from the `Discs` of one object and a key of PRETESTS, and serves every frame.
`splat(lines, sign, sums, part, parts)` adds sign x flux of lines (`Lines`, in the discs' space) to the sums of the
discs they cross, and returns the number of crossings. It does one of `parts` shares of that work; several
threads may do one each, with sums of their own. Where `parts_share_lines`, a share is some of the discs with all
lines; where not, it is some of the lines: whoever makes lines ready need make ready only those of the share.
`told()` says in words what was built or chosen. One that tries candidates (`auto`) has `patient`, to be set False
while somebody waits for a frame, and `rehearse(n, ready)`, trials to be made when nobody does.
"""

from gi_core.disc_search.auto import Auto
from gi_core.disc_search.brute_force import BruteForce
from gi_core.disc_search.disc_index import DiscIndex
from gi_core.disc_search.pretest import PRETESTS
from gi_core.disc_search.ray_cache import RayCache, UnsortedRayCache

__all__ = ["PRETESTS", "SEARCHES"]

SEARCHES = {
    "auto": Auto,
    "disc_index": DiscIndex,
    "ray_cache": RayCache,
    "ray_cache_unsorted": UnsortedRayCache,
    "brute_force": BruteForce,
}
