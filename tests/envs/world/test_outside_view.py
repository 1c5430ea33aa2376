from dataclasses import replace

import numpy as np
import pytest

from envs.world.outside_view import HEIGHT, WIDTH, OutsideView
from envs.world.vehicle import make_vehicle
from marssim.base.rover_spec import ZHURONG


@pytest.fixture(scope="module")
def view_and_rover(make_scene):
    """A view, the rover's state, and its parts."""
    scene = make_scene(rocks=[(4.0, 1.0, 0.8, 0.5)])
    vehicle = make_vehicle("kinematic", scene, ZHURONG, 0.0, 0.0, 0.4)
    view = OutsideView(scene)
    yield view, vehicle.state(), vehicle.mesh()
    view.close()
    view.close()


@pytest.fixture(scope="module")
def pictures(view_and_rover):
    """With the rover, without it, and with it a metre aside."""
    view, state, parts = view_and_rover
    return [view.picture(state, moved(parts, offset), 0) for offset in ((0, 0, 0), (0, 0, -50), (-0.4, 0.9, 0))]


def moved(parts, offset):
    shift = np.eye(4)
    shift[:3, 3] = offset
    return [replace(part, pose=shift @ part.pose) for part in parts]


def changed(a, b):
    return np.abs(a.astype(int) - b).max(axis=2) > 25


def test_the_rover_is_in_the_middle_of_the_picture(pictures):
    with_rover, without, _ = pictures
    assert with_rover.shape == without.shape == (HEIGHT, WIDTH, 3) and with_rover.dtype == np.uint8
    rows, columns = np.nonzero(changed(with_rover, without))
    assert 0.03 < len(rows) / (HEIGHT * WIDTH) < 0.5
    assert 0.3 < np.median(columns) / WIDTH < 0.7 and 0.2 < np.median(rows) / HEIGHT < 0.8
    # all of it: nothing changes along the border but what auto-exposure does
    border = np.ones((HEIGHT, WIDTH), bool)
    border[5:-5, 5:-5] = False
    assert changed(with_rover, without)[border].mean() < 0.05


def test_the_rover_is_drawn_where_it_stands(pictures):
    here, without, aside = pictures
    column = [np.median(np.nonzero(changed(picture, without))[1]) for picture in (here, aside)]
    assert column[1] < column[0] - 40  # to the left of where it was


def test_the_same_state_is_the_same_picture(view_and_rover, pictures):
    view, state, parts = view_and_rover
    np.testing.assert_array_equal(view.picture(state, parts, 1), pictures[0])


def test_the_sky_is_above_and_the_ground_is_red(pictures):
    _, without, _ = pictures
    ground = without[-60:].reshape(-1, 3).mean(axis=0)
    assert ground[0] > 1.2 * ground[2]
    assert 40 < without[HEIGHT // 3 :].mean() < 215


def test_the_camera_follows_turns_slowly_and_stands_behind(make_scene, view_and_rover):
    _, state, _ = view_and_rover
    view = OutsideView(make_scene())
    level = replace(state, yaw=0.0, position=np.zeros(3))
    first = view._chase(level, 0)
    assert first[0, 3] < -3 and first[2, 3] > 2 and first[0, 2] > 0.8  # behind, above, looking forward
    turned = view._chase(replace(level, yaw=np.pi / 2), 1)
    direction = np.arctan2(turned[1, 2], turned[0, 2]) - np.arctan2(first[1, 2], first[0, 2])
    assert direction == pytest.approx(0.3 * np.pi / 2, abs=1e-6)
    np.testing.assert_array_equal(view._chase(replace(level, yaw=np.pi / 2), 1), turned)  # a second look at this step
    for step in range(2, 22):
        turned = view._chase(replace(level, yaw=np.pi / 2), step)
    assert turned[1, 3] < -3
    view.close()


def test_the_camera_stays_above_what_it_stands_on(make_scene, view_and_rover):
    _, state, _ = view_and_rover
    level = replace(state, yaw=0.0, position=np.zeros(3))
    heights = []
    for scene in (make_scene(lambda x, y: np.where(x < -2, 3.0, 0.0)), make_scene(rocks=[(-4.2, -1.6, 2.4, 1.8)])):
        view = OutsideView(scene)
        heights.append(view._chase(level, 0)[2, 3])
        view.close()
    assert heights[0] >= 3.9 and heights[1] >= 2.8
