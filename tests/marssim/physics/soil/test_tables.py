"""Slip over slope against what rovers of this size showed; docs/results/slip.md says where the figures are from."""

import numpy as np
import pytest

from marssim.base.rover_spec import ZHURONG
from marssim.physics.soil.soils import BEDROCK, SOIL_NAMES, SOILS
from marssim.physics.soil.tables import SLIPS, wheel_table
from marssim.physics.soil.wheel import sinkage_under_load, wheel_forces
from marssim.physics.world import GRAVITY

WEIGHT = ZHURONG.mass * GRAVITY / 6
SIZE = ZHURONG.wheel_radius, ZHURONG.wheel_width, ZHURONG.mass * GRAVITY
TABLES = {name: wheel_table(name, *SIZE) for name in SOIL_NAMES}


def slip_deg(soil, *slopes):
    return TABLES[soil].slip_on_slope(WEIGHT, np.deg2rad(slopes))


def test_sand_slips_in_the_order_that_rovers_showed():
    level, five, ten, fifteen, twenty, steeper = slip_deg("sand", 0, 5, 10, 15, 20, 23)
    assert 0.01 < level < 0.08 and 0.03 < five < 0.15 and 0.1 < ten < 0.3
    assert 0.25 < fifteen < 0.65 and twenty > 0.55 and steeper == 1.0


def test_crust_slips_less_than_sand_and_bedrock_a_few_percent():
    slopes = np.arange(0, 21, 2.5)
    sand, crust, bedrock = (slip_deg(soil, *slopes) for soil in SOIL_NAMES)
    assert (sand > crust).all() and (crust > bedrock).all()
    assert slip_deg("crust", 15)[0] < 0.25 and slip_deg("bedrock", 20)[0] < 0.05


def test_on_level_bedrock_nothing_slips_or_sinks():
    assert slip_deg("bedrock", 0)[0] == 0.0
    assert not TABLES["bedrock"].sinkage.any() and not TABLES["bedrock"].torque[:, 0].any()


def test_the_steepest_bedrock_is_that_of_its_friction():
    steepest = np.rad2deg(np.arctan(BEDROCK.friction))
    assert slip_deg("bedrock", steepest - 1)[0] < 1.0 == slip_deg("bedrock", steepest + 0.1)[0]


@pytest.mark.parametrize("soil", SOIL_NAMES)
def test_the_pull_rises_with_the_slip(soil):
    """In sand it falls again by less than 0.3 % of the load where the wheel digs itself in."""
    table = TABLES[soil]
    assert (table.pull[:, 0] <= 0).all()
    assert (np.diff(table.pull, axis=1) > -0.003 * table.loads[:, None]).all()
    slope = (table.pull[:, 1:] - table.pull[:, :1]) / table.slips[1:]
    assert (np.diff(slope, axis=1) < 1e-6).all()  # which the search of the rover's motion relies on


@pytest.mark.parametrize("soil", ["sand", "crust"])
def test_a_wheel_on_a_slope_is_in_balance(soil):
    """The soil's own integral, at the slip that the table gives: pull against the weight's part along the slope."""
    slope = np.deg2rad([2.0, 8.0, 14.0])
    slip, load = TABLES[soil].slip_on_slope(WEIGHT, slope), WEIGHT * np.cos(slope)
    sinkage = sinkage_under_load(SOILS[soil], *SIZE[:2], load, slip)
    forces = wheel_forces(SOILS[soil], *SIZE[:2], sinkage, slip)
    np.testing.assert_allclose(forces.support, load, rtol=1e-6)
    np.testing.assert_allclose(forces.pull, WEIGHT * np.sin(slope), atol=0.005 * WEIGHT)


def test_tables_are_computed_once_and_alike():
    assert wheel_table("sand", *SIZE) is TABLES["sand"]
    again = wheel_table.__wrapped__("sand", *SIZE)
    np.testing.assert_array_equal(again.pull, TABLES["sand"].pull)


def test_between_loads_the_table_is_interpolated_and_beyond_them_clipped():
    table = TABLES["sand"]
    pull, torque, sinkage = table.at(table.loads[[0, 3, -1]])
    np.testing.assert_allclose(pull, table.pull[[0, 3, -1]])
    assert torque.shape == sinkage.shape == (3, len(SLIPS))
    np.testing.assert_allclose(table.at(np.array([1e4]))[0], table.pull[[-1]])
    np.testing.assert_allclose(table.at(np.array([1e4]))[2], table.sinkage[[-1]])


@pytest.mark.parametrize("soil", SOIL_NAMES)
def test_a_wheel_in_the_air_pulls_nothing_and_does_not_sink(soil):
    table = TABLES[soil]
    lifted, light = table.at(np.array([0.0, table.loads[0] / 2])).swapaxes(0, 1)
    assert not lifted.any()
    np.testing.assert_allclose(light, [table.pull[0] / 2, table.torque[0] / 2, table.sinkage[0] / 2])


def test_the_tables_hold_every_load_of_a_heavier_rover():
    heavy = wheel_table("sand", *SIZE[:2], 4 * SIZE[2])
    assert heavy.loads[-1] == pytest.approx(2 * SIZE[2])
    assert heavy.at(np.array([SIZE[2] / 6]))[0, 0, -1] == pytest.approx(
        TABLES["sand"].at(np.array([SIZE[2] / 6]))[0, 0, -1], rel=0.02
    )


@pytest.mark.parametrize(("soil", "least", "most"), [("sand", 1.2, 1.35), ("crust", 1.05, 1.2), ("bedrock", 1, 1)])
def test_soil_holds_a_wheel_more_across_than_along(soil, least, most):
    assert least <= TABLES[soil].side_at(np.array([WEIGHT]))[0] <= most


@pytest.mark.parametrize("soil", ["sand", "crust"])
@pytest.mark.parametrize("slide", [0.05, 0.1, 0.2])
def test_the_force_across_is_the_integral_of_the_stresses(soil, slide):
    """A wheel that slides sideways by 5 to 20 % of its way, within 8 %."""
    sinkage = sinkage_under_load(SOILS[soil], *SIZE[:2], WEIGHT, 0.0, slide)
    integral = float(wheel_forces(SOILS[soil], *SIZE[:2], sinkage, 0.0, slide).side)
    pull = TABLES[soil].at(np.array([WEIGHT]))[0][0]
    table = TABLES[soil].side_at(np.array([WEIGHT]))[0] * np.interp(slide, SLIPS, pull - pull[0])
    assert table == pytest.approx(integral, rel=0.08)


def test_on_bedrock_nothing_resists_so_the_torque_is_that_of_the_pull():
    table = TABLES["bedrock"]
    np.testing.assert_allclose(table.torque, ZHURONG.wheel_radius * table.pull)
    assert table.pull[:, -1] == pytest.approx(BEDROCK.friction * table.loads, rel=1e-6)
