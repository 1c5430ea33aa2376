"""Where exactly rays meet the triangles that they are known to meet, and with which normals."""

from __future__ import annotations

import math

import numpy as np

from marssim.camera import PinholeCamera
from marssim.compiled import compiled
from marssim.render.gbuffer import SKY, GBuffer, Hits
from marssim.render.mesh import Mesh

MISS = 1e-3  # barycentric coordinate by which a ray may pass a triangle before the nearest point on it is taken


def seen(mesh: Mesh, camera: PinholeCamera, pose: np.ndarray, face: np.ndarray) -> GBuffer:
    """The G-buffer of a view whose pixels' rays meet the faces (H * W,), negative for the sky. pose: (4, 4)."""
    shape = (camera.height, camera.width)
    rays = camera.rays().reshape(-1, 3)
    depth, normal, shading, surface = hits(mesh, pose, rays, face)
    return GBuffer(depth.reshape(shape), normal.reshape(*shape, 3), shading.reshape(*shape, 3), surface.reshape(shape))


def hits(mesh: Mesh, pose: np.ndarray, rays: np.ndarray, face: np.ndarray) -> Hits:
    """Where exactly rays meet faces that they are known to meet.

    pose: (4, 4) camera to world; rays: (N, 3) camera frame, z = 1; face: (N,) the face of the mesh that each ray meets,
    negative for the sky. All in float64 until the result is stored.
    """
    pose, rays = (np.ascontiguousarray(each, dtype=np.float64) for each in (pose, rays))
    return Hits(*_hits(mesh.vertices, mesh.faces, mesh.surface, mesh.vertex_normals, pose, rays, face))


@compiled
def _hits(vertices, faces, surface, vertex_normals, pose, rays, face):
    n = len(face)
    depth = np.full(n, np.inf, dtype=np.float32)
    normal, shading = np.zeros((n, 3), dtype=np.float32), np.zeros((n, 3), dtype=np.float32)
    ids = np.full(n, SKY, dtype=np.int32)
    ox, oy, oz = pose[0, 3], pose[1, 3], pose[2, 3]
    last = -1
    # of the face that was met last: corners a, b, c from the eye, edge functions, normal, and its values in the image
    ax = ay = az = bx = by = bz = cx = cy = cz = 0.0
    eax = eay = eaz = ebx = eby = ebz = ecx = ecy = ecz = 0.0
    nx = ny = nz = size = height = 0.0
    i = j = m = 0
    for k in range(n):
        f = face[k]
        if f < 0:
            continue
        if f != last:  # neighbours often meet the same face
            last = f
            i, j, m = faces[f, 0], faces[f, 1], faces[f, 2]
            ax, ay, az = vertices[i, 0] - ox, vertices[i, 1] - oy, vertices[i, 2] - oz
            bx, by, bz = vertices[j, 0] - ox, vertices[j, 1] - oy, vertices[j, 2] - oz
            cx, cy, cz = vertices[m, 0] - ox, vertices[m, 1] - oy, vertices[m, 2] - oz
            eax, eay, eaz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
            ebx, eby, ebz = cy * az - cz * ay, cz * ax - cx * az, cx * ay - cy * ax
            ecx, ecy, ecz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
            ux, uy, uz = bx - ax, by - ay, bz - az
            tx, ty, tz = cx - ax, cy - ay, cz - az
            nx, ny, nz = uy * tz - uz * ty, uz * tx - ux * tz, ux * ty - uy * tx
            size = math.sqrt(nx * nx + ny * ny + nz * nz)
            height = nx * ax + ny * ay + nz * az
        ids[k] = surface[f]
        u, v = rays[k, 0], rays[k, 1]
        rx = pose[0, 0] * u + pose[0, 1] * v + pose[0, 2]
        ry = pose[1, 0] * u + pose[1, 1] * v + pose[1, 2]
        rz = pose[2, 0] * u + pose[2, 1] * v + pose[2, 2]
        # edge functions: how far the ray passes inside of each edge
        wa = rx * eax + ry * eay + rz * eaz
        wb = rx * ebx + ry * eby + rz * ebz
        wc = rx * ecx + ry * ecy + rz * ecz
        slant = nx * rx + ny * ry + nz * rz
        share = 1 / slant
        z = height * share
        wa, wb, wc = wa * share, wb * share, wc * share
        if not (z > 0 and wa > -MISS and wb > -MISS and wc > -MISS):
            # seen edge on, or passed by a hair (Embree works in float32): take the nearest point of the triangle
            wa, wb, wc = _within(wa), _within(wb), _within(wc)
            total = wa + wb + wc
            wa, wb, wc = wa / total, wb / total, wc / total
            px, py, pz = wa * ax + wb * bx + wc * cx, wa * ay + wb * by + wc * cy, wa * az + wb * bz + wc * cz
            z = pose[0, 2] * px + pose[1, 2] * py + pose[2, 2] * pz
        wa, wb, wc = min(max(wa, 0.0), 1.0), min(max(wb, 0.0), 1.0), min(max(wc, 0.0), 1.0)
        unit = 1 / size if size != 0 else 1.0
        if slant > 0:
            unit = -unit
        fx, fy, fz = nx * unit, ny * unit, nz * unit
        depth[k] = z
        for axis in range(3):
            normal[k, axis] = fx * pose[0, axis] + fy * pose[1, axis] + fz * pose[2, axis]
        sx = wa * vertex_normals[i, 0] + wb * vertex_normals[j, 0] + wc * vertex_normals[m, 0]
        sy = wa * vertex_normals[i, 1] + wb * vertex_normals[j, 1] + wc * vertex_normals[m, 1]
        sz = wa * vertex_normals[i, 2] + wb * vertex_normals[j, 2] + wc * vertex_normals[m, 2]
        # where the interpolated normal is shorter than 1, as on rocks, the facet's own makes up: edges stay visible
        lack = 1 - min(math.sqrt(sx * sx + sy * sy + sz * sz), 1.0)
        sx, sy, sz = sx + lack * fx, sy + lack * fy, sz + lack * fz
        unit = 1 / math.sqrt(sx * sx + sy * sy + sz * sz)
        shading[k, 0], shading[k, 1], shading[k, 2] = sx * unit, sy * unit, sz * unit
    return depth, normal, shading, ids


@compiled
def _within(weight: float) -> float:
    """A barycentric coordinate brought into the triangle; also where it is not finite."""
    return min(max(weight, 1e-9), 1.0) if weight == weight else 1e-9
