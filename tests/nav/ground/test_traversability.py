import numpy as np
import pytest
from drawn_maps import map_of_height
from hypothesis import example, given, settings
from hypothesis import strategies as st
from rock_world import SMALL_RIG, RockWorld, body_pose

from marssim.base.rover_spec import ZHURONG
from nav.ground.elevation import ElevationConfig, ElevationMap
from nav.ground.traversability import (
    TraversabilityConfig,
    _ground_cost,
    assess,
    distance_to,
    fit_planes,
    ground_surface,
)

SMALL = ElevationConfig(size=16.0)
CONFIG = TraversabilityConfig()


def painted(height):
    """A fully seen map with given heights; height: callable of x, y."""
    elevation = ElevationMap(SMALL)
    x, y = elevation.centres()
    z = np.broadcast_to(height(x[None, :], y[:, None]), (elevation.n, elevation.n)).astype(np.float32)
    elevation.top, elevation.low, elevation.weight = z.copy(), z.copy(), np.ones_like(z)
    return elevation


@settings(max_examples=15, deadline=None)
@given(st.floats(-0.25, 0.25), st.floats(-0.25, 0.25))
@example(0.25, 0.25)  # rises most from a cell to its neighbour across the corner
def test_planes_have_their_slope_and_no_steps(a, b):
    ground = assess(painted(lambda x, y: a * x + b * y), ZHURONG, CONFIG)
    inner = np.s_[20:-20, 20:-20]
    np.testing.assert_allclose(ground.slope[inner], np.arctan(np.hypot(a, b)), atol=2e-3)
    assert np.nanmax(ground.step[inner]) < 1e-3
    assert np.nanmax(ground.roughness[inner]) < 2e-3
    assert ground.blocked[inner].all() == (np.hypot(a, b) > np.tan(np.deg2rad(22)))


def test_slopes_cost_and_steep_ones_block():
    def cost(degrees):
        ground = assess(painted(lambda x, y: np.tan(np.deg2rad(degrees)) * x), ZHURONG, CONFIG)
        return ground.cost[80, 80], ground.blocked[80, 80]

    assert cost(3)[0] == pytest.approx(0)
    assert 0 < cost(10)[0] < cost(18)[0]
    assert not cost(20)[1] and cost(25)[1]


@pytest.mark.parametrize("slope", [0.0, 0.15])
@pytest.mark.parametrize(("height", "blocks"), [(0.1, False), (0.18, False), (0.3, True), (0.4, True), (1.0, True)])
@pytest.mark.parametrize("width", [0.3, 1.0, 2.4])
def test_rocks_block_by_their_exposed_height(height, blocks, width, slope):
    def shape(x, y):
        return slope * x + height * ((np.abs(x) < width / 2) & (np.abs(y) < width / 2))

    ground = assess(painted(shape), ZHURONG, CONFIG)
    middle = np.s_[64:96, 64:96]
    assert ground.blocked[middle].any() == blocks
    assert ground.cost[80, 80] > 0
    far = np.s_[10:30, 10:30]
    assert not ground.blocked[far].any()
    if blocks and width < CONFIG.ground_window:
        assert ground.step[80, 80] == pytest.approx(height, abs=0.03)


@pytest.mark.parametrize(("height", "blocks"), [(0.4, True), (0.1, False)])
def test_rocks_seen_by_the_camera(height, blocks):
    elevation, world = ElevationMap(SMALL), RockWorld(domes=np.array([[4.0, 0.3, height, height]]))
    camera = body_pose(0, 0, 0) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline)
    elevation.integrate(world.depth(SMALL_RIG, camera), None, SMALL_RIG, camera)
    ground = assess(elevation, ZHURONG, CONFIG)
    assert ground.blocked.any() == blocks
    if blocks:
        iy, ix = np.nonzero(ground.blocked)
        x, y = elevation.centres()
        assert np.hypot(x[ix] - 4.0, y[iy] - 0.3).max() < height + 0.15


