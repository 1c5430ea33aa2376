"""Stereo frames of a scene in a few lines of Python, from any place and under any sun.

    from marssim.render.view import SceneRenderer, render_view
    from marssim.scene.presets import preset
    from marssim.scene.scene import build_scene

    scene = build_scene(preset("gale"), rng=7)
    frame = render_view(scene, x=2.0, y=-1.0, yaw_deg=30)
    frame.left, frame.depth  # (512, 512, 3) uint8 RGB and (512, 512) float32 [m]

    rng = np.random.default_rng(0)  # the frames share it, so that their noise differs
    with SceneRenderer(scene.with_sun(elevation_deg=10, azimuth_deg=200)) as renderer:
        frames = [renderer.render(x=0, y=0, yaw_deg=yaw, rng=rng) for yaw in (0, 90, 180, 270)]

Positions are in the world frame of the scene: x east, y north, z up, in metres from the scene's middle. Angles are in
degrees and end in `_deg`. What a frame holds is documented at `marssim.base.dataset.frame.StereoFrame`.
"""

from __future__ import annotations

import numpy as np

from marssim.base.camera import NATECAM, StereoRig
from marssim.base.compute.one_thread import several_threads
from marssim.base.dataset.frame import StereoFrame
from marssim.base.pose import rigid_pose
from marssim.render.renderers.by_name import RendererName, make_renderer
from marssim.render.sensor import Sensor, SensorConfig
from marssim.render.stereo import render_stereo
from marssim.render.surfaces.shading import Shader
from marssim.scene.own_rover import ROVER_DRAWS, draw_pan, draw_pose_of_rover, rover_below
from marssim.scene.scene import Scene
from marssim.scene.trajectory import MastState
from marssim.scene.viewpoint import ViewConfig, draw_pose, pose_on_ground

PITCH_DEG = 20.0  # [deg] how far NaTeCam looks down on the rover's mast
HEIGHT = 1.2  # [m] height of NaTeCam above the ground


def _of_rover(rng: np.random.Generator) -> np.random.Generator:
    """Return a generator of the rover's draws, which spawns from a generator of a frame's draws."""
    spawned = rng.spawn(1)[0].bit_generator.seed_seq
    assert isinstance(spawned, np.random.SeedSequence)
    return np.random.default_rng(np.random.SeedSequence(spawned.entropy, spawn_key=(*spawned.spawn_key, ROVER_DRAWS)))


