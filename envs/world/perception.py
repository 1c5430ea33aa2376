"""The rover's eyes: renders what its cameras see and turns it into depth, by an estimator or by the ground truth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from envs.world.user_code import errors_of
from m3depth.estimator import Estimator, EstimatorName, checked_prediction, load_estimator
from marssim.base.camera import NATECAM, StereoRig
from marssim.base.dataset.frame import StereoFrame
from marssim.render.geometry.gbuffer import GBufferMaker
from marssim.render.renderers.by_name import known_renderer, make_renderer
from marssim.render.sensor import Sensor, SensorConfig
from marssim.render.stereo import render_stereo
from marssim.render.surfaces.shading import Shader
from marssim.scene.scene import Scene

GROUND_TRUTH = "ground_truth"  # the name of the perception that reads the true depth
GROUND_TRUTH_PIXELS = 128  # true depth needs no images: this many rays a side are enough to drive by


@dataclass(frozen=True)
class Sight:
    """One look.

    depth: (H, W) float32 [m] of the left eye, inf in the sky, NaN unknown. confidence: (H, W) float32 in [0, 1].
    rig: of these maps; pan [rad] of the mast. left, right: (h, w, 3) uint8 images or None with ground truth. normal:
    (h, w, 3), camera frame, or None. seconds: perception alone. What no rover knows, for scores and films: pose, (4, 4)
    left camera to world as it truly is; true_depth, (h, w) [m].
    """

    depth: np.ndarray
    confidence: np.ndarray
    rig: StereoRig
    pose: np.ndarray
    pan: float
    left: np.ndarray | None = None
    right: np.ndarray | None = None
    true_depth: np.ndarray | None = None
    normal: np.ndarray | None = None
    seconds: float = 0.0


def load_perception(perception: str | Estimator) -> Estimator | None:
    """What turns images into depth; None for "ground_truth", which needs none.

    perception: as MarsNavEnv takes it. Raises ValueError that lists the names there are, FileNotFoundError that names
    the file if weights are missing.
    """
    if isinstance(perception, str) and perception == GROUND_TRUTH:
        return None
    return load_estimator(perception, "`perception`", (GROUND_TRUTH,))


def perception_digest(perception: str) -> str | None:
    """Return the SHA-256 of the file that a perception is read from; None where it is part of the packages' code.

    Raises:
        OSError: The weights file is missing or cannot be read.
    """
    return None if perception == GROUND_TRUTH else EstimatorName.parse(perception).digest()


class Perception:
    """Looks at one Scene. perception: "ground_truth", an estimator's name or class path, or an estimator object."""

    def __init__(
        self,
        perception: str | Estimator,
        renderer: str,
        sensor: SensorConfig | None = None,
        disparity_noise: float = 0.0,
    ) -> None:
        """disparity_noise: standard deviation [px of a 512 px image] of an error added to what is perceived."""
        self.renderer_name = known_renderer(renderer)
        self.estimator = load_perception(perception)
        self.sensor_config = sensor or SensorConfig()
        self.disparity_noise = disparity_noise
        self.renderer: GBufferMaker | None = None
        self._shader: Shader | None = None

    def open(self, scene: Scene, rng: np.random.Generator) -> None:
        """Turn to another scene; rng draws the detector and its noise."""
        self.close()
        self.renderer = make_renderer(self.renderer_name, scene)
        self._scene, self._shader = scene, None  # true depth needs no shading
        self._rng = rng
        self._sensor = Sensor.draw(self.sensor_config, rng)
        self._noise = np.random.default_rng(rng.integers(2**63)) if self.disparity_noise else rng

    def look(self, pose: np.ndarray, pan: float) -> Sight:
        """See from a left-camera pose (4, 4) to world.

        Raises EstimatorError (m3depth.estimator) where the perception returns anything but a whole Prediction,
        UserCodeError (envs.world.user_code) for what a class of the user's own raises.
        """
        sight = self._see(pose, pan)
        if self.disparity_noise == 0:
            return sight
        disparity = sight.rig.depth_to_disparity(sight.depth)
        scale = sight.rig.camera.width / NATECAM.camera.width
        disparity = disparity + self._noise.normal(0, self.disparity_noise * scale, disparity.shape)
        noisy = sight.rig.disparity_to_depth(disparity)
        return replace(sight, depth=np.where(np.isfinite(sight.depth), noisy, sight.depth).astype(np.float32))

    def _see(self, pose: np.ndarray, pan: float) -> Sight:
        if self.renderer is None:
            raise RuntimeError("open a scene before looking")
        if self.estimator is None:
            rig = NATECAM.resized(GROUND_TRUTH_PIXELS, GROUND_TRUTH_PIXELS)
            depth = self.renderer.render(rig.camera, pose).depth
            return Sight(depth, np.ones_like(depth), rig, pose, pan, true_depth=depth)
        frame = self.picture(pose)
        start = perf_counter()
        with errors_of(self.estimator):
            found = self.estimator.infer(frame.left, frame.right, NATECAM)
        seconds = perf_counter() - start
        seen = checked_prediction(self.estimator, found, frame.left.shape[:2])
        return Sight(
            seen.depth, seen.confidence, NATECAM, pose, pan, frame.left, frame.right, frame.depth, seen.normal, seconds
        )

    def picture(self, pose: np.ndarray) -> StereoFrame:
        """The StereoFrame from a pose, as the cameras take it."""
        if self.renderer is None:
            raise RuntimeError("open a scene before looking")
        self._shader = self._shader or Shader(self._scene)
        return render_stereo(self.renderer, self._shader, NATECAM, pose, self._sensor, self._rng)

    def close(self) -> None:
        """Free the renderer; may be called twice."""
        if self.renderer is not None:
            self.renderer.close()
            self.renderer = None
