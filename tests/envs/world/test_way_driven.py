import numpy as np
import pytest

from envs.courses.clearance import ObstacleClearance
from envs.world.way_driven import WayDriven
from marssim.base.rover_spec import ZHURONG


def test_the_least_clearance_is_that_of_the_whole_way_and_not_of_the_last_step(make_scene, make_course):
    """The way passes a rock of radius 0.5 m at 0.2 m, and goes on for 4 m."""
    course = make_course(make_scene(rocks=[(0.0, 0.5 + 0.2 + ZHURONG.width / 2, 1.0, 0.5)]), goal=(6.0, 0.0))
    obstacles = ObstacleClearance(course.scene, ZHURONG, course.ground.steep)
    way = WayDriven(course, obstacles, np.array([-2.0, 0.0, 0.0]))
    for x in (-1.0, 0.0, 1.0, 3.0, 4.0):
        way.advance(np.array([x, 0.0, 0.0]))
    beyond = np.hypot(3.0 - ZHURONG.length / 2, 0.7) - 0.5
    assert way.to_go == pytest.approx(2.0, abs=0.1)
    assert way.min_clearance == pytest.approx(0.2, abs=0.02) and way.clearance == pytest.approx(beyond, abs=0.02)
