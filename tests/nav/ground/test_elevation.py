import cv2
import numpy as np
import pytest
from drawn_maps import SMALL as DRAWN
from drawn_maps import map_of_height
from hypothesis import given, settings
from hypothesis import strategies as st
from rock_world import SMALL_RIG, RockWorld, body_pose

from marssim.base.camera import NATECAM
from marssim.base.pose import look_pose
from marssim.base.rover_spec import ZHURONG
from nav.ground.elevation import ElevationConfig, ElevationMap

SMALL = ElevationConfig(size=24.0)


def look(elevation, world, pose, confidence=None, pan=0.0):
    camera = pose @ ZHURONG.mount.left_eye(SMALL_RIG.baseline, pan)
    return elevation.integrate(world.depth(SMALL_RIG, camera), confidence, SMALL_RIG, camera)


@settings(max_examples=15, deadline=None)
@given(st.floats(-0.15, 0.15), st.floats(-0.15, 0.15), st.floats(-3, 3))
def test_map_of_a_plane_is_the_plane(slope_x, slope_y, yaw):
    elevation = ElevationMap(SMALL)
    camera = look_pose([0.3, -0.2, 1.2], yaw, np.deg2rad(20))
    elevation.integrate(RockWorld(slope=(slope_x, slope_y)).depth(SMALL_RIG, camera), None, SMALL_RIG, camera)
    x, y = elevation.centres()
    plane = slope_x * x[None, :] + slope_y * y[:, None]
    known = elevation.known
    assert known.sum() > 500
    # Inside a cell the plane itself rises by up to slope x cell.
    tolerance = 0.05 * (abs(slope_x) + abs(slope_y)) + 0.002
    assert np.abs(elevation.top - plane)[known].max() < tolerance
    assert np.abs(elevation.low - plane)[known].max() < tolerance


def test_only_what_the_camera_sees_becomes_known():
    elevation = ElevationMap(SMALL)
    look(elevation, RockWorld(), body_pose(0, 0, 0))
    x, y = elevation.centres()
    bearing = np.abs(np.arctan2(y[:, None], x[None, :] - ZHURONG.mount.x))
    ahead = x[None, :] - ZHURONG.mount.x + 0 * y[:, None]
    assert not elevation.known[(bearing > np.deg2rad(36)) & (ahead > 1)].any()
    assert not elevation.known[ahead < 1.1].any()
    assert elevation.known[(bearing < np.deg2rad(20)) & (ahead > 1.5) & (ahead < 4)].mean() > 0.97


def test_a_rock_keeps_its_height_and_hides_what_is_behind():
    elevation = ElevationMap(SMALL)
    look(elevation, RockWorld(boxes=np.array([[4.0, 0.0, 0.3, 0.3, 0.6]])), body_pose(0, 0, 0))
    ix, iy = elevation.cell_of(np.array([3.7, 0.0]))
    assert 0.5 < elevation.top[iy, ix - 1 : ix + 2].max() < 0.61
    # The shadow is 0.6 / (1.2 - 0.6) times the distance long.
    for behind in (4.6, 5.5, 6.5):
        bx, by = elevation.cell_of(np.array([behind, 0.0]))
        assert not elevation.known[by, bx]


def test_rock_does_not_melt_over_many_looks():
    elevation, world = ElevationMap(SMALL), RockWorld(domes=np.array([[5.0, 0.2, 0.4, 0.4]]))
    for x in np.arange(0, 2.4, 0.4):
        look(elevation, world, body_pose(x, 0, 0))
    ix, iy = elevation.cell_of(np.array([5.0, 0.2]))
    assert np.nanmax(elevation.top[iy - 4 : iy + 5, ix - 4 : ix + 5]) > 0.35


