"""Scan conversion in double precision: which triangle each pixel's ray hits.

The rays through a camera's pixel centres need no search: each triangle is tested against the pixels that it covers. The
test is that of a ray against a triangle (triangles.py), so the results are those of ray casting, but no acceleration
structure has to be built.
"""

from __future__ import annotations

import math

import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.base.compute.compiled import compiled, inlined
from marssim.render.geometry.mesh import SceneMesh
from marssim.render.geometry.projection import Projection
from marssim.render.geometry.triangles import box_extent, corners, edges, extent, meet

SLACK = 1e-6  # [px] margin around what a triangle covers, against rounding


def first_faces(mesh: SceneMesh, camera: PinholeCamera, pose: np.ndarray) -> np.ndarray:
    """Return the face that each pixel's ray hits first.

    Args:
        mesh: The scene's mesh.
        camera: The camera.
        pose: (4, 4) camera to world.

    Returns:
        (H * W,) int32 index of the face, -1 for the sky.
    """
    return _nearest(mesh, None, camera, pose, None, None)


def matching_faces(
    mesh: SceneMesh, group: np.ndarray, camera: PinholeCamera, pose: np.ndarray, depth: np.ndarray, wanted: np.ndarray
) -> np.ndarray:
    """Return the face of a wanted group that each pixel's ray hits nearest to a given depth.

    Args:
        mesh: The scene's mesh.
        group: (F,) int32 group of each face.
        camera: The camera.
        pose: (4, 4) camera to world.
        depth: (H, W) depth [m].
        wanted: (H, W) int32 group.

    Returns:
        (H * W,) int32 index of the face, -1 where the ray hits no face of that group.
    """
    depth = np.ascontiguousarray(depth, dtype=float).ravel()
    return _nearest(mesh, group, camera, pose, depth, wanted.ravel())


def _nearest(
    mesh: SceneMesh, group: np.ndarray | None, camera: PinholeCamera, pose: np.ndarray,
    guess: np.ndarray | None, wanted: np.ndarray | None,
) -> np.ndarray:  # fmt: skip
    """Do as `matching_faces` with guess and wanted (H * W,); as `first_faces` where these and the group are None."""
    view = Projection.of_eye(pose)
    return _scan(
        mesh.vertices, mesh.faces, group, mesh.start, mesh.low, mesh.high, view.numbers, view.nearest, _grid(camera),
        guess, wanted,
    )  # fmt: skip


def _grid(camera: PinholeCamera) -> tuple[int, int, float, float, float, float]:
    return camera.width, camera.height, float(camera.fx), float(camera.fy), float(camera.cx), float(camera.cy)


@inlined
def _pixels(left, right, top, bottom, grid):
    """Return the first and last column and row of the pixels in a part of the image plane; none if first > last."""
    width, height, fx, fy, cx, cy = grid
    left, right, top, bottom = left * fx + cx, right * fx + cx, top * fy + cy, bottom * fy + cy
    # clipped to the image as floats: a value far outside does not fit an integer
    return (
        np.int32(math.ceil(min(max(left - SLACK, 0.0), float(width)))),
        np.int32(math.floor(max(min(right + SLACK, width - 1.0), -1.0))),
        np.int32(math.ceil(min(max(top - SLACK, 0.0), float(height)))),
        np.int32(math.floor(max(min(bottom + SLACK, height - 1.0), -1.0))),
    )


@compiled
def _scan(vertices, faces, group, start, low, high, view, nearest, grid, guess, wanted):
    """Return the faces nearest to the guess; nearest to the eye if guess, group and wanted are None."""
    width, height, fx, fy, cx, cy = grid
    out = np.full(width * height, -1, dtype=np.int32)
    off = np.full(width * height, np.inf)
    for piece in range(len(start) - 1):
        left, right, top, bottom, _ = box_extent(low[piece], high[piece], view)
        i0, i1, j0, j1 = _pixels(left, right, top, bottom, grid)
        if i0 > i1 or j0 > j1:
            continue
        for face in range(start[piece], start[piece + 1]):
            a, b, c = corners(vertices, faces, face, view)
            left, right, top, bottom = extent(a, b, c)
            i0, i1, j0, j1 = _pixels(left, right, top, bottom, grid)
            if i0 > i1 or j0 > j1:
                continue
            triangle, first = edges(a, b, c)
            for row in range(j0, j1 + 1):
                y = (row - cy) / fy
                for column in range(i0, i1 + 1):
                    k = row * width + column
                    if (off[k] > first) if guess is None else (wanted[k] == group[face]):
                        s = meet(triangle, (column - cx) / fx, y)
                        away = s if guess is None else abs(s - guess[k])
                        if s > nearest and away < off[k]:
                            off[k] = away
                            out[k] = face
    return out
