"""The rover's perception: it renders the cameras' images and turns them into depth, or returns the true depth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import perf_counter
from typing import Protocol, runtime_checkable

import numpy as np

from envs.world.eyes import EyesConfig
from envs.world.user_code import errors_of
from m3depth.checked_inference import checked_prediction
from m3depth.estimator import M3DEPTH, Estimator, EstimatorName, load_estimator
from m3depth.runtimes.choice import check_runtime
from m3depth.stereo.rows import align_rows
from marssim.base.camera import NATECAM, StereoRig
from marssim.base.compute.one_thread import one_thread_in_workers, several_threads
from marssim.base.dataset.frame import StereoFrame
from marssim.render.renderers.by_name import checked_renderer_name, make_renderer
from marssim.render.renderers.renderer import Renderer
from marssim.render.sensor import Sensor
from marssim.render.stereo import render_stereo
from marssim.render.surfaces.shading import Shader
from marssim.scene.scene import Scene

GROUND_TRUTH = "ground_truth"  # the name of the perception that reads the true depth


@dataclass(frozen=True)
class Sight:
    """One look of the rover.

    `pose`, `true_depth`, `true_surface` and `occluded` are for scores and films: no rover knows them.
    """

    depth: np.ndarray
    """(H, W) float32 depth of the left eye [m], inf in the sky, NaN where unknown."""
    confidence: np.ndarray
    """(H, W) float32 in [0, 1]."""
    rig: StereoRig
    """The cameras at the size of `depth`."""
    pose: np.ndarray
    """(4, 4) true pose of the left camera, camera to world."""
    pan: float
    """Pan of the mast [rad], positive to the left."""
    left: np.ndarray | None = None
    """(h, w, 3) uint8 image of the left eye; None with ground truth."""
    right: np.ndarray | None = None
    """(h, w, 3) uint8 image of the right eye; None with ground truth."""
    true_depth: np.ndarray | None = None
    """(h, w) true depth of the left eye [m]."""
    true_surface: np.ndarray | None = None
    """(h, w) int32 what the left eye sees, as StereoFrame.surface; None with ground truth."""
    occluded: np.ndarray | None = None
    """(h, w) bool, what the right eye does not see; None with ground truth."""
    normal: np.ndarray | None = None
    """(h, w, 3) surface normals in the camera frame, or None."""
    seconds: float = 0.0
    """Run time of the perception alone [s]."""


def load_perception(perception: str | Estimator, runtime: str = "auto") -> Estimator | None:
    """Return the estimator that turns images into depth; None for "ground_truth", which needs none.

    Args:
        perception: As MarsNavEnv takes it.
        runtime: Program that runs M3Depth, as MarsNavEnv takes it.

    Raises:
        ValueError: If the name or the runtime is unknown; it lists the known ones.
        FileNotFoundError: If a file of weights is missing.
        ImportError: If OpenVINO is asked for and not installed.
    """
    if isinstance(perception, str) and perception == GROUND_TRUTH:
        check_runtime(runtime)
        return None
    return load_estimator(perception, "`perception`", (GROUND_TRUTH,), runtime=runtime)


def is_ours(perception: str) -> bool:
    """Return whether a name is of a method of this project, which keeps nothing from one pair to the next."""
    return ":" not in perception or perception.startswith(f"{M3DEPTH}:")


def perception_digest(perception: str) -> str | None:
    """Return the SHA-256 of the file that a perception is read from; None where it is part of the packages' code.

    Raises:
        OSError: The weights file is missing or cannot be read.
    """
    return None if perception == GROUND_TRUTH else EstimatorName.parse(perception).digest()


def rng_of_perception(rng: np.random.Generator) -> np.random.Generator:
    """Return the generator that a drive's detectors and their noise are drawn from.

    Args:
        rng: Generator of the episode, from which one number is drawn.
    """
    return np.random.default_rng(rng.integers(2**63))


@runtime_checkable
class BeginsDrives(Protocol):
    """An estimator that remembers something from pair to pair, and can forget it."""

    def begin_drive(self) -> None:
        """Forget the last drive."""


class Perception:
    """Looks at one scene after the other.

    Attributes:
        renderer_name: Name of the renderer.
        renderer: The renderer of the open scene, or None.
        sensor: The detectors of the open scene, or None.
        eyes: The settings of the cameras; others may be set before `open`.
        estimator: The estimator; None for ground truth.
        disparity_noise: Standard deviation of an error added to the perceived disparity [px of a 512 px image].
        align_rows: Whether rows that lie apart are aligned first (m3depth.stereo.rows).
    """

    def __init__(
        self,
        perception: str | Estimator,
        renderer: str,
        eyes: EyesConfig | None = None,
        disparity_noise: float = 0.0,
        align_rows: bool = True,
        runtime: str = "auto",
    ) -> None:
        """Load the estimator; `open` makes the renderer.

        Args:
            perception: "ground_truth", an estimator's name or class path, or an estimator.
            renderer: Name of a renderer.
            eyes: The cameras; None for sound ones of the default size.
            disparity_noise: Standard deviation of an error added to the perceived disparity [px of a 512 px image].
            align_rows: Whether rows of the images that lie significantly apart are aligned before an estimator sees
                them.
            runtime: Program that runs M3Depth, as load_estimator takes it.
        """
        one_thread_in_workers()
        self.renderer_name = checked_renderer_name(renderer)
        self.estimator = load_perception(perception, runtime)
        self.eyes = eyes or EyesConfig()
        self.disparity_noise = float(disparity_noise)
        self.align_rows = align_rows
        self.renderer: Renderer | None = None
        self.sensor: Sensor | None = None
        self._scene: Scene | None = None
        self._shader: Shader | None = None

    @property
    def rig(self) -> StereoRig:
        """The cameras."""
        return self.eyes.rig

    def open(self, scene: Scene, rng: np.random.Generator) -> None:
        """Turn to a scene, for a new drive.

        The renderer of one that is open already stays. The method begin_drive of an estimator, without arguments, is
        called where there is one, so that it can forget the last drive.

        Args:
            scene: The scene.
            rng: Draws the detector and its noise.

        Raises:
            UserCodeError: If `begin_drive` of a class of the user raises an exception.
        """
        if isinstance(self.estimator, BeginsDrives):
            with errors_of(self.estimator):
                self.estimator.begin_drive()
        if self.renderer is None or scene is not self._scene:
            self.close()
            self.renderer = make_renderer(self.renderer_name, scene)
            self._scene, self._shader = scene, None  # true depth needs no shading
        self._rng = rng
        self.sensor = Sensor.draw(self.eyes.sensor(), rng)
        self._noise = np.random.default_rng(rng.integers(2**63)) if self.disparity_noise else rng

    def look(self, pose: np.ndarray, pan: float) -> Sight:
        """Take the images from a pose, and turn them into depth.

        Args:
            pose: (4, 4) pose of the left camera, camera to world.
            pan: Pan of the mast [rad], positive to the left.

        Raises:
            EstimatorError: If the estimator returns anything but a whole Prediction.
            UserCodeError: If a class of the user raises an exception (envs.world.user_code).
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
            rig = self.eyes.ground_truth_rig
            depth = self.renderer.render(rig.camera, pose, sunlit=False).depth
            return Sight(depth, np.ones_like(depth), rig, pose, pan, true_depth=depth)
        frame = self.picture(pose)
        start = perf_counter()
        right = align_rows(frame.left, frame.right, self.rig)[0] if self.align_rows else frame.right
        with errors_of(self.estimator):
            returned = self.estimator.infer(frame.left.copy(), right.copy(), self.rig)  # it may write into them
        seconds = perf_counter() - start
        prediction = checked_prediction(self.estimator, returned, frame.left.shape[:2])
        return Sight(
            depth=prediction.depth,
            confidence=prediction.confidence,
            rig=self.rig,
            pose=pose,
            pan=pan,
            left=frame.left,
            right=frame.right,
            true_depth=frame.depth,
            true_surface=frame.surface,
            occluded=frame.occluded,
            normal=prediction.normal,
            seconds=seconds,
        )

    def picture(self, pose: np.ndarray) -> StereoFrame:
        """Return the StereoFrame from a pose, as the cameras take it."""
        if self.renderer is None or self._scene is None or self.sensor is None:
            raise RuntimeError("open a scene before looking")
        self._shader = self._shader or Shader(self._scene)
        return render_stereo(
            self.renderer, self._shader, self.rig, pose, self.sensor, self._rng, at_once=several_threads()
        )

    def close(self) -> None:
        """Free the renderer and forget the scene; may be called twice."""
        if self.renderer is not None:
            self.renderer.close()
        self.renderer = self.sensor = self._scene = self._shader = None
