import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt

from marssim.base.images.distance_transform import euclidean_distance


@pytest.fixture(params=[1, 2])
def threads(request):
    before = cv2.getNumThreads()
    cv2.setNumThreads(request.param)
    yield request.param
    cv2.setNumThreads(before)


@pytest.mark.parametrize("share", [0.0005, 0.01, 0.3])
def test_distances_have_the_same_bits_with_any_number_of_threads(threads, share):
    free = np.random.default_rng(7).random((240, 260)) > share
    free[20, 30] = False
    np.testing.assert_array_equal(euclidean_distance(free), distance_transform_edt(free).astype(np.float32))


@given(st.integers(1, 40), st.integers(1, 40), st.data())
def test_one_cell_that_is_not_free(height, width, data):
    row, column = data.draw(st.integers(0, height - 1)), data.draw(st.integers(0, width - 1))
    free = np.ones((height, width), np.uint8)
    free[row, column] = 0
    y, x = np.indices(free.shape)
    np.testing.assert_array_equal(euclidean_distance(free), np.hypot(y - row, x - column).astype(np.float32))


def test_distances_beyond_500_cells_are_within_a_millionth(threads):
    free = np.ones((3, 1500), bool)
    free[1, 0] = False
    distance, expected = euclidean_distance(free), distance_transform_edt(free).astype(np.float32)
    np.testing.assert_array_equal(distance[:, :500], expected[:, :500])
    np.testing.assert_allclose(distance, expected, rtol=1e-6)


def test_a_grid_of_free_cells_alone_is_refused():
    with pytest.raises(ValueError, match="every cell is free"):
        euclidean_distance(np.ones((4, 4), bool))