def test_a_stray_far_point_disappears_when_seen_from_near():
    elevation, camera = ElevationMap(SMALL), body_pose(0, 0, 0) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline)
    depth = RockWorld().depth(SMALL_RIG, camera)
    far = np.argwhere((depth > 7.9) & (depth < 8.1))[:, 0].max()
    depth[far - 12 : far, 90:100] = 8.0
    elevation.integrate(depth, None, SMALL_RIG, camera)
    assert np.nanmax(elevation.top) > 0.2
    for x in (3.0, 3.4, 3.8, 4.2, 4.6):
        look(elevation, RockWorld(), body_pose(x, 0, 0))
    assert np.nanmax(elevation.top) < 0.08


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_no_depth_makes_nothing_known(value):
    elevation = ElevationMap(SMALL)
    depth = np.full((192, 192), value, np.float32)
    assert elevation.integrate(depth, None, SMALL_RIG, body_pose(0, 0, 0)) == 0
    assert not elevation.known.any()


def test_nan_pixels_stay_unknown_and_low_confidence_too():
    camera = body_pose(0, 0, 0) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline)
    depth = RockWorld().depth(SMALL_RIG, camera)
    holed = depth.copy()
    holed[:, :96] = np.nan
    confidence = np.ones_like(depth)
    confidence[:, :96] = 0.1
    for d, c in ((holed, None), (depth, confidence)):
        elevation = ElevationMap(SMALL)
        elevation.integrate(d, c, SMALL_RIG, camera)
        _, y = elevation.centres()
        assert elevation.known[y < -0.2].any()
        assert not elevation.known[y > 0.2].any()


def alone_and_both(depth):
    """(H, W) bool: pixels that the left eye alone sees, by the geometry of the rig; and the others."""
    outside = np.arange(192)[None, :] - SMALL_RIG.depth_to_disparity(depth) < 0
    return outside, ~outside


def test_what_one_eye_sees_makes_ground_known_only_where_it_is_sure():
    camera = body_pose(0, 0, 0) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline)
    depth = RockWorld().depth(SMALL_RIG, camera)
    alone, both = alone_and_both(depth)
    known = {}
    for name, d, confidence in (
        ("unsure", depth, np.full_like(depth, 0.6)),
        ("sure", depth, np.full_like(depth, 0.8)),
        ("overlap", np.where(both, depth, np.nan), None),
    ):
        elevation = ElevationMap(SMALL)
        elevation.integrate(d, confidence, SMALL_RIG, camera)
        known[name] = elevation.known
    assert alone[96:].mean() > 0.1 and known["overlap"].sum() > 300
    assert known["unsure"][known["overlap"]].all()
    assert (known["unsure"] & ~known["overlap"]).sum() < 0.03 * known["overlap"].sum()  # beside NaN is an edge
    assert known["sure"].sum() > 1.05 * known["overlap"].sum()


def test_what_one_eye_sees_may_show_an_obstacle():
    """The same rock, unsure and seen by the left eye alone, stands in the map; the ground about it does not."""
    camera = body_pose(0, 0, 0) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline)
    world = RockWorld(boxes=np.array([[4.0, 1.5, 0.15, 0.06, 0.4]]))
    depth = world.depth(SMALL_RIG, camera)
    on_rock = depth < RockWorld().depth(SMALL_RIG, camera) - 0.01
    assert on_rock.sum() > 100 and alone_and_both(depth)[0][on_rock].mean() > 0.97
    elevation = ElevationMap(SMALL)
    elevation.integrate(depth, np.full_like(depth, 0.6), SMALL_RIG, camera)
    x, y = elevation.centres()
    near = (np.abs(x[None, :] - 3.85) < 0.3) & (np.abs(y[:, None] - 1.5) < 0.25)
    assert np.nanmax(elevation.top[near]) == pytest.approx(0.4, abs=0.05)
    left = (x[None, :] > 2.5) & (x[None, :] < 6) & (y[:, None] > 0.45 * x[None, :])
    assert np.nanmin(elevation.top[left], initial=1.0) > 0.1


