"""Which triangle each pixel's ray meets: scan conversion in double precision.

For the rays through the centres of a camera's pixels no search is needed: each triangle is held against the pixels
that it covers. The test is that of the ray against the triangle (triangles.py), so the answers are those of ray
casting, without an acceleration structure that would have to be built per scene.
"""

from __future__ import annotations

import math

import numpy as np

from marssim.camera import PinholeCamera
from marssim.compiled import compiled, inlined
from marssim.render.mesh import SceneMesh
from marssim.render.projection import Projection
from marssim.render.triangles import box_extent, corner, edge, extent, meet

SLACK = 1e-6  # [px] about what a triangle covers, against rounding


def first_faces(mesh: SceneMesh, camera: PinholeCamera, pose: np.ndarray) -> np.ndarray:
    """(H * W,) int32 index of the face that the ray of each pixel meets first, -1 for the sky.

    pose: (4, 4) camera to world.
    """
    view = Projection.of_eye(pose)
    return _first_faces(
        mesh.vertices, mesh.faces, mesh.start, mesh.low, mesh.high, view.numbers, view.nearest, _grid(camera)
    )


def matching_faces(
    mesh: SceneMesh, group: np.ndarray, camera: PinholeCamera, pose: np.ndarray, depth: np.ndarray, wanted: np.ndarray
) -> np.ndarray:
    """(H * W,) int32 index of the face of the group wanted (H, W) that each pixel's ray meets nearest to depth (H, W).

    -1 where it meets none of that group. group: (F,) int32 of each face; pose: (4, 4) camera to world.
    """
    view = Projection.of_eye(pose)
    return _matching_faces(
        mesh.vertices, mesh.faces, group, mesh.start, mesh.low, mesh.high, view.numbers, view.nearest,
        _grid(camera), np.ascontiguousarray(depth, dtype=float).ravel(), wanted.ravel(),
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


@inlined
def _covered(vertices, faces, face, view, grid):
    """Corners of a face, and the pixels that it may cover, see _pixels."""
    a = corner(vertices, faces, face, 0, view)
    b = corner(vertices, faces, face, 1, view)
    c = corner(vertices, faces, face, 2, view)
    left, right, top, bottom = extent(a, b, c)
    i0, i1, j0, j1 = _pixels(left, right, top, bottom, grid)
    return a, b, c, i0, i1, j0, j1


@compiled
def _first_faces(vertices, faces, start, low, high, view, nearest, grid):
    width, height, fx, fy, cx, cy = grid
    out = np.full(width * height, -1, dtype=np.int32)
    best = np.full(width * height, np.inf)
    for piece in range(len(start) - 1):
        left, right, top, bottom, _ = box_extent(low[piece], high[piece], view)
        i0, i1, j0, j1 = _pixels(left, right, top, bottom, grid)
        if i0 > i1 or j0 > j1:
            continue
        for face in range(start[piece], start[piece + 1]):
            a, b, c, i0, i1, j0, j1 = _covered(vertices, faces, face, view, grid)
            if i0 > i1 or j0 > j1:
                continue
            ea, eb, ec = edge(b, c), edge(c, a), edge(a, b)
            first = min(a[3], min(b[3], c[3]))
            for row in range(j0, j1 + 1):
                y = (row - cy) / fy
                for column in range(i0, i1 + 1):
                    k = row * width + column
                    if best[k] > first:
                        s = meet(ea, eb, ec, a[3], b[3], c[3], (column - cx) / fx, y)
                        if nearest < s < best[k]:
                            best[k] = s
                            out[k] = face
    return out


@compiled
def _matching_faces(vertices, faces, group, start, low, high, view, nearest, grid, guess, wanted):
    width, height, fx, fy, cx, cy = grid
    out = np.full(width * height, -1, dtype=np.int32)
    off = np.full(width * height, np.inf)
    for piece in range(len(start) - 1):
        left, right, top, bottom, _ = box_extent(low[piece], high[piece], view)
        i0, i1, j0, j1 = _pixels(left, right, top, bottom, grid)
        if i0 > i1 or j0 > j1:
            continue
        for face in range(start[piece], start[piece + 1]):
            a, b, c, i0, i1, j0, j1 = _covered(vertices, faces, face, view, grid)
            if i0 > i1 or j0 > j1:
                continue
            ea, eb, ec = edge(b, c), edge(c, a), edge(a, b)
            for row in range(j0, j1 + 1):
                y = (row - cy) / fy
                for column in range(i0, i1 + 1):
                    k = row * width + column
                    if wanted[k] == group[face]:
                        s = meet(ea, eb, ec, a[3], b[3], c[3], (column - cx) / fx, y)
                        if s > nearest and abs(s - guess[k]) < off[k]:
                            off[k] = abs(s - guess[k])
                            out[k] = face
    return out
