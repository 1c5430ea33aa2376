"""A stereo pair of a scene with its ground truth."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from marssim.camera import PinholeCamera, StereoRig, rotate
from marssim.render.gbuffer import GROUND, SKY, GBuffer, GBufferMaker
from marssim.render.sensor import Sensor
from marssim.render.shading import Shader

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
    hit = view.hit
    points = view.world(rig.camera, pose)[hit]
    normals = rotate(view.normal[hit], pose[:3, :3])
    u = np.broadcast_to(np.arange(rig.camera.width), hit.shape)[hit] - rig.depth_to_disparity(view.depth[hit])
    inside = u >= -0.5
    seen = np.zeros(len(points), dtype=bool)
    seen[inside] = maker.seen_from(points[inside], normals[inside], rig.right_pose(pose)[:3, 3])
    out = np.zeros(hit.shape, dtype=bool)
    out[hit] = ~seen
    return out


def radiance(maker: GBufferMaker, shader: Shader, camera: PinholeCamera, pose: np.ndarray, view: GBuffer) -> np.ndarray:
    """(H, W, 3) float32 radiance of a view; edges are supersampled."""
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
        fine_colour, _ = _shade(maker, shader, camera, pose, fine, *maker.trace(fine, pose))
        colour[edge] = fine_colour.reshape(len(edge), len(SUBPIXELS), 3).mean(axis=1)
    return colour.reshape(*shape, 3)


def _shade(
    maker: GBufferMaker, shader: Shader, camera: PinholeCamera, pose: np.ndarray, rays: np.ndarray,
    depth: np.ndarray, normal: np.ndarray, shading_normal: np.ndarray, surface: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Radiance (N, 3) and lit (N,) along rays (N, 3) whose hits are given."""
    eye = pose[:3, 3]
    colour = np.empty((len(rays), 3), dtype=np.float32)
    lit = np.zeros(len(rays), dtype=bool)
    world_rays = rotate(rays, pose[:3, :3])
    sky = np.flatnonzero(surface == SKY)
    if len(sky):
        toward = world_rays[sky]
        colour[sky] = shader.sky(toward / np.linalg.norm(toward, axis=1, keepdims=True))
    hit = np.flatnonzero(surface != SKY)
    if len(hit):
        points = eye + world_rays[hit] * depth[hit, None]
        lit[hit] = maker.lit(points, rotate(normal[hit], pose[:3, :3]))
        colour[hit] = shader.surface(points, shading_normal[hit], surface[hit], eye, lit[hit], camera.fx)
    return colour, lit


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
