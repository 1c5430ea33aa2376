"""Which looks near the rover have shown a direction already."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from nav.looks import SAME_BEARING, SAME_PLACE, Looks

angles = st.floats(-np.pi, np.pi)


@given(angles, angles)
def test_a_look_covers_its_own_bearing_whatever_the_rover_heads_for(yaw, pan):
    looks = Looks()
    assert not looks.cover(np.array([1.0, 2.0, yaw]), pan)
    looks.note(np.array([1.0, 2.0, yaw]), pan)
    assert looks.cover(np.array([1.0, 2.0, yaw]), pan)
    assert looks.cover(np.array([1.0, 2.0, yaw + 2.0]), pan - 2.0)
    assert looks.cover(np.array([1.0, 2.0, yaw]), pan + 0.9 * SAME_BEARING)
    assert not looks.cover(np.array([1.0, 2.0, yaw]), pan + 1.1 * SAME_BEARING)


def test_a_look_from_elsewhere_shows_other_ground():
    looks = Looks()
    looks.note(np.zeros(3), 0.0)
    assert looks.cover(np.array([0.9 * SAME_PLACE, 0.0, 0.0]), 0.0)
    assert not looks.cover(np.array([1.1 * SAME_PLACE, 0.0, 0.0]), 0.0)


def test_looks_that_the_rover_has_left_behind_are_forgotten():
    looks = Looks()
    looks.note(np.zeros(3), 0.0)
    looks.note(np.array([5.0, 0.0, 0.0]), 0.0)
    assert not looks.cover(np.zeros(3), 0.0)


def test_bearings_on_both_sides_of_the_jump_from_pi_to_minus_pi_are_near():
    looks = Looks()
    looks.note(np.array([0.0, 0.0, 3.1]), 0.0)
    assert looks.cover(np.array([0.0, 0.0, -3.1]), 0.0)  # 5 deg away
