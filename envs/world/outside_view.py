"""The rover seen from outside, in the light that its cameras see."""

from __future__ import annotations

import numpy as np

from marssim.base.angle import wrapped
from marssim.base.camera import PinholeCamera
from marssim.base.dataset.frame import GROUND, SKY
from marssim.base.pose import look_pose, moved, rotate
from marssim.physics.body import Part
from marssim.physics.state import RoverState
from marssim.render.geometry.gbuffer import Footprint
from marssim.render.geometry.mesh import Mesh
from marssim.render.renderers.embree_renderer import EmbreeRenderer, MeshTracer
from marssim.render.renderers.renderer import Renderer
from marssim.render.sensor import Sensor
from marssim.render.surfaces.shading import Shader
from marssim.scene.scene import Scene

WIDTH, HEIGHT = 800, 400  # [px] of the picture
BEHIND, ABOVE, ASIDE = 4.2, 2.3, 1.6  # [m] from the rover to the chase camera
SUBPIXELS = ((-0.375, -0.125), (0.125, -0.375), (0.375, 0.125), (-0.125, 0.375))  # [px] rays of a pixel on an edge
# the detector of the chase camera: no blur, no noise
SENSOR = Sensor(exposure=0.5, psf=0.0, full_well=1e6, read_noise=0.0, vignetting=0.0, gain_difference=0.0)


