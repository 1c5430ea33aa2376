"""Renders a stereo pair of a scene with its ground truth."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.compute.compiled import compiled, read_only
from marssim.base.compute.threads import in_threads
from marssim.base.dataset.frame import GROUND, SKY, StereoFrame
from marssim.base.pose import rigid_pose, rotate
from marssim.base.right_image import IDEAL, image_disparity, outside_right
from marssim.render.antialias import RAYS, average, colours_beside, edge_pixels, subpixel_rays
from marssim.render.geometry.gbuffer import Footprint, GBuffer, Hits
from marssim.render.own_rover.body import RoverBody
from marssim.render.own_rover.renderer import WithRover
from marssim.render.penumbra import penumbra
from marssim.render.renderers.renderer import Renderer
from marssim.render.sensor import Sensor
from marssim.render.sun_glare import sun_glare
from marssim.render.surfaces.shading import Shader

SHADED = np.zeros((0, 0, 0), dtype=np.float32)  # in place of what only shading needs of a view, which takes much memory
UP = (0.0, 0.0, 1.0)
SAME_POINT = 2e-3  # relative difference of depth up to which two views show one point
SHORTLY = 0.999  # of the depth at which a ray is known to hit: where it is followed again
SMOOTH = 0.03  # relative change of 1 / Z from pixel to pixel up to which a view counts as smooth


def render_stereo(
    renderer: Renderer, shader: Shader, rig: StereoRig, pose: np.ndarray, sensor: Sensor, rng: np.random.Generator,
    rover: np.ndarray | None = None, at_once: bool = False,
) -> StereoFrame:  # fmt: skip
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
        rover: (4, 4) body to world of the rover that carries the cameras; None for a scene without it.
        at_once: Render both eyes at once, in two threads, which takes more memory. The frame is the same.

    Raises:
        ValueError: The pose is no rotation and translation.
    """
    pose = rigid_pose(pose)
    if rover is not None:
        renderer = WithRover(renderer, RoverBody(rover, pose, rig.baseline), shader.light.sun)
    rotation = sensor.right_rotation(rig.camera)
    right_pose = rig.right_pose(pose)
    right_pose[:3, :3] @= rotation
    footprint = Footprint.from_camera(rig.camera, pose)

    def rendered(pose: np.ndarray) -> tuple[GBuffer, np.ndarray]:
        view = renderer.render(rig.camera, pose, footprint)
        colour = light_at_detector(renderer, shader, rig.camera, pose, view, footprint, sensor.sun_glare)
        return replace(view, shading_normal=SHADED, detail=SHADED), colour

    (left_view, left), (right_view, right) = _both(rendered, (pose, right_pose), at_once)

    def images() -> tuple[np.ndarray, np.ndarray]:
        return sensor.expose_pair(left, right, left_view.hit, rng)

    def hidden() -> np.ndarray:
        return occlusion(renderer, rig, pose, left_view, right_view, rotation)

    (left_image, right_image), occluded = _both(lambda job: job(), (images, hidden), at_once)
    return StereoFrame(
        left=left_image,
        right=right_image,
        depth=left_view.depth,
        disparity=image_disparity(rig, left_view.depth, rotation),
        normal=left_view.normal,
        surface=left_view.surface,
        occluded=occluded,
        rig=rig,
        pose=pose,
        right_rotation=rotation,
    )


def _both(work: Callable[[Any], Any], jobs: tuple[Any, Any], at_once: bool) -> Iterable[Any]:
    """Return the results of two jobs, which run in two threads if they are done at once."""
    return in_threads(work, jobs, 2) if at_once else map(work, jobs)


def occlusion(
    renderer: Renderer,
    rig: StereoRig,
    pose: np.ndarray,
    view: GBuffer,
    right_view: GBuffer,
    rotation: np.ndarray = IDEAL,
) -> np.ndarray:
    """Return the left pixels whose points the right camera does not see.

    A point is visible where the right view shows its depth. Where that view changes too much between pixels to tell, a
    ray from the right eye to the point decides.

    Args:
        renderer: Renderer of the scene.
        rig: The two cameras.
        pose: (4, 4) left camera to world.
        view: G-buffer of the left camera.
        right_view: G-buffer of the right camera.
        rotation: (3, 3) frame of the right camera to that of the ideal right camera.

    Returns:
        (H, W) bool: the point is hidden from the right camera, or beyond the borders of its image. False in the sky.
    """
    rays, camera, depths, surface = (
        rig.camera.rays().reshape(-1, 3),
        rig.camera,
        view.depth.ravel(),
        view.surface.ravel(),
    )
    right_pose = rig.right_pose(pose)
    right_pose[:3, :3] @= rotation
    hidden = outside_right(rig, view.depth, rotation).ravel()
    at, towards, depth = _undecided(
        read_only(rays), depths, hidden | (surface == SKY), read_only(np.linalg.inv(right_pose) @ pose),
        right_view.depth, (float(camera.fx), float(camera.fy), float(camera.cx), float(camera.cy)),
    )  # fmt: skip
    if len(at):
        met = renderer.trace(towards, right_pose, Footprint.from_camera(camera, pose), sunlit=False)
        hidden[at] = met.depth < depth * (1 - SAME_POINT)
    return hidden.reshape(view.depth.shape)


