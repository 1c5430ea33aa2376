"""Which triangle each pixel's ray meets: scan conversion in double precision.

For the rays through the centres of a camera's pixels no search is needed: each triangle is held against the pixels
that it covers. The test is that of the ray against the triangle (triangles.py), so the answers are those of ray
casting, without an acceleration structure that would have to be built per scene.
"""

from __future__ import annotations

import math

import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.base.compute.compiled import compiled, inlined
from marssim.render.geometry.mesh import SceneMesh
from marssim.render.geometry.projection import Projection
from marssim.render.geometry.triangles import box_extent, corners, edges, extent, meet

SLACK = 1e-6  # [px] about what a triangle covers, against rounding


def first_faces(mesh: SceneMesh, camera: PinholeCamera, pose: np.ndarray) -> np.ndarray:
    """(H * W,) int32 index of the face that the ray of each pixel meets first, -1 for the sky.

    pose: (4, 4) camera to world.
    """
    return _nearest(mesh, None, camera, pose, None, None)


def matching_faces(
    mesh: SceneMesh, group: np.ndarray, camera: PinholeCamera, pose: np.ndarray, depth: np.ndarray, wanted: np.ndarray
) -> np.ndarray:
    """(H * W,) int32 index of the face of the group wanted (H, W) that each pixel's ray meets nearest to depth (H, W).

    -1 where it meets none of that group. group: (F,) int32 of each face; pose: (4, 4) camera to world.
    """
    depth = np.ascontiguousarray(depth, dtype=float).ravel()
    return _nearest(mesh, group, camera, pose, depth, wanted.ravel())


def _nearest(
    mesh: SceneMesh, group: np.ndarray | None, camera: PinholeCamera, pose: np.ndarray,
    guess: np.ndarray | None, wanted: np.ndarray | None,
) -> np.ndarray:  # fmt: skip
    """As matching_faces of guess (H * W,) and wanted (H * W,); as first_faces where these and the group are None."""
    view = Projection.of_eye(pose)
    return _scan(
        mesh.vertices, mesh.faces, group, mesh.start, mesh.low, mesh.high, view.numbers, view.nearest, _grid(camera),
        guess, wanted,
    )  # fmt: skip


def _grid(camera: PinholeCamera) -> tuple[int, int, float, float, float, float]:
    return camera.width, camera.height, float(camera.fx), float(camera.fy), float(camera.cx), float(camera.cy)


@inlined
def _pixels(left, right, top, bottom, grid):
    """First and last column, first and last row of the pixels in a part of the image plane: none if first > last."""
    width, height, fx, fy, cx, cy = grid
    left, right, top, bottom = left * fx + cx, right * fx + cx, top * fy + cy, bottom * fy + cy
    # held within the image as floats: what is far outside does not fit an integer
    return (
        np.int32(math.ceil(min(max(left - SLACK, 0.0), float(width)))),
        np.int32(math.floor(max(min(right + SLACK, width - 1.0), -1.0))),
        np.int32(math.ceil(min(max(top - SLACK, 0.0), float(height)))),
        np.int32(math.floor(max(min(bottom + SLACK, height - 1.0), -1.0))),
    )


@compiled
def _scan(vertices, faces, group, start, low, high, view, nearest, grid, guess, wanted):
    """What is nearest to the guess; to the eye where guess, group and wanted are None, which is compiled apart."""
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
