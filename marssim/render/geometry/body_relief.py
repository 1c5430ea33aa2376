"""The relief of rocks, slabs and ledges: pits, dents and beds, as heights over the faces of their meshes.

A face has flat coordinates: world coordinates on the plane that it faces most. A hit moves along its ray to the height
of the relief there. Silhouettes stay those of the mesh.
"""

from __future__ import annotations

import math
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from marssim.base.compute.compiled import compiled, inlined
from marssim.base.dataset.frame import GROUND
from marssim.render.geometry.vectors import dot, minus, unit
from marssim.render.relief.layers import VARIANTS
from marssim.scene.ground.noise import STEP, TEXELS, Octaves, coded_tile, octave_slopes, octave_weight, placing
from marssim.scene.scene import Scene

WAVELENGTHS = np.array([0.009, 0.02, 0.05, 0.14])  # [m] octaves of the relief
STAIN = np.array([0.12, 0.10, 0.08, 0.07])  # amplitude of each in the brightness, as its logarithm
SLOPE = 0.16  # RMS slope of an octave of 10 cm at a texture strength of 1
ROUGHNESS = (0.4, 1.2)  # range of the factors by which bodies differ
TOP = 0.5  # height of the relief on tops of slabs and ledges, which sand has ground smooth, over that of sides
BEDS = 6.0  # how many times longer along the beds the relief of clearly bedded faces is, less one
THIN = 0.35  # by how much of that it is finer across them
APART = 0.37  # [m] shift of the pattern from body to body, so that neighbours differ
RIDGE = np.float32(0.8)  # mean of |noise|, which leaves the mean height of ridges at 0
GRAZING = 0.2  # least cosine between a ray and a face at which hits move as far as they should
ROUNDS = 2  # times that a hit moves to the height of the relief where it was before
LEAST_SLANT = 0.08  # least cosine of the viewing angle at which the relief is filtered


class BodyRelief(NamedTuple):
    """The relief of a scene's bodies, as kernels take it.

    Attributes:
        noise: The octaves: their stains, and their slopes.
        rise: (M,) float32 height [m] of each octave per unit of its noise.
        beds: (N + 1,) float32 how much longer along the beds the relief of each surface's sides is, by surface id.
        roughness: (N + 1,) float32 factor of the heights, by surface id.
        tops: (N + 1,) float32 further factor of those on faces that look up, by surface id.
    """

    noise: Octaves
    rise: np.ndarray
    beds: np.ndarray
    roughness: np.ndarray
    tops: np.ndarray


_of_scene: WeakKeyDictionary[Scene, BodyRelief] = WeakKeyDictionary()


def body_relief(scene: Scene) -> BodyRelief:
    """Return the relief of a scene's bodies, made at the first call for this scene."""
    if scene not in _of_scene:
        _of_scene[scene] = _made(scene)
    return _of_scene[scene]


def _made(scene: Scene) -> BodyRelief:
    look, seed, count = scene.look, scene.look.texture_seed, len(scene.bodies)
    rng = np.random.default_rng((seed, 6))
    tile = coded_tile(2 * VARIANTS + seed % VARIANTS)
    slope = (SLOPE * look.texture_strength * (WAVELENGTHS / 0.1) ** -0.25).astype(np.float32)
    noise = Octaves(tile, placing(tuple(WAVELENGTHS), seed + 2), STAIN.astype(np.float32), slope)
    steep = float(np.diff(tile[..., 0].astype(float) * STEP, axis=1).std()) * TEXELS  # per wavelength
    beds, roughness = np.zeros(count + 1, dtype=np.float32), np.ones(count + 1, dtype=np.float32)
    beds[1:] = BEDS * look.bedding * rng.uniform(0.4, 1, count)
    roughness[1:] = rng.uniform(*ROUGHNESS, count)
    smooth = np.ones(count + 1, dtype=np.float32)
    first = 1 + len(scene.rocks)
    smooth[first : first + sum(scene.outcrop.count[:2])] = TOP
    return BodyRelief(noise, (slope * WAVELENGTHS / steep).astype(np.float32), beds, roughness, smooth)


@inlined
def face_axis(normal):
    """Return the axis that a normal (x, y, z) points along most: 0, 1 or 2."""
    x, y, z = abs(normal[0]), abs(normal[1]), abs(normal[2])
    return 0 if x >= y and x >= z else 1 if y >= z else 2


@inlined
def face_place(axis, surface, x, y, z):
    """Return the flat coordinates of a point x, y, z [m] on a face of a surface that looks along an axis."""
    apart = APART * surface
    return np.float32((y if axis == 0 else x) + apart), np.float32((y if axis == 2 else z) + apart)


