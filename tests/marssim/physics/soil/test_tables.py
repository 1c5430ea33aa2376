"""Slip over slope against what rovers of this size showed; docs/results/slip.md says where the figures are from."""

import numpy as np
import pytest

from marssim.base.rover_spec import ZHURONG
from marssim.physics.soil.soils import BEDROCK, SOIL_NAMES, SOILS
from marssim.physics.soil.tables import LOADS, SLIPS, wheel_table
from marssim.physics.soil.wheel import sinkage_under_load, wheel_forces
from marssim.physics.world import GRAVITY

WEIGHT = ZHURONG.mass * GRAVITY / 6
TABLES = {name: wheel_table(name, ZHURONG.wheel_radius, ZHURONG.wheel_width) for name in SOIL_NAMES}


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
    size = ZHURONG.wheel_radius, ZHURONG.wheel_width
    sinkage = sinkage_under_load(SOILS[soil], *size, load, slip)
    forces = wheel_forces(SOILS[soil], *size, sinkage, slip)
    np.testing.assert_allclose(forces.support, load, rtol=1e-6)
    np.testing.assert_allclose(forces.pull, WEIGHT * np.sin(slope), atol=0.005 * WEIGHT)


def test_tables_are_computed_once_and_alike():
    size = ZHURONG.wheel_radius, ZHURONG.wheel_width
    assert wheel_table("sand", *size) is TABLES["sand"]
    again = wheel_table.__wrapped__("sand", *size)
    np.testing.assert_array_equal(again.pull, TABLES["sand"].pull)


def test_between_loads_the_table_is_interpolated_and_beyond_them_clipped():
    table = TABLES["sand"]
    pull, torque, sinkage = table.at(LOADS[[0, 3, -1]])
    np.testing.assert_allclose(pull, table.pull[[0, 3, -1]])
    assert torque.shape == sinkage.shape == (3, len(SLIPS))
    np.testing.assert_allclose(table.at(np.array([1.0, 1e4]))[2], table.sinkage[[0, -1]])
