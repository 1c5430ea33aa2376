"""The G-buffer by rasterising: PyBullet's TinyRenderer tells what each pixel sees, the geometry is then made exact."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from marssim.camera import PinholeCamera, rotate
from marssim.render.bullet_tiles import BulletTiles
from marssim.render.faces import GroundFaces, RockFaces
from marssim.render.gbuffer import GROUND, SKY, GBuffer, shading_normals
from marssim.scene.scene import Scene

NEAR = 0.1  # [m] what is nearer to the camera is not drawn
SELF_GAP = 2e-3  # [m] secondary rays start this far off the surface
SLIP = 0.01  # share of the depth by which the exact hit may differ from the depth buffer before it is not believed
SUN_NEAR = 0.8  # share of the points that get a shadow map of their own; the others share those of the scene
SUN_NEAR_PIXELS = 768  # side of that map
SUN_WIDE_PIXELS = 1280  # side of the maps of the scene, at most
SUN_TEXEL = (0.02, 0.1)  # [m] and no finer than this: of the finely gridded square, of everything
SUN_SCALE = 1.25  # half sides of maps of their own are powers of this [m]
SUN_PITCH = 0.25  # and their centres lie on a lattice of this times the half side
SUN_RIM = 0.03  # share of the half side that is left unused at the map's edge
SUN_DISTANCE = 400.0  # from which a shadow map is drawn, over its half side: rays part by less than the sun's disc
KEPT_MAPS = 8
WIDEST = np.deg2rad(50.0)  # half angle that one view of seen_from covers at most
EYE_FOCAL = 600.0  # [px] of the views of seen_from
EYE_PIXELS = 1024  # their largest side


@dataclass(frozen=True)
class _SunMap:
    """A depth map seen from the sun. centre: (2,) on the sun's plane; half: half its side [m]."""

    centre: np.ndarray
    half: float
    camera: PinholeCamera
    pose: np.ndarray
    depth: np.ndarray


