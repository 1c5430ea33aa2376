import numpy as np
import pytest

from marssim.base.rover_spec import ZHURONG


def test_footprint_and_wheels():
    assert (ZHURONG.length, ZHURONG.width) == pytest.approx((1.6, 1.4))
    wheels = ZHURONG.wheel_positions
    assert wheels.shape == (6, 3)
    assert (wheels[0, :2] > 0).all()  # front left
    assert (wheels[::2, 1] > 0).all()
    assert (wheels[1::2, 1] < 0).all()


@pytest.mark.parametrize("pan", [-1.0, 0.0, 0.6])
def test_eyes_straddle_the_mast_and_look_where_it_pans(pan):
    left = ZHURONG.mount.left_eye(0.27, pan)
    right = left[:3, 3] + 0.27 * left[:3, 0]
    middle = (left[:3, 3] + right) / 2
    assert middle == pytest.approx([ZHURONG.mount.x, 0, 1.2])
    forward = left[:3, 2]
    assert np.arctan2(forward[1], forward[0]) == pytest.approx(pan)
    assert np.arcsin(-forward[2]) == pytest.approx(np.deg2rad(20))
