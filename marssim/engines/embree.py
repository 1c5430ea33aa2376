"""Ray casting with Embree 4, through the C interface of the library that the package embreex contains.

embreex's Python interface copies a mesh number by number, which takes as long as Embree needs to build its tree, and
casts rays one by one. Here Embree reads the arrays in place and takes rays in packets, which is three times as fast
where neighbouring rays are nearly parallel.
"""

from __future__ import annotations

import ctypes
import weakref
from functools import cache
from importlib import metadata

import numpy as np

from marssim.base.compute.compiled import compiled

FAR = 1e9  # longest ray, in lengths of its direction: beyond everything
TRIANGLES, INDICES, VERTICES, UINT3, FLOAT3 = 0, 0, 1, 0x5003, 0x9003  # RTCGeometryType, RTCBufferType, RTCFormat
ROBUST = 4  # RTCSceneFlags: no ray slips through between neighbouring triangles
COHERENT = 1 << 16  # RTCRayQueryFlags: neighbouring rays are nearly parallel
LANES = 8  # rays in a packet, the width of AVX2; 16 are no faster with AVX-512, and far slower without
# the rows of RTCRayHit8 that are not left at 0; each row has LANES numbers of 4 bytes
ORIGIN, DIRECTION, REACH, MASK, PRIMITIVE, GEOMETRY, ROWS = 0, 4, 8, 9, 17, 18, 21
_ARGUMENTS = (ctypes.c_uint64 * 6)(0xFFFFFFFF << 32 | COHERENT)  # RTCIntersectArguments: all features, no callbacks


class TriangleRays:
    """Triangles that rays are cast at.

    Args:
        vertices: (V, 3) [m]; converted to float32.
        faces: (F, 3) indices of vertices. An int32 array is not copied, so do not write to it later.

    Raises:
        ImportError: embreex is not installed or does not work here.
        ValueError: A face names a vertex that does not exist.
        RuntimeError: Embree refuses the mesh.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        embree, device = _embree()
        faces = np.asarray(faces).reshape(-1, 3)
        if len(faces) and not (faces.min() >= 0 and faces.max() < len(vertices)):
            raise ValueError(f"faces must be of the {len(vertices)} vertices, got {faces.min()} to {faces.max()}")
        # Embree reads both while the scene lives, and 16 bytes from the start of each vertex: hence one vertex more
        self._vertices = np.zeros((len(vertices) + 1, 3), dtype=np.float32)
        self._vertices[:-1] = vertices
        self._faces = np.ascontiguousarray(faces, dtype=np.int32)
        self._scene = embree.rtcNewScene(device)
        self._free = weakref.finalize(self, embree.rtcReleaseScene, self._scene)
        embree.rtcSetSceneFlags(self._scene, ROBUST)
        geometry = embree.rtcNewGeometry(device, TRIANGLES)
        for buffer, form, array, count in (
            (VERTICES, FLOAT3, self._vertices, len(vertices)), (INDICES, UINT3, self._faces, len(self._faces)),
        ):  # fmt: skip
            embree.rtcSetSharedGeometryBuffer(geometry, buffer, 0, form, array.ctypes.data, 0, 12, count)
        embree.rtcCommitGeometry(geometry)
        embree.rtcAttachGeometry(self._scene, geometry)
        embree.rtcReleaseGeometry(geometry)
        embree.rtcCommitScene(self._scene)
        if error := embree.rtcGetDeviceError(device):
            raise RuntimeError(f"Embree refuses a mesh of {len(self._faces)} triangles: error {error}")

    def meet(
        self, origins: np.ndarray, directions: np.ndarray, reach: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return which face each ray hits first, and at what distance. Computed in float32.

        Args:
            origins: (N, 3) start of each ray [m], or (1, 3) for all rays.
            directions: (N, 3) direction of each ray, of any length.
            reach: (N,) length of each ray, in lengths of its direction; None for no limit.

        Returns:
            (N,) int32 face, -1 where the ray hits none; and (N,) float32 distance in lengths of the direction, equal to
            the reach where the ray hits none.

        Raises:
            RuntimeError: The triangles are closed.
            ValueError: The arrays' shapes do not fit.
        """
        if not self._free.alive:
            raise RuntimeError("these triangles are closed")
        origins, directions = (np.ascontiguousarray(each, dtype=np.float32) for each in (origins, directions))
        if directions.ndim != 2 or directions.shape[1] != 3 or origins.shape not in ((1, 3), directions.shape):
            raise ValueError(f"origins and directions must be (N, 3) each, got {origins.shape} and {directions.shape}")
        limit = np.full(len(directions), FAR if reach is None else reach, dtype=np.float32)
        embree, _ = _embree()
        face = _meet(embree.rtcIntersect8, self._scene, ctypes.addressof(_ARGUMENTS), origins, directions, limit)
        return face, limit

    def close(self) -> None:
        """Free Embree's memory; a second call does nothing."""
        self._free()