@pytest.mark.parametrize(("rows", "columns", "stands"), [(1, 1, False), (8, 8, True)])
def test_few_points_stand_out_only_beside_a_cell_as_high(rows, columns, stands):
    """Pixels a little too near, 0.74 px at 10 m, hang 0.12 m above the ground; that is no edge of depth."""
    camera = body_pose(0, 0, 0) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline)
    disparity = SMALL_RIG.depth_to_disparity(RockWorld().depth(SMALL_RIG, camera))
    row = int(np.argmin(np.abs(disparity[:, 96] - SMALL_RIG.fb / 10)))
    disparity[row - rows + 1 : row + 1, 96 : 96 + columns] += 0.74
    depth = SMALL_RIG.disparity_to_depth(disparity).astype(np.float32)
    elevation = ElevationMap(SMALL)
    elevation.integrate(depth, None, SMALL_RIG, camera)
    assert (np.nanmax(elevation.top) > 0.1) == stands
    trusting = ElevationMap(ElevationConfig(size=24.0, few=0))
    trusting.integrate(depth, None, SMALL_RIG, camera)
    assert np.nanmax(trusting.top) > 0.1


@pytest.mark.parametrize("sign", [1, -1])
def test_one_stray_point_among_many_is_neither_top_nor_ground(sign):
    """At 3.5 m a cell has a dozen points; 0.5 px of disparity are 4 cm of height. Several such are believed."""
    camera = body_pose(0, 0, 0) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline)
    level = SMALL_RIG.depth_to_disparity(RockWorld().depth(SMALL_RIG, camera))
    row = int(np.argmin(np.abs(level[:, 96] - SMALL_RIG.fb / 3.5)))
    extremes = []
    for width in (1, 3):
        disparity = level.copy()
        disparity[row, 96 : 96 + width] += 0.5 * sign
        elevation = ElevationMap(SMALL)
        elevation.integrate(SMALL_RIG.disparity_to_depth(disparity).astype(np.float32), None, SMALL_RIG, camera)
        extremes.append(np.nanmax(sign * (elevation.top if sign > 0 else elevation.low)))
    assert extremes[0] < 0.005 and extremes[1] > 0.025


def test_the_weight_of_a_cell_saturates_at_four_looks():
    elevation, weights = ElevationMap(SMALL), []
    for _ in range(8):
        look(elevation, RockWorld(), body_pose(0, 0, 0))
        weights.append(elevation.weight[elevation.measured])
    for n, expected in enumerate((1, 2, 3, 4, 4, 4, 4, 4)):
        np.testing.assert_allclose(weights[n], expected * weights[0], rtol=1e-5)


def test_the_weight_of_a_look_is_the_inverse_square_of_its_range_error():
    """The error is z^2 / (f b) for each pixel of disparity: at twice the distance a look weighs a sixteenth."""
    elevation, z = ElevationMap(SMALL), np.array([3.0, 6.0])
    points = np.array([[3.05, 0.05, 0.0], [6.05, 0.05, 0.0]])
    elevation._fuse(points, z, np.ones(2), np.ones(2, bool), SMALL_RIG.fb)
    ix, iy = elevation.cell_of(points[:, :2]).T
    error = z**2 / SMALL_RIG.fb * SMALL.disparity_sigma
    np.testing.assert_allclose(elevation.weight[iy, ix], 1 / error**2, rtol=1e-5)


@pytest.mark.parametrize("distance", [2.5, 4.0, 6.0])
def test_low_rocks_keep_their_height(distance):
    camera = body_pose(0, 0, 0) @ ZHURONG.mount.left_eye(NATECAM.baseline)
    world = RockWorld(domes=np.array([[distance, 0.1, 0.25, 0.2]]))
    elevation = ElevationMap(SMALL)
    elevation.integrate(world.depth(NATECAM, camera), None, NATECAM, camera)
    assert np.nanmax(elevation.top) == pytest.approx(0.19, abs=0.011)


def test_flying_pixels_are_edges_not_ground():
    """Disparities that are averaged across a rock's outline hang in its shadow, where nothing is to be seen."""
    world = RockWorld(boxes=np.array([[4.0, 0.0, 0.3, 0.3, 0.6]]))
    camera = body_pose(0, 0, 0) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline)
    disparity = SMALL_RIG.depth_to_disparity(world.depth(SMALL_RIG, camera))
    blurred = cv2.blur(disparity.astype(np.float32), (3, 3))
    blurred[disparity == 0] = 0  # the sky stays
    depth = SMALL_RIG.disparity_to_depth(blurred).astype(np.float32)
    hanging = []
    for jump in (ElevationConfig().edge_jump, 100.0):
        elevation = ElevationMap(ElevationConfig(size=24.0, edge_jump=jump))
        elevation.integrate(depth, None, SMALL_RIG, camera)
        x, y = elevation.centres()
        shadow = (x[None, :] > 4.5) & (x[None, :] < 6.5) & (np.abs(y[:, None]) < 0.25)
        hanging.append(elevation.known[shadow].sum())
        assert elevation.known.sum() > 1000
    assert hanging[0] == 0 < hanging[1]