def test_the_top_of_a_rock_in_its_own_shadow_is_no_ground():
    low = np.full((60, 60), np.nan, np.float32)
    low[:, :30] = 0.0
    low[20:40, 30:32] = 0.8
    known = np.isfinite(low)
    assert np.nanmax(ground_surface(low, known, 17)) == pytest.approx(0, abs=1e-6)


def test_the_flanks_of_a_rock_belong_to_it_and_a_low_stone_is_none():
    """A cone that wheels must not touch even where it is low, and one that is as low everywhere."""
    cone, stone = (painted(lambda x, y, h=h: np.maximum(h - 0.8 * np.hypot(x, y), 0)) for h in (0.4, 0.2))
    blocked = assess(cone, ZHURONG, CONFIG).blocked
    x, y = np.meshgrid(*cone.centres())
    assert blocked[np.hypot(x, y) < 0.35].all() and not blocked[np.hypot(x, y) > 0.6].any()
    assert not assess(stone, ZHURONG, CONFIG).blocked.any()


def test_what_is_hidden_behind_a_face_is_taken_for_the_rock_and_no_more():
    """A block of which only the near face, at x = 2 m, is seen; behind it nothing is known."""
    elevation = painted(lambda x, y: 0.5 * ((x > 2.0) & (np.abs(y) < 0.3)))
    x, y = (a.ravel() for a in elevation.centres())
    hidden = (x[None, :] > 2.1) & (np.abs(y[:, None]) < 0.3)
    for layer, empty in ((elevation.top, np.nan), (elevation.low, np.nan), (elevation.weight, 0)):
        layer[hidden] = empty
    blocked = assess(elevation, ZHURONG, CONFIG).blocked
    row = int(np.argmin(np.abs(y)))
    depth = x[np.flatnonzero(blocked[row])] - 2.0
    assert depth.min() < 0.1 and CONFIG.hidden_depth - 0.05 < depth.max() < CONFIG.hidden_depth + 0.15


def test_the_bottom_of_a_ditch_is_rough_where_it_does_not_slope():
    """Sides of 47 deg: along the middle the plane that fits best is all but level, and 0.17 m off."""
    ditch = painted(lambda x, y: np.tan(np.deg2rad(47)) * np.abs(x) + 0 * y)
    ground = assess(ditch, ZHURONG, CONFIG)
    bottom = np.s_[40:120, 79:81]
    assert ground.slope[bottom].max() < np.deg2rad(15) and ground.blocked[bottom].all()
    smooth = TraversabilityConfig(roughness_blocked=9.0)
    assert not assess(ditch, ZHURONG, smooth).blocked[bottom].any()


def test_beside_an_obstacle_ground_costs_less_and_less():
    ground = assess(painted(lambda x, y: 0.6 * ((np.abs(x) < 0.2) & (np.abs(y) < 0.2))), ZHURONG, CONFIG)
    half = ZHURONG.width / 2 + CONFIG.margin
    for column in range(94, 105):  # 1.2 m and more beside the block, which itself counts up to 0.9 m
        away = ground.clearance[80, column]
        expected = CONFIG.near_cost * np.clip((CONFIG.comfort - away) / (CONFIG.comfort - half), 0, 1)
        assert ground.cost[80, column] == pytest.approx(expected, abs=1e-4)
    assert ground.cost[80, 94] > 0.5 and ground.cost[80, 100] == 0


def test_unknown_is_dark_never_blocked_never_free():
    elevation = ElevationMap(SMALL)
    elevation.assume_flat(body_pose(0, 0, 0), 3.0)
    ground = assess(elevation, ZHURONG, CONFIG)
    assert not ground.blocked.any()
    assert ground.dark[5, 5] and not ground.dark[80, 80] and not ground.known[5, 5]
    assert ground.cost[5, 5] >= CONFIG.unknown_cost
    assert ground.cost[80, 80] == 0
    assert ground.dark_distance[80, 80] == pytest.approx(3.0, abs=0.2)