def light_at_detector(
    renderer: Renderer, shader: Shader, camera: PinholeCamera, pose: np.ndarray, view: GBuffer, footprint: Footprint,
    glare: float,
) -> np.ndarray:  # fmt: skip
    """Return the radiance of a view and what its lens adds to it of the sun.

    Args:
        renderer, shader, camera, pose, view, footprint: See `radiance`.
        glare: Share of the sunlight on the lens that is scattered, 0 to 1.

    Returns:
        (H, W, 3) float32, as `radiance` returns it.
    """
    light = radiance(renderer, shader, camera, pose, view, footprint)
    if glare > 0:
        light += sun_glare(renderer, shader.light, camera, pose, glare)
    return light


def radiance(
    renderer: Renderer, shader: Shader, camera: PinholeCamera, pose: np.ndarray, view: GBuffer, footprint: Footprint
) -> np.ndarray:
    """Return the radiance of a view: one sample a pixel, four on edges (antialias.py).

    The sun is a disc: in the borders of shadows its share is found (penumbra.py). Elsewhere a ray to its centre tells.

    Args:
        renderer: Renderer of the scene.
        shader: Shader of the same scene.
        camera: The camera.
        pose: (4, 4) camera to world.
        view: G-buffer of the camera.
        footprint: The camera that relief and patterns are filtered for.

    Returns:
        (H, W, 3) float32 linear RGB, relative to a white Lambert surface under the sun at zenith without air.
    """
    shape = view.depth.shape
    colour = np.empty((view.depth.size, 3), dtype=np.float32)
    rays = camera.rays().reshape(-1, 3)
    none = np.zeros(len(colour), dtype=bool)
    every = _surface_points(rays, view.pixels, pose, none)
    distance = np.zeros(len(colour), dtype=np.float32)
    distance[every.at] = renderer.shadow_distance(every.points, every.normals)
    soft = penumbra(rays, pose, view.depth, distance.reshape(shape), shader.light.sun)
    share = (distance == np.inf).astype(np.float32)
    _soften(renderer, every, soft, share)
    _shade(shader, footprint, pose, rays, view.pixels, none, every, share, colour)
    del every, rays, none, distance  # of all pixels, which takes much memory
    lit = share.reshape(shape)
    pixels, begin, amid = edge_pixels(view, lit, colour)
    if len(pixels):
        rays = subpixel_rays(camera, pixels)
        hits = _traced(renderer, rays, pose, np.repeat(begin, RAYS), RAYS * amid, footprint)
        samples, coloured = colours_beside(pixels, hits, view, lit, colour)
        _find_sunlight(renderer, rays, pose, footprint, hits, coloured)
        rest = _surface_points(rays, hits, pose, coloured)
        share = np.zeros(len(rays), dtype=np.float32)
        share[rest.at] = renderer.lit(rest.points, rest.normals)
        _soften(renderer, rest, np.repeat(soft[pixels], RAYS), share)
        _shade(shader, footprint, pose, rays, hits, coloured, rest, share, samples)
        average(pixels, samples, colour)
    return colour.reshape(*shape, 3)


def _traced(
    renderer: Renderer, rays: np.ndarray, pose: np.ndarray, begin: np.ndarray, amid: int, footprint: Footprint
) -> Hits:
    """Return what rays (N, 3) hit that begin at depths (N,) of edge_pixels; the first `amid` are amid ground."""
    ground = renderer.trace_ground(rays[:amid], pose, begin[:amid], footprint, sunlit=False)
    rest = renderer.trace(rays[amid:], pose, footprint, sunlit=False, begin=begin[amid:])
    return Hits(*(np.concatenate(each) for each in zip(ground, rest)))


def _find_sunlight(
    renderer: Renderer, rays: np.ndarray, pose: np.ndarray, footprint: Footprint, hits: Hits, coloured: np.ndarray
) -> None:
    """Write the share of sunlight that relief lets through to the details of hits on ground without a colour."""
    at = np.flatnonzero((hits.surface == GROUND) & ~coloured)
    again = renderer.trace_ground(rays[at], pose, SHORTLY * hits.depth[at].astype(float), footprint)
    hits.detail[at, 3] = again.detail[:, 3]