def test_scrolling_keeps_heights_where_they_are_in_the_world():
    elevation, world = ElevationMap(SMALL), RockWorld(slope=(0.1, -0.05))
    camera = look_pose([0, 0, 1.2], 0.0, np.deg2rad(20))
    elevation.integrate(world.depth(SMALL_RIG, camera), None, SMALL_RIG, camera)
    before = elevation.known.sum()
    assert elevation.recentre(np.array([6.0, 1.0]))
    x, y = elevation.centres()
    known = elevation.known
    assert known.sum() == before
    plane = 0.1 * x[None, :] - 0.05 * y[:, None]
    assert np.abs(elevation.top - plane)[known].max() < 0.02 and np.abs(elevation.low - plane)[known].max() < 0.02
    assert elevation.recentre(np.array([500.0, 500.0])) and not elevation.known.any()
    assert not elevation.recentre(np.array([501.0, 499.0]))


def test_measurements_replace_the_assumed_ground():
    elevation = ElevationMap(SMALL)
    raised = body_pose(0, 0, 0)
    raised[2, 3] = 0.5
    elevation.assume_flat(raised, 4.0)
    assert np.nanmin(elevation.top) == pytest.approx(0.5)
    look(elevation, RockWorld(), body_pose(0, 0, 0))
    ix, iy = elevation.cell_of(np.array([3.0, 0.0]))
    assert elevation.top[iy, ix] == pytest.approx(0, abs=0.01) and elevation.low[iy, ix] == pytest.approx(0, abs=0.01)


def test_the_assumed_ground_is_as_steep_as_the_rover_stands():
    elevation, pose = ElevationMap(SMALL), body_pose(1.0, 2.0, 0.0)
    c, s = np.cos(np.deg2rad(20)), np.sin(np.deg2rad(20))
    pose[:3, :3] = [[c, 0, -s], [0, 1, 0], [s, 0, c]]  # the nose up
    elevation.assume_flat(pose, 3.0)
    plane = np.tan(np.deg2rad(20)) * (elevation.centres()[0] - 1.0) + np.zeros((elevation.n, 1))
    assert elevation.known.sum() > 2000
    for layer in (elevation.top, elevation.low):
        np.testing.assert_allclose(layer[elevation.known], plane[elevation.known], atol=1e-5)


def test_wrong_shapes_are_refused():
    elevation = ElevationMap(SMALL)
    with pytest.raises(ValueError, match="192"):
        elevation.integrate(np.ones((10, 10)), None, SMALL_RIG, np.eye(4))
    with pytest.raises(ValueError, match="confidence"):
        elevation.integrate(np.ones((192, 192)), np.ones((5, 5)), SMALL_RIG, np.eye(4))
    with pytest.raises(ValueError, match="cell"):
        ElevationConfig(cell=0)


def test_a_map_is_completed_by_another_where_it_never_measured():
    here, other = ElevationMap(), ElevationMap()
    here.top[5, 5], here.low[5, 5], here.weight[5, 5] = 0.4, 0.3, 2.0
    here.hidden_drop[6, 5] = True
    other.top[5:7, 5], other.low[5:7, 5], other.weight[5:7, 5] = 1.0, 0.9, 3.0
    here.complete(other)
    assert (here.top[5, 5], here.weight[5, 5]) == (np.float32(0.4), 2.0)
    assert (here.top[6, 5], here.low[6, 5], here.weight[6, 5]) == (1.0, np.float32(0.9), 3.0)
    assert not here.possible_drop.any() and here.measured.sum() == 2


