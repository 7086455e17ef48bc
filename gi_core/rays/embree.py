"""Embree's C functions as functions that kernels call, one ray per call.

The package embreex ships the library. A ray costs the same as in embreex's own loop over arrays of rays, but its data
stays in registers, and a bounce needs no Python.
"""

from __future__ import annotations

import ctypes
import weakref
from pathlib import Path

import llvmlite.binding
import numpy as np
from embreex import rtcore_scene
from numba import types

from gi_core.base.jit import inlined
from gi_core.rays.triangles import Meshes

_MAJOR = 4  # of the library: earlier versions take other arguments
_QUERIES = ("rtcIntersect1", "rtcOccluded1")


def _library() -> ctypes.CDLL:
    """Return the Embree library that embreex has loaded.

    An extension module exports the symbols of the libraries that it is linked to; not on Windows.
    """
    module = Path(rtcore_scene.__file__)
    for path in [module, *sorted((module.parent.parent / "embreex.libs").glob("embree*.dll"))]:
        library = ctypes.CDLL(str(path))
        if hasattr(library, "rtcGetDeviceProperty"):
            return library
    raise ImportError("the package embreex exports no Embree functions; install embreex 4.4 or later")


def _declared(name: str, result, *arguments):
    function = getattr(_EMBREE, name)
    function.restype, function.argtypes = result, arguments
    return function


_EMBREE = _library()
_P, _I, _U, _N = ctypes.c_void_p, ctypes.c_int, ctypes.c_uint, ctypes.c_size_t
_new_device = _declared("rtcNewDevice", _P, ctypes.c_char_p)
_property = _declared("rtcGetDeviceProperty", ctypes.c_ssize_t, _P, _I)
_error = _declared("rtcGetDeviceError", _I, _P)
_new_scene = _declared("rtcNewScene", _P, _P)
_set_flags = _declared("rtcSetSceneFlags", None, _P, _I)
_new_geometry = _declared("rtcNewGeometry", _P, _P, _I)
_new_buffer = _declared("rtcSetNewGeometryBuffer", _P, _P, _I, _U, _I, _N, _N)
_commit_geometry = _declared("rtcCommitGeometry", None, _P)
_attach = _declared("rtcAttachGeometry", _U, _P, _P)
_release_geometry = _declared("rtcReleaseGeometry", None, _P)
_commit_scene = _declared("rtcCommitScene", None, _P)
_release_scene = _declared("rtcReleaseScene", None, _P)

_DEVICE = _new_device(None)
VERSION = int(_property(_DEVICE, 0))  # 10000 major + 100 minor + patch
if VERSION // 10_000 != _MAJOR:
    raise ImportError(f"embreex ships Embree {VERSION // 10_000}, not {_MAJOR}; install embreex 4.4 or later")
for _name in _QUERIES:  # kernels, also those from the disk cache, are linked by these names
    llvmlite.binding.add_symbol(_name, ctypes.cast(getattr(_EMBREE, _name), _P).value)
_intersect, _occluded = (types.ExternalFunction(n, types.void(*(types.intp,) * 3)) for n in _QUERIES)


class EmbreeMesh:
    """An Embree scene of one mesh. Vertices (V, 3) and faces (F, 3) are copied as float32 and uint32.

    Raises MemoryError if Embree cannot build it.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray):
        self.address = _new_scene(_DEVICE)  # of the Embree scene, for kernels
        # Not at exit of Python: a thread that still runs may trace rays.
        weakref.finalize(self, _release_scene, self.address).atexit = False
        _set_flags(self.address, 1 << 2)  # scene flag: no ray slips through between two triangles
        geometry = _new_geometry(_DEVICE, 0)  # RTC_GEOMETRY_TYPE_TRIANGLE
        for kind, layout, rows in (  # RTC_BUFFER_TYPE_VERTEX of RTC_FORMAT_FLOAT3, ..._INDEX of ..._UINT3
            (1, 0x9003, np.ascontiguousarray(vertices, np.float32)),
            (0, 0x5003, np.ascontiguousarray(faces, np.uint32)),
        ):
            room = _new_buffer(geometry, kind, 0, layout, rows.strides[0], len(rows))
            if not room:
                raise MemoryError(f"no memory for the acceleration structure of {len(faces):,} triangles")
            ctypes.memmove(room, rows.ctypes.data, rows.nbytes)
        _commit_geometry(geometry)
        _attach(self.address, geometry)
        _release_geometry(geometry)
        _commit_scene(self.address)
        if _error(_DEVICE):
            raise MemoryError(f"Embree could not build the acceleration structure of {len(faces):,} triangles")


def build(meshes: Meshes) -> np.ndarray:
    """Return the addresses (objects,) int64 of the Embree scenes of meshes, 0 for an empty one.

    They live as long as the array.
    """
    made = [EmbreeMesh(v, f) if len(f) else None for v, f in meshes]
    scenes = np.array([m.address if m else 0 for m in made], np.int64)
    weakref.finalize(scenes, made.clear).atexit = False
    return scenes


# Words of RTCRayHit: origin, tnear, direction, time, tfar, mask, id, flags; then the hit, instance last.
_TFAR, MASK, _PRIMITIVE = 8, 9, 17


@inlined
def trace(scenes, o, ray, ox, oy, oz, dx, dy, dz, limit, any_hit):
    """Return distance and triangle of the nearest hit; limit and -1 for none. Of any hit, the triangle is 0.

    scenes: of build(); ray: a buffer (24 or more,) float32, 16-byte aligned; direction: unit.
    """
    scene, numbers = scenes[o], ray.view(np.int32)
    ray[0], ray[1], ray[2] = ox, oy, oz
    ray[4], ray[5], ray[6] = dx, dy, dz
    ray[_TFAR] = limit
    numbers[_PRIMITIVE] = numbers[18] = numbers[19] = -1
    if scene != 0 and any_hit:
        _occluded(scene, ray.ctypes.data, 0)
        numbers[_PRIMITIVE] = 0 if ray[_TFAR] < 0.0 else -1
    elif scene != 0:
        _intersect(scene, ray.ctypes.data, 0)
    return ray[_TFAR], numbers[_PRIMITIVE]