class Rasterizer:
    """Renders a Scene with PyBullet's `getCameraImage`. Implements GBufferMaker.

    Depth and normals are those of the very triangle (see faces.py); what may differ from ray casting is which surface
    a pixel on a silhouette shows. Shadows and occlusion come from depth maps, so their edges are a texel wide.
    Raises ImportError where PyBullet is not installed.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._tiles = BulletTiles(scene)
        self._fine, self._coarse = GroundFaces(scene.terrain.fine), GroundFaces(scene.terrain.coarse)
        self._rocks = RockFaces(scene.rocks)
        self._near_sun_maps: dict[tuple[int, int, int], _SunMap] = {}
        self._wide: list[_SunMap] = []

    def render(self, camera: PinholeCamera, pose: np.ndarray) -> GBuffer:
        """What the camera sees; see GBuffer. pose: (4, 4) camera to world. Nothing nearer than 0.1 m is seen."""
        shape = (camera.height, camera.width)
        raw, surface = self._draw(camera, pose, NEAR, self._farthest(pose[:3, 3]))
        at = np.flatnonzero(surface.ravel() != SKY)
        rotation, eye = pose[:3, :3], pose[:3, 3]
        rays = rotate(camera.rays().reshape(-1, 3).take(at, 0), rotation)
        z, face, smooth = self._exact(eye, rays, raw.ravel()[at], surface.ravel()[at])
        away = np.einsum("ij,ij->i", face, rays) > 0
        face[away] *= -1
        depth = np.full(camera.height * camera.width, np.inf, dtype=np.float32)
        depth[at] = z
        normal, shading = np.zeros((2, camera.height * camera.width, 3), dtype=np.float32)
        normal[at] = rotate(face, rotation.T)
        shading[at] = shading_normals(smooth, face)
        return GBuffer(depth.reshape(shape), normal.reshape(*shape, 3), shading.reshape(*shape, 3), surface)

    def lit(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """(N,) bool: the sun's centre reaches these surface points; see GBufferMaker."""
        sun = self.scene.look.sun
        out = np.zeros(len(points), dtype=bool)
        facing = normals @ sun
        at = np.flatnonzero(facing > 0)
        if len(at) == 0:
            return out
        plane = rotate(points[at], np.stack(_plane_axes(sun)))
        middle = np.median(plane, axis=0)
        off = np.abs(plane - middle).max(axis=1)
        sun_maps = [self._near_sun_map(middle, max(float(np.quantile(off, SUN_NEAR)), 0.1)), *self._wide_sun_maps()]
        todo = np.arange(len(at))
        for sun_map in sun_maps:
            inside = np.abs(plane[todo] - sun_map.centre).max(axis=1) < 0.99 * sun_map.half
            here = at[todo[inside]]
            out[here] = _lit_on(sun_map, points[here], normals[here], facing[here])
            todo = todo[~inside]
        out[at[todo]] = True  # outside the scene there is nothing to throw a shadow
        return out

    def seen_from(self, points: np.ndarray, normals: np.ndarray, eye: np.ndarray) -> np.ndarray:
        """(N,) bool: nothing stands between these surface points and the eye; see GBufferMaker."""
        eye = np.asarray(eye, dtype=float)
        towards = points - eye
        distance = np.linalg.norm(towards, axis=1)
        out = np.zeros(len(points), dtype=bool)
        todo = np.flatnonzero((np.einsum("ij,ij->i", normals, towards) < 0) & (distance > 0))
        while len(todo):
            direction = towards[todo] / distance[todo, None]
            axis = direction.mean(axis=0)
            axis /= max(float(np.linalg.norm(axis)), 1e-12)
            covered = direction @ axis > np.cos(WIDEST)
            if not covered.any():  # the points stand around the eye: begin with any of them
                axis = direction[0]
                covered = direction @ axis > np.cos(WIDEST)
            out[todo[covered]] = self._seen_in_view(points[todo[covered]], eye, axis)
            todo = todo[~covered]
        return out

    def close(self) -> None:
        """Free the PyBullet world; may be called twice."""
        self._tiles.close()
        self._near_sun_maps.clear()
        self._wide.clear()

    def _farthest(self, eye: np.ndarray) -> float:
        reach = np.maximum(np.abs(self._tiles.low - eye), np.abs(self._tiles.high - eye))
        return float(np.linalg.norm(reach)) + 1.0

    def _draw(self, camera: PinholeCamera, pose: np.ndarray, near: float, far: float) -> tuple[np.ndarray, np.ndarray]:
        """Depth [m] to the depth buffer's precision, arbitrary in the sky, and surface ids."""
        view = np.diag([1.0, -1.0, -1.0, 1.0]) @ np.linalg.inv(pose)
        projection = _projection(camera, near, far)
        buffer, surface = self._tiles.draw(view, projection, camera.width, camera.height)
        return far * near / (far - (far - near) * np.minimum(buffer, 1.0)), surface

    def _exact(
        self, eye: np.ndarray, rays: np.ndarray, guess: np.ndarray, surface: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Depth, face normal and interpolated normal (world frame) of pixels of known surface and rough depth."""
        z = guess.copy()
        face, smooth = np.empty((2, len(rays), 3), dtype=np.float32)
        fine = self.scene.terrain.fine.contains(eye[0] + guess * rays[:, 0], eye[1] + guess * rays[:, 1])
        ground = surface == GROUND
        for grid, mask in ((self._fine, ground & fine), (self._coarse, ground & ~fine)):
            at = np.flatnonzero(mask)
            if len(at):
                z[at], face[at], smooth[at] = grid.meet(eye, rays.take(at, 0), guess[at])
        at = np.flatnonzero(~ground)
        if len(at):
            z[at], face[at], smooth[at] = self._rocks.meet(eye, rays[at], guess[at], surface[at] - 1)
        return np.where(np.abs(z - guess) < SLIP * guess, z, guess), face, smooth

    def _near_sun_map(self, centre: np.ndarray, half: float) -> _SunMap:
        """A shadow map of the square or a little more.

        Views near to each other share one, yet which one a view gets depends on its own square alone, never on what
        was rendered before: scale and centre are rounded, and a map is known by these.
        """
        level = int(np.ceil(np.log(half) / np.log(SUN_SCALE)))
        scale = SUN_SCALE**level
        column, row = np.rint(centre / (SUN_PITCH * scale)).astype(int).tolist()
        key = (level, column, row)
        known = self._near_sun_maps.pop(key, None)
        if known is None:
            middle = SUN_PITCH * scale * np.array([column, row])
            known = self._draw_sun_map(middle, (1 + SUN_PITCH / 2 + SUN_RIM) * scale, SUN_NEAR_PIXELS)
            while len(self._near_sun_maps) >= KEPT_MAPS:
                del self._near_sun_maps[next(iter(self._near_sun_maps))]  # the one not used for longest
        self._near_sun_maps[key] = known
        return known

    def _wide_sun_maps(self) -> list[_SunMap]:
        """Shadow maps of the finely gridded square and of the whole scene, drawn once."""
        if not self._wide:
            axes = np.stack(_plane_axes(self.scene.look.sun), axis=1)
            x0, y0, x1, y1 = self.scene.terrain.fine.bounds
            low, high = self._tiles.low, self._tiles.high
            boxes = ((x0, x1), (y0, y1), (0.0, 0.0)), tuple(zip(low, high))
            for box, texel in zip(boxes, SUN_TEXEL):
                corner = np.array(list(product(*box))) @ axes
                least, most = corner.min(axis=0), corner.max(axis=0)
                half = float((most - least).max()) / 2 + 1.0
                pixels = min(SUN_WIDE_PIXELS, int(np.ceil(2 * half / texel)))
                self._wide.append(self._draw_sun_map((least + most) / 2, half, pixels))
        return self._wide

    def _draw_sun_map(self, centre: np.ndarray, half: float, pixels: int) -> _SunMap:
        sun = self.scene.look.sun
        right, up = _plane_axes(sun)
        low, high = self._tiles.low, self._tiles.high
        diagonal = float(np.linalg.norm(high - low))
        distance = max(SUN_DISTANCE * half, 3 * diagonal)
        pose = np.eye(4)
        pose[:3, :3] = np.stack([right, -up, -sun], axis=1)
        # at this distance stands the scene's middle, so that depths vary by half a diagonal at most
        along = float((low + high) / 2 @ sun)
        pose[:3, 3] = centre[0] * right + centre[1] * up + (distance + along) * sun
        camera = PinholeCamera.centred(pixels, pixels, distance / half * pixels / 2)
        depth, surface = self._draw(camera, pose, distance - diagonal, distance + diagonal)
        depth[surface == SKY] = np.inf
        return _SunMap(centre, half, camera, pose, depth.astype(np.float32))

    def _seen_in_view(self, points: np.ndarray, eye: np.ndarray, axis: np.ndarray) -> np.ndarray:
        right, up = _plane_axes(-axis)
        pose = np.eye(4)
        pose[:3, :3] = np.stack([right, -up, axis], axis=1)
        pose[:3, 3] = eye
        local = rotate(points - eye, pose[:3, :3].T)
        slope = local[:, :2] / local[:, 2:]
        low, high = slope.min(axis=0), slope.max(axis=0)
        focal = min(EYE_FOCAL, (EYE_PIXELS - 6) / max(float((high - low).max()), 1e-6))
        width, height = (np.ceil((high - low) * focal) + 6).astype(int)
        camera = PinholeCamera(int(width), int(height), focal, focal, 3 - focal * low[0], 3 - focal * low[1])
        depth, surface = self._draw(camera, pose, NEAR, self._farthest(eye))
        depth[surface == SKY] = np.inf
        return _nearest_on(depth, camera, pose, points, 0.004 * local[:, 2] + SELF_GAP)


def _lit_on(sun_map: _SunMap, points: np.ndarray, normals: np.ndarray, facing: np.ndarray) -> np.ndarray:
    """(N,) bool: do the points lie in front of the shadow map? facing: (N,) cosine of the sun's angle to the normal."""
    texel = 2 * sun_map.half / sun_map.camera.width
    tilt = np.sqrt(np.maximum(0, 1 - facing**2))
    start = points + (SELF_GAP + texel * tilt)[:, None] * normals
    return _nearest_on(sun_map.depth, sun_map.camera, sun_map.pose, start, np.zeros(len(points)))


def _nearest_on(
    depth: np.ndarray, camera: PinholeCamera, pose: np.ndarray, points: np.ndarray, tolerance: np.ndarray
) -> np.ndarray:
    """(N,) bool: is a point in front of the depth map, or behind it by less than the tolerance [m]?

    Inverse depth is linear on a plane, so on a surface it is interpolated without error between the four pixels around
    the point. Across an edge that says nothing, and the four vote with their bilinear weights.
    """
    local = rotate(points - pose[:3, 3], pose[:3, :3].T)
    pixel = camera.project(local)
    near = local[:, 2] - tolerance
    limit = np.array([camera.width - 2, camera.height - 2])
    column, row = np.clip(pixel, 0, limit).astype(int).T
    right, down = np.clip(pixel[:, 0] - column, 0, 1), np.clip(pixel[:, 1] - row, 0, 1)
    corner = row * camera.width + column
    votes, inverse = np.zeros(len(points)), np.zeros(len(points))
    for dv, du in ((0, 0), (0, 1), (1, 0), (1, 1)):
        weight = (right if du else 1 - right) * (down if dv else 1 - down)
        there = depth.take(corner + dv * camera.width + du)
        votes += weight * (near <= there)
        inverse += weight / there
    return (votes > 0.5) | (near * inverse <= 1)


def _plane_axes(towards: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors that make a right-handed frame with `towards`: right, up, towards."""
    helper = np.array([0.0, 0.0, 1.0]) if abs(towards[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    right = np.cross(helper, towards)
    right /= np.linalg.norm(right)
    return right, np.cross(towards, right)


def _projection(camera: PinholeCamera, near: float, far: float) -> np.ndarray:
    """(4, 4) OpenGL projection for column vectors: pixel centres are integers, row 0 is on top.

    TinyRenderer samples the left edge of a pixel in u and the lower one in v (found by comparison with rays, which the
    tests repeat), so the image is moved by half a pixel each way against OpenGL's convention.
    """
    out = np.zeros((4, 4))
    out[0, 0], out[1, 1] = 2 * camera.fx / camera.width, 2 * camera.fy / camera.height
    out[0, 2] = 1 - 2 * camera.cx / camera.width
    out[1, 2] = 2 * (camera.cy + 1) / camera.height - 1
    out[2, 2], out[2, 3] = -(far + near) / (far - near), -2 * far * near / (far - near)
    out[3, 2] = -1
    return out
