import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from marssim.scene.ditches import ROUND, SPACING, Ditch, Ditches, draw_ditch_across, draw_ditches
from marssim.scene.relief import ReliefConfig
from marssim.scene.terrain import build_terrain

LEVEL = {"rms_slope_deg": 0.0, "crater_density": 0.0, "ripple_amplitude": 0.0}


def straight(width=2.0, depth=0.8, wall_deg=50.0, length=8.0):
    """A ditch along x about the origin."""
    x = np.arange(-length / 2, length / 2, SPACING)
    return Ditch(np.column_stack([x, 0 * x]), np.full(len(x), width / 2), depth, np.tan(np.deg2rad(wall_deg)))


def dig(*ditches, cell=0.08):
    x = np.arange(-8, 8 + cell / 2, cell)
    heights = np.zeros((len(x), len(x)))
    Ditches(ditches).add_to(heights, x, x)
    return x, heights


@settings(max_examples=20)
@given(st.floats(1.5, 3.0), st.floats(0.3, 0.8), st.floats(40, 65))
def test_a_ditch_has_its_depth_its_width_and_the_slope_of_its_walls(width, depth, wall_deg):
    x, heights = dig(straight(width, depth, wall_deg), cell=0.02)
    across = heights[:, len(x) // 2]
    assert across.min() == pytest.approx(-depth, abs=2e-3)
    # the rounding of the brink begins half of it outside
    assert np.ptp(x[across < -1e-6]) == pytest.approx(width + ROUND, abs=0.06)
    steepest = np.abs(np.diff(across)).max() / 0.02
    assert steepest <= np.tan(np.deg2rad(wall_deg)) * 1.01
    if depth > ROUND * np.tan(np.deg2rad(wall_deg)):
        assert steepest == pytest.approx(np.tan(np.deg2rad(wall_deg)), rel=0.03)


def test_a_wall_spans_several_cells_of_the_scenes_grid():
    x, heights = dig(straight(depth=0.5, wall_deg=60.0))
    across = heights[:, len(x) // 2]
    on_the_wall = (across < -0.005) & (across > -0.495) & (x > 0)
    assert on_the_wall.sum() >= 4
    assert np.abs(np.diff(across, 2)).max() < 0.12  # no spike, no step within one cell


def test_crossing_ditches_are_as_deep_as_the_deeper_one():
    along = straight(depth=0.8)
    across = Ditch(along.line[:, ::-1].copy(), along.half, 0.5, along.wall)
    x, heights = dig(along, across)
    assert heights.min() == pytest.approx(-0.8, abs=5e-3)
    assert heights[np.abs(x - 3).argmin(), len(x) // 2] == pytest.approx(-0.5, abs=5e-3)


def test_ditches_that_a_grid_cannot_show_are_left_out():
    assert not dig(straight(width=2.0), cell=1.0)[1].any()
    assert dig(straight(width=4.0), cell=1.0)[1].any()


def test_drawn_ditches_have_their_number_and_sizes():
    config = ReliefConfig(
        ditch_density=0.01, ditch_width=(0.6, 1.2), ditch_depth=(0.5, 2.0), ditch_wall_deg=(45.0, 45.0),
        ditch_length=(5.0, 9.0), ditch_meander_deg=(0.0, 0.0),
    )  # fmt: skip
    drawn = [draw_ditches(config, 30.0, (), np.random.default_rng(seed)).ditches for seed in range(5)]
    assert sum(map(len, drawn)) / 5 == pytest.approx(36, rel=0.25)
    for ditch in (ditch for some in drawn for ditch in some):
        length = np.hypot(*np.ptp(ditch.line, axis=0)) + 2 * ditch.half.mean()
        assert 4.7 < length < 9.3
        assert 2 * ditch.half.min() > 0.5 and 2 * ditch.half.max() < 1.4
        assert ditch.depth <= 0.48 + 1e-9  # two walls of 45 deg and a floor in 1.2 m


@given(st.floats(0, 80), st.integers(0, 20))
@settings(max_examples=10)
def test_a_meandering_ditch_turns_no_farther_than_its_angle(meander, seed):
    config = ReliefConfig(ditch_density=0.02, ditch_meander_deg=(meander, meander), ditch_length=(30.0, 40.0))
    for ditch in draw_ditches(config, 10.0, (), np.random.default_rng(seed)).ditches:
        step = np.diff(ditch.line, axis=0)
        heading = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
        assert np.ptp(heading) <= 2 * np.deg2rad(meander) + 1e-6


def test_clear_discs_stay_free_of_ditches_and_fresh_craters():
    config = ReliefConfig(**LEVEL, ditch_density=0.02, fresh_crater_density=0.02)
    clear = ((-2.0, 0.0, 1.5), (2.0, 1.0, 1.5))

    def ground(discs):
        return build_terrain(config, 16.0, 0.1, 20.0, np.random.default_rng(2), discs)

    kept, bare = ground(clear), ground(())
    angle = np.linspace(0, 2 * np.pi, 50)
    roughness = []
    for terrain in (kept, bare):
        heights = [
            terrain.height_at(x + r * np.cos(angle), y + r * np.sin(angle)) for x, y, _ in clear for r in (0.5, 1.4)
        ]
        roughness.append(max(np.ptp(h) for h in heights))
    assert roughness[0] < 0.3 < roughness[1]


def test_steep_landforms_leave_the_other_draws_of_a_seed():
    plain, steep = (
        build_terrain(ReliefConfig(**changes), 12.0, 0.1, 20.0, np.random.default_rng(4))
        for changes in ({}, {"ditch_density": 0.01, "fresh_crater_density": 0.005})
    )
    change = (steep.fine.heights + steep.datum) - (plain.fine.heights + plain.datum)
    assert np.abs(change).max() > 0.3
    assert (np.abs(change) < 1e-6).mean() > 0.3


def test_wide_ditches_across_the_seam_leave_no_gap():
    config = ReliefConfig(ditch_density=0.02, ditch_width=(3.0, 5.0), ditch_length=(15.0, 30.0))
    terrain = build_terrain(config, 12.0, 0.1, 20.0, np.random.default_rng(1))
    x0, _, x1, _ = terrain.fine.bounds
    edge = np.linspace(x0, x1, len(terrain.fine.heights))
    depths = []
    for fixed in (x0, x1):
        for x, y in ((edge, np.full_like(edge, fixed)), (np.full_like(edge, fixed), edge)):
            height = terrain.fine.gradient_at(x, y)[0]
            assert np.abs(height - terrain.coarse.smooth_heights(x, y)).max() < 1e-9
            depths.append(np.ptp(height))
    assert max(depths) > 0.5  # a ditch does cross the seam


def test_a_ditch_across_a_way_cuts_it_in_its_middle_and_leaves_room_to_drive_round():
    start, end = np.array([-4.0, 7.0]), np.array([10.0, -7.0])
    along = (end - start) / np.hypot(*(end - start))
    for seed in range(30):
        ditch = draw_ditch_across(ReliefConfig(), (*start, *end), np.random.default_rng(seed))
        ahead, aside = (ditch.line - start) @ along, (ditch.line - start) @ np.array([-along[1], along[0]])
        crossing = ahead[np.abs(aside).argmin()] / np.hypot(*(end - start))
        assert 0.34 < crossing < 0.66 and np.abs(aside).min() < SPACING
        assert aside.max() > 2 and aside.min() < -2 and np.ptp(aside) < 14  # on both sides, and it ends
        assert not ditch.reaches(*start, 1.2) and not ditch.reaches(*end, 1.2)
        assert ditch.depth > 0.45


def test_a_ditch_across_a_way_changes_nothing_else():
    config = ReliefConfig(ditch_density=0.002)
    plain, cut = (
        build_terrain(config, 10.0, 0.25, 12.0, np.random.default_rng(3), (), way)
        for way in (None, (-4.0, -4.0, 4.0, -4.0))
    )
    lower = plain.fine.heights - cut.fine.heights
    assert lower.max() > 0.4
    assert (np.abs(lower - np.median(lower)) < 1e-9).mean() > 0.5  # the origin keeps height 0
