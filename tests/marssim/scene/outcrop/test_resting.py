import numpy as np
import pytest

from marssim.scene.outcrop.resting import camera_distance, ground_under, rest, shown_part

SQUARE = np.array([[[2.0, 4.0], [4.0, 4.0], [4.0, 6.0], [2.0, 6.0]]])
MIDDLE = np.array([[3.0, 5.0]])


def slope(x, y):
    return 0.1 * x - 0.2 * y + 4


def test_the_highest_edge_stands_at_its_height_over_sloping_ground():
    lie = rest(SQUARE, MIDDLE, np.array([2.0]), np.array([[0.05, 0.0]]), np.array([0.18]), slope)
    top = lie.plane[0, 0] + SQUARE[0] @ lie.plane[0, 1:]
    assert (top - slope(*SQUARE[0].T)).max() == pytest.approx(0.18) and lie.rise == pytest.approx(0.05)
    assert lie.area == pytest.approx(4) and lie.middle == pytest.approx(MIDDLE)


def test_only_the_part_above_the_ground_shows():
    lie = rest(SQUARE, MIDDLE, np.array([2.0]), np.array([[0.05, 0.0]]), np.array([0.05]), slope)
    assert lie.area == pytest.approx(2) and lie.middle == pytest.approx(np.array([[3.5, 5.0]]))
    assert shown_part(SQUARE, np.array([[-0.1, 0.0, 0.0]]))[0] == 0


def test_the_ground_under_a_plate_is_a_plane():
    assert ground_under(MIDDLE, np.array([0.5]), slope) == pytest.approx(np.array([[4, 0.1, -0.2]]))


def test_cameras_stand_in_the_middle():
    near, far = camera_distance(np.array([[0.0, 1.0], [10.0, -30.0]]), 16.0)
    assert near < 3 and far == pytest.approx(near + 30 - 0.4 * 16)