def test_unknown_heights_of_another_map_fill_no_cell_whatever_their_weight():
    here, other = ElevationMap(), ElevationMap()
    other.top[5:8, 5], other.low[5:8, 5], other.weight[:] = 1.0, 0.9, 1.0
    other.low[6, 5] = np.nan
    here.complete(other)
    assert here.measured.sum() == 2 and here.measured[5, 5] and here.measured[7, 5]
    assert np.isfinite(here.low[here.measured]).all()


@given(shift=st.tuples(*[st.integers(-70, 70)] * 2), size=st.sampled_from([2.0, 6.0, 14.0]))
@settings(max_examples=40, deadline=None)
def test_cells_of_another_map_are_filled_in_where_they_lie(shift, size):
    here, other = ElevationMap(ElevationConfig(size=6.0)), ElevationMap(ElevationConfig(size=size), (3.0, -2.0))
    here.origin = here.origin + 0.1 * np.array(shift)
    x, y = other.centres()
    other.top[:], other.low[:], other.weight[:] = x[None, :], y[:, None], 1.0
    here.complete(other)
    x, y = here.centres()
    inside = np.abs(y[:, None] + 2.0) < size / 2
    inside = inside & (np.abs(x[None, :] - 3.0) < size / 2)
    np.testing.assert_array_equal(here.measured, inside)
    rows, columns = np.nonzero(inside)
    np.testing.assert_allclose(here.top[inside], x[columns], atol=1e-4)
    np.testing.assert_allclose(here.low[inside], y[rows], atol=1e-4)


@pytest.mark.parametrize("height", [-2.0, 2.0])
def test_the_first_look_replaces_the_heights_of_another_map_unless_they_weigh_more(height):
    elevation, prior = ElevationMap(SMALL), ElevationMap(SMALL)
    prior.top[:], prior.low[:] = height, height
    ix, iy = elevation.cell_of(np.array([3.0, 0.0]))
    for weight, is_replaced in ((1.0, True), (1e9, False)):
        elevation.clear((0.0, 0.0))
        prior.weight[:] = weight
        elevation.complete(prior)
        assert elevation.from_prior.all()
        look(elevation, RockWorld(), body_pose(0, 0, 0))
        heights = elevation.top[iy, ix], elevation.low[iy, ix]
        assert (heights == pytest.approx((0.0, 0.0), abs=0.01)) == is_replaced
        assert (pytest.approx(height, abs=0.01) in heights) != is_replaced
        assert elevation.from_prior[iy, ix] != is_replaced and elevation.from_prior.any()
        elevation.complete(prior)
        assert elevation.from_prior[iy, ix] != is_replaced


def test_a_look_that_weighs_more_replaces_heights_of_before_also_after_lighter_ones():
    elevation, prior = ElevationMap(SMALL), ElevationMap(SMALL)
    prior.top[:], prior.low[:], prior.weight[:] = 1.0, 1.0, 20.0
    elevation.complete(prior)
    cell, level = np.array([0]), np.zeros(1, np.float32)
    heights = []
    for gain in (10.0, 500.0):
        elevation._blend(cell, level, level, np.array([gain], np.float32))
        heights.append((elevation.top[0, 0], elevation.low[0, 0]))
    assert heights[0][0] > 0.3 and heights[1] == (0.0, 0.0) and not elevation.from_prior[0, 0]


def test_a_map_of_other_cells_completes_none():
    with pytest.raises(ValueError, match=r"cells of 0.1 m, got 0.2 m"):
        ElevationMap().complete(ElevationMap(ElevationConfig(cell=0.2)))


def test_a_much_surer_height_replaces_four_fifths_of_the_highest_at_most():
    elevation = ElevationMap()
    cell, one = np.array([0]), np.array([1.0])
    elevation._blend(cell, one, 0 * one, one)
    elevation._blend(cell, 0 * one, 0 * one, 99 * one)  # it may have seen the foot of a rock alone
    assert elevation.top.ravel()[0] == pytest.approx(0.2)


def test_measured_heights_of_another_map_replace_assumed_ones():
    other, elevation = map_of_height(lambda x, y: 0.3 + 0 * x), ElevationMap(DRAWN)
    elevation.assume_flat(body_pose(0, 0, 0), 2.0)
    elevation.complete(other)
    assert np.nanmin(elevation.top) == pytest.approx(0.3)


