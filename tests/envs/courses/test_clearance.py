"""The rover's outline against rocks that are nearly circles: the closed form of a rectangle's distance to a disc."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.courses.clearance import FAR, ObstacleClearance
from marssim.base.rover_spec import ZHURONG

LENGTH, WIDTH = ZHURONG.length, ZHURONG.width
ROUND = 0.02  # [m] that an icosphere's outline lies inside its sphere's at most


def of_rocks(scene):
    """The clearance on a scene without steep ground."""
    return ObstacleClearance(scene, ZHURONG, np.zeros((5, 5), bool))


def beside_disc(place, x, y, radius):
    """Distance of the footprint at place (x, y, yaw) to a disc."""
    away = np.array([x, y]) - place[:2]
    c, s = np.cos(place[2]), np.sin(place[2])
    beyond = np.maximum(np.abs([c * away[0] + s * away[1], c * away[1] - s * away[0]]) - (LENGTH / 2, WIDTH / 2), 0)
    return max(0.0, float(np.hypot(*beyond)) - radius)


def places(reach=4.0):
    return st.tuples(*[st.floats(-reach, reach)] * 2, st.floats(-np.pi, np.pi)).map(np.array)


@pytest.fixture(scope="module")
def two_rocks(make_scene):
    return of_rocks(make_scene(rocks=[(0.0, 0.0, 1.2, 0.6), (3.0, 1.0, 0.8, 0.4), (-2.0, 2.0, 0.8, 0.29)]))


@given(places())
def test_the_clearance_of_a_standing_rover_is_that_of_a_rectangle_to_discs(two_rocks, place):
    true = min(FAR, beside_disc(place, 0, 0, 0.6), beside_disc(place, 3, 1, 0.4))
    assert true - 1e-6 <= two_rocks.between(place, place) <= true + ROUND


@given(places(), st.floats(-0.4, 0.4), st.floats(-0.5, 0.5))
@settings(max_examples=50)
def test_the_clearance_of_a_drive_is_the_least_on_its_way(two_rocks, before, ahead, turn):
    after = before + np.array([ahead * np.cos(before[2]), ahead * np.sin(before[2]), turn])
    between = [two_rocks.between(p, p) for p in before + np.linspace(0, 1, 41)[:, None] * (after - before)]
    least = two_rocks.between(before, after)
    assert min(between) - 0.03 <= least <= min(between[0], between[-1]) + 1e-9
    wrapped = after + np.array([0, 0, 2 * np.pi])  # a heading counts modulo a turn
    assert two_rocks.between(before, wrapped) == pytest.approx(least, abs=1e-9)


def test_a_corner_that_swings_past_a_rock_is_seen(two_rocks):
    """Turning on the spot: at both ends the outline is away from the rock, half-way the corner points at it."""
    corner = np.hypot(LENGTH, WIDTH) / 2
    at = np.arctan2(WIDTH, LENGTH)
    x = -(corner + 0.6 + 0.05)
    before, after = np.array([x, 0.0, -at - 0.5]), np.array([x, 0.0, -at + 0.5])
    assert two_rocks.between(before, after) == pytest.approx(0.05, abs=ROUND)
    assert min(two_rocks.between(before, before), two_rocks.between(after, after)) > 0.1


def test_of_a_buried_rock_only_the_part_above_ground_counts(make_scene):
    """Ground at 0.3 m cuts an ellipsoid of 0.6 m height at half its height: its outline shrinks by the root of 3/4."""
    scene = make_scene(lambda x, y: 0.3 + 0 * x, rocks=[(0.0, 0.0, 2.0, 0.6)])
    place = np.array([3.0, 0.0, 0.0])
    true = 3.0 - LENGTH / 2 - np.sqrt(0.75)
    assert of_rocks(scene).between(place, place) == pytest.approx(true, abs=0.04)


def test_without_rocks_the_clearance_is_the_largest(make_scene):
    place = np.zeros(3)
    for rocks in ([], [(1.5, 0.0, 1.0, 0.29)], [(8.0, 0.0, 1.0, 0.9)]):
        assert of_rocks(make_scene(rocks=rocks)).between(place, place) == FAR


def test_a_rock_beyond_the_edge_counts_where_it_reaches_in(make_scene):
    clearance = of_rocks(make_scene(half=6.0, rocks=[(6.3, 0.0, 2.4, 0.5)]))
    place = np.array([3.5, 0.0, 0.0])
    assert clearance.between(place, place) == pytest.approx(5.1 - 3.5 - LENGTH / 2, abs=0.05)
