"""A stereo pair of a scene with its ground truth."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from marssim.camera import PinholeCamera, StereoRig, rotate
from marssim.compiled import compiled
from marssim.render.gbuffer import GROUND, SKY, GBuffer, GBufferMaker
from marssim.render.sensor import Sensor
from marssim.render.shading import Shader

SAME_DEPTH = 0.02  # share of the depth up to which neighbours on one surface are taken for one place
SUBPIXELS = ((-0.375, -0.125), (0.125, -0.375), (0.375, 0.125), (-0.125, 0.375))  # rotated grid [px]


@dataclass(frozen=True)
class StereoFrame:
    """What the rig sees. Maps are of the left eye; frame: left camera, x right, y down, z forward.

    left, right: (H, W, 3) uint8 RGB. depth: (H, W) float32 [m], inf in the sky. disparity: (H, W) float32 [px], 0 in
    the sky. normal: (H, W, 3) float32. surface: (H, W) int32 ids of GBuffer. occluded: (H, W) bool, left pixels whose
    point the right eye does not see. rig; pose: (4, 4) left camera to world.
    """

    left: np.ndarray
    right: np.ndarray
    depth: np.ndarray
    disparity: np.ndarray
    normal: np.ndarray
    surface: np.ndarray
    occluded: np.ndarray
    rig: StereoRig
    pose: np.ndarray


def render_stereo(
    maker: GBufferMaker, shader: Shader, rig: StereoRig, pose: np.ndarray, sensor: Sensor, rng: np.random.Generator
) -> StereoFrame:
    """Render both eyes and the ground truth. pose: (4, 4) left camera to world; rng: detector noise.

    What the sensor says of imperfect rectification shows in the right image alone.
    """
    right_pose = sensor.right_view(rig.camera, rig.right_pose(pose))
    left_view = maker.render(rig.camera, pose)
    right_view = maker.render(rig.camera, right_pose)
    left = radiance(maker, shader, rig.camera, pose, left_view)
    right = radiance(maker, shader, rig.camera, right_pose, right_view)
    gain = sensor.gain(left, left_view.hit)
    return StereoFrame(
        left=sensor.expose(left, gain, rng),
        right=sensor.right.expose(right, gain * (1 + sensor.gain_difference), rng),
        depth=left_view.depth,
        disparity=rig.depth_to_disparity(left_view.depth),
        normal=left_view.normal,
        surface=left_view.surface,
        occluded=occlusion(maker, left_view, rig, pose),
        rig=rig,
        pose=pose,
    )


def occlusion(maker: GBufferMaker, view: GBuffer, rig: StereoRig, pose: np.ndarray) -> np.ndarray:
    """(H, W) bool: the left pixel's point is hidden from the right eye or outside its image; never so in the sky."""
    surface, depth = view.surface.ravel(), view.depth.ravel()
    u = np.arange(depth.size) % rig.camera.width - rig.depth_to_disparity(depth)
    inside = np.where(u >= -0.5, surface, SKY)
    at, points, normals = _hit_points(rig.camera.rays().reshape(-1, 3), depth, view.normal.reshape(-1, 3), inside, pose)
    out = surface != SKY
    out[at] = ~maker.seen_from(points, normals, rig.right_pose(pose)[:3, 3])
    return out.reshape(view.depth.shape)


def radiance(maker: GBufferMaker, shader: Shader, camera: PinholeCamera, pose: np.ndarray, view: GBuffer) -> np.ndarray:
    """(H, W, 3) float32 radiance of a view, one sample a pixel and more where edges are.

    On an edge a pixel is the mean of four rays. Where a ray meets what a pixel beside it shows, in the same light, it
    takes that pixel's colour; others are shaded.
    """
    shape = view.depth.shape
    rays = camera.rays().reshape(-1, 3)
    colour, lit = _shade(
        maker, shader, camera, pose, rays,
        view.depth.ravel(), view.normal.reshape(-1, 3), view.shading_normal.reshape(-1, 3), view.surface.ravel(),
    )  # fmt: skip
    edge = np.flatnonzero(_edges(view, lit.reshape(shape)).ravel())
    if len(edge):
        step = np.array([[du / camera.fx, dv / camera.fy, 0] for du, dv in SUBPIXELS])
        fine = (rays[edge, None] + step).reshape(-1, 3)
        depth, normal, shading_normal, surface = maker.trace(fine, pose)
        samples = np.empty((len(fine), 3), dtype=np.float32)
        known = _beside(
            edge, depth, surface, view.depth, view.surface, lit.reshape(shape), colour.reshape(*shape, 3), samples
        )
        new = np.flatnonzero(~known)
        if len(new):
            samples[new] = _shade(
                maker, shader, camera, pose, fine[new], depth[new], normal[new], shading_normal[new], surface[new]
            )[0]
        colour[edge] = samples.reshape(len(edge), len(SUBPIXELS), 3).mean(axis=1)
    return colour.reshape(*shape, 3)


