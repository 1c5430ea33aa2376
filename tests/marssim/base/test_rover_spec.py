from dataclasses import replace

import numpy as np
import pytest

from marssim.base.rover_spec import ZHURONG, CameraMount


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


@pytest.mark.parametrize("pan", [-2.0, 0.0, 0.6])
def test_a_mast_follows_from_the_place_of_its_left_eye(pan):
    mount = replace(ZHURONG.mount, x=0.3, y=-0.2, height=0.7, pitch=0.5)
    found, turned = CameraMount.of_left_eye(mount.left_eye(0.4, pan), 0.4)
    assert turned == pytest.approx(pan)
    assert (found.x, found.y, found.height, found.pitch) == pytest.approx((0.3, -0.2, 0.7, 0.5))
    below = mount.left_eye(0.4)
    below[2, 3] = -0.1
    with pytest.raises(ValueError, match=r"above the ground of the rover, got -0.1 m"):
        CameraMount.of_left_eye(below, 0.4)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"obstacle_height": 120.0}, r"obstacle_height must lie in \[0.001, 10\] m, got 120; is it in millimetres\?"),
        ({"max_slope": 25.0}, "max_slope must lie in .* rad, got 25; is it in degrees"),
        ({"max_steer": -0.1}, "max_steer must lie in"), ({"wheel_radius": np.nan}, "wheel_radius must lie in"),
        ({"max_speed": 0.0}, "max_speed must lie in"), ({"mass": 0.0}, "mass must be above 0"),
        ({"wheel_x": (0.3, -0.3)}, "wheel_x must be three"), ({"wheel_x": (-0.6, 0, 0.6)}, "wheel_x must be three"),
        ({"wheel_x": (1.3, 0.65, 0.0)}, "wheel_x must have the origin midway between the front and the rear axle"),
        ({"chassis_size": (1100, 800, 400)}, "chassis_size must be three lengths"),
    ],
)  # fmt: skip
def test_dimensions_that_no_rover_has_are_refused_by_name(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(ZHURONG, **changes)


@pytest.mark.parametrize(
    "changes", [{"pitch": 20.0}, {"height": 1200.0}, {"height": 0.0}, {"x": np.nan}, {"pan_rate": 0}]
)
def test_a_mast_that_no_rover_has_is_refused_by_name(changes):
    (name,) = changes
    with pytest.raises(ValueError, match=f"^{name} must lie in"):
        CameraMount(**changes)