def test_what_a_masked_array_hides_is_unknown():
    camera = body_pose(0, 0, 0) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline)
    depth = RockWorld().depth(SMALL_RIG, camera)
    hidden = np.zeros(depth.shape, bool)
    hidden[:, : depth.shape[1] // 2] = True
    maps = [ElevationMap(SMALL) for _ in range(5)]
    confidence = np.ones(depth.shape, np.float32)
    unsure = np.where(hidden, np.nan, confidence)
    maps[0].integrate(np.where(hidden, np.nan, depth), None, SMALL_RIG, camera)
    maps[1].integrate(np.ma.array(depth, mask=hidden), None, SMALL_RIG, camera)
    maps[2].integrate(depth, np.ma.array(confidence, mask=hidden), SMALL_RIG, camera)
    assert maps[0].known.any() and np.array_equal(maps[0].top, maps[1].top, equal_nan=True)
    maps[3].integrate(depth, unsure, SMALL_RIG, camera)
    assert maps[2].known.any() and np.array_equal(maps[2].top, maps[3].top, equal_nan=True)
    assert maps[4].integrate(np.ma.array(depth, mask=True), None, SMALL_RIG, camera) == 0


@pytest.mark.parametrize("pose", [np.full((4, 4), np.nan), 2 * np.eye(4), np.eye(4)[:3]])
def test_a_pose_of_the_camera_that_is_none_is_named(pose):
    with pytest.raises(ValueError, match=r"^pose must be"):
        ElevationMap(SMALL).integrate(RockWorld().depth(SMALL_RIG, np.eye(4)), None, SMALL_RIG, pose)


def test_a_look_from_afar_leaves_the_weight_of_near_ones_and_looks_saturate_at_four():
    elevation, cell = ElevationMap(ElevationConfig(size=4.0)), np.array([7])
    weights = []
    for gain in (100.0, 1.0, 100.0, 100.0, 100.0, 100.0):
        elevation._blend(cell, np.zeros(1), np.zeros(1), np.array([gain]))
        weights.append(float(elevation.weight.ravel()[7]))
    assert weights == [100, 100, 200, 300, 400, 400]


@pytest.mark.parametrize(("columns", "is_marked"), [([4], False), ([4, 4, 4], False), ([4, 8], True)])
def test_two_image_columns_have_to_show_the_drop_of_a_cell(monkeypatch, columns, is_marked):
    places = np.tile([0.55, 0.35], (len(columns), 1))
    monkeypatch.setattr("nav.ground.elevation.hidden_drops", lambda *_: (places, np.array(columns)))
    elevation = ElevationMap(ElevationConfig(size=4.0))
    elevation._mark_drops(np.zeros((1, 1)), np.zeros((1, 1), bool), NATECAM, np.eye(4))
    assert elevation.hidden_drop[23, 25] == is_marked and elevation.hidden_drop.sum() == is_marked


def test_ground_that_another_map_only_assumes_is_not_taken_from_it():
    config = ElevationConfig(size=4.0)
    other, here = ElevationMap(config), ElevationMap(config)
    other.assume_flat(np.eye(4), 1.0)
    other.top[20, 5], other.low[20, 5], other.weight[20, 5] = 0.3, 0.2, 8.0
    here.complete(other)
    assert other.known.sum() > 100 and np.argwhere(here.known).tolist() == [[20, 5]]
    assert np.array_equal(here.from_prior, here.known)


@pytest.mark.parametrize(("points", "top"), [(3, 0.08), (4, 0.0), (5, 0.0)])
def test_the_highest_of_four_points_or_more_is_not_used(points, top):
    elevation = ElevationMap(ElevationConfig(size=4.0))
    places = np.full((points, 3), [0.05, 0.05, 0.0])
    places[-1, 2] = 0.08
    elevation._fuse(places, np.full(points, 2.0), np.ones(points), np.ones(points, bool), 100.0)
    assert elevation.top[20, 20] == pytest.approx(top, abs=1e-3)
