"""Rays against triangles with Embree 4, by the C interface of the library that embreex brings.

embreex's own interface copies a mesh in Python, number by number, which takes as long as Embree needs to sort it, and
shoots rays one by one. Here Embree reads the arrays where they are, and takes rays in packets, which is three times as
fast where neighbours go alike.
"""

from __future__ import annotations

import ctypes
import weakref
from functools import cache
from importlib import metadata

import numpy as np

from marssim.base.compute.compiled import compiled

FAR = 1e9  # lengths of a ray's direction: beyond everything
TRIANGLES, INDICES, VERTICES, UINT3, FLOAT3 = 0, 0, 1, 0x5003, 0x9003  # of RTCGeometryType, RTCBufferType, RTCFormat
ROBUST = 4  # of RTCSceneFlags: no ray slips through between neighbours
COHERENT = 1 << 16  # of RTCRayQueryFlags: neighbouring rays go alike
LANES = 8  # rays in a packet: what AVX2 takes at once; 16 are no faster with AVX-512, and far slower without
# rows of RTCRayHit8, of LANES numbers of 4 bytes each, that are not left at 0
ORIGIN, DIRECTION, REACH, MASK, PRIMITIVE, GEOMETRY, ROWS = 0, 4, 8, 9, 17, 18, 21
_ARGUMENTS = (ctypes.c_uint64 * 6)(0xFFFFFFFF << 32 | COHERENT)  # RTCIntersectArguments: flags, all features, no calls


class TriangleRays:
    """Triangles that rays are shot at.

    vertices: (V, 3) [m], taken in float32; faces: (F, 3) int, not copied if int32, and then not to be written to.
    Raises ImportError without embreex or where it does not work, ValueError for faces of other vertices.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        embree, device = _embree()
        faces = np.asarray(faces).reshape(-1, 3)
        if len(faces) and not (faces.min() >= 0 and faces.max() < len(vertices)):
            raise ValueError(f"faces must be of the {len(vertices)} vertices, got {faces.min()} to {faces.max()}")
        # both are read as long as the scene lives, 16 bytes from the start of each vertex
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
        """Which face each ray meets first, and how far away. Raises RuntimeError after close.

        origins: (N, 3), or (1, 3) for all rays; directions: (N, 3); reach: (N,) how far to look, in lengths of the
        direction, None for any distance. All are taken in float32.
        Returns (N,) int32, -1 where there is none, and (N,) float32 in lengths of the direction, the reach there.
        """
        if not self._free.alive:
            raise RuntimeError("these triangles are closed")
        origins, directions = (np.ascontiguousarray(each, dtype=np.float32) for each in (origins, directions))
        if directions.ndim != 2 or directions.shape[1] != 3 or origins.shape not in ((1, 3), directions.shape):
            raise ValueError(f"origins {origins.shape} and directions {directions.shape} are no (N, 3) each")
        limit = np.full(len(directions), FAR if reach is None else reach, dtype=np.float32)
        embree, _ = _embree()
        face = _meet(embree.rtcIntersect8, self._scene, ctypes.addressof(_ARGUMENTS), origins, directions, limit)
        return face, limit

    def close(self) -> None:
        """Free what Embree holds; may be called twice."""
        self._free()


@cache
def _embree() -> tuple[ctypes.CDLL, int]:
    """Embree's library, and a device of it that works in the thread that calls."""
    from embreex import rtcore_scene

    brought = [str(file.locate()) for file in metadata.files("embreex") or () if "embree4" in file.name]
    # where the package brings no library, its module is linked to one, whose functions are found through it
    library = brought[0] if brought else rtcore_scene.__file__
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
    """Faces (N,) that rays meet within the limit (N,), which becomes how far away that is."""
    out = np.empty(len(limit), dtype=np.int32)
    memory = np.zeros((ROWS + 2) * LANES, dtype=np.float32)
    memory = memory[(-memory.ctypes.data % 32) // 4 :]  # Embree wants packets at multiples of 32 bytes
    packet, used = memory[: ROWS * LANES].reshape(ROWS, LANES), memory[ROWS * LANES :].view(np.int32)
    whole = packet.view(np.int32)
    whole[MASK], used[:] = -1, -1
    for first in range(0, len(limit), LANES):
        count = min(LANES, len(limit) - first)  # what the last packet holds beyond is shot for nothing
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