@cache
def _embree() -> tuple[ctypes.CDLL, int]:
    """Load Embree's library and return it with a device that works in the calling thread."""
    try:
        from embreex import rtcore_scene
    except ImportError as error:
        raise ImportError(
            f"embreex cannot be imported ({error}): the renderer embree and the rover need its rays; "
            "the renderer scan does without"
        ) from None

    bundled = [str(file.locate()) for file in metadata.files("embreex") or () if "embree4" in file.name]
    # a package without a bundled library has a module that is linked to one: its functions are found through the module
    library = bundled[0] if bundled else rtcore_scene.__file__
    embree = ctypes.CDLL(library)
    number, address = ctypes.c_int, ctypes.c_size_t
    for name, result, arguments in (
        ("NewDevice", address, [ctypes.c_char_p]),
        ("GetDeviceError", number, [address]),
        ("NewScene", address, [address]),
        ("SetSceneFlags", None, [address, number]),
        ("CommitScene", None, [address]),
        ("ReleaseScene", None, [address]),
        ("NewGeometry", address, [address, number]),
        ("SetSharedGeometryBuffer", None, [address, number, number, number, address, address, address, address]),
        ("CommitGeometry", None, [address]),
        ("AttachGeometry", number, [address, address]),
        ("ReleaseGeometry", None, [address]),
        ("Intersect8", None, [address, address, address, address]),
    ):
        try:
            function = getattr(embree, "rtc" + name)
        except AttributeError:
            raise ImportError(f"{library}: is no Embree 4 (it has no rtc{name})") from None
        function.restype, function.argtypes = result, arguments
    device = embree.rtcNewDevice(b"threads=1")
    if not device:
        raise ImportError(f"Embree gives no device: error {embree.rtcGetDeviceError(None)}")
    return embree, device


@compiled
def _meet(intersect, scene, arguments, origins, directions, limit):
    """Return the faces (N,) that rays hit within limit (N,), and overwrite limit with the distances."""
    out = np.empty(len(limit), dtype=np.int32)
    memory = np.zeros((ROWS + 2) * LANES, dtype=np.float32)
    memory = memory[(-memory.ctypes.data % 32) // 4 :]  # Embree wants packets at multiples of 32 bytes
    packet, used = memory[: ROWS * LANES].reshape(ROWS, LANES), memory[ROWS * LANES :].view(np.int32)
    whole = packet.view(np.int32)
    whole[MASK], used[:] = -1, -1
    for first in range(0, len(limit), LANES):
        count = min(LANES, len(limit) - first)  # the last packet may hold leftover rays; their hits are ignored
        for k in range(count):
            start = first + k if len(origins) > 1 else 0
            for axis in range(3):
                packet[ORIGIN + axis, k] = origins[start, axis]
                packet[DIRECTION + axis, k] = directions[first + k, axis]
            packet[REACH, k] = limit[first + k]
            whole[PRIMITIVE, k] = whole[GEOMETRY, k] = -1
        intersect(used.ctypes.data, scene, packet.ctypes.data, arguments)
        for k in range(count):
            out[first + k], limit[first + k] = whole[PRIMITIVE, k], packet[REACH, k]
    return out