@inlined
def _relief_at(noise, rise, u, v, footprint, beds):
    """Return height [m], slopes along u and v, and stain of the relief, float32.

    u, v: of face_place; footprint: width of a pixel on the face [m]; beds: by how much longer the relief is along u.
    """
    longer, finer = np.float32(1) / (np.float32(1) + beds), np.float32(1) + np.float32(THIN) * beds
    tile, places, stains, slopes = noise
    height, du, dv, stain = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
    wide = footprint * (np.float32(0.5) + np.float32(0.5) * finer)
    for octave in range(len(places)):
        weight = octave_weight(places[octave, 0], wide)
        if weight > 0:
            value, along, across = octave_slopes(tile, places, octave, u * longer, v * finer)
            stain += weight * stains[octave] * value
            side = np.float32(1) if value < 0 else np.float32(-1)  # broken stone has ridges and no round tops
            height += weight * rise[octave] * (RIDGE + side * value)
            du += weight * slopes[octave] * side * along
            dv += weight * slopes[octave] * side * across
    return height, du * longer, dv * finer, stain


@compiled
def raise_hits(relief, eye, focal, pose, rays, depth, normal, shading, surface, detail):
    """Move hits on bodies to their relief, and turn their normals.

    Args:
        relief: BodyRelief.
        eye: (3,) position of the left camera [m].
        focal: Its focal length [px].
        pose: (4, 4) camera to world.
        rays: (N, 3) directions, camera frame, z = 1.
        depth, normal, shading, surface, detail: Of gbuffer.Hits, changed in place. The second detail of a body is its
            stain: the logarithm of its brightness.
    """
    noise, rise, beds, roughness, tops = relief
    for k in range(len(depth)):
        if surface[k] <= GROUND:
            continue
        ray = (rays[k, 0], rays[k, 1], 1.0)
        rx, ry, rz = _turned(pose, ray)
        facet = _turned(pose, (float(normal[k, 0]), float(normal[k, 1]), float(normal[k, 2])))
        smooth = (float(shading[k, 0]), float(shading[k, 1]), float(shading[k, 2]))
        axis, z = face_axis(smooth), float(depth[k])
        closing = -(facet[0] * rx + facet[1] * ry + facet[2] * rz)
        length = math.sqrt(rx * rx + ry * ry + rz * rz)
        x0, y0, z0 = pose[0, 3] + z * rx, pose[1, 3] + z * ry, pose[2, 3] + z * rz
        ex, ey, ez = eye[0] - x0, eye[1] - y0, eye[2] - z0
        apart = math.sqrt(ex * ex + ey * ey + ez * ez)
        slant = min(max((smooth[0] * ex + smooth[1] * ey + smooth[2] * ez) / apart, LEAST_SLANT), 1.0)
        # geometric mean of the two axes of the ellipse that a pixel covers
        footprint = np.float32(apart / (focal * math.sqrt(slant)))
        bedded = beds[surface[k]] if axis != 2 else np.float32(0)
        rough = roughness[surface[k]] / (np.float32(1) + np.float32(0.5 * THIN) * bedded)
        rough *= tops[surface[k]] if axis == 2 else np.float32(1)
        move, du, dv, stain = 0.0, np.float32(0), np.float32(0), np.float32(0)
        for _ in range(ROUNDS):
            u, v = face_place(axis, surface[k], x0 + move * rx, y0 + move * ry, z0 + move * rz)
            height, du, dv, stain = _relief_at(noise, rise, u, v, footprint, bedded)
            move = -rough * height / max(closing, GRAZING * length)
        depth[k] = z + move
        du, dv = rough * du, rough * dv
        lean = (0.0, du, dv) if axis == 0 else (du, 0.0, dv) if axis == 1 else (du, dv, 0.0)
        # else the relief hides this side of itself: what the ray sees is nearer, and turned to it
        true, shade = unit(minus(facet, lean)), unit(minus(smooth, lean))
        if dot(true, (rx, ry, rz)) < 0:
            for n in range(3):
                normal[k, n] = pose[0, n] * true[0] + pose[1, n] * true[1] + pose[2, n] * true[2]
        if dot(shade, (rx, ry, rz)) < 0:
            shading[k, 0], shading[k, 1], shading[k, 2] = shade
        detail[k, 1] = stain


@inlined
def _turned(pose, vector):
    """Return a vector (x, y, z) of the camera's frame in the world's."""
    x, y, z = vector
    return (
        pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z,
        pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z,
        pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z,
    )
