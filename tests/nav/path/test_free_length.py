"""How far motions are free, on maps of flat ground with rocks and on maps of any height."""

import numpy as np
import pytest
from drawn_maps import flat_map_with_rocks, map_of_height
from hypothesis import given
from hypothesis import strategies as st

from marssim.base.rover_spec import ZHURONG
from nav.ground.traversability import TraversabilityConfig, assess
from nav.path.footprint import arc_poses
from nav.path.free_length import free_length, room_needed
from nav.path.planner_config import PlannerConfig
from nav.path.stance import StanceModel

CONFIG = PlannerConfig()


@given(st.floats(-0.5, 2.0), st.floats(0.0, 0.3), st.floats(0.05, 0.2))
def test_a_rover_within_the_margin_may_come_nearer_by_little_and_never_into_the_rock(room, margin, cell):
    least = room_needed(np.array(room), margin, cell)
    assert least <= margin and least <= max(room, margin)
    if room < margin:
        assert room - least <= 0.01 + 1e-9
    plans = [room]
    for _ in range(200):
        plans.append(min(plans[-1], float(room_needed(np.array(plans[-1]), margin, cell))))
    assert plans[-1] == pytest.approx(min(room, -cell / 2)) or room >= margin


@pytest.mark.parametrize("side", [-0.6, 0.0, 0.6])
def test_arcs_through_rocks_are_rejected(side):
    elevation, ground = flat_map_with_rocks([(3.0, side, 0.25)])
    poses = arc_poses(np.zeros(3), np.zeros(1), np.arange(0, 4.01, 0.2))
    free = free_length(poses, 0.2, elevation, ground, ZHURONG, CONFIG)[0]
    # The front wheels stand 0.8 m ahead of the centre, the rock begins at 2.75 m.
    assert 1.4 <= free <= 2.75 - 0.8


def test_wide_gaps_pass_and_narrow_ones_do_not():
    for gap, passes in ((1.3, False), (2.2, True)):
        elevation, ground = flat_map_with_rocks([(3.0, gap / 2 + 0.3, 0.3), (3.0, -gap / 2 - 0.3, 0.3)])
        poses = arc_poses(np.zeros(3), np.zeros(1), np.arange(0, 4.01, 0.2))
        assert (free_length(poses, 0.2, elevation, ground, ZHURONG, CONFIG)[0] >= 3.8) == passes


def test_unseen_ground_ends_an_arc():
    elevation, ground = flat_map_with_rocks(seen=lambda x, y: x < 3.0)
    poses = arc_poses(np.zeros(3), np.zeros(1), np.arange(0, 4.01, 0.2))
    assert free_length(poses, 0.2, elevation, ground, ZHURONG, CONFIG)[0] <= 2.2


def test_unseen_ground_has_a_margin_of_its_own():
    elevation, ground = flat_map_with_rocks(seen=lambda x, y: x < 3.0)
    poses = arc_poses(np.zeros(3), np.zeros(1), np.arange(0, 4.01, 0.1))
    plain, dark, wide = (
        free_length(poses, 0.1, elevation, ground, ZHURONG, PlannerConfig(margin=margin, dark_margin=dark_margin))[0]
        for margin, dark_margin in ((0.08, 0.0), (0.08, 0.5), (0.5, 0.0))
    )
    assert plain - dark == pytest.approx(0.5, abs=0.11) and wide == plain


def test_ground_behind_an_obstacle_is_not_free_again():
    elevation, ground = flat_map_with_rocks([(2.6, 0.0, 0.25)])
    poses = arc_poses(np.zeros(3), np.zeros(1), np.arange(0, 7.01, 0.2))
    assert free_length(poses, 0.2, elevation, ground, ZHURONG, CONFIG)[0] <= 2.35 - 0.8


def test_a_rover_beside_a_rock_may_leave_but_not_come_nearer():
    elevation, ground = flat_map_with_rocks([(1.1, 0.0, 0.25)])
    ahead = arc_poses(np.zeros(3), np.zeros(1), np.arange(0, 2.01, 0.2))
    back = arc_poses(np.zeros(3), np.zeros(1), -np.arange(0, 2.01, 0.2))
    assert free_length(ahead, 0.2, elevation, ground, ZHURONG, CONFIG)[0] == 0
    assert free_length(back, 0.2, elevation, ground, ZHURONG, CONFIG)[0] == pytest.approx(2.0)


def test_arcs_end_where_the_rover_would_tilt_or_ground():
    config, rules = PlannerConfig(), TraversabilityConfig(slope_blocked_deg=60, step_blocked=9, roughness_blocked=9)
    poses = arc_poses(np.zeros(3), np.zeros(1), np.arange(0, 4.01, 0.2))
    for height, end in (
        (lambda x, y: np.tan(np.deg2rad(33)) * np.maximum(0, x - 2), (1.0, 3.4)),  # a bank of 33 deg
        (lambda x, y: 0.3 * (np.abs(y) < 0.2) * (x > 2.5), (1.2, 2.2)),  # a ridge between the wheels
        (lambda x, y: 0 * x, (4.0, 4.0)),
    ):
        elevation = map_of_height(height)
        ground = assess(elevation, ZHURONG, rules)
        free = free_length(poses, 0.2, elevation, ground, ZHURONG, config, StanceModel(elevation, ZHURONG))[0]
        assert end[0] <= free <= end[1] + 1e-6
        assert free_length(poses, 0.2, elevation, ground, ZHURONG, config)[0] >= free


@pytest.mark.parametrize("height", [lambda x, y: np.tan(np.deg2rad(28)) * y, lambda x, y: 0.3 * (np.abs(y) < 0.2)])
def test_a_rover_beyond_a_limit_may_move_on_where_it_gets_no_worse(height):
    rules = TraversabilityConfig(slope_blocked_deg=60, step_blocked=9, roughness_blocked=9)
    elevation, poses = map_of_height(height), arc_poses(np.zeros(3), np.zeros(1), np.arange(0, 2.01, 0.2))
    ground, stance = assess(elevation, ZHURONG, rules), StanceModel(elevation, ZHURONG)
    assert free_length(poses, 0.2, elevation, ground, ZHURONG, CONFIG, stance)[0] == pytest.approx(2.0)