class SceneRenderer:
    """Renders stereo frames of one scene. Use it as a context manager, or call `close`.

    Building it takes longer than a frame, so keep it for all frames of a scene. The scene's sun is fixed: for another
    sun, build another SceneRenderer of `scene.with_sun(...)`.
    """

    def __init__(self, scene: Scene, renderer: RendererName = "scan", rig: StereoRig = NATECAM) -> None:
        """Prepare the geometry and the surface of a scene.

        Args:
            scene: The scene, of `build_scene`.
            renderer: "scan", "embree" or "pybullet". Scan is the default here: it starts fastest and needs no library.
                The three differ in a few pixels on silhouettes.
            rig: The two cameras.

        Raises:
            ValueError: There is no renderer of that name.
            ImportError: The renderer's library is not installed.
        """
        self.scene = scene
        self.rig = rig
        self._renderer = make_renderer(renderer, scene)
        self._shader = Shader(scene)

    def render(
        self,
        x: float,
        y: float,
        yaw_deg: float,
        pitch_deg: float = PITCH_DEG,
        roll_deg: float = 0.0,
        height: float = HEIGHT,
        sensor: Sensor | None = None,
        rng: np.random.Generator | int = 0,
        rover_pan_deg: float | None = None,
    ) -> StereoFrame:
        """Render the view of a rig whose left camera stands above a point of the ground.

        Args:
            x: East of the scene's middle [m].
            y: North of the scene's middle [m].
            yaw_deg: Viewing direction [deg], counter-clockwise from east: 90 looks north.
            pitch_deg: How far the cameras look down from the horizon [deg].
            roll_deg: Tilt about the optical axis [deg], clockwise as seen from behind the camera.
            height: Height of the left camera above the ground [m].
            sensor: The detectors; None draws them from the ranges of SensorConfig.
            rng: Random generator, or the seed of one, for the detectors and their noise. One seed gives all frames the
                same noise; frames that share a generator differ.
            rover_pan_deg: How far the mast is turned to the left of where the rover heads [deg], for a view with the
                rover that carries the cameras and its shadow; None for a view without it.

        Raises:
            ValueError: The point lies outside the scene, an angle is not finite, or the height is not above 0.
            RuntimeError: The renderer is closed.
        """
        for name, value in (("yaw_deg", yaw_deg), ("pitch_deg", pitch_deg), ("roll_deg", roll_deg)):
            if not np.isfinite(value):
                raise ValueError(f"{name} must be finite, got {value}")
        if not 0 < height < np.inf:
            raise ValueError(f"height must be above 0 m and finite, got {height}")
        horizon = self.scene.terrain.coarse
        if not horizon.contains(np.array(x), np.array(y)):
            raise ValueError(f"x={x:g}, y={y:g} is outside the scene, which reaches {horizon.bounds[2]:g} m each way")
        yaw, pitch, roll = np.deg2rad([yaw_deg, pitch_deg, roll_deg])
        pose = pose_on_ground(self.scene, x, y, yaw, pitch, roll, height)
        return self.render_from(pose, sensor, rng, rover_pan_deg)

    def render_from(
        self, pose: np.ndarray, sensor: Sensor | None = None, rng: np.random.Generator | int = 0,
        rover_pan_deg: float | None = None,
    ) -> StereoFrame:  # fmt: skip
        """Render the view from a pose of the left camera.

        Args:
            pose: (4, 4) left camera (x right, y down, z forward) to world.
            sensor: The detectors; None draws them from the ranges of SensorConfig.
            rng: Random generator, or the seed of one, for the detectors and their noise.
            rover_pan_deg: As in `render`.

        Raises:
            ValueError: The pose is no rotation and translation, or the pan of the rover is not finite.
            RuntimeError: The renderer is closed.
        """
        pose = rigid_pose(pose)
        if rover_pan_deg is not None and not np.isfinite(rover_pan_deg):
            raise ValueError(f"rover_pan_deg must be finite, got {rover_pan_deg}")
        rng = np.random.default_rng(rng)
        sensor = sensor or Sensor.draw(SensorConfig(), rng)
        rover = None
        if rover_pan_deg is not None:
            rover = rover_below(self.scene, pose, self.rig.baseline, float(np.deg2rad(rover_pan_deg)))
        return render_stereo(
            self._renderer, self._shader, self.rig, pose, sensor, rng, rover, at_once=several_threads()
        )

    def draw(
        self,
        rng: np.random.Generator | int,
        view: ViewConfig | None = None,
        sensor: SensorConfig | None = None,
    ) -> StereoFrame:
        """Render a view from a random place, drawn as `marssim.generate` draws those of a dataset.

        Args:
            rng: Random generator, or the seed of one. The same seed gives the same frame.
            view: Ranges of the cameras' height and angles, and of the rover; None takes the defaults of ViewConfig.
            sensor: Ranges of the detectors' values; None takes the defaults of SensorConfig.

        Raises:
            ValueError: Rocks leave the camera no place to stand, or the right one is below the ground everywhere.
            RuntimeError: The renderer is closed.
        """
        rng = np.random.default_rng(rng)
        view = view or ViewConfig()
        pan = draw_pan(view, _of_rover(rng))
        if pan is None:
            pose = draw_pose(self.scene, view, rng, self.rig.baseline)
        else:
            pose = draw_pose_of_rover(self.scene, view, rng, MastState(self.rig.baseline, pan))
        drawn = Sensor.draw(sensor or SensorConfig(), rng)
        return self.render_from(pose, drawn, rng, None if pan is None else float(np.rad2deg(pan)))

    def close(self) -> None:
        """Free the renderer's memory; a second call does nothing."""
        self._renderer.close()

    def __enter__(self) -> SceneRenderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def render_view(
    scene: Scene,
    x: float,
    y: float,
    yaw_deg: float,
    pitch_deg: float = PITCH_DEG,
    roll_deg: float = 0.0,
    height: float = HEIGHT,
    sun_elevation_deg: float | None = None,
    sun_azimuth_deg: float | None = None,
    rig: StereoRig = NATECAM,
    renderer: RendererName = "scan",
    sensor: Sensor | None = None,
    rng: np.random.Generator | int = 0,
    rover_pan_deg: float | None = None,
) -> StereoFrame:
    """Render one stereo frame of a scene. For several frames of a scene, SceneRenderer is faster.

    Args:
        scene: The scene, of `build_scene`.
        x: East of the scene's middle [m].
        y: North of the scene's middle [m].
        yaw_deg: Viewing direction [deg], counter-clockwise from east: 90 looks north.
        pitch_deg: How far the cameras look down from the horizon [deg].
        roll_deg: Tilt about the optical axis [deg], clockwise as seen from behind the camera.
        height: Height of the left camera above the ground [m].
        sun_elevation_deg: Height of the sun above the horizon [deg]; None keeps the sun that the scene drew.
        sun_azimuth_deg: Direction of the sun [deg], counter-clockwise from east; None keeps the scene's.
        rig: The two cameras.
        renderer: "scan", "embree" or "pybullet"; see SceneRenderer.
        sensor: The detectors; None draws them from the ranges of SensorConfig.
        rng: Random generator, or the seed of one, for the detectors and their noise.
        rover_pan_deg: As in SceneRenderer.render.

    Returns:
        Both images with depth, disparity, normals, surface ids and the mask of occluded pixels.

    Raises:
        ValueError: The point lies outside the scene, the sun is out of range, or there is no such renderer.
        ImportError: The renderer's library is not installed.
    """
    if sun_elevation_deg is not None or sun_azimuth_deg is not None:
        sun = scene.look.sun
        elevation = np.rad2deg(scene.look.sun_elevation) if sun_elevation_deg is None else sun_elevation_deg
        azimuth = np.rad2deg(np.arctan2(sun[1], sun[0])) if sun_azimuth_deg is None else sun_azimuth_deg
        scene = scene.with_sun(float(elevation), float(azimuth))
    with SceneRenderer(scene, renderer, rig) as opened:
        return opened.render(x, y, yaw_deg, pitch_deg, roll_deg, height, sensor, rng, rover_pan_deg)
