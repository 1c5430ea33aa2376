import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from marssim.base.angle import wrapped


@given(st.floats(-100, 100))
def test_a_wrapped_angle_lies_in_one_turn_and_points_the_same_way(angle):
    assert -np.pi <= wrapped(angle) <= np.pi
    assert np.exp(1j * wrapped(angle)) == pytest.approx(np.exp(1j * angle), abs=1e-12)


def test_half_a_turn_is_minus_pi():
    np.testing.assert_array_equal(wrapped(np.array([np.pi, -np.pi])), -np.pi)
