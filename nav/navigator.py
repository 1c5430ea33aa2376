"""Look, update, plan, command: the rover's autonomous drive.

Call it once per drive step with what the cameras measured; it answers with a motion for the next step and, at times,
with a wish where the mast should look. It holds the map and the driven track, and nothing of a simulator:

    import numpy as np
    from marssim.camera import NATECAM
    from marssim.rover_spec import ZHURONG
    from nav import Navigator, wheel_command

    navigator = Navigator(ZHURONG)
    goal = np.array([20.0, 5.0])  # world x, y [m]
    pan = 0.0  # the mast's angle [rad], positive to the left
    while True:
        pair = rover.take_images()
        prediction = network.infer(pair.left, pair.right, NATECAM)  # any source of depth will do
        pose = rover.localise()  # (4, 4) body to world, body origin on the ground under the middle of the rover
        command = navigator.step(prediction.depth, prediction.confidence, NATECAM, pose, goal, pan)
        if command.status in ("arrived", "stuck", "no_path"):
            break
        pan = command.pan or 0.0
        rover.pan_mast(pan)
        wheels = wheel_command(command.speed, command.yaw_rate, ZHURONG)
        rover.drive(wheels.speeds, wheels.angles, seconds=2.0)  # then stop and look again
    rover.stop()

The pan that is handed to `step` is the mast's at the moment of the image. A rover whose mast cannot turn ignores
`command.pan` and keeps passing 0: the navigator notices, and turns the whole rover instead.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from marssim.camera import StereoRig
from marssim.rover_spec import ZHURONG, RoverSpec
from nav.controller import steerable
from nav.elevation import ElevationConfig, ElevationMap
from nav.planner import Motion, Planner, PlannerConfig, arc_poses, free_length
from nav.traversability import Traversability, TraversabilityConfig, assess


@dataclass(frozen=True)
class NavigatorConfig:
    """Everything that can be tuned, in one place."""

    elevation: ElevationConfig = field(default_factory=ElevationConfig)
    traversability: TraversabilityConfig = field(default_factory=TraversabilityConfig)
    planner: PlannerConfig = field(default_factory=PlannerConfig)
    step_time: float = 2.0  # a command is held this long [s]
    goal_radius: float = 1.0  # arrived within [m]
    clear_radius: float = 2.5  # round the start the ground is taken for clear [m]
    look_pan_deg: float = 40.0  # the mast looks this far to either side for a way out
    pan_reach_deg: float = 75.0  # and at most this far when it follows the path
    back_up: float = 1.2  # recovery drives back this far [m]
    back_speed: float = 0.15  # at this speed [m/s]
    max_recoveries: int = 6  # without coming a metre nearer to the goal; then stuck
    closed_steps: int = 15  # in a row with every way to the goal closed by known obstacles; then no path
    bold_after: int = 5  # closed steps, after which rocks up to bold_step [m] are climbed ...
    bold_step: float = 0.285  # ... instead of step_blocked; just below RoverSpec.obstacle_height ...
    bold_steps: int = 25  # ... for so many steps
    slip_steps: int = 2  # drive steps without motion that mean an unseen obstacle


@dataclass(frozen=True)
class Command:
    """What the rover shall do in the next step.

    speed [m/s], negative backwards; yaw_rate [rad/s], positive to the left; pan [rad] of the mast for the next image,
    None for straight ahead. status: "drive", "turn" (in place), "look" (stand, and look where pan says), "recover"
    (backing out of a dead end), "blind" (no depth: standing), "arrived", "stuck" (recoveries did not help) or
    "no_path" (the same, and obstacles are known to close every way). The last three stand still.
    """

    speed: float
    yaw_rate: float
    pan: float | None
    status: str


def _wrap(angle: float) -> float:
    """The same angle in [-pi, pi) [rad]."""
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


class Navigator:
    """Drives a rover to a goal from depth maps.

    After a step, `map` (ElevationMap), `ground` (Traversability), `motion` (the chosen Motion or None) and
    `planner.field` (cost-to-go) hold what the decision was made from, for display and logging.
    """

    def __init__(self, spec: RoverSpec = ZHURONG, config: NavigatorConfig | None = None) -> None:
        self.spec = spec
        self.config = config or NavigatorConfig()
        self.map = ElevationMap(self.config.elevation)
        self.planner = Planner(spec, self.config.planner, self.map)
        self.reset()

    def reset(self) -> None:
        """Forget map, track and recoveries; the next step's pose is a new start, clear all round."""
        self._started = False
        self.ground: Traversability | None = None
        self.motion: Motion | None = None
        self.planner.reset()
        self._track: list[np.ndarray] = []
        self._bumps: list[np.ndarray] = []
        self._dead_ends: list[np.ndarray] = []
        self._last_pose = np.zeros(3)
        self._last_command = Command(0.0, 0.0, None, "look")
        self._idle_drives = 0
        self._looks: list[float] | None = None
        self._pan_works = True
        self._back_left = 0.0
        self._recoveries = 0
        self._closed = 0
        self._bold = 0  # steps left
        self._nearest = np.inf
        self._goal = np.full(2, np.nan)

    def step(
        self,
        depth: np.ndarray | None,
        confidence: np.ndarray | None,
        rig: StereoRig,
        pose: np.ndarray,
        goal: np.ndarray,
        pan: float = 0.0,
    ) -> Command:
        """One cycle: fuse the image, judge the ground, choose the motion for the next step_time seconds.

        depth: (H, W) [m] of the left eye along its optical axis, inf for sky and beyond measure, NaN for unknown; None
        if no image came. confidence: (H, W) in [0, 1] or None. rig: the cameras at that size. pose: (4, 4) body to
        world at the moment of the image. goal: (2,) or (3,) world [m]; may change at any time. pan [rad]: of the mast
        at the moment of the image, positive to the left.
        Raises ValueError where shapes disagree or pose or goal are not finite.
        """
        pose, goal = np.asarray(pose, float), np.asarray(goal, float)
        if pose.shape != (4, 4) or not np.isfinite(pose).all():
            raise ValueError("pose must be a finite (4, 4) matrix, body to world")
        if goal.shape not in ((2,), (3,)) or not np.isfinite(goal).all():
            raise ValueError(f"goal must be 2 or 3 finite numbers [m], got {goal}")
        planar = np.array([pose[0, 3], pose[1, 3], np.arctan2(pose[1, 0], pose[0, 0])])
        self._begin(pose, planar, goal[:2], pan)
        seen = self._look(depth, confidence, rig, pose, pan)
        command = self._decide(planar, goal[:2], pan, seen)
        self._last_pose, self._last_command = planar, command
        return command

    # ---------------------------------------------------------------- what happened since the last step

    def _begin(self, pose: np.ndarray, planar: np.ndarray, goal: np.ndarray, pan: float) -> None:
        if not self._started:
            self.map.clear(planar[:2])
            self.map.assume_flat(pose, self.config.clear_radius)
            self._started = True
        if not np.array_equal(goal, self._goal):
            self._goal = goal.copy()
            self._nearest, self._recoveries, self._closed, self._bold = np.inf, 0, 0, 0
        self.map.recentre(planar[:2])
        # Where the rover stands, the ground carries it, seen or not.
        self.map.assume_flat(pose, self.spec.footprint_radius)
        if not self._track or np.hypot(*(planar - self._track[-1])[:2]) > 0.2:
            self._track.append(planar)
        wish = self._last_command.pan
        if wish is not None and abs(wish - pan) > np.deg2rad(10):
            self._pan_works = False
        moved = float(np.hypot(*(planar - self._last_pose)[:2]))
        wanted = abs(self._last_command.speed) * self.config.step_time
        if self._last_command.status == "drive" and moved < 0.25 * wanted:
            self._idle_drives += 1
        elif wanted > 0:
            self._idle_drives = 0

    def _look(
        self, depth: np.ndarray | None, confidence: np.ndarray | None, rig: StereoRig, pose: np.ndarray, pan: float
    ) -> bool:
        """Fuse the image. Returns whether it showed any ground."""
        if depth is None:
            return False
        camera_pose = pose @ self.spec.mount.left_eye(rig.baseline, pan)
        return self.map.integrate(depth, confidence, rig, camera_pose) > 0

    # ---------------------------------------------------------------- what to do now

    def _decide(self, here: np.ndarray, goal: np.ndarray, pan: float, seen: bool) -> Command:
        distance = float(np.hypot(*(goal - here[:2])))
        if distance <= self.config.goal_radius:
            return Command(0.0, 0.0, None, "arrived")
        if not seen:
            return Command(0.0, 0.0, None, "blind")
        if distance < self._nearest - 1.0:
            self._nearest, self._recoveries = distance, 0

        if self._idle_drives >= self.config.slip_steps:
            self._idle_drives = 0
            ahead = self.spec.length / 2 + 0.15
            self._bumps.append(here[:2] + ahead * np.array([np.cos(here[2]), np.sin(here[2])]))
            self._start_recovery(here)
        ground = self._assess(here)
        self.ground = ground
        self.planner.field.update(self.map, ground, goal)

        self._closed = self._closed + 1 if self._no_way(here, goal, ground) else 0
        self._bold = max(self._bold - 1, 0)
        if self._closed >= self.config.bold_after and not self._bold:
            self._bold, self._closed = self.config.bold_steps, 0
        if self._closed >= self.config.closed_steps:
            return Command(0.0, 0.0, None, "no_path")
        if self._back_left > 0:
            command = self._back_up(here, ground)
            if command is not None:
                return command
        self.motion = self.planner.plan(self.map, ground, here, goal)
        if self.motion is None:
            return self._search(here, ground, pan)
        self._looks = None
        return self._follow(self.motion, here, distance)

    def _assess(self, here: np.ndarray) -> Traversability:
        """Traversability, with what bumps and dead ends taught, and free of obstacles under the rover itself."""
        extra = self._discs(self._bumps, 0.2) > 0 if self._bumps else None
        # A little less than the footprint: a rock that a wheel touches stays a rock.
        half = np.array([self.spec.length, self.spec.width]) / 2 - 0.15
        corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * half
        c, s = np.cos(here[2]), np.sin(here[2])
        corners = self.map.cell_of(here[:2] + corners @ np.array([[c, s], [-s, c]]))
        carried = np.zeros((self.map.n, self.map.n), np.uint8)
        cv2.fillConvexPoly(carried, corners.astype(np.int32), 1)
        rules = self.config.traversability
        if self._bold:
            rules = replace(rules, step_blocked=max(self.config.bold_step, rules.step_blocked))
        ground = assess(self.map, self.spec, rules, extra, carried > 0)
        if not self._dead_ends:
            return ground
        return replace(ground, cost=ground.cost + 3.0 * self._discs(self._dead_ends, 1.0))

    def _discs(self, centres: list[np.ndarray], radius: float) -> np.ndarray:
        """(n, n) float32, 1 within radius [m] of any of the world positions."""
        out = np.zeros((self.map.n, self.map.n), np.float32)
        for cell in self.map.cell_of(np.array(centres)):
            cv2.circle(out, (int(cell[0]), int(cell[1])), round(radius / self.map.config.cell), 1.0, -1)
        return out

    def _follow(self, motion: Motion, here: np.ndarray, distance: float) -> Command:
        c = self.config
        if motion.turn:
            rate = float(np.clip(motion.turn / c.step_time, -self.spec.max_yaw_rate, self.spec.max_yaw_rate))
            left = motion.turn - rate * c.step_time
            return Command(0.0, rate, self._pan(left), "turn")
        speed = self.spec.max_speed * float(np.clip(motion.length / (2 * c.planner.commit), 0.5, 1.0))
        speed = min(speed, max(distance - 0.5 * c.goal_radius, 0.1) / c.step_time)
        speed, yaw_rate = steerable(speed, motion.curvature * speed, self.spec)
        # The next image shall show where the path leads from where the rover will be by then.
        turn = yaw_rate * c.step_time
        then = arc_poses(here, np.array(motion.curvature), np.array([speed * c.step_time]))[0]
        path = self.planner.field.path(then, 3.0)
        way = path[-1] - then[:2]
        bearing = _wrap(float(np.arctan2(way[1], way[0])) - then[2]) if len(path) > 3 else 0.0
        if motion.length < 2 * c.planner.commit and abs(turn) < 0.2:
            bearing = 0.0
        return Command(speed, yaw_rate, self._pan(bearing), "drive")

    def _pan(self, bearing: float) -> float | None:
        """The mast's angle for a bearing; None near straight ahead, or where the mast does not obey."""
        if not self._pan_works or abs(bearing) < np.deg2rad(15):
            return None
        reach = min(np.deg2rad(self.config.pan_reach_deg), self.spec.mount.pan_limit)
        return float(np.clip(bearing, -reach, reach))

    # ---------------------------------------------------------------- when there is no way on

    def _search(self, here: np.ndarray, ground: Traversability, pan: float) -> Command:
        """Look to both sides, then back out, then turn; give up after max_recoveries."""
        if self._looks is None:
            side = np.deg2rad(self.config.look_pan_deg)
            looks = [side, -side, 0.0] if self._pan_works else []
            self._looks = [a for a in looks if abs(a - pan) > np.deg2rad(10)]
        if not self._pan_works:
            self._looks = []
        if self._looks:
            wish = self._looks.pop(0)
            return Command(0.0, 0.0, wish or None, "look")
        if self._recoveries >= self.config.max_recoveries:
            return Command(0.0, 0.0, None, "no_path" if self._closed else "stuck")
        self._looks = None
        self._start_recovery(here)
        command = self._back_up(here, ground)
        if command is not None:
            return command
        turns = self.planner.free_turns(self.map, ground, here)
        if turns.size:
            # Towards the side with more room to turn; the new view may open a way.
            target = turns[np.abs(turns).argmax()]
            rate = float(np.clip(target / self.config.step_time, -self.spec.max_yaw_rate, self.spec.max_yaw_rate))
            return Command(0.0, rate, None, "recover")
        return Command(0.0, 0.0, None, "look")

    def _no_way(self, here: np.ndarray, goal: np.ndarray, ground: Traversability) -> bool:
        """Whether even the best path to the goal leads through known obstacles, away from both of its ends."""
        path = self.planner.field.path(here, 2 * self.config.elevation.size)
        from_ends = np.minimum(np.hypot(*(path - here[:2]).T), np.hypot(*(path - goal).T))
        cell = np.clip(self.map.cell_of(path), 0, self.map.n - 1)
        return bool((ground.inflated[cell[:, 1], cell[:, 0]] & (from_ends > 1.0)).any())

    def _start_recovery(self, here: np.ndarray) -> None:
        self._recoveries += 1
        self._dead_ends.append(here[:2] + 0.5 * np.array([np.cos(here[2]), np.sin(here[2])]))
        self._back_left = self.config.back_up
        self.planner.reset()

    def _back_up(self, here: np.ndarray, ground: Traversability) -> Command | None:
        """Reverse along the driven track. None where it ends or is closed, which ends the backing."""
        moved = float(np.hypot(*(here - self._last_pose)[:2]))
        if self._last_command.status == "recover" and self._last_command.speed < 0:
            self._back_left -= moved
            if moved < 0.02:
                self._back_left = 0.0
        while len(self._track) > 1 and np.hypot(*(here - self._track[-1])[:2]) < 0.5:
            self._track.pop()
        if self._back_left <= 0 or not self._track:
            self._back_left = 0.0
            return None
        away = self._track[-1][:2] - here[:2]
        x = float(np.cos(here[2]) * away[0] + np.sin(here[2]) * away[1])
        y = float(-np.sin(here[2]) * away[0] + np.cos(here[2]) * away[1])
        # A circle through the track point, tangent to the heading (pure pursuit, backwards).
        curvature = 2 * y / max(x * x + y * y, 1e-6)
        if x > -0.1:
            self._back_left = 0.0
            return None
        speed, yaw_rate = steerable(-self.config.back_speed, -curvature * self.config.back_speed, self.spec)
        curvature = yaw_rate / speed
        spacing = self.config.planner.spacing
        poses = arc_poses(here, np.array(curvature), -np.arange(4) * spacing)[None]
        if free_length(poses, spacing, self.map, ground, self.spec, self.config.planner)[0] < 2 * spacing:
            self._back_left = 0.0
            return None
        return Command(speed, yaw_rate, None, "recover")