def test_gaps_too_small_for_an_obstacle_are_not_dark():
    elevation = painted(lambda x, y: 0 * x)
    for layer, empty in ((elevation.top, np.nan), (elevation.low, np.nan), (elevation.weight, 0)):
        layer[40:43, 40:43] = empty
        layer[100:110, 100:110] = empty
    dark = assess(elevation, ZHURONG, CONFIG).dark
    assert not dark[35:50, 35:50].any()
    assert dark[105, 105]


def test_bumps_block_and_carried_ground_does_not():
    elevation = painted(lambda x, y: 0.5 * ((np.abs(x) < 0.2) & (np.abs(y) < 0.2)))
    at = np.zeros((160, 160), bool)
    at[80 - 4 : 84, 76:84] = True
    assert not assess(elevation, ZHURONG, CONFIG, passable=at).blocked.any()
    bump = np.zeros_like(at)
    bump[20, 20] = True
    ground = assess(elevation, ZHURONG, CONFIG, extra_blocked=bump)
    assert ground.blocked[20, 20] and ground.clearance[20, 30] == pytest.approx(0.95)
    assert ground.inflated[20, 28] and not ground.inflated[20, 31]  # up to half the width and the margin


def test_plane_fit_is_exact_with_gaps():
    rng = np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(40) * 0.1, np.arange(40) * 0.1)
    known = rng.random((40, 40)) < 0.6
    slope, rms = fit_planes(5 + 0.2 * x - 0.1 * y, known, 11, 0.1)
    np.testing.assert_allclose(slope[8:-8, 8:-8], np.arctan(np.hypot(0.2, 0.1)), atol=1e-5)
    assert rms[8:-8, 8:-8].max() < 1e-4


def test_distance_is_to_the_edge_of_the_cell():
    mask = np.zeros((20, 20), bool)
    mask[10, 10] = True
    distance = distance_to(mask, 0.1)
    assert distance[10, 15] == pytest.approx(0.45) and distance[10, 10] < 0
    assert np.isinf(distance_to(np.zeros_like(mask), 0.1)).all()


def test_assumed_ground_makes_no_steps():
    elevation = ElevationMap(SMALL)
    tilted = body_pose(0, 0, 0)
    tilted[2, 3] = 0.4
    elevation.assume_flat(tilted, 2.5)
    camera = body_pose(0, 0, 0) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline)
    elevation.integrate(RockWorld().depth(SMALL_RIG, camera), None, SMALL_RIG, camera)
    assert not assess(elevation, ZHURONG, CONFIG).blocked.any()


def test_gaps_in_level_ground_at_any_height_make_no_slope():
    elevation = map_of_height(lambda x, y: 5 + 0 * x)
    gap = np.random.default_rng(0).random(elevation.top.shape) < 0.4
    elevation.top[gap], elevation.weight[gap] = np.nan, 0
    ground = assess(elevation, ZHURONG, TraversabilityConfig())
    assert np.nanmax(ground.slope) < 1e-3 and not ground.blocked.any()


def test_the_cost_of_a_step_reaches_as_far_as_the_wheels_of_a_rover_whose_body_is_over_it():
    """Each cell takes the mean over squares of the rover's width of what a wheel would feel that stands there."""
    cell, still = 0.1, np.zeros((61, 61), np.float32)
    step = still.copy()
    step[30, 30] = CONFIG.step_blocked
    cost = _ground_cost(step, still, still, ZHURONG, cell, CONFIG)
    wheel, width = (2 * round(length / cell / 2) + 1 for length in (2 * ZHURONG.wheel_radius, ZHURONG.width))
    reach = np.abs(np.arange(61) - 30) <= wheel // 2 + width // 2
    assert np.array_equal(cost > 1e-6, reach[:, None] & reach)
    assert wheel > 1 and cost[30, 30] == pytest.approx(CONFIG.step_cost * wheel**2 / width**2, rel=1e-5)
