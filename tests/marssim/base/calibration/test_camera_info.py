import numpy as np
import pytest

from marssim.base.calibration.camera_info import ImagePart


def test_a_region_and_binning_that_differ_by_axis_move_points_as_their_pixels():
    """A point at a column of the full resolution lies in the mean of the columns that are binned into one."""
    full = np.array([[600.0, 0, 319.5], [0, 620, 239.5], [0, 0, 1]])
    matrix, size = ImagePart(40, 8, 560, 440, 2, 4).cropped(full, (640, 480))
    assert size == (280, 110)
    point = np.array([0.11, -0.07, 1.0])
    u, v = (full @ point)[:2]
    assert (matrix @ point)[:2] == pytest.approx([(u - 40 + 0.5) / 2 - 0.5, (v - 8 + 0.5) / 4 - 0.5])
    assert ImagePart().cropped(full, (640, 480))[1] == (640, 480) and ImagePart().cropped(full, None)[1] is None