def _shade(
    maker: GBufferMaker, shader: Shader, camera: PinholeCamera, pose: np.ndarray, rays: np.ndarray,
    depth: np.ndarray, normal: np.ndarray, shading_normal: np.ndarray, surface: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Radiance (N, 3) and lit (N,) along rays (N, 3) whose hits are given."""
    colour = np.empty((len(rays), 3), dtype=np.float32)
    lit = np.zeros(len(rays), dtype=bool)
    sky = np.flatnonzero(surface == SKY)
    if len(sky):
        toward = rotate(rays[sky], pose[:3, :3])
        colour[sky] = shader.sky(toward / np.sqrt(np.einsum("ij,ij->i", toward, toward))[:, None])
    at, points, normals = _hit_points(rays, depth, normal, surface, pose)
    if len(at):
        lit[at] = maker.lit(points, normals)
        shader.surface(points, shading_normal, surface, pose[:3, 3], lit, camera.fx, at, colour)
    return colour, lit


@compiled
def _hit_points(rays, depth, normal, surface, pose):
    """Indices (M,) of what is not sky, its points (M, 3), float64, and its normals (M, 3), float32, world frame."""
    n = len(rays)
    at, points, normals = np.empty(n, dtype=np.int32), np.empty((n, 3)), np.empty((n, 3), dtype=np.float32)
    found = 0
    for k in range(n):
        if surface[k] == SKY:
            continue
        at[found] = k
        z = depth[k]
        for axis in range(3):
            ray = pose[axis, 0] * rays[k, 0] + pose[axis, 1] * rays[k, 1] + pose[axis, 2] * rays[k, 2]
            points[found, axis] = pose[axis, 3] + z * ray
            normals[found, axis] = (
                pose[axis, 0] * normal[k, 0] + pose[axis, 1] * normal[k, 1] + pose[axis, 2] * normal[k, 2]
            )
        found += 1
    return at[:found], points[:found], normals[:found]


@compiled
def _beside(edge, depth, surface, pixel_depth, pixel_surface, lit, colour, out):
    """(N,) bool: whether the pixels about a ray tell its colour, which is then written to out (N, 3).

    edge: (N / 4,) pixels, depth, surface: (N,) of their rays. They do if some of the 3 x 3 show the same surface at the
    same depth and all of these agree on whether the sun shines there.
    """
    height, width = lit.shape
    known = np.zeros(len(depth), dtype=np.bool_)
    for k in range(len(depth)):
        row, column = edge[k // 4] // width, edge[k // 4] % width
        du, dv = SUBPIXELS[k % 4]
        total, dark, bright = 0.0, False, False
        out[k] = 0
        for j in range(max(row - 1, 0), min(row + 2, height)):
            for i in range(max(column - 1, 0), min(column + 2, width)):
                if pixel_surface[j, i] != surface[k]:
                    continue
                if surface[k] != SKY and not abs(pixel_depth[j, i] - depth[k]) < SAME_DEPTH * depth[k]:
                    continue
                if lit[j, i]:
                    bright = True
                else:
                    dark = True
                # bilinear where the ray lies amid such pixels, and all but the nearest ones where it does not
                weight = max(1 - abs(i - column - du), 1e-6) * max(1 - abs(j - row - dv), 1e-6)
                total += weight
                for c in range(3):
                    out[k, c] += weight * colour[j, i, c]
        if total > 0:
            out[k] /= total
        known[k] = bright != dark
    return known


def _edges(view: GBuffer, lit: np.ndarray) -> np.ndarray:
    """(H, W) bool: pixels beside a change of surface, a depth edge or a shadow's border."""
    inverse = np.where(view.hit, 1 / np.where(view.hit, view.depth, 1), 0).astype(np.float32)
    kernel = np.ones((3, 3), np.uint8)
    step = cv2.dilate(inverse, kernel) - cv2.erode(inverse, kernel) > 0.06 * inverse + 1e-3
    level = view.surface == GROUND
    # on open ground seen at a slant, 1 / Z changes fast without any edge
    return borders(2 * view.surface + lit) | (step & ~level)


def borders(seen: np.ndarray) -> np.ndarray:
    """(H, W) bool: pixels beside one with another id. seen: (H, W) int."""
    out = np.zeros(seen.shape, dtype=bool)
    across, down = seen[:, 1:] != seen[:, :-1], seen[1:] != seen[:-1]
    out[:, 1:] |= across
    out[:, :-1] |= across
    out[1:] |= down
    out[:-1] |= down
    return out
