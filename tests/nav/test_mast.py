import numpy as np
import pytest
from drawn_maps import flat_map_with_rocks
from hypothesis import given
from hypothesis import strategies as st

from marssim.base.rover_spec import ZHURONG
from nav.command import Command
from nav.config import NavigatorConfig
from nav.mast import Mast

CONFIG = NavigatorConfig()
REACH = np.deg2rad(CONFIG.pan_reach_deg)
DRIVE, HERE = Command(0.2, 0.0, None, "drive"), np.zeros(3)


def mast():
    return Mast(ZHURONG, CONFIG)


@given(st.floats(-np.pi, np.pi))
def test_the_mast_looks_along_a_bearing_as_far_as_it_can_turn(bearing):
    pan = mast().towards(bearing)
    if abs(bearing) < np.deg2rad(14):
        assert pan is None
    elif abs(bearing) > np.deg2rad(16):
        assert pan == pytest.approx(np.clip(bearing, -REACH, REACH))


def test_a_mast_that_does_not_move_is_noticed_and_a_slow_one_is_not():
    slow, pan = mast(), 0.0
    for _ in range(14):
        pan = min(pan + 0.1, 1.2)
        slow.follow(pan, 1.2)
        assert slow.obeys
    stuck = mast()
    stuck.follow(0.0, None)
    stuck.follow(0.0, 1.2)
    assert not stuck.obeys and stuck.towards(1.2) is None
    assert not stuck.must_look(1.2, HERE, 0.0, DRIVE, flat_map_with_rocks(seen=lambda x, y: x > 50)[0])


def test_the_mast_looks_once_before_a_turn_into_unseen_ground():
    elevation, _ = flat_map_with_rocks(seen=lambda x, y: (np.abs(y) < 0.8) & (x > 0))
    new_mast = mast()
    assert new_mast.must_look(1.2, HERE, 0.0, DRIVE, elevation)
    look_left = Command(0.0, 0.0, 1.2, "look")
    assert new_mast.must_look(1.2, HERE, 0.6, look_left, elevation)  # on its way
    assert not new_mast.must_look(1.2, HERE, 1.2, look_left, elevation)  # it has looked there, whatever it saw
    new_mast.turn_is_over()
    assert new_mast.must_look(1.2, HERE, 0.0, DRIVE, elevation)


def test_turns_that_are_small_or_into_seen_ground_need_no_look():
    everything, _ = flat_map_with_rocks()
    assert not mast().must_look(1.2, HERE, 0.0, DRIVE, everything)
    nothing, _ = flat_map_with_rocks(seen=lambda x, y: x > 50)
    assert not mast().must_look(0.9 * np.deg2rad(CONFIG.look_before_turn_deg), HERE, 0.0, DRIVE, nothing)
    assert mast().must_look(1.1 * np.deg2rad(CONFIG.look_before_turn_deg), HERE, 0.0, DRIVE, nothing)
    # to the left everything was seen, to the right nothing
    left, _ = flat_map_with_rocks(seen=lambda x, y: y > -0.7)
    assert not mast().must_look(1.5, HERE, 0.0, DRIVE, left) and mast().must_look(-1.5, HERE, 0.0, DRIVE, left)


def test_beyond_the_map_nothing_was_seen():
    everything, _ = flat_map_with_rocks()
    assert mast().must_look(0.7, np.array([7.5, 0.0, 0.0]), 0.0, DRIVE, everything)


@pytest.mark.parametrize("side", [1, -1])
def test_the_way_after_a_turn_must_be_known_on_both_sides(side):
    half, _ = flat_map_with_rocks(seen=lambda x, y: side * x < 0)
    assert Mast(ZHURONG, CONFIG).must_look(np.pi / 2, HERE, 0.0, DRIVE, half)
