"""Renders a pair as the cameras of a rig take it, before rectification.

Each eye is rendered as an image without distortion in the lens's own orientation, with at least FINER pixels for one of
the raw image, and the raw pixels are the means of this image over what the lens shows in them. So the raw pair has the
light, the shadows and the edges of the rectified one, with any renderer. The relief is filtered for the rectified left
camera, as in the rectified pair: both pairs show one surface, that of the truth.

What this leaves out: entrance pupils that move (the terms E of CAHVORE). All rays pass through the lens's centre, as
m3depth.rectify assumes too.
"""

from __future__ import annotations

import cv2
import numpy as np

from marssim.base.calibration.cameras import PosedCamera
from marssim.base.calibration.rig_file import RawRig
from marssim.base.camera import PinholeCamera
from marssim.render.geometry.gbuffer import Footprint
from marssim.render.own_rover.body import RoverBody
from marssim.render.own_rover.renderer import WithRover
from marssim.render.renderers.renderer import Renderer
from marssim.render.sensor import Sensor
from marssim.render.stereo import light_at_detector
from marssim.render.surfaces.shading import Shader

FINER = 2.0  # pixels of the image without distortion for one of the raw image, along a side, where there are fewest
STEP = 1.5  # largest distance of the places that a raw pixel is the mean of, in pixels of the image without distortion
FEWEST, MOST = 2, 8  # such places along a side
WIDEST = np.deg2rad(70)  # largest angle to the lens's axis: tan grows beyond all use there
MOST_DARK = 0.05  # share of a raw image that may lie beyond it, or have no ray
LARGEST = 16_384  # [px] side of the image without distortion
OUTSIDE = -1e4  # [px] place of what shows nothing


class RawLens:
    """A lens as a resampling of an image without distortion.

    Attributes:
        ideal: The camera of that image, in the frame of the lens.
        places: (H, W, 2) float32 column and row in it of the middles of the raw pixels; -1e4 where they see nothing.
    """

    def __init__(self, camera: PosedCamera, name: str) -> None:
        """Choose the image.

        Args:
            camera: The lens and the size of its images.
            name: What messages call it.

        Raises:
            ValueError: Too much of the image lies far off the axis, or the image without distortion is too large.
        """
        assert camera.size is not None
        tangents = _tangents(camera)
        if (dark := float(np.isnan(tangents[..., 0]).mean())) > MOST_DARK:
            raise ValueError(
                f"{100 * dark:.0f} % of the image of the {name} camera lie more than {np.rad2deg(WIDEST):.0f} deg off "
                "its axis, which cannot be rendered"
            )
        steps = np.stack(np.gradient(tangents, axis=(1, 0)), axis=-1)  # (H, W, x or y, along row or column)
        least, most = _extremes(steps)
        focal = FINER / least
        self._count = int(np.clip(np.ceil(focal * most / STEP), FEWEST, MOST))
        low, high = np.nanmin(tangents, axis=(0, 1)) - most, np.nanmax(tangents, axis=(0, 1)) + most
        width, height = (int(np.ceil(focal * side)) for side in high - low)
        if max(width, height) > LARGEST:
            raise ValueError(
                f"the {name} camera would be rendered from an image of {width} x {height} px, over {LARGEST} px"
            )
        self.ideal = PinholeCamera(width, height, focal, focal, float(-focal * low[0]), float(-focal * low[1]))
        places = tangents * focal + (self.ideal.cx, self.ideal.cy)
        self.places = np.nan_to_num(places, nan=OUTSIDE).astype(np.float32)
        self._steps = np.nan_to_num(focal * steps).astype(np.float32)

    def mean(self, image: np.ndarray) -> np.ndarray:
        """Return the raw image (H, W, C) of an image (H', W', C) float32 of `ideal`; 0 where it sees nothing."""
        offsets = (np.arange(self._count, dtype=np.float32) + 0.5) / self._count - 0.5
        total = np.zeros((*self.places.shape[:2], *image.shape[2:]), np.float32)
        for dv in offsets:
            for du in offsets:
                places = self.places + self._steps @ np.array([du, dv])
                total += cv2.remap(image, places[..., 0], places[..., 1], cv2.INTER_LINEAR)
        return total / self._count**2

    def nearest(self, mask: np.ndarray) -> np.ndarray:
        """Return what a mask (H', W') bool of `ideal` has at the middles of the raw pixels, (H, W) bool."""
        return cv2.remap(mask.astype(np.uint8), self.places[..., 0], self.places[..., 1], cv2.INTER_NEAREST) > 0


