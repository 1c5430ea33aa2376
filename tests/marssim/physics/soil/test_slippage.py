import numpy as np
import pytest

from marssim.physics.soil.slippage import DRIVE_FRICTION, EFFICIENCY, Slippage
from marssim.physics.soil.traction import Balance

RADIUS, SPEED, SECONDS = 0.15, 0.2, 2.0


def energy(torque):
    """Energy [J] of six wheels that roll ahead without slip under a torque [N m]."""
    ahead, none = np.tile([SPEED, 0.0], (6, 1)), np.zeros(6)
    slippage = Slippage()
    slippage.add(
        Balance(
            motion=np.array([SPEED, 0, 0]), rims=ahead, slip=none, force=0 * ahead, torque=np.full(6, torque),
            sinkage=none, hub_velocities=ahead,
        ), RADIUS, SECONDS, np.array([SPEED * SECONDS, 0]),
    )  # fmt: skip
    return slippage.energy


@pytest.mark.parametrize(
    ("torque", "paid"),
    [(30.0, 30.0 + DRIVE_FRICTION), (0.0, DRIVE_FRICTION), (-0.4 * DRIVE_FRICTION, 0.6 * DRIVE_FRICTION), (-30.0, 0.0)],
)
def test_driving_costs_its_torque_and_braking_gives_nothing_back(torque, paid):
    """What a slope gives to a wheel overcomes its friction first."""
    work = 6 * paid * SPEED / RADIUS * SECONDS
    assert energy(torque) == pytest.approx(work / EFFICIENCY)


def test_what_the_wheels_roll_sideways_is_no_slide():
    rims, hubs = np.tile([0.0, 0.1], (6, 1)), np.tile([0.0, 0.08], (6, 1))
    none, slippage = np.zeros(6), Slippage()
    slippage.add(
        Balance(
            motion=np.array([0, 0.08, 0]), rims=rims, slip=none, force=0 * rims, torque=none, sinkage=none,
            hub_velocities=hubs,
        ), RADIUS, SECONDS, np.array([0, 0.1 * SECONDS]),
    )  # fmt: skip
    assert slippage.sideways == pytest.approx(-0.02 * SECONDS) and slippage.slip == pytest.approx(0.2)