class OutsideView:
    """A chase camera on one scene."""

    def __init__(self, scene: Scene, shared: Renderer | None = None) -> None:
        """Make the camera.

        Args:
            scene: The scene.
            shared: A renderer of that scene, which is used too if it is an EmbreeRenderer; else one is built.
        """
        self.scene = scene
        self._own = not isinstance(shared, EmbreeRenderer)
        self.caster = shared if isinstance(shared, EmbreeRenderer) else EmbreeRenderer(scene)
        self.shader = Shader(scene)
        self._heading: float | None = None
        self._step: int | None = None  # that of the last picture

    def picture(self, state: RoverState, parts: list[Part], step: int) -> np.ndarray:
        """Return a picture of the rover's parts on the scene, from behind, above and aside: (400, 800, 3) uint8 RGB.

        Args:
            state: Where the rover is.
            parts: Its parts, from Vehicle.mesh.
            step: Number of the step. The camera turns after the rover once a step, so that a second picture of the
                same step is the same.
        """
        pose = self._chase(state, step)
        camera = PinholeCamera.centred(WIDTH, HEIGHT, 0.75 * WIDTH)
        rover = MeshTracer([_part(part, n) for n, part in enumerate(parts)])
        rays = camera.rays().reshape(-1, 3)
        colour, surface = self._shade(rays, camera.fx, pose, rover, parts)
        edge = np.flatnonzero(_borders(surface.reshape(HEIGHT, WIDTH)).ravel())
        aside = np.array([[du / camera.fx, dv / camera.fy, 0] for du, dv in SUBPIXELS])
        fine = (rays[edge, None] + aside).reshape(-1, 3)
        colour[edge] = self._shade(fine, camera.fx, pose, rover, parts)[0].reshape(len(edge), -1, 3).mean(axis=1)
        colour = colour.reshape(HEIGHT, WIDTH, 3)
        gain = SENSOR.gain(colour[HEIGHT // 3 :], np.ones(colour[HEIGHT // 3 :].shape[:2], dtype=bool))
        return SENSOR.expose(colour, gain, np.random.default_rng(0))

    def close(self) -> None:
        """Free the ray caster if it is not shared; may be called twice."""
        if self._own:
            self.caster.close()

    def _chase(self, state: RoverState, step: int) -> np.ndarray:
        """Return the camera's pose behind the rover; it follows turns slowly, so that a film is calm."""
        if self._heading is None:
            self._heading = state.yaw
        if step != self._step:
            self._heading += 0.3 * wrapped(state.yaw - self._heading)
            self._step = step
        c, s = np.cos(self._heading), np.sin(self._heading)
        offset = np.array([-BEHIND * c + ASIDE * s, -BEHIND * s - ASIDE * c])
        eye = np.append(state.position[:2] + offset, state.position[2] + ABOVE)
        ground = float(self.scene.terrain.height_at(eye[0], eye[1]))
        near = np.hypot(*(self.scene.bodies.centre[:, :2] - eye[:2]).T) < self.scene.bodies.diameter
        top = ground + float(self.scene.bodies.height[near].max(initial=0))
        eye[2] = max(eye[2], top + 1.0)
        aim = state.position + np.array([1.2 * c, 1.2 * s, 0.45]) - eye
        yaw, pitch = np.arctan2(aim[1], aim[0]), np.arctan2(-aim[2], np.hypot(aim[0], aim[1]))
        return look_pose(eye, float(yaw), float(pitch))

    def _shade(
        self, rays: np.ndarray, focal: float, pose: np.ndarray, rover: MeshTracer, parts: list[Part]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the radiance (N, 3) and the surface's number (N,) along rays, with the shadows of ground and rover."""
        world_rays = rotate(rays, pose[:3, :3])
        eye, sun = pose[:3, 3], self.scene.look.sun
        footprint = Footprint(eye, focal)
        hits = self.caster.trace(rays, pose, footprint)
        depth, surface = hits.depth, hits.surface
        near, near_normal, _, part, _ = rover.trace(rays, pose)
        is_rover = near < depth
        colour = np.empty((len(rays), 3), dtype=np.float32)
        sky = np.flatnonzero((surface == SKY) & ~is_rover)
        toward = world_rays[sky]
        colour[sky] = self.shader.sky(toward / np.linalg.norm(toward, axis=1, keepdims=True))

        ground = np.flatnonzero((surface >= GROUND) & ~is_rover)
        points = eye + world_rays[ground] * depth[ground, None]
        normals = rotate(hits.normal[ground], pose[:3, :3])
        lit_ground = self.caster.lit(points, normals)
        open_ = points[lit_ground]
        lit_ground[lit_ground] = rover.free(open_, normals[lit_ground], np.broadcast_to(sun, open_.shape), None)
        colour[ground] = self.shader.surface(
            points, hits.shading_normal[ground], surface[ground], hits.detail[ground], eye, lit_ground, footprint
        )

        body = np.flatnonzero(is_rover)
        points = eye + world_rays[body] * near[body, None]
        normals = rotate(near_normal[body], pose[:3, :3])
        towards = np.broadcast_to(sun, points.shape)
        lit = (normals @ sun > 0) & rover.free(points, normals, towards, None)
        lit &= self.caster.lit(points, normals)
        albedo = (np.array([p.colour for p in parts], dtype=np.float32) / 255) ** 2.2
        direct = (np.maximum(normals @ sun, 0) * lit)[:, None] * self.shader.light.sunlight
        light = direct + self.shader.light.skylight * (0.6 + 0.4 * normals[:, 2:])
        colour[body] = albedo[part[body]] * light
        shadow = np.zeros(len(rays), dtype=np.int32)
        shadow[ground] = lit_ground
        return colour, np.where(is_rover, -2 - part, 2 * surface + shadow)


def _part(part: Part, number: int) -> Mesh:
    vertices = moved(part.vertices, part.pose)
    surface = np.full(len(part.faces), number, dtype=np.int32)
    return Mesh(vertices, part.faces, surface, np.zeros_like(vertices))


def _borders(surface: np.ndarray) -> np.ndarray:
    """Return the pixels (H, W) bool beside a pixel of another number; surface: (H, W) int."""
    out = np.zeros(surface.shape, dtype=bool)
    across, down = surface[:, 1:] != surface[:, :-1], surface[1:] != surface[:-1]
    out[:, 1:] |= across
    out[:, :-1] |= across
    out[1:] |= down
    out[:-1] |= down
    return out