class RawRenderer:
    """Renders raw pairs of a rig. It works out the lenses once."""

    def __init__(self, raw: RawRig) -> None:
        """Prepare the lenses of a rig.

        Raises:
            ValueError: A lens cannot be rendered.
        """
        self.raw = raw
        self._lenses = {name: RawLens(getattr(raw.cameras, name), name) for name in ("left", "right")}

    def pose(self, eye: str, pose: np.ndarray, turn: np.ndarray) -> np.ndarray:
        """Return the pose of a camera as it was built, (4, 4) camera to world.

        Args:
            eye: "left" or "right".
            pose: (4, 4) rectified left camera to world.
            turn: (3, 3) turn of the rectified camera of this eye, from its frame to that of the ideal one.
        """
        camera: PosedCamera = getattr(self.raw.cameras, eye)
        to_rectified = self.raw.view.rotation
        out = np.array(pose, dtype=float)
        out[:3, 3] += pose[:3, :3] @ to_rectified @ (camera.centre - self.raw.cameras.left.centre)
        out[:3, :3] = pose[:3, :3] @ turn @ to_rectified @ camera.rotation.T
        return out

    def render(
        self, renderer: Renderer, shader: Shader, pose: np.ndarray, sensor: Sensor, rng: np.random.Generator,
        rover: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Render the raw pair that belongs to a rectified one of `render_stereo`.

        The sensor's errors of rectification turn the right camera as they do there: a pair that is rectified with the
        calibration of the rig has them too.

        Args:
            renderer: Renderer of the scene.
            shader: Shader of the same scene.
            pose: (4, 4) rectified left camera to world.
            sensor: The two detectors.
            rng: Random generator of the detectors' noise.
            rover: (4, 4) body to world of the rover that carries the cameras; None for a scene without it.

        Returns:
            Two (H, W, 3) uint8 RGB images.
        """
        rig = self.raw.rig
        if rover is not None:
            renderer = WithRover(renderer, RoverBody(rover, pose, rig.baseline), shader.light.sun)
        footprint = Footprint.from_camera(rig.camera, pose)
        turns = {"left": np.eye(3), "right": sensor.right_rotation(rig.camera)}
        light, ground = {}, None
        for eye, lens in self._lenses.items():
            eye_pose = self.pose(eye, pose, turns[eye])
            view = renderer.render(lens.ideal, eye_pose, footprint)
            colour = light_at_detector(renderer, shader, lens.ideal, eye_pose, view, footprint, sensor.sun_glare)
            light[eye] = lens.mean(colour)
            ground = lens.nearest(view.hit) if ground is None else ground
        assert ground is not None
        return sensor.expose_pair(light["left"], light["right"], ground, rng)


def _tangents(camera: PosedCamera) -> np.ndarray:
    """Return (H, W, 2) x / z and y / z of the rays of all pixels, in the camera's frame; NaN where there are none."""
    assert camera.size is not None
    u, v = np.meshgrid(np.arange(camera.size[0]), np.arange(camera.size[1]))
    direction = camera.lens.rays(np.stack([u, v], axis=-1)).direction
    with np.errstate(invalid="ignore"):
        ahead = np.where(direction[..., 2:] > np.cos(WIDEST), direction[..., 2:], np.nan)
    return direction[..., :2] / ahead


def _extremes(steps: np.ndarray) -> tuple[float, float]:
    """Return the least and the largest change (per pixel) of tangents in any direction, from (H, W, 2, 2) steps."""
    finite = steps[np.isfinite(steps).all(axis=(-2, -1))]
    squares, determinant = (finite**2).sum(axis=(-2, -1)), np.abs(np.linalg.det(finite))
    largest = np.sqrt((squares + np.sqrt(np.maximum(squares**2 - 4 * determinant**2, 0))) / 2)
    return float((determinant / largest).min()), float(largest.max())
