"""The registry of acceleration structures, and the queries that kernels put to whichever they are given.

A structure is one module and one line of STRUCTURES. The module has

    build(meshes[, leaf]) -> scenes    of objects, each vertices (V, 3) and faces (F, 3); leaf: triangles per leaf
    trace(scenes, o, ray, ox, oy, oz, dx, dy, dz, limit, any_hit) -> distance float32, face int32

`scenes` is a NamedTuple of arrays, of a class of that module, or Embree's array of addresses. Numba chooses trace() by
its type, so kernels above name no structure, and only those that run are compiled. trace() is a kernel; it returns the
nearest hit of object o, or with `any_hit` the first that it finds, (limit, -1) for none. All but Embree's use the test
in `triangles.py`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types
from numba.extending import overload

from gi_core.base.kernel_cache import problems
from gi_core.rays import binary_tree, bsp, bvh, grid3d, octree, triangles
from gi_core.scene.rules import one_of

try:
    from gi_core.rays import embree
except (ImportError, OSError) as error:  # no wheel for this platform, or another version
    embree = None
    problems.append(f"Embree cannot be loaded ({error}): rays are traced by bvh, in up to 2.5 times the time")

STRUCTURES: dict[str, Any] = ({"embree": embree} if embree else {}) | {
    "bvh": bvh,
    "grid3d": grid3d,
    "octree": octree,
    "binary_tree": binary_tree,
    "bsp": bsp,
    "none": triangles,  # no structure
}
DEFAULT = next(iter(STRUCTURES))


def checked(name: str | None) -> str:
    """Return the name of a structure; the default for None. Raises SceneError for any other name."""
    return DEFAULT if name is None else one_of(STRUCTURES).check("rays", name)


def new_ray() -> np.ndarray:
    """Return the buffer (1024,) float32 of one ray at a time of one thread, 16-byte aligned."""
    room = np.zeros(triangles.WORDS + 3, np.float32)
    first = -(room.ctypes.data // 4) % 4  # Embree needs 16-byte alignment
    ray = room[first : first + triangles.WORDS]
    if embree:
        ray.view(np.int32)[embree.MASK] = -1
    return ray


def nearest_hit(scenes, o, ray, ox, oy, oz, dx, dy, dz, limit):
    """Return distance (limit for none) and face (-1 for none) of a ray's nearest hit on object o, in its space.

    scenes: of an Accelerator; ray: new_ray(); origin and unit direction: float32. For kernels only.
    """
    raise NotImplementedError


def any_hit(scenes, o, ray, ox, oy, oz, dx, dy, dz, limit):
    """Return whether a ray hits object o before its limit; arguments as nearest_hit()."""
    raise NotImplementedError


def _trace(scenes: types.Type) -> Callable:
    """Return trace() of the module that a scene record is of."""
    is_ours = isinstance(scenes, types.NamedTuple)
    return (sys.modules[scenes.instance_class.__module__] if is_ours else embree).trace


@overload(nearest_hit, inline="always")
def _nearest_hit(scenes, o, ray, ox, oy, oz, dx, dy, dz, limit):
    trace = _trace(scenes)
    return lambda scenes, o, ray, ox, oy, oz, dx, dy, dz, limit: trace(
        scenes, o, ray, ox, oy, oz, dx, dy, dz, limit, False
    )


@overload(any_hit, inline="always")
def _any_hit(scenes, o, ray, ox, oy, oz, dx, dy, dz, limit):
    trace = _trace(scenes)
    return lambda scenes, o, ray, ox, oy, oz, dx, dy, dz, limit: (
        trace(scenes, o, ray, ox, oy, oz, dx, dy, dz, limit, True)[1] >= 0
    )
