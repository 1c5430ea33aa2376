"""The rover's autonomous drive: look, update the map, plan, command.

Call `step` once per drive step with the depth that the cameras measured. It returns a motion for the next step and, at
times, a direction in which the mast should look. The navigator holds the map and the driven track, and needs no
simulator:

    import numpy as np
    from marssim.base.camera import NATECAM
    from marssim.base.rover_spec import ZHURONG
    from nav import Navigator, wheel_command

    navigator = Navigator(ZHURONG)
    goal = np.array([20.0, 5.0])  # world x, y [m]
    pan = 0.0  # the mast's angle [rad], positive to the left
    while True:
        pair = rover.take_images()
        prediction = network.infer(pair.left, pair.right, NATECAM)  # any source of depth will do
        pose = rover.localise()  # (4, 4) body to world, body origin on the ground under the middle of the rover
        command = navigator.step(prediction.depth, prediction.confidence, NATECAM, pose, goal, pan)
        if command.over:
            break
        pan = command.pan or 0.0
        rover.pan_mast(pan)
        wheels = wheel_command(command.speed, command.yaw_rate, ZHURONG)
        rover.drive(wheels.speeds, wheels.angles, seconds=2.0)  # then stop and look again
    rover.stop()

`step` takes the pan of the mast at the moment of the image: a slow mast may still be turning. A rover whose mast cannot
turn ignores `command.pan` and always passes 0: the navigator notices it, and turns the whole rover instead.
`python -m nav.replay FOLDER` feeds recorded frames to the navigator.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from marssim.base.angle import wrapped
from marssim.base.camera import StereoRig
from marssim.base.pose import planar_pose, rigid_pose
from marssim.base.rover_spec import ZHURONG, RoverSpec
from nav.command import Command
from nav.config import NavigatorConfig
from nav.controller import point_turn, steerable
from nav.ground.elevation import ElevationMap
from nav.ground.masks import Area, disc_mask, outside_mask, rectangle_mask
from nav.ground.traversability import Traversability, assess
from nav.looks import Looks
from nav.mast import Mast
from nav.path.footprint import arc_poses
from nav.path.open_path import is_closed
from nav.path.planner import Motion, Planner
from nav.recovery import Recovery
from nav.risk import RiskTaking

PROGRESS = 1.0  # [m] nearer to the goal, after which recoveries and closed steps are counted from zero again
IDLE_SHARE = 0.25  # share of a commanded drive below which the rover did not move
CARRIED_INSET = 0.15  # [m] by which the ground under the rover is smaller than the footprint: touched rocks stay rocks
BUMP_RADIUS = 0.2  # [m] around a place where the rover bumped into something
DEAD_END_RADIUS, DEAD_END_COST = 1.0, 3.0  # [m] around a dead end, and the extra cost of a metre there
WAY_AHEAD = 3.0  # [m] of the far path along which the mast looks
UPRIGHT = 0.34  # least z of the body's z axis in the world: 70 deg from the vertical, where no rover drives any more
BEND = 0.2  # [rad] turned in a step from which a short motion leads round something


class Navigator:
    """Drives a rover to a goal from depth maps.

    After a step, `map`, `ground`, `motion`, `planner.field` and `planner.considered` show what the decision was made
    from, for display and logging, and nav.reason.reason_of says it in words.

    Attributes:
        looks_along: Whether the last step stopped for a look along the far path, between two looks.
        map: The ElevationMap.
        ground: The Traversability of the last step; None before it.
        motion: The Motion chosen in the last step, or None.
        planner: The planner; `planner.field` is the cost to go, and `planner.considered` what the last step chose from,
            None if it planned nothing.
    """

    def __init__(
        self, spec: RoverSpec = ZHURONG, config: NavigatorConfig | None = None, area: Area | None = None,
        prior: ElevationMap | None = None,
    ) -> None:  # fmt: skip
        """Make a navigator that has seen nothing.

        Args:
            spec: The rover.
            config: The settings; None for NavigatorConfig.of_rover(spec).
            area: (x0, y0, x1, y1) in the world [m], the operators' keep-in zone for the rover's middle; None for no
                bounds.
            prior: Heights that are known before the drive, on a map of any size: where no look has measured the ground,
                the navigator drives by them. None if there are none.

        Raises:
            ValueError: If the area is empty, the cells of the prior are not of the navigator's size, or the rover
                cannot turn in place.
        """
        if area is not None and not (area[0] < area[2] and area[1] < area[3]):
            raise ValueError(f"area must be x0 < x1 and y0 < y1 [m], got {area}")
        try:
            point_turn(spec.max_yaw_rate, spec)
        except ValueError as error:
            raise ValueError(f"spec: the navigator turns a rover in place, and this one cannot: {error}") from None
        self.spec = spec
        self.config = config or NavigatorConfig.of_rover(spec)
        self.area = area
        self.prior = prior
        self.map = ElevationMap(self.config.elevation)
        if prior is not None:
            self.map.complete(prior)  # raises ValueError for cells of another size
        self.planner = Planner(spec, self.config.planner, self.map)
        self.reset()

    def reset(self) -> None:
        """Forget map, track and recoveries; the pose of the next step is a new start, clear all around."""
        self._started = False
        self.ground: Traversability | None = None
        self.motion: Motion | None = None
        self.looks_along = False
        self.planner.reset()
        self.recovery = Recovery(self.spec, self.config)
        self._last_pose = np.zeros(3)
        self._last_command = Command(0.0, 0.0, None, "look")
        self._idle_drives = 0
        self.mast = Mast(self.spec, self.config)
        self.looks = Looks()
        self.risk = RiskTaking(self.config)
        self._nearest = np.inf
        self._goal = np.full(2, np.nan)

    @property
    def last_command(self) -> Command:
        """The command of the last step; "look" before the first."""
        return self._last_command

    def step(
        self,
        depth: np.ndarray | None,
        confidence: np.ndarray | None,
        rig: StereoRig,
        pose: ArrayLike,
        goal: ArrayLike,
        pan: float = 0.0,
        between_looks: bool = False,
        obeyed: bool = True,
    ) -> Command:
        """Do one cycle: fuse the image, judge the ground, choose the motion for the next step_time seconds.

        Args:
            depth: (H, W) depth of the left eye along its optical axis [m], inf for sky and beyond measure, NaN for
                unknown; None if no image came.
            confidence: (H, W) in [0, 1], or None.
            rig: The cameras at that size.
            pose: (4, 4) body to world at the moment of the image.
            goal: (2,) or (3,) goal in the world [m]; it may change at any time.
            pan: Pan of the mast at the moment of the image [rad], positive to the left.
            between_looks: Whether the rover took no image on purpose, as it looks only once in a while. It then drives
                on by its map as long as that shows a free way, and stops for a look where it does not; depth and
                confidence are not read. Without it, a rover without an image stands still.
            obeyed: Whether the rover was to carry out the last command. Where it was not, as another driver moves it,
                a rover that stands still is no sign of an obstacle, and a mast that does not turn is none of a fault.

        Returns:
            The command for the next step.

        Raises:
            ValueError: If shapes disagree, depth is of integers, confidence exceeds 1, goal is not finite, pan is no
                angle in [-pi, pi], or pose is no rotation and translation, or one of a body that lies on its side.
        """
        pose, goal = rigid_pose(pose), np.asarray(goal, float)
        if pose[2, 2] < UPRIGHT:
            tilt = np.rad2deg(np.arccos(np.clip(pose[2, 2], -1, 1)))
            raise ValueError(
                f"pose must be body to world, x ahead and z up, and its z axis is {tilt:.0f} deg from the vertical: is "
                "it that of a camera? spec.mount.left_eye gives the camera's place on the body. A wrong mount "
                "(--mount, spec.mount) tilts it too"
            )
        if goal.shape not in ((2,), (3,)) or not np.isfinite(goal).all():
            raise ValueError(f"goal must be 2 or 3 finite numbers [m], got {goal}")
        if pan is None or not abs(pan) <= np.pi:
            raise ValueError(f"pan must be an angle in [-pi, pi] rad, got {pan}")
        planar = planar_pose(pose)
        self._begin(pose, planar, goal[:2], pan, obeyed)
        ground_visible = between_looks or self._look(depth, confidence, rig, pose, pan)
        if depth is not None and not between_looks:
            self.looks.note(planar, pan)
        command = self._decide(planar, goal[:2], pan, ground_visible, between_looks)
        self._last_pose, self._last_command = planar, command
        return command

    def _begin(self, pose: np.ndarray, planar: np.ndarray, goal: np.ndarray, pan: float, obeyed: bool) -> None:
        """Take in the rover's new pose and the goal: move the map, and count what the last command achieved."""
        self.motion = self.planner.considered = None
        self.looks_along = False
        if not self._started:
            self.map.clear(planar[:2])
            self.map.assume_flat(pose, self.config.clear_radius)
            self._started = True
        if not np.array_equal(goal, self._goal):
            self._goal = goal.copy()
            self._nearest, self.recovery.attempts = np.inf, 0
            self.risk.reset()
        self.map.recentre(planar[:2])
        if self.prior is not None:
            self.map.complete(self.prior)
        # The ground under the rover carries it, seen or not.
        self.map.assume_under(pose, self.spec.length, self.spec.width)
        self.recovery.follow(planar)
        if not obeyed:
            self._last_command = replace(self._last_command, pan=None)
            self.recovery.skip_look()
        self.mast.follow(pan, self._last_command.pan)
        moved = float(np.hypot(*(planar - self._last_pose)[:2]))
        self.recovery.count(planar, moved, self._last_command)
        wanted = abs(self._last_command.speed) * self.config.step_time
        if obeyed and self._last_command.status == "drive" and moved < IDLE_SHARE * wanted:
            self._idle_drives += 1
        elif wanted > 0 or not obeyed:
            self._idle_drives = 0

    def _look(
        self, depth: np.ndarray | None, confidence: np.ndarray | None, rig: StereoRig, pose: np.ndarray, pan: float
    ) -> bool:
        """Fuse the image and return whether it showed any ground."""
        if depth is None:
            return False
        camera_pose = pose @ self.spec.mount.left_eye(rig.baseline, pan)
        height = self.spec.mount.height
        return self.map.integrate(depth, confidence, rig, camera_pose, height) >= self.config.least_points

    def _decide(
        self, place: np.ndarray, goal: np.ndarray, pan: float, ground_visible: bool, between_looks: bool
    ) -> Command:
        """Return the next command from the map, the goal, and what happened in the last steps."""
        distance = float(np.hypot(*(goal - place[:2])))
        if distance <= self.config.goal_radius or not ground_visible:
            self.ground = self.judge(place)  # nothing is decided by it, but the map may have scrolled
            return Command(0.0, 0.0, None, "arrived" if distance <= self.config.goal_radius else "blind")
        if distance < self._nearest - PROGRESS:
            self._nearest, self.recovery.attempts = distance, 0
            self.risk.came_nearer()

        if self._idle_drives >= self.config.slip_steps:
            self._idle_drives = 0
            self.recovery.bump(place)
            self.planner.reset()
        ground = self.ground = self.judge(place)
        self.planner.margin = self.config.planner.margin * self.risk.margin_share
        self.planner.update(self.map, ground, goal)

        self.risk.update(is_closed(self.planner.field, place, goal), self._is_hemmed_in(place, ground))
        if self.risk.given_up:
            return Command(0.0, 0.0, None, "no_path")
        if self.recovery.backing:
            command = self.recovery.back_up(place, ground, self.map, self.planner)
            if command is not None:
                return command
        self.motion = self.planner.plan(self.map, ground, place, goal)
        if between_looks and (look := self._look_first(self.motion, place, pan)):
            self.looks_along = True
            return look
        if self.motion is None:
            if self.recovery.attempts >= self.config.risk_after_recoveries and not self.recovery.looking:
                self.risk.raise_level()
            way = self.recovery.search(place, ground, self.map, self.planner, pan, self.mast.obeys)
            return way or Command(0.0, 0.0, None, "no_path" if self.risk.closed else "stuck")
        self.recovery.found_a_way()
        return self._follow(self.motion, place, distance, pan)

    def _look_first(self, motion: Motion | None, place: np.ndarray, pan: float) -> Command | None:
        """Return a command to look along the far path, for a rover that took no image here; None if it shall go on.

        Without a look, a turn in place or a short arc often leads back to where the map already showed no way. A drive
        that the map shows to be free needs none.
        """
        if motion is not None and not motion.turn and motion.length >= 2 * self.config.planner.commit:
            return None
        wanted = (self.mast.towards(self._bearing_onward(place)) or 0.0) if self.mast.obeys else pan
        return None if self.looks.cover(place, wanted) else Command(0.0, 0.0, wanted or None, "look")

    def _is_hemmed_in(self, place: np.ndarray, ground: Traversability) -> bool:
        """Return whether the rover stands nearer to an obstacle than its footprint allows at any heading."""
        x, y = np.clip(self.map.cell_of(place[:2]), 0, self.map.n - 1)
        return bool(ground.inflated[y, x])

    def judge(
        self, place: np.ndarray, elevation: ElevationMap | None = None, passable: np.ndarray | None = None
    ) -> Traversability:
        """Return the traversability of a map as this step judges it: with its bumps, dead ends, area and risk.

        Args:
            place: (3,) x, y [m], yaw [rad] of the rover, under which nothing is an obstacle.
            elevation: The map, with the cells of the navigator's own; None for that one.
            passable: (n, n) bool, further cells that are no obstacle whatever the map shows, or None.
        """
        elevation = self.map if elevation is None else elevation
        half_length, half_width = self.spec.length / 2 - CARRIED_INSET, self.spec.width / 2 - CARRIED_INSET
        carried = rectangle_mask(elevation, place, half_length, half_width)
        passable = carried if passable is None else passable | carried
        ground = assess(elevation, self.spec, self.risk.rules, self._closed(), passable)
        if not self.recovery.dead_ends:
            return ground
        dead_ends = disc_mask(self.map, self.recovery.dead_ends, DEAD_END_RADIUS)
        return replace(ground, cost=ground.cost + DEAD_END_COST * dead_ends.astype(np.float32))

    def _closed(self) -> np.ndarray | None:
        """Return the closed cells that the map does not show, (n, n) bool: bumps, and ground beyond the area; None if
        neither.
        """
        bumps = self.recovery.bumps
        closed = disc_mask(self.map, bumps, BUMP_RADIUS) if bumps else None
        if self.area is None:
            return closed
        # Nothing stands there, but closing the cells from half a width beyond the area keeps the rover's middle in it.
        outside = outside_mask(self.map, self.area, self.spec.width / 2)
        return outside if closed is None else closed | outside

    def _follow(self, motion: Motion, place: np.ndarray, distance: float, pan: float) -> Command:
        """Return the command that begins a motion: a look into a turn, the turn, or a drive of one step."""
        c = self.config
        if motion.turn:
            if self.mast.must_look(motion.turn, place, pan, self._last_command, self.map):
                return Command(0.0, 0.0, self.mast.towards(motion.turn), "look")
            rate = float(np.clip(motion.turn / c.step_time, -self.spec.max_yaw_rate, self.spec.max_yaw_rate))
            left = motion.turn - rate * c.step_time
            return Command(0.0, rate, self.mast.towards(left), "turn")
        self.mast.turn_is_over()
        speed = self.spec.max_speed * float(np.clip(motion.length / (2 * c.planner.commit), 0.5, 1.0))
        speed = min(speed, max(distance - c.goal_radius, 0.1) / c.step_time)
        speed = min(speed, max(motion.length, c.planner.commit) / c.step_time)  # only what is known to be free
        speed, yaw_rate = steerable(speed, motion.curvature * speed, self.spec)
        turn = yaw_rate * c.step_time
        short = motion.length < 2 * c.planner.commit and abs(turn) < BEND
        next_pose = arc_poses(place, np.array(motion.curvature), np.array([speed * c.step_time]))[0]
        return Command(speed, yaw_rate, self.mast.towards(0.0 if short else self._bearing_onward(next_pose)), "drive")

    def _bearing_onward(self, next_pose: np.ndarray) -> float:
        """Return the bearing of the path from where the rover will be, so that the next image shows it.

        Args:
            next_pose: (3,) x, y [m], yaw [rad] after the step.

        Returns:
            Bearing from the heading [rad], positive to the left; 0 where the path ends.
        """
        path = self.planner.field.path(next_pose, WAY_AHEAD)
        if len(path) <= 3:
            return 0.0
        way = path[-1] - next_pose[:2]
        return float(wrapped(float(np.arctan2(way[1], way[0])) - next_pose[2]))
