"""Renders a stereo pair of a scene with its ground truth."""

from __future__ import annotations

import numpy as np

from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.compute.compiled import compiled, read_only
from marssim.base.dataset.frame import SKY, StereoFrame
from marssim.base.pose import rotate
from marssim.base.right_image import IDEAL, image_disparity, outside_right
from marssim.render.antialias import average, colours_beside, edge_pixels, subpixel_rays
from marssim.render.geometry.gbuffer import GBuffer, Hits
from marssim.render.renderers.renderer import Renderer
from marssim.render.sensor import Sensor
from marssim.render.surfaces.shading import Shader


def render_stereo(
    renderer: Renderer, shader: Shader, rig: StereoRig, pose: np.ndarray, sensor: Sensor, rng: np.random.Generator
) -> StereoFrame:
    """Render both images and the ground truth.

    `marssim.render.view` offers this in fewer lines. The sensor's errors of rectification turn the right camera: the
    right image, the disparity and the mask of occluded pixels follow it, and all else is that of the ideal rig.

    Args:
        renderer: Renderer of the scene.
        shader: Shader of the same scene.
        rig: The two cameras.
        pose: (4, 4) left camera to world.
        sensor: The two detectors.
        rng: Random generator of the detectors' noise.
    """
    rotation = sensor.right_rotation(rig.camera)
    right_pose = rig.right_pose(pose)
    right_pose[:3, :3] @= rotation
    left_view = renderer.render(rig.camera, pose)
    right_view = renderer.render(rig.camera, right_pose)
    left = radiance(renderer, shader, rig.camera, pose, left_view)
    right = radiance(renderer, shader, rig.camera, right_pose, right_view)
    left_image, right_image = sensor.expose_pair(left, right, left_view.hit, rng)
    return StereoFrame(
        left=left_image,
        right=right_image,
        depth=left_view.depth,
        disparity=image_disparity(rig, left_view.depth, rotation),
        normal=left_view.normal,
        surface=left_view.surface,
        occluded=occlusion(renderer, left_view, rig, pose, rotation),
        rig=rig,
        pose=pose,
        right_rotation=rotation,
    )


def occlusion(
    renderer: Renderer, view: GBuffer, rig: StereoRig, pose: np.ndarray, rotation: np.ndarray = IDEAL
) -> np.ndarray:
    """Return the left pixels whose points the right camera does not see.

    Args:
        renderer: Renderer of the scene.
        view: G-buffer of the left camera.
        rig: The two cameras.
        pose: (4, 4) left camera to world.
        rotation: (3, 3) frame of the right camera to that of the ideal right camera.

    Returns:
        (H, W) bool: the point is hidden from the right camera, or beyond the borders of its image. False in the sky.
    """
    hits, rays = view.pixels, rig.camera.rays().reshape(-1, 3)
    hidden = outside_right(rig, view.depth, rotation).ravel()
    decided = hidden | (hits.surface == SKY)
    at, points, normals = _hit_points(read_only(rays), hits.depth, hits.normal, hits.surface, read_only(pose), decided)
    hidden[at] = ~renderer.visible_from(points, normals, rig.right_pose(pose)[:3, 3])
    return hidden.reshape(view.depth.shape)


def radiance(renderer: Renderer, shader: Shader, camera: PinholeCamera, pose: np.ndarray, view: GBuffer) -> np.ndarray:
    """Return the radiance of a view: one sample a pixel, four on edges (antialias.py).

    Args:
        renderer: Renderer of the scene.
        shader: Shader of the same scene.
        camera: The camera.
        pose: (4, 4) camera to world.
        view: G-buffer of the camera.

    Returns:
        (H, W, 3) float32 linear RGB, relative to a white Lambert surface under the sun at zenith without air.
    """
    shape = view.depth.shape
    colour = np.empty((view.depth.size, 3), dtype=np.float32)
    none = np.zeros(len(colour), dtype=bool)
    lit = _shade(renderer, shader, camera, pose, camera.rays().reshape(-1, 3), view.pixels, none, colour).reshape(shape)
    pixels = edge_pixels(view, lit)
    if len(pixels):
        rays = subpixel_rays(camera, pixels)
        hits = renderer.trace(rays, pose)
        samples, known = colours_beside(pixels, hits.depth, hits.surface, view, lit, colour)
        _shade(renderer, shader, camera, pose, rays, hits, known, samples)
        average(pixels, samples, colour)
    return colour.reshape(*shape, 3)


def _shade(
    renderer: Renderer, shader: Shader, camera: PinholeCamera, pose: np.ndarray, rays: np.ndarray, hits: Hits,
    known: np.ndarray, colour: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Write the radiance along rays to colour, except where it is known.

    Args:
        renderer: Renderer of the scene.
        shader: Shader of the same scene.
        camera: The camera.
        pose: (4, 4) camera to world.
        rays: (N, 3) directions, camera frame, z = 1.
        hits: What these rays hit.
        known: (N,) bool, the rays whose colour is left as it is.
        colour: (N, 3) float32, changed in place.

    Returns:
        (N,) bool: the ray's point is in sunlight; False where the colour is known.
    """
    lit = np.zeros(len(rays), dtype=bool)
    sky = np.flatnonzero((hits.surface == SKY) & ~known)
    if len(sky):
        toward = rotate(rays[sky], pose[:3, :3])
        colour[sky] = shader.sky(toward / np.sqrt(np.einsum("ij,ij->i", toward, toward))[:, None])
    at, points, normals = _hit_points(read_only(rays), hits.depth, hits.normal, hits.surface, read_only(pose), known)
    if len(at):
        lit[at] = renderer.lit(points, normals)
        shader.surface(points, hits.shading_normal, hits.surface, pose[:3, 3], lit, camera.fx, at, colour)
    return lit


@compiled
def _hit_points(rays, depth, normal, surface, pose, known):
    """Return the rays (M,) that hit a surface and are not known, with points (M, 3) and normals (M, 3), world frame."""
    n = len(rays)
    at, points, normals = np.empty(n, dtype=np.int32), np.empty((n, 3)), np.empty((n, 3), dtype=np.float32)
    count = 0
    for k in range(n):
        if surface[k] == SKY or known[k]:
            continue
        at[count] = k
        z = depth[k]
        for axis in range(3):
            ray = pose[axis, 0] * rays[k, 0] + pose[axis, 1] * rays[k, 1] + pose[axis, 2] * rays[k, 2]
            points[count, axis] = pose[axis, 3] + z * ray
            normals[count, axis] = (
                pose[axis, 0] * normal[k, 0] + pose[axis, 1] * normal[k, 1] + pose[axis, 2] * normal[k, 2]
            )
        count += 1
    return at[:count], points[:count], normals[:count]
