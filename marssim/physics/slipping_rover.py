"""The rover without dynamics on wheels that slip and sink: it loses way, slides sideways, and settles."""

from __future__ import annotations

import numpy as np

from marssim.base.rover_spec import RoverSpec
from marssim.physics.kinematics import SETTLE_EVERY, SUBSTEP, KinematicRover, along_arc
from marssim.physics.soil.slippage import Slippage
from marssim.physics.soil.soil_map import GroundName
from marssim.physics.soil.traction import Traction
from marssim.physics.state import RoverState
from marssim.physics.support import SupportMap
from marssim.scene.scene import Scene

INTERVAL = SETTLE_EVERY * SUBSTEP  # [s] for which the grip of the wheels is taken as constant


class SlippingRover(KinematicRover):
    """A KinematicRover that moves as the soil lets it, not as its wheels turn.

    The motion is the quasi-static one: at each moment, the pull of the wheels balances the weight. The rover rests on
    the ground as without slip: its wheels' sinkage, 1 to 3 cm, does not lower it.
    """

    def __init__(
        self,
        scene: Scene,
        spec: RoverSpec,
        x: float,
        y: float,
        yaw: float,
        support: SupportMap | None = None,
        ground: GroundName = "scene",
    ) -> None:
        """Put the rover down at rest; see KinematicRover.

        Args:
            scene: The scene.
            spec: The rover.
            x: East coordinate of the body origin [m].
            y: North coordinate [m].
            yaw: Heading [rad], counter-clockwise from east.
            support: The scene's map, if it has been built already.
            ground: "scene" for the scene's own soils, or the soil that lies everywhere instead.

        Raises:
            ValueError: The place is outside the finely gridded square, or there is no such ground.
        """
        super().__init__(scene, spec, x, y, yaw, support)
        self._traction = Traction(scene, spec, self.support, ground)
        self._slippage = Slippage()
        self._turning = (0.0, 0.0, 0.0)

    def drive_twist(self, speed: float, yaw_rate: float, seconds: float, lateral: float = 0.0) -> RoverState:
        """Turn the wheels for an arc, and move as far along it as they grip; see KinematicRover.drive_twist."""
        self._slippage = Slippage()
        self._turning = (speed, yaw_rate, lateral)
        if not any(self._turning) or not np.isfinite([*self._turning, seconds]).all() or seconds < 0:
            return super().drive_twist(speed, yaw_rate, seconds, lateral)  # which refuses what it cannot drive
        rims = self._traction.rims(speed, yaw_rate, lateral)
        pieces = max(1, int(np.ceil(seconds / INTERVAL - 1e-9)))
        for _ in range(pieces):
            start = self._settled
            soils = self._traction.soils_under(start.wheel_middles, start.wheel_contacts)
            balance = self._traction.balance(self._traction.grip(start.pose, soils), rims)
            ahead, left, turn = (float(v) for v in balance.motion)
            super().drive_twist(ahead, turn, seconds / pieces, left)
            rolled = np.array(along_arc(start, speed, turn, self._travelled, lateral)[:2]) - start.pose[:2, 3]
            self._slippage.add(balance, self.spec.wheel_radius, self._travelled, rolled)
            if self._stopped:
                break
        return self.state()

    def slippage(self) -> Slippage:
        """Return what the last drive cost."""
        return self._slippage

    def _turn_wheels(self, speed: float, yaw_rate: float, seconds: float, lateral: float = 0.0) -> None:
        speed, yaw_rate, lateral = self._turning
        super()._turn_wheels(speed, yaw_rate, seconds, lateral)
