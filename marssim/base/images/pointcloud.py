"""A depth map as coloured points (PLY) and as a mesh (GLB) that is cut where two surfaces only meet in the image."""

from __future__ import annotations

import numpy as np

from marssim.base.camera import PinholeCamera

CUT = 3.0  # pixel widths by which neighbours may lie off each other's tangent plane
GLTF_AXES = np.array([1.0, -1.0, -1.0])  # glTF: x right, y up, z towards the viewer


def coloured_points(
    image: np.ndarray, depth: np.ndarray, camera: PinholeCamera, farthest: float
) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) [m] in the camera's frame and their colours (N, 3) uint8.

    image: (H, W, 3) uint8; depth: (H, W) [m]. Left out is what is farther than `farthest` [m] or unknown.
    """
    keep = _known(depth, farthest)
    return (camera.rays()[keep] * depth[keep, None]).astype(np.float32), image[keep]


def surface_mesh(
    depth: np.ndarray, normal: np.ndarray, camera: PinholeCamera, farthest: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two triangles between each four neighbouring pixels, none across a depth edge.

    A triangle is kept if no corner lies more than CUT pixel widths, at the farther corner's depth, off the tangent
    plane of another. Ground at a slant, where depth changes fast without an edge, stays whole; silhouettes are cut.

    depth: (H, W) [m]; normal: (H, W, 3), camera frame. Returns vertices (V, 3) [m] in the camera's frame, faces (F, 3)
    whose normals face the camera, and the pixel (V,) of each vertex, counted along rows.
    """
    height, width = depth.shape
    known = _known(depth, farthest)
    points = camera.rays() * np.where(known, depth, 0)[..., None]
    allowed = CUT * np.where(known, depth, 0) / min(camera.fx, camera.fy)

    def joined(first: tuple[slice, slice], second: tuple[slice, slice]) -> np.ndarray:
        step = points[second] - points[first]
        off = np.maximum(
            np.abs(np.einsum("ijk,ijk->ij", step, normal[first])),
            np.abs(np.einsum("ijk,ijk->ij", step, normal[second])),
        )
        return known[first] & known[second] & (off <= np.maximum(allowed[first], allowed[second]))

    here, there, every = slice(None, -1), slice(1, None), slice(None)
    across = joined((every, here), (every, there))  # (H, W - 1)
    down = joined((here, every), (there, every))  # (H - 1, W)
    slanted = joined((there, here), (here, there))  # from lower left to upper right
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
    """A binary PLY of points (N, 3) with colours (N, 3) uint8; without points, a header that says so."""
    if not len(points):
        kinds = [f"property float {axis}" for axis in "xyz"] + [f"property uchar {c}" for c in ("red", "green", "blue")]
        lines = ["ply", "format binary_little_endian 1.0", "element vertex 0", *kinds, "end_header", ""]
        return "\n".join(lines).encode()
    import trimesh  # here, for it loads Embree

    return trimesh.PointCloud(points, colors=colours).export(file_type="ply")


def encode_glb(vertices: np.ndarray, faces: np.ndarray, colours: np.ndarray) -> bytes:
    """A binary glTF of a mesh with vertex colours (V, 3) uint8, turned from the camera's axes to glTF's.

    Raises ValueError if there are no faces.
    """
    if not len(faces):
        raise ValueError("a mesh needs at least one triangle")
    import trimesh

    mesh = trimesh.Trimesh(vertices * GLTF_AXES, faces, vertex_colors=colours, process=False)
    data = mesh.export(file_type="glb")
    assert isinstance(data, bytes)
    return data


def _known(depth: np.ndarray, farthest: float) -> np.ndarray:
    return np.isfinite(depth) & (depth > 0) & (depth <= farthest)
