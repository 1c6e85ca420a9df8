# SPDX-License-Identifier: Apache-2.0
"""Casts rays at a mesh: through Embree's C interface where the system has it, else through Open3D.

Both are Embree, but Open3D hands it one ray at a time; a stream of coherent rays takes a third of
the time.
"""

import ctypes
import logging
from typing import Optional

import numpy as np

from fcsv_sim.errors import RenderError
from fcsv_sim.render.rays import DX, OX, PRIM, T

_log = logging.getLogger(__name__)
_LIBRARY = "libembree3.so.3"
_BUFFER_INDEX, _BUFFER_VERTEX = 0, 1  # RTCBufferType
_UINT3, _FLOAT3 = 0x5003, 0x9003  # RTCFormat
_COHERENT = 1  # RTC_INTERSECT_CONTEXT_FLAG_COHERENT
_NONE = 0xFFFFFFFF
_POINTER, _UINT, _INT, _SIZE = ctypes.c_void_p, ctypes.c_uint, ctypes.c_int, ctypes.c_size_t
_SIGNATURES = {
    "rtcNewDevice": ([ctypes.c_char_p], _POINTER),
    "rtcGetDeviceError": ([_POINTER], _INT),
    "rtcReleaseDevice": ([_POINTER], None),
    "rtcNewScene": ([_POINTER], _POINTER),
    "rtcReleaseScene": ([_POINTER], None),
    "rtcNewGeometry": ([_POINTER, _INT], _POINTER),
    "rtcSetSharedGeometryBuffer": (
        [_POINTER, _INT, _UINT, _INT, _POINTER, _SIZE, _SIZE, _SIZE],
        None,
    ),
    "rtcCommitGeometry": ([_POINTER], None),
    "rtcAttachGeometry": ([_POINTER, _POINTER], _UINT),
    "rtcReleaseGeometry": ([_POINTER], None),
    "rtcCommitScene": ([_POINTER], None),
    "rtcIntersect1M": ([_POINTER, _POINTER, _POINTER, _UINT, _SIZE], None),
}


class _Context(ctypes.Structure):
    """RTCIntersectContext; the last field exists in some builds only and is ignored by the
    others."""

    _fields_ = [
        ("flags", _INT),
        ("filter", _POINTER),
        ("instance", _UINT),
        ("min_width", ctypes.c_float),
    ]


class EmbreeCaster:
    """vertices (N,3) f32, triangles (M,3). Raises RenderError where the library is missing or
    refuses."""

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray, threads: int = 1):
        self._device: Optional[int] = None
        try:
            self._library = ctypes.CDLL(_LIBRARY)
        except OSError as error:
            raise RenderError(
                f"{_LIBRARY} is not installed ({error}); install libembree3-3"
            ) from error
        for name, (arguments, result) in _SIGNATURES.items():
            function = getattr(self._library, name)
            function.argtypes, function.restype = arguments, result
        # Embree reads 16 bytes at the last vertex: one more keeps it inside the buffer
        self._vertices = np.concatenate([vertices, vertices[:1]]).astype(np.float32)
        self._triangles = np.ascontiguousarray(triangles, np.uint32)
        self._context = _Context(_COHERENT, None, _NONE, 0.0)
        self._device = self._library.rtcNewDevice(f"threads={threads}".encode())
        self._scene = self._library.rtcNewScene(self._device)
        self._build(len(vertices))

    def _build(self, vertex_count: int) -> None:
        lib = self._library
        geometry = lib.rtcNewGeometry(self._device, 0)  # RTC_GEOMETRY_TYPE_TRIANGLE
        buffers = (
            (_BUFFER_VERTEX, _FLOAT3, self._vertices, vertex_count),
            (_BUFFER_INDEX, _UINT3, self._triangles, len(self._triangles)),
        )
        for kind, form, array, count in buffers:
            lib.rtcSetSharedGeometryBuffer(geometry, kind, 0, form, array.ctypes.data, 0, 12, count)
        lib.rtcCommitGeometry(geometry)
        lib.rtcAttachGeometry(self._scene, geometry)
        lib.rtcReleaseGeometry(geometry)
        lib.rtcCommitScene(self._scene)
        code = lib.rtcGetDeviceError(self._device)
        if code:
            raise RenderError(f"Embree refused the mesh (error {code})")

    def cast(self, rays: np.ndarray) -> None:
        """Set distance and triangle of every ray (N,20; rays.py) in place."""
        self._library.rtcIntersect1M(
            self._scene, ctypes.byref(self._context), rays.ctypes.data, len(rays), 80
        )

    def __del__(self):
        if self._device is not None:
            self._library.rtcReleaseScene(self._scene)
            self._library.rtcReleaseDevice(self._device)


class Open3dCaster:
    """The same through Open3D, which brings Embree along."""

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray, threads: int = 1):
        import open3d as o3d  # a second of import that only this path needs

        self._tensor = o3d.core.Tensor
        self._threads = threads
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=threads)
        self._scene.add_triangles(self._tensor(vertices), self._tensor(triangles.astype(np.uint32)))

    def cast(self, rays: np.ndarray) -> None:
        """Set distance and triangle of every ray (N,20; rays.py) in place."""
        plain = np.ascontiguousarray(rays[:, [OX, OX + 1, OX + 2, DX, DX + 1, DX + 2]])
        hits = self._scene.cast_rays(self._tensor.from_numpy(plain), nthreads=self._threads)
        rays[:, T] = hits["t_hit"].numpy()
        rays.view(np.uint32)[:, PRIM] = hits["primitive_ids"].numpy()


def make_caster(vertices: np.ndarray, triangles: np.ndarray, threads: int = 1):
    """The fastest that this machine has."""
    try:
        return EmbreeCaster(vertices, triangles, threads)
    except RenderError as error:
        _log.warning("%s; rays are cast through Open3D, three times slower", error)
        return Open3dCaster(vertices, triangles, threads)