class _Points(NamedTuple):
    """Surface points that rays hit.

    Attributes:
        at: (M,) int32, the rays.
        points: (M, 3) world frame [m].
        normals: (M, 3) float32 that rays to the sun leave along, world frame. Those of ground are vertical: the share
            of light that relief takes is in the details.
    """

    at: np.ndarray
    points: np.ndarray
    normals: np.ndarray


def _surface_points(rays: np.ndarray, hits: Hits, pose: np.ndarray, coloured: np.ndarray) -> _Points:
    """Return the points that rays (N, 3) hit, of those that hit a surface and are not coloured (N,) yet."""
    at, points, normals = _hit_points(read_only(rays), hits.depth, hits.normal, hits.surface, read_only(pose), coloured)
    normals[hits.surface[at] == GROUND] = UP
    return _Points(at, points, normals)


def _soften(renderer: Renderer, points: _Points, soft: np.ndarray, share: np.ndarray) -> None:
    """Replace the share of sunlight (N,) of the rays that are `soft` (N,) bool by the share of the sun's disc."""
    some = np.flatnonzero(soft[points.at])
    if len(some):
        share[points.at[some]] = renderer.sun_share(points.points[some], points.normals[some])


def _shade(
    shader: Shader, footprint: Footprint, pose: np.ndarray, rays: np.ndarray, hits: Hits, coloured: np.ndarray,
    points: _Points, share: np.ndarray, colour: np.ndarray,
) -> None:  # fmt: skip
    """Write the radiance along rays to colour, except where they are coloured.

    Args:
        shader: Shader of the scene.
        footprint: The camera that patterns are filtered for.
        pose: (4, 4) camera to world.
        rays: (N, 3) directions, camera frame, z = 1.
        hits: What these rays hit.
        coloured: (N,) bool, the rays whose colour is left as it is.
        points: The points of the others that do not end in the sky.
        share: (N,) float32 share of the sun's disc that hills and rocks leave free.
        colour: (N, 3) float32, changed in place.
    """
    sky = np.flatnonzero((hits.surface == SKY) & ~coloured)
    if len(sky):
        toward = rotate(rays[sky], pose[:3, :3])
        colour[sky] = shader.sky(toward / np.sqrt(np.einsum("ij,ij->i", toward, toward))[:, None])
    if len(points.at):
        shader.surface(
            points.points, hits.shading_normal, hits.surface, hits.detail, pose[:3, 3], share, footprint,
            points.at, colour,
        )  # fmt: skip


@compiled
def _hit_points(rays, depth, normal, surface, pose, coloured):
    """Return the uncoloured rays (M,) that hit a surface, with points (M, 3) and normals (M, 3), world frame."""
    n = len(rays)
    at, points, normals = np.empty(n, dtype=np.int32), np.empty((n, 3)), np.empty((n, 3), dtype=np.float32)
    count = 0
    for k in range(n):
        if surface[k] == SKY or coloured[k]:
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


@compiled
def _undecided(rays, depth, decided, turn, right_depth, camera):
    """Return the left pixels whose visibility the right view does not show, unless they are decided.

    turn: (4, 4) left camera to right camera; camera: fx, fy, cx, cy. Returns the indices (M,) of the pixels; rays
    (M, 3) to their points, right camera's frame; and the depths (M,) of these in it.
    """
    height, width = right_depth.shape
    fx, fy, cx, cy = camera
    at, towards, apart = np.empty(len(depth), dtype=np.int32), np.ones((len(depth), 3)), np.empty(len(depth))
    count = 0
    for k in range(len(depth)):
        if decided[k]:
            continue
        z = depth[k]
        px, py, pz = rays[k, 0] * z, rays[k, 1] * z, float(z)
        x = turn[0, 0] * px + turn[0, 1] * py + turn[0, 2] * pz + turn[0, 3]
        y = turn[1, 0] * px + turn[1, 1] * py + turn[1, 2] * pz + turn[1, 3]
        z = turn[2, 0] * px + turn[2, 1] * py + turn[2, 2] * pz + turn[2, 3]
        u, v = fx * x / z + cx, fy * y / z + cy
        same = False
        if 0 <= u < width - 1 and 0 <= v < height - 1:
            i, j = int(u), int(v)
            s, t = u - i, v - j
            a, b = 1 / right_depth[j, i], 1 / right_depth[j, i + 1]
            c, d = 1 / right_depth[j + 1, i], 1 / right_depth[j + 1, i + 1]
            shown = (1 - t) * (a + s * (b - a)) + t * (c + s * (d - c))
            low, high = min(min(a, b), min(c, d)), max(max(a, b), max(c, d))
            # what the four pixels show changes no faster than a plane does, and passes through the point
            same = abs(shown * z - 1) < SAME_POINT and high - low < SMOOTH * shown
        if not same:
            at[count], apart[count] = k, z
            towards[count, 0], towards[count, 1] = x / z, y / z
            count += 1
    return at[:count], towards[:count], apart[:count]
