"""Trenches and rocks on a plain, as an exact depth map shows them: which hidden ground is taken for a drop."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rock_world import SMALL_RIG, RockWorld, body_pose

from marssim.base.rover_spec import ZHURONG
from nav.ground.elevation import ElevationConfig, ElevationMap
from nav.ground.hidden_drops import HiddenDropConfig, _gaps
from nav.ground.traversability import TraversabilityConfig, assess

SMALL = ElevationConfig(size=16.0)
TRENCH = (3.5, 0.0, 0.6, 6.0)  # from x = 2.9 m to 4.1 m


def look(world, *places, change=lambda depth: depth, descent_deg=0.0):
    """A map after one look from each place (x, y, yaw), with the whole world tilted so that it descends along x."""
    elevation = ElevationMap(SMALL)
    c, s = np.cos(np.deg2rad(descent_deg)), np.sin(np.deg2rad(descent_deg))
    tilted = np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1.0]])
    for place in places or [(0, 0, 0)]:
        camera = body_pose(*place) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline)
        depth = change(world.depth(SMALL_RIG, camera))
        elevation.integrate(depth, None, SMALL_RIG, tilted @ camera)
    return elevation


def drops(elevation):
    """World x and y of the cells that are possible drops."""
    iy, ix = np.nonzero(elevation.possible_drop)
    x, y = elevation.centres()
    return x[ix], y[iy]


def trench(depth=1.2):
    return RockWorld(trenches=np.array([(*TRENCH, depth)]))


def test_the_hidden_part_of_a_trench_is_a_possible_drop_and_blocks():
    elevation = look(trench())
    x, y = drops(elevation)
    assert len(x) > 100
    assert x.min() > 2.9 - 0.1 and x.max() < 4.1 + 0.1
    ahead = np.abs(y) < 0.7
    assert x[ahead].min() < 3.1  # from its near brink on
    ground = assess(elevation, ZHURONG, TraversabilityConfig())
    assert ground.blocked[elevation.possible_drop].all()
    row, column = elevation.cell_of(np.array([2.3, 0.0]))[::-1]
    assert ground.clearance[row, column] < 0.8


@pytest.mark.parametrize("descent_deg", [0.0, 10.0])
def test_before_a_trench_is_near_nothing_is_marked(descent_deg):
    """The line of sight to ground as far away is as flat on a slope, whatever its angle to the horizon."""
    far = RockWorld(trenches=np.array([(7.0, 0.0, 1.0, 6.0, 1.2)]))
    assert len(drops(look(far, descent_deg=descent_deg))[0]) == 0
    assert len(drops(look(trench(), descent_deg=descent_deg))[0]) > 100


def test_a_trench_too_shallow_or_too_narrow_to_matter_is_not_marked():
    for half, depth in ((0.6, 0.2), (0.15, 1.0)):
        assert len(drops(look(RockWorld(trenches=np.array([(3.5, 0.0, half, 6.0, depth)]))))[0]) == 0


def test_ground_that_a_later_look_shows_is_no_possible_drop_any_more():
    """From nearer to the brink the camera sees more of the floor."""
    first, both = look(trench(0.5)), look(trench(0.5), (0, 0, 0), (0.9, 0, 0))
    seen = both.measured & first.possible_drop
    assert seen.sum() > 10 and not both.possible_drop[seen].any()
    assert np.nanmin(both.low[seen]) == pytest.approx(-0.5, abs=0.05)
    floor = seen & (both.centres()[0] < 3.6)  # away from the edge of what is known
    assert floor.sum() > 10 and not assess(both, ZHURONG, TraversabilityConfig()).blocked[floor].any()


def test_a_brink_with_nothing_behind_it_is_a_possible_drop():
    cliff = RockWorld(trenches=np.array([(53.0, 0.0, 50.0, 60.0, 80.0)]))
    x, _ = drops(look(cliff, change=lambda depth: np.where(depth > 20, np.inf, depth)))
    assert len(x) > 100 and x.min() > 2.9 and x.max() < 4.2


def test_unknown_depth_is_no_drop():
    """A hole in the depth map, as over a patch without texture."""

    def hole(depth):
        depth = depth.copy()
        depth[100:140, 60:130] = np.nan
        return depth

    assert len(drops(look(RockWorld(), change=hole))[0]) == 0
    assert len(drops(look(trench(), change=lambda depth: np.full_like(depth, np.nan)))[0]) == 0


@given(
    st.lists(
        st.tuples(st.floats(1.8, 6), st.floats(-1.5, 1.5), st.floats(0.15, 0.9), st.floats(0.1, 0.9)),
        min_size=1, max_size=4,
    )
)  # fmt: skip
@settings(max_examples=25)
def test_shadows_of_rocks_are_no_drops(rocks):
    assert len(drops(look(RockWorld(domes=np.array(rocks))))[0]) == 0


@pytest.mark.parametrize("y", [-0.6, 0.0, 0.6])
@pytest.mark.parametrize("x", [3.5, 4.5])
def test_shadows_of_rocks_on_a_slope_are_no_drops(x, y):
    """The rock hides the ground just before its shadow, so that the slope shows only before the rock."""
    assert len(drops(look(RockWorld(domes=np.array([(x, y, 0.5, 0.35)])), descent_deg=14.0))[0]) == 0


@given(st.floats(1.8, 4.5), st.floats(0.2, 0.6), st.floats(0.1, 0.9))
@settings(max_examples=15)
def test_shadows_of_blocks_with_level_tops_are_no_drops(x, half, height):
    assert len(drops(look(RockWorld(boxes=np.array([(x + half, 0.0, half, half, height)]))))[0]) == 0


@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
@settings(max_examples=15)
def test_slopes_are_no_drops(east, north):
    assert len(drops(look(RockWorld(slope=(east, north))))[0]) == 0


def test_the_marks_move_with_the_map_and_are_forgotten_with_it():
    elevation = look(trench())
    before = np.array(drops(elevation))
    assert elevation.recentre(np.array([3.0, 0.0]))
    np.testing.assert_allclose(np.array(drops(elevation)), before, atol=1e-6)
    elevation.clear((0.0, 0.0))
    assert not elevation.possible_drop.any()


def test_a_gap_lies_between_the_points_of_two_pixels_of_its_column():
    camera = body_pose(0.4, -0.3, 0.5) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline)
    depth = np.minimum(trench().depth(SMALL_RIG, camera), 50.0)
    columns = np.array([60, 90, 130])
    column, near, far = _gaps(depth, depth < 50, columns, SMALL_RIG, camera, HiddenDropConfig())
    u, v = np.rint(SMALL_RIG.camera.project((near - camera[:3, 3]) @ camera[:3, :3])).astype(int).T
    points = SMALL_RIG.camera.unproject(depth) @ camera[:3, :3].T + camera[:3, 3]
    np.testing.assert_array_equal(column, columns)
    np.testing.assert_array_equal(u, columns)
    np.testing.assert_allclose(near, points[v, u], atol=1e-4)
    np.testing.assert_allclose(far, points[v - 1, u], atol=1e-4)
    assert np.abs(near[:, 2]).max() < 1e-4 and far[:, 2].max() < -0.3


@pytest.mark.parametrize(("columns", "marked"), [(slice(95, 98), False), (slice(91, 102), True)])
def test_a_few_pixels_that_see_a_drop_are_not_believed(columns, marked):
    camera = body_pose(0, 0, 0) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline)
    trench = RockWorld(trenches=np.array([(*TRENCH, 1.2)]))
    depth, deep = (world.depth(SMALL_RIG, camera) for world in (RockWorld(), trench))
    depth[:, columns] = deep[:, columns]
    elevation = ElevationMap(SMALL)
    elevation.integrate(depth, None, SMALL_RIG, camera)
    assert elevation.hidden_drop.any() == marked


def test_of_a_narrow_trench_nothing_beyond_its_far_side_is_hidden():
    trench = RockWorld(trenches=np.array([(3.5, 0.0, 0.4, 6.0, 1.2)]))  # narrower than HiddenDropConfig.reach
    camera = body_pose(0, 0, 0) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline)
    elevation = ElevationMap(SMALL)
    elevation.integrate(trench.depth(SMALL_RIG, camera), None, SMALL_RIG, camera)
    x = elevation.centres()[0][np.nonzero(elevation.hidden_drop)[1]]
    assert len(x) > 50 and x.max() < 3.9 + 0.1
