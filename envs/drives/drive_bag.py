"""A ROS 2 bag of a drive: what the rover saw, where it was and believed to be, and what its driver decided."""

from __future__ import annotations

import numpy as np

from envs.drivers.builtin import NavigatorDriver
from envs.drivers.driver import Driver
from envs.mars_nav import STEP_SECONDS, MarsNavEnv
from marssim.base.bags.messages import SECOND
from marssim.base.bags.stereo_writer import StereoBagWriter
from nav.bag import write_decision


class DriveBag(StereoBagWriter):
    """Writes each step of a drive in the frames and topics of marssim.base.bags.

    Give `watch` to envs.drives.episodes.run_episode, and call `end` after it. Use the bag as a context manager. The
    first look is at 1 s. map is the world, odom the world as the rover's odometry has it. Depth is what the perception
    measured, and between two looks there are no images.
    """

    _step = -1
    _stamp = 0
    _believed = np.eye(4)

    def watch(self, env: MarsNavEnv, driver: Driver, step: int) -> None:
        """Write the decision that led to a step, and what the rover sees after it.

        Args:
            env: The environment.
            driver: The driver.
            step: Number of the step, 0 after the reset. The step at which the driver ended the drive comes twice, and
                is written once.
        """
        if step == self._step:
            return
        self._step = step
        assert env.course is not None and env.vehicle is not None and env.sight is not None
        navigator = driver.navigator if isinstance(driver, NavigatorDriver) else None
        if step:
            speed, yaw_rate = env.last_action[:2] * (env.rover_spec.max_speed, env.rover_spec.max_yaw_rate)
            status = "drive" if navigator is None else navigator.last_command.status
            write_decision(self, self._stamp, status, speed, yaw_rate, self._believed, navigator)
        self._stamp = round((1 + step * STEP_SECONDS) * SECOND)
        self._believed = env.believed_pose.copy()
        if not step:
            x, y = env.course.goal
            self.write_goal(self._stamp, np.array([x, y, env.course.scene.terrain.height_at(x, y)]))
        rig, body = env.perception.rig, env.vehicle.state().pose
        eye = body @ env.rover_spec.mount.left_eye(rig.baseline, env.gaze.pan)
        self.write_pose(self._stamp, body, eye, rig.baseline, self._believed)
        if not env.gaze.fresh:
            return
        sight = env.sight
        left, right = sight.left, sight.right
        if left is None or right is None:  # the perception is the ground truth, and took no picture
            picture = env.perception.picture(sight.pose)
            left, right = picture.left, picture.right
        self.write_images(self._stamp, left, right, rig)
        self.write_depth(self._stamp, sight.depth, sight.rig.camera)

    def end(self, outcome: str) -> None:
        """Write that the rover stands still, and how the drive ended: the outcome of its record."""
        write_decision(self, self._stamp, outcome, 0.0, 0.0, self._believed)
