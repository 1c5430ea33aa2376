"""MarsNav-v0: cross rocky Martian ground to a goal, seeing through a stereo camera only."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import EzPickle

from envs.courses.clearance import ObstacleClearance
from envs.courses.course import Course
from envs.courses.kept_scene import another_course
from envs.observation.info import episode_info
from envs.observation.map_view import MapView
from envs.observation.spaces import observation_space, observe
from envs.suites.drawn_course import draw_episode
from envs.suites.draws import Condition, EpisodeDraws, EpisodeSettings, Number, Slip, stream_of_draws
from envs.world.action import checked_action, warn_if_ended
from envs.world.arguments import check_count, check_errors, check_flags, check_render_mode, checked_scene
from envs.world.eyes import EyesConfig
from envs.world.gaze import Gaze
from envs.world.odometry import Odometry
from envs.world.perception import Perception, Sight, rng_of_perception
from envs.world.referee import Referee
from envs.world.reward import step_reward
from envs.world.slip import SlipGauge
from envs.world.vehicle import FALLBACK_NOTE, DynamicsName, Vehicle, checked_dynamics, make_vehicle
from envs.world.way_driven import WayDriven
from marssim.base.rover_spec import ZHURONG
from marssim.render.renderers.by_name import RendererName
from marssim.scene.scene import SceneConfig

if TYPE_CHECKING:
    from envs.world.outside_view import OutsideView
    from m3depth.estimator import Estimator

STEP_SECONDS = 2.0  # [s] that the rover drives in one step


class MarsNavEnv(gymnasium.Env, EzPickle):
    """
    ## Description

    A six-wheel rover of Zhurong's size stands on a Martian plain with rocks, craters and slopes, and has to come within
    1 m of a goal. It sees through its mast camera NaTeCam only: at each step it drives for 2 s, stops and looks. The
    real rover drives at 0.056 m/s; here it may drive at 0.20 m/s. At both speeds the motion is quasi-static, so the
    outcome is the same.

    ## Action space

    `Box(-1, 1, (2,), float32)`; with `mast=True` `Box(-1, 1, (3,), float32)`.

    | Num | Action                         | -1               | 1               |
    |-----|--------------------------------|------------------|-----------------|
    | 0   | forward speed                  | -0.20 m/s        | 0.20 m/s        |
    | 1   | yaw rate, positive to the left | -0.25 rad/s      | 0.25 rad/s      |
    | 2   | pan of the mast for the next look (`mast=True`) | 90 deg right | 90 deg left |

    The mast turns at 30 deg/s while the rover drives, 60 deg in a step at most: a look to the side costs steps, and a
    longer turn continues in the next step. Actions outside the box are clipped. Curves that would turn a wheel beyond
    its stop become the nearest ones that do not (`nav.controller.steerable`).

    ## Observation space

    `Dict`, all float32.

    | Key     | Shape    | Meaning                                                            | Unit, range |
    |---------|----------|--------------------------------------------------------------------|-------------|
    | `depth` | (64, 64) | depth z of the left eye, nearest of each block; 15 beyond, 0 unknown | m, 0 to 15 |
    | `goal`  | (3,)     | distance; sine and cosine of the bearing from the heading, left > 0 | m; -1 to 1  |
    | `state` | (6,)     | roll, pitch; speed; yaw rate; last action (2)                | rad; m/s; rad/s; -1 to 1 |
    | `map`   | (3, 64, 64) | with `map_observation=True`: see below                          | -1 to 1     |
    | `pan`   | (1,)     | with `mast=True`: pan of the mast / 90 deg, left > 0               | -1 to 1     |

    `map` shows 12.8 m around the rover, with its heading up, as `nav` has fused it from all looks. Channel 0: height
    above the rover / 2 m. Channel 1: largest cost of driving in a pixel, 0 to 1: an obstacle, or 8 m more for a metre.
    Channel 2: 1 where the ground was seen or is assumed flat (2.5 m about the start, and under the rover), else 0.

    `envs.drivers.image_observation.ImageObservation` turns depth and map into the uint8 images that stable-baselines3
    expects, `envs.drivers.corridors.Corridors` the map into a short vector and the action into one number. What is seen
    at full size (stereo pair, depth, confidence, rig, pan) is `env.unwrapped.sight` (envs.world.perception.Sight),
    beside the truth (its `true_depth` and `pose`) by which a driver must not drive; its odometry is `believed_pose`.

    ## Reward

    Progress along the shortest path round the obstacles to the goal [m], minus 0.01 a step; +10 at the goal, -10 at a
    collision or a tilt of more than 30 deg.

    ## Starting state

    The scene is drawn from the seed. Start and goal lie `goal_distance` apart, free of rocks and ditches within 2.5 m,
    and of other steep ground within 1.2 m; the rover heads for the goal within 45 deg. A course without a way to its
    goal is drawn again (`info["redraws"]`).

    A way is passable if it keeps clear of rocks of 0.30 m or more, of ground that is steeper than 25 deg over 1.1 m,
    and of drops: heights that differ by 0.30 m or more within 0.4 m, as at the brink of a ditch or of a fresh crater.

    ## Episode end

    Terminated: within 1 m of the goal; the chassis touches anything, on uneven ground also rocks of 0.24 m, or a wheel
    a rock of 0.30 m or more; tilt over 30 deg; out of bounds; stuck (less than 0.1 m in five steps that were commanded
    to drive at 0.05 m/s or more, forwards or backwards). Truncated: out of time, 15 steps for each metre of goal
    distance. `info["outcome"]` is "driving" or one of "goal", "collision", "tilt", "out_of_bounds", "stuck", "time".
    There is no action to stop: the rover's true place ends the episode, whatever the odometry says. A fall into a ditch
    has no rule of its own: it ends as "tilt", as "collision" where the chassis touches the brink, or not at all where
    the rover gets through. Drivers of `envs.evaluate` may end a drive by themselves: "no_path", or "elsewhere" where
    they believe that they are at the goal and are not.

    ## Information

    | Key                  | Meaning                                                                               |
    |----------------------|---------------------------------------------------------------------------------------|
    | `outcome`            | see above                                                                             |
    | `is_success`         | whether the rover is at its goal                                                      |
    | `distance`           | distance to the goal [m]                                                              |
    | `shortest`           | length of the shortest passable path from the start to the goal [m]                    |
    | `to_go`              | length of the shortest passable path from here to the goal [m]; inf if there is none  |
    | `path_length`        | length of the way driven [m]                                                          |
    | `min_clearance`      | least distance so far from the footprint to an obstacle, as above [m]; 3 if farther   |
    | `pan`                | pan of the mast [rad]                                                                 |
    | `position_error`     | error of the odometry's position [m]                                                  |
    | `perception_seconds` | run time of the perception at this look [s]                                           |
    | `looked`             | whether this step ended with a look, as every step does without `look_every`          |
    | `redraws`            | rejected courses: no way to the goal, or a steep end; 0 after a scene's first episode |
    | `slip`               | with `slip`: share of the wheels' way in this step that the rover did not make        |
    | `sideways`           | with `slip`: how far the rover slid to its left in this step [m]                      |
    | `sinkage`            | with `slip`: mean depth of the wheels in the soil in this step [m]                    |
    | `energy`             | with `slip`: energy of the wheels' motors since the start [J]                         |
    | `drive_seconds`      | with `slip`: time in which the wheels have turned since the start [s]                 |
    | `drawn`              | with ranges or choices: dict of the episode's values, a `condition` as name or JSON text |

    ## Arguments

    `perception`: "m3depth" (default), "sgbm", "ground_truth", "m3depth:WEIGHTS", "package.module:Class", any object
    with `infer(left, right, rig)`, or a classical window: "ssd", "sad", "ncc", each also with "-sgm". Estimators see
    images of 512 x 512 pixels. The ground truth has 128 x 128 rays over the same view and needs no images.

    `dynamics`: "physics" (PyBullet's rigid bodies) or "kinematic" (settling alone, faster). The default is "physics",
    and "kinematic", with a warning, without PyBullet. `renderer`: "embree" (default), "scan" or "pybullet".

    `scene`: the name of a preset, "utopia" by default; the path of a JSON file of a place (marssim.scene.place_file);
    or a SceneConfig. The course determines its size and cell: `goal_distance` + 14 m wide, on a grid of 0.1 m.

    `goal_distance`, `k`, `slope_deg`, `sun_elevation_deg`: defaults of the options of `reset` below. Each is a number,
    or the two ends of a range, as `k=(0.03, 0.2)`, from which each scene draws its own.

    `mast`, `map_observation`: whether the action has a pan and the observation a map, see the spaces.

    `disparity_noise`: standard deviation of an error added to the disparity of each pixel [px], at 512 pixels.
    `align_rows`: whether rows that lie significantly apart are aligned first, in some 0.03 s a look; True by default.

    `runtime`: the program that runs M3Depth: "pytorch", "openvino" (on the CPU, with the extra `fast`), or "auto",
    which is OpenVINO if it is installed and there is no GPU. Their disparities differ by some thousandths of a pixel.

    `drift`, `yaw_drift_deg`: standard deviations of the odometry's errors in position along each axis [m] and heading
    [deg] after 1 m; they grow with the root of the way. `goal`, `map` and, with `slip`, the speed in `state` are those
    of the odometry; reward and episode end are true.

    `slip`: None (default) for wheels that do not slip; "scene" for wheels that slip and sink in the sand, crust and
    bedrock that the scene shows; "sand", "crust" or "bedrock" for one of them everywhere; or an
    envs.world.slip.SlipConfig, which also says how much of the slip the odometry measures. A name alone measures none.
    Of a tuple of these, each scene draws one.

    `eyes`: an envs.world.eyes.EyesConfig: pixels of the images and of the true depth, dust and sunlight on the lenses,
    temperature of the rig, compression, and `look_every`, the way after which the rover looks again. With it, the rover
    also looks after each step without speed and yaw rate. Between two looks `depth` is 0; `map` shows what is known.

    `condition`: the name of a condition, such as "storm" (envs.suites.conditions.CONDITIONS), or a dict of such values.
    They replace those of the other arguments, and are the defaults of the options of `reset`. Of a tuple of conditions,
    `condition=("clear", "storm")`, each scene draws one, and of a range, `{"optical_depth": (1, 3)}`, its strength.

    `episodes_per_scene`: number of episodes in a row in one scene, 1 by default. Each has another start and goal, free
    of obstacles within 2.5 m, or with `ditch` the way back (envs.courses.kept_scene). A reset with a seed or options
    makes a new scene. A kept scene takes no more memory, and its reset a small part of the time, with physics a fifth.

    Options of `reset`, for one episode:

    | Option              | Default        | Range    | Meaning                                    |
    |---------------------|----------------|----------|--------------------------------------------|
    | `goal_distance`     | 20             | 3 to 100 | distance from start to goal [m]            |
    | `k`                 | the scene's    | 0 to 0.4 | rock abundance, Golombek's k               |
    | `slope_deg`         | the scene's    | 0 to 25  | regional slope [deg], its direction drawn  |
    | `sun_elevation_deg` | the scene's    | 1 to 90  | height of the sun [deg]                    |
    | `into_sun`          | False          | bool     | the sun stands over the goal               |
    | `ditch`             | False          | bool     | a ditch cuts the straight path to the goal  |
    | `scene_seed`        | drawn          | 0 and up | seed of the course and of what is drawn    |

    ## Version history

    v0: first version. Since release 0.2.0:

    - Steep ground and drops are obstacles beside the rocks: `shortest`, `redraws`, `min_clearance` and the reward know
      them, and the preset `hard` has ditches. Before, only rocks counted.
    - Scenes have slabs, ledges and fragments, and rocks sit deeper in the ground, so a seed gives another course than
      in 0.1.0. Blocks of ledges of 0.30 m or more are obstacles like rocks.
    - Images and true depth show the smooth ground with relief down to the pebble. Under the wheels is the grid of
      0.1 m, without it. Before, both were the facets of this grid.
    - The rover stops where it tilts by more than 30 deg.
    - `slip`, `eyes`, `condition`, ranges and `episodes_per_scene` are off by default, where nothing changes.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 5}  # noqa: RUF012  (as gymnasium declares it)

    def __init__(
        self,
        perception: str | Estimator = "m3depth",
        dynamics: DynamicsName | None = None,
        renderer: RendererName = "embree",
        scene: str | Path | SceneConfig = "utopia",
        goal_distance: float | tuple[float, float] = 20.0,
        mast: bool = False,
        map_observation: bool = False,
        disparity_noise: float = 0.0,
        drift: float = 0.0,
        yaw_drift_deg: float = 0.0,
        render_mode: str | None = None,
        align_rows: bool = True,
        slip: Slip | tuple[Slip, ...] = None,
        runtime: str = "auto",
        eyes: EyesConfig | None = None,
        condition: Condition | tuple[Condition, ...] | None = None,
        k: Number = None,
        slope_deg: Number = None,
        sun_elevation_deg: Number = None,
        episodes_per_scene: int = 1,
    ) -> None:
        EzPickle.__init__(  # copies and unpickled environments start without a course: they need a reset
            self, perception, dynamics, renderer, scene, goal_distance, mast, map_observation, disparity_noise, drift,
            yaw_drift_deg, render_mode, align_rows, slip, runtime, eyes, condition, k, slope_deg, sun_elevation_deg,
            episodes_per_scene,
        )  # fmt: skip
        check_errors(disparity_noise=disparity_noise, drift=drift, yaw_drift_deg=yaw_drift_deg)
        check_flags(mast=mast, map_observation=map_observation, align_rows=align_rows)
        check_render_mode(render_mode, self.metadata["render_modes"])
        check_count("episodes_per_scene", episodes_per_scene)
        self.render_mode, self.rover_spec, self.mast = render_mode, ZHURONG, mast
        self.dynamics = checked_dynamics(dynamics)
        if dynamics is None and self.dynamics != "physics":
            gymnasium.logger.warn(FALLBACK_NOTE)
        numbers = dict(goal_distance=goal_distance, k=k, slope_deg=slope_deg, sun_elevation_deg=sun_elevation_deg)
        eyes = EyesConfig() if eyes is None else eyes
        self.draws = EpisodeDraws(checked_scene(scene), eyes, numbers, slip, condition)
        self.episodes_per_scene, self._episodes_left = episodes_per_scene, -1  # before the first reset
        self.perception = Perception(perception, renderer, None, disparity_noise, align_rows, runtime)
        self.gaze = Gaze(self.perception, self.rover_spec)
        self.drift, self.yaw_drift = float(drift), float(np.deg2rad(yaw_drift_deg))
        self.map_view = MapView(self.rover_spec) if map_observation else None
        self.action_space = spaces.Box(-1, 1, (3 if mast else 2,), np.float32)
        self.observation_space: spaces.Dict = observation_space(map_observation, mast)
        self.settings: EpisodeSettings | None = None
        self.course: Course | None = None
        self.vehicle: Vehicle | None = None
        self.outcome = "driving"
        self._view: OutsideView | None = None

    @property
    def sight(self) -> Sight | None:
        """The last look, also between two looks; None before the first reset."""
        return self.gaze.sight

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Draw a course and look once.

        Args:
            seed: Seed of the environment; None continues its random stream.
            options: Properties of the course for this episode; see the class.

        Returns:
            The observation and the info.

        Raises:
            ValueError: If an option is unknown or out of range, or if no course with this k has a way to its goal.
        """
        try:
            super().reset(seed=seed)
            if seed is not None or self._episodes_left < 0:
                self._draw_rng, self._episodes_left = stream_of_draws(self.np_random_seed), 0
            if self._episodes_left > 0 and not options and self.course is not None and self.settings is not None:
                self._episodes_left -= 1
                self._close_view()  # it still follows the last drive
                self.course = another_course(self.course, self.settings.course, self.np_random)
            else:
                self.close()
                self.settings, self.course = draw_episode(self.draws, options, self._draw_rng, self.np_random)
                scene, steep = self.course.scene, self.course.ground.steep
                self._clearance = ObstacleClearance(scene, self.rover_spec, steep)
                self._episodes_left = 0 if options else self.episodes_per_scene - 1
            return self._begin(self.course, self.settings)
        except BaseException:
            self.close()  # the last drive is over, and one that is half begun cannot go on
            raise

    def _begin(self, course: Course, settings: EpisodeSettings) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Put the rover on the start of a course, start counting, and look once."""
        x, y, yaw = (float(v) for v in course.start)
        ground = None if settings.slip is None else settings.slip.ground
        self.vehicle = make_vehicle(self.dynamics, course.scene, self.rover_spec, x, y, yaw, ground, self.vehicle)
        self.gaze.every, self.perception.eyes = settings.eyes.look_every, settings.eyes
        self.perception.open(course.scene, rng_of_perception(self.np_random))
        self._odometry = Odometry(self.drift, self.yaw_drift, np.random.default_rng(self.np_random.integers(2**63)))
        self.believed_pose = self._odometry.update(self.vehicle.state().pose)
        self._gauge = SlipGauge(settings.slip, self.vehicle, self.draws.may_slip)
        if self.map_view is not None:
            self.map_view.start(self.believed_pose)
        self.referee = Referee(course, self.rover_spec, settings.course.goal_distance)
        self._steps, self.outcome = 0, "driving"
        self.last_action = np.zeros(3 if self.mast else 2, dtype=np.float32)
        self.way = WayDriven(course, self._clearance, self._place())
        self.gaze.begin(self.vehicle.state())
        return self._observation(), self._info()

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Drive for 2 s, then look.

        Args:
            action: Speed, yaw rate and, with mast=True, pan; see the class.

        Returns:
            Observation, reward, whether the episode is terminated, whether it is truncated, and the info.

        Raises:
            ActionError: If the action has the wrong shape or is not finite.
            ResetNeeded: Before the first reset.
        """
        if self.course is None or self.vehicle is None:
            raise gymnasium.error.ResetNeeded("call reset before step")
        warn_if_ended(self.outcome)
        assert self.action_space.shape is not None
        action = checked_action(action, self.action_space.shape)
        speed, yaw_rate = float(action[0]) * self.rover_spec.max_speed, float(action[1]) * self.rover_spec.max_yaw_rate
        if self.mast:
            self.gaze.turn_mast(float(action[2]), STEP_SECONDS)
        self.vehicle.drive_twist(speed, yaw_rate, STEP_SECONDS)
        self.believed_pose = self._odometry.update(self.vehicle.state().pose, self._gauge.update(self.vehicle))
        self._steps += 1
        self.last_action = action.copy()

        before = self.way.length
        progress = self.way.advance(self._place())
        self.outcome = self.referee.judge(self.vehicle, speed, self._steps)
        reward = step_reward(progress, self.outcome)
        terminated = self.outcome not in ("driving", "time")
        self.gaze.after_step(self.vehicle.state(), self.way.length - before, stands=not action[:2].any())
        return self._observation(), reward, terminated, self.outcome == "time", self._info()

    def render(self) -> np.ndarray | None:
        """Return a picture of the rover from behind and above, (H, W, 3) uint8, in render_mode "rgb_array".

        Raises:
            ResetNeeded: Before the first reset.
        """
        if self.render_mode is None:
            gymnasium.logger.warn('render() needs gymnasium.make(..., render_mode="rgb_array")')
            return None
        if self.course is None or self.vehicle is None:
            raise gymnasium.error.ResetNeeded("call reset before render")
        if self._view is None:
            from envs.world.outside_view import OutsideView

            self._view = OutsideView(self.course.scene, self.perception.renderer)
        return self._view.picture(self.vehicle.state(), self.vehicle.mesh(self.gaze.pan), self._steps)

    def close(self) -> None:
        """Free physics and renderer; may be called twice."""
        self.perception.close()
        if self.vehicle is not None:
            self.vehicle.close()
        self._close_view()
        self.gaze.forget()
        self.vehicle = self.course = None

    def _close_view(self) -> None:
        if self._view is not None:
            self._view.close()
        self._view = None

    def _place(self) -> np.ndarray:
        """Return x, y [m] and yaw [rad] of the rover, (3,)."""
        assert self.vehicle is not None
        state = self.vehicle.state()
        return np.array([*state.position[:2], state.yaw], dtype=float)

    def _observation(self) -> dict[str, np.ndarray]:
        assert self.course is not None and self.vehicle is not None and self.sight is not None
        state, last = self.vehicle.state(), self.last_action[:2]
        excess, pan = self._gauge.excess_speed(state.yaw, STEP_SECONDS), self.gaze.pan_share if self.mast else None
        observation = observe(self.gaze.observed(), self.believed_pose, self.course.goal, state, excess, last, pan)
        if self.map_view is not None:
            observation["map"] = self.map_view.update(self.sight if self.gaze.fresh else None, self.believed_pose)
        return observation

    def _info(self) -> dict[str, Any]:
        assert self.course is not None and self.settings is not None
        standing = episode_info(self.outcome, self.course, self.way, self.gaze, self.believed_pose)
        return standing | self._gauge.info() | self.settings.info()
