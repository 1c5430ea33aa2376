import numpy as np
import pytest

from envs.observation.spaces import observation_space, observe, share_of_distance
from marssim.physics.state import rotation, state_of


def pose(x, y, yaw, roll=0.0, pitch=0.0):
    out = np.eye(4)
    out[:3, :3], out[:2, 3] = rotation(roll, pitch, yaw), (x, y)
    return out


def test_the_goal_is_where_the_rover_believes_and_the_rest_is_what_it_measures():
    """Odometry is off by (1, -1) m and 0.5 rad; attitude is not, and the wheels turn by 0.05 m/s in vain."""
    true, believed = pose(3.0, 4.0, 0.2, 0.1, -0.05), pose(4.0, 3.0, 0.7, 0.1, -0.05)
    state = state_of(true, np.array([0.15, 0.01, 0.0]), 0.08)
    goal = np.array([4.0 + 2 * np.cos(1.0), 3.0 + 2 * np.sin(1.0)])
    seen = observe(np.full((64, 64), 5.0), believed, goal, state, 0.05, np.array([0.5, -0.25]), None)
    np.testing.assert_allclose(seen["goal"], [2.0, np.sin(0.3), np.cos(0.3)], atol=1e-6)
    np.testing.assert_allclose(seen["state"], [0.1, -0.05, 0.2, 0.08, 0.5, -0.25], atol=1e-6)
    assert (seen["depth"] == 5).all() and seen in observation_space(False, False)


@pytest.mark.parametrize("with_pan", [False, True])
@pytest.mark.parametrize("with_map", [False, True])
def test_the_space_has_a_map_and_a_pan_where_there_are_any(with_map, with_pan):
    space = observation_space(with_map, with_pan)
    assert set(space.spaces) == {"depth", "goal", "state"} | ({"map"} if with_map else set()) | (
        {"pan"} if with_pan else set()
    )
    if with_map:
        low, high = space["map"].low, space["map"].high
        assert (low[0] == -1).all() and (low[1:] == 0).all() and (high == 1).all()


def test_the_share_of_a_distance_grows_with_it_and_stays_below_one():
    shares = [share_of_distance(d) for d in (0.0, 1.0, 5.0, 20.0, 1e6)]
    assert shares[0] == 0 and shares[2] == 0.5 and shares == sorted(shares) and shares[-1] < 1
