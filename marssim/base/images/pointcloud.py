"""Turn a depth map into coloured points (PLY), or into a mesh (GLB) that is cut at depth edges."""

from __future__ import annotations

import numpy as np

from marssim.base.camera import PinholeCamera

CUT = 3.0  # largest distance of a neighbour from the tangent plane, in pixel widths, that is no edge
FAR = 8192.0  # [m] from which on 32-bit floats are 1 mm apart
GLTF_AXES = np.array([1.0, -1.0, -1.0])  # glTF: x right, y up, z towards the viewer


def coloured_points(
    image: np.ndarray, depth: np.ndarray, camera: PinholeCamera, farthest: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points that a depth map shows, with the colours of their pixels.

    Args:
        image: (H, W, 3) uint8.
        depth: (H, W) [m]; pixels that are not finite or not positive are left out.
        camera: The camera.
        farthest: Depth beyond which pixels are left out [m].

    Returns:
        (N, 3) float32 points [m] in the camera frame, and (N, 3) uint8 colours.
    """
    keep = _within(depth, farthest)
    return (camera.rays()[keep] * depth[keep, None]).astype(np.float32), image[keep]


def surface_mesh(
    depth: np.ndarray, normal: np.ndarray, camera: PinholeCamera, farthest: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a mesh with two triangles between each four neighbouring pixels, and none across a depth edge.

    A triangle is kept if no corner lies more than CUT pixel widths, at the farther corner's depth, off the tangent
    plane of another corner. Slanted ground, where depth changes fast without an edge, stays whole; silhouettes are cut.

    Args:
        depth: (H, W) [m]; pixels that are not finite or not positive are left out.
        normal: (H, W, 3) unit vectors, camera frame.
        camera: The camera.
        farthest: Depth beyond which pixels are left out [m].

    Returns:
        (V, 3) vertices [m] in the camera frame; (F, 3) faces, whose normals face the camera; and (V,) the pixel of each
        vertex, row * width + column.
    """
    height, width = depth.shape
    valid = _within(depth, farthest)
    points = camera.rays() * np.where(valid, depth, 0)[..., None]
    allowed = CUT * np.where(valid, depth, 0) / min(camera.fx, camera.fy)

    def connected(first: tuple[slice, slice], second: tuple[slice, slice]) -> np.ndarray:
        """Return whether the two pixels of each pair lie on one surface."""
        step = points[second] - points[first]
        off = np.maximum(
            np.abs(np.einsum("ijk,ijk->ij", step, normal[first])),
            np.abs(np.einsum("ijk,ijk->ij", step, normal[second])),
        )
        return valid[first] & valid[second] & (off <= np.maximum(allowed[first], allowed[second]))

    head, tail, every = slice(None, -1), slice(1, None), slice(None)
    across = connected((every, head), (every, tail))  # (H, W - 1)
    down = connected((head, every), (tail, every))  # (H - 1, W)
    slanted = connected((tail, head), (head, tail))  # (H - 1, W - 1), from lower left to upper right
    index = np.arange(height * width).reshape(height, width)
    upper_left, upper_right, lower_left, lower_right = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    first = down[:, :-1] & across[:-1] & slanted
    second = down[:, 1:] & across[1:] & slanted
    faces = np.concatenate(
        [
            np.stack([upper_left[first], lower_left[first], upper_right[first]], axis=1),
            np.stack([lower_left[second], lower_right[second], upper_right[second]], axis=1),
        ]
    )
    pixel, corner = np.unique(faces, return_inverse=True)
    return points.reshape(-1, 3)[pixel], corner.reshape(-1, 3), pixel


def encode_ply(points: np.ndarray, colours: np.ndarray) -> bytes:
    """Encode coloured points as a binary PLY, in 32-bit floats, or in 64 bits if these would round by millimetres.

    Args:
        points: (N, 3) [m]; without points, the file is a header alone.
        colours: (N, 3) uint8.

    Returns:
        The content of the file.
    """
    if not len(points):
        kinds = [f"property float {axis}" for axis in "xyz"] + [f"property uchar {c}" for c in ("red", "green", "blue")]
        lines = ["ply", "format binary_little_endian 1.0", "element vertex 0", *kinds, "end_header", ""]
        return "\n".join(lines).encode()
    if np.abs(points).max() > FAR:
        return _encode_wide(points, colours)
    import trimesh  # not at the top, since it loads Embree

    return trimesh.PointCloud(points.astype(np.float32), colors=colours).export(file_type="ply")


def encode_glb(vertices: np.ndarray, faces: np.ndarray, colours: np.ndarray) -> bytes:
    """Encode a mesh as a binary glTF (GLB).

    Args:
        vertices: (V, 3) [m], camera frame; the file has glTF's axes.
        faces: (F, 3), at least one.
        colours: (V, 3) uint8 colours of the vertices.

    Returns:
        The content of the file.

    Raises:
        ValueError: There are no faces.
    """
    if not len(faces):
        raise ValueError("a mesh needs at least one triangle")
    import trimesh

    mesh = trimesh.Trimesh(vertices * GLTF_AXES, faces, vertex_colors=colours, process=False)
    data = mesh.export(file_type="glb")
    assert isinstance(data, bytes)
    return data


def _encode_wide(points: np.ndarray, colours: np.ndarray) -> bytes:
    """Encode coloured points as a binary PLY with 64-bit coordinates."""
    names = [*"xyz", "red", "green", "blue"]
    rows = np.zeros(len(points), [(name, "<f8" if name in "xyz" else "u1") for name in names])
    for name, column in zip(names, (*points.T, *colours.T), strict=True):
        rows[name] = column
    kinds = [f"property {'double' if name in 'xyz' else 'uchar'} {name}" for name in names]
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}", *kinds, "end_header", ""]
    return "\n".join(lines).encode() + rows.tobytes()


def _within(depth: np.ndarray, farthest: float) -> np.ndarray:
    """Return (H, W) bool, whether depth [m] is valid and at most `farthest`."""
    return np.isfinite(depth) & (depth > 0) & (depth <= farthest)
