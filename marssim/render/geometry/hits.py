"""The exact intersections of rays with triangles that they are known to hit, and the normals there."""

from __future__ import annotations

import math

import numpy as np

from marssim.base.compute.compiled import compiled, inlined, read_only
from marssim.base.dataset.frame import SKY
from marssim.render.geometry.gbuffer import Hits
from marssim.render.geometry.mesh import Mesh
from marssim.render.geometry.vectors import column, cross, dot, minus, mixed, row, times

MISS = 1e-3  # barycentric coordinate by which a ray may miss a triangle before the nearest point on it is taken


def intersect_faces(mesh: Mesh, pose: np.ndarray, rays: np.ndarray, face: np.ndarray) -> Hits:
    """Intersect rays with faces that they are known to hit. Computed in float64, stored in float32.

    Args:
        mesh: The triangles.
        pose: (4, 4) camera to world.
        rays: (N, 3) directions, camera frame, z = 1.
        face: (N,) face that each ray hits, negative for the sky.
    """
    hits = _hits(mesh.vertices, mesh.faces, mesh.surface, mesh.vertex_normals, read_only(pose), read_only(rays), face)
    detail = np.zeros((len(rays), 4), dtype=np.float32)
    detail[:, 0], detail[:, 3] = -1, 1
    return Hits(hits[0], hits[1], hits[2], hits[3], detail)


def depths_of_faces(mesh: Mesh, pose: np.ndarray, rays: np.ndarray, face: np.ndarray) -> np.ndarray:
    """Return the depths (N,) float64 [m] at which rays pass the planes of faces, inf where the face is negative.

    The arguments are those of intersect_faces.
    """
    return _plane_depths(mesh.vertices, mesh.faces, read_only(pose), read_only(rays), face)


@compiled
def _plane_depths(vertices, faces, pose, rays, face):
    out = np.full(len(face), np.inf)
    right, down, ahead, eye = column(pose, 0), column(pose, 1), column(pose, 2), column(pose, 3)
    last = -1
    wide = (0.0, 0.0, 0.0)
    height = 0.0
    for k in range(len(face)):
        f = face[k]
        if f < 0:
            continue
        if f != last:
            last = f
            a = minus(row(vertices, faces[f, 0]), eye)
            wide = cross(
                minus(minus(row(vertices, faces[f, 1]), eye), a), minus(minus(row(vertices, faces[f, 2]), eye), a)
            )
            height = dot(wide, a)
        slant = dot(wide, mixed(right, down, ahead, (rays[k, 0], rays[k, 1], 1.0)))
        out[k] = max(height / slant, 0.0) if slant != 0 else 0.0
    return out


@compiled
def _hits(vertices, faces, surface, vertex_normals, pose, rays, face):
    n = len(face)
    depth = np.full(n, np.inf, dtype=np.float32)
    normal, shading = np.zeros((n, 3), dtype=np.float32), np.zeros((n, 3), dtype=np.float32)
    ids = np.full(n, SKY, dtype=np.int32)
    right, down, ahead, eye = column(pose, 0), column(pose, 1), column(pose, 2), column(pose, 3)
    last, i, j, m = -1, 0, 0, 0
    # of the last face: corners relative to the eye, edge functions opposite to them, normal times twice its area
    a = b = c = edge_a = edge_b = edge_c = wide = (0.0, 0.0, 0.0)
    size = height = 0.0
    for k in range(n):
        f = face[k]
        if f < 0:
            continue
        if f != last:  # neighbouring rays often hit the same face
            last = f
            i, j, m = faces[f, 0], faces[f, 1], faces[f, 2]
            a, b, c = minus(row(vertices, i), eye), minus(row(vertices, j), eye), minus(row(vertices, m), eye)
            edge_a, edge_b, edge_c = cross(b, c), cross(c, a), cross(a, b)
            wide = cross(minus(b, a), minus(c, a))
            size, height = math.sqrt(dot(wide, wide)), dot(wide, a)
        ray = mixed(right, down, ahead, (rays[k, 0], rays[k, 1], 1.0))
        slant = dot(wide, ray)
        z, weights = _intersection(ray, ahead, (a, b, c), (edge_a, edge_b, edge_c), height, slant)
        unit = 1 / size if size != 0 else 1.0
        if slant > 0:
            unit = -unit
        facet = times(wide, unit)
        depth[k], ids[k] = z, surface[f]
        normal[k, 0], normal[k, 1], normal[k, 2] = dot(facet, right), dot(facet, down), dot(facet, ahead)
        smooth = mixed(row(vertex_normals, i), row(vertex_normals, j), row(vertex_normals, m), weights)
        shading[k, 0], shading[k, 1], shading[k, 2] = _shading(smooth, facet)
    return depth, normal, shading, ids


@inlined
def _intersection(ray, ahead, corners, edges, height, slant):
    """Return the depth at which a ray hits a triangle, and the barycentric coordinates there, 0 to 1.

    ray: direction of depth 1; ahead: unit vector along which depth is measured; corners: relative to the eye; edges:
    edge functions, how far inside each edge the ray passes; height, slant: components of the first corner and of the
    ray along the triangle's normal.
    """
    a, b, c = corners
    share = 1 / slant
    z = height * share
    wa, wb, wc = dot(ray, edges[0]) * share, dot(ray, edges[1]) * share, dot(ray, edges[2]) * share
    if not (z > 0 and wa > -MISS and wb > -MISS and wc > -MISS):
        # the triangle is seen edge-on, or narrowly missed (Embree works in float32): take its nearest point
        wa, wb, wc = _within(wa), _within(wb), _within(wc)
        total = wa + wb + wc
        wa, wb, wc = wa / total, wb / total, wc / total
        z = dot(ahead, mixed(a, b, c, (wa, wb, wc)))
    return z, (min(max(wa, 0.0), 1.0), min(max(wb, 0.0), 1.0), min(max(wc, 0.0), 1.0))


@inlined
def _shading(smooth, facet):
    """Return the unit normal for shading. smooth: interpolated normal; facet: unit normal of the triangle."""
    # where the interpolated normal is shorter than 1, as on rocks, the facet's normal fills up: edges stay visible
    lack = 1 - min(math.sqrt(dot(smooth, smooth)), 1.0)
    leaning = (smooth[0] + lack * facet[0], smooth[1] + lack * facet[1], smooth[2] + lack * facet[2])
    return times(leaning, 1 / math.sqrt(dot(leaning, leaning)))


@compiled
def _within(weight: float) -> float:
    """Return a barycentric coordinate clipped into the triangle; one that is not a number becomes the least."""
    return min(max(weight, 1e-9), 1.0) if weight == weight else 1e-9
