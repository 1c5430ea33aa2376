from dataclasses import replace

import numpy as np
import pytest
from drawn_maps import flat_map_with_rocks

from nav.path.distance_field import DistanceField


def test_field_is_the_distance_on_open_ground_and_longer_behind_a_wall():
    elevation, ground = flat_map_with_rocks()
    field = DistanceField(elevation, 2, 30.0)
    field.update(elevation, ground, np.array([5.0, 0.0]))
    points = np.array([[0.0, 0.0], [5.0, 4.0], [-5.0, -3.0]])
    straight = np.hypot(points[:, 0] - 5, points[:, 1])
    # Eight directions are at most 8.3 % longer than the straight line.
    assert (field.at(points) >= straight - 0.3).all() and (field.at(points) <= 1.09 * straight + 0.3).all()
    wall, blocked = flat_map_with_rocks([(2.5, y, 0.3) for y in np.arange(-4, 4.1, 0.5)])
    field.update(wall, blocked, np.array([5.0, 0.0]))
    assert field.at(points)[0] > straight[0] + 4
    path = field.path(points[0], 40.0)
    assert np.hypot(*(path[-1] - [5, 0])) < 0.3
    assert not field.is_inflated(path).any()


@pytest.mark.parametrize("shift", [0.0, 0.1])
@pytest.mark.parametrize("width, passes", [(1.7, True), (1.5, False)])
def test_a_gap_is_as_wide_as_on_the_map_wherever_its_cells_lie(width, passes, shift):
    sides = [(2.5, shift + side * (width / 2 + 0.25 + 0.5 * n), 0.25) for side in (1, -1) for n in range(14)]
    elevation, ground = flat_map_with_rocks(sides)
    field = DistanceField(elevation, 2, 30.0)
    field.update(elevation, ground, np.array([5.0, 0.0]))
    across = np.stack([np.arange(1.5, 3.5, 0.1), np.full(20, shift)], axis=1)
    assert field.is_inflated(across).any() != passes
    assert (field.at(np.zeros(2)) < 20) == passes


def test_goals_outside_the_map_pull_to_the_border():
    elevation, ground = flat_map_with_rocks()
    field = DistanceField(elevation, 2, 30.0)
    field.update(elevation, ground, np.array([50.0, 0.0]))
    assert field.at(np.array([0.0, 0.0])) == pytest.approx(50.0, abs=0.5)
    assert field.at(np.array([3.0, 0.0])) < field.at(np.array([-3.0, 0.0])) - 5.5
    assert np.isinf(field.at(np.array([30.0, 0.0])))


def test_a_cell_of_the_field_costs_what_its_dearest_ground_does():
    """The goal lies in the cell beside; the way out of the dear cell is half in each."""
    elevation, ground = flat_map_with_rocks()
    cost = np.zeros_like(ground.cost)
    cost[81, 80] = 8.0
    field = DistanceField(elevation, 2, 30.0)
    field.update(elevation, replace(ground, cost=cost), np.array([0.3, 0.1]))
    assert field.values[40, 41] == 0 and field.values[40, 40] == pytest.approx(0.2 * (1 + (1 + 8)) / 2)
