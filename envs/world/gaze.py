"""The gaze of a rover: where its mast points, and after which steps the rover takes images."""

from __future__ import annotations

import numpy as np

from envs.world.perception import Perception, Sight
from marssim.base.rover_spec import RoverSpec
from marssim.physics.state import RoverState


class Gaze:
    """Turns the mast, and looks after each step or once in a while.

    Attributes:
        every: Way after which the rover looks again [m]; 0 where each step ends with a look.
        pan: Pan of the mast now [rad], positive to the left.
        sight: The last look, or None before the first.
        fresh: Whether the last step ended with a look.
    """

    def __init__(self, perception: Perception, spec: RoverSpec, every: float = 0.0) -> None:
        """Make the gaze of an environment.

        Args:
            perception: Takes the images.
            spec: The rover.
            every: Way after which the rover looks again [m]; 0 looks after every step.
        """
        self._perception, self._mount, self.every = perception, spec.mount, every
        self.pan = 0.0
        self.sight: Sight | None = None
        self.fresh = False
        self._since = 0.0  # [m] driven since the last look

    def begin(self, state: RoverState) -> None:
        """Look ahead from the start of an episode."""
        self.pan = 0.0
        self._look(state)

    @property
    def pan_share(self) -> float:
        """Pan of the mast as a share of the largest, -1 to 1, positive to the left."""
        return self.pan / self._mount.pan_limit

    def turn_mast(self, wanted: float, seconds: float) -> None:
        """Turn the mast towards an angle.

        Args:
            wanted: The pan asked for, as a share of the largest, -1 to 1.
            seconds: Time that there is for it [s].
        """
        turn = self._mount.pan_rate * seconds
        self.pan += float(np.clip(wanted * self._mount.pan_limit - self.pan, -turn, turn))

    def after_step(self, state: RoverState, way: float, stands: bool) -> None:
        """Look if it is time for it.

        Args:
            state: The rover's state after the step.
            way: Way driven in the step [m].
            stands: Whether the step was commanded to stand still, as a rover does that only wants to look.
        """
        self._since += way
        if self._since >= self.every or stands:
            self._look(state)
        else:
            self.fresh = False

    def observed(self) -> np.ndarray:
        """Return the depth to observe now, (H, W) [m]: that of the look, or NaN (unknown) where none was taken."""
        assert self.sight is not None
        return self.sight.depth if self.fresh else np.full_like(self.sight.depth, np.nan)

    def forget(self) -> None:
        """Forget the last look, as its scene is closed."""
        self.sight = None

    def _look(self, state: RoverState) -> None:
        """Take the images at the present pose and pan, and turn them into depth."""
        pose = state.pose @ self._mount.left_eye(self._perception.rig.baseline, self.pan)
        self.sight = self._perception.look(pose, self.pan)
        self.fresh, self._since = True, 0.0
