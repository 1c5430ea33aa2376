import numpy as np
import pytest
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from m3depth.figures.drawing import normal_image
from m3depth.figures.panels import predicted_normal_image, show_disparity_error


def test_normals_are_grey_where_there_is_no_depth() -> None:
    normal = np.full((1, 3, 3), (0.0, 0.0, -1.0), np.float32)
    colours = predicted_normal_image(normal, np.array([[2.0, np.inf, np.nan]]))
    np.testing.assert_array_equal(colours[0, 0], normal_image(normal)[0, 0])
    assert colours[0, 1:].tolist() == [[209, 209, 209]] * 2


@pytest.mark.parametrize(("scored", "words"), [([True, True, False], "3.50 px"), ([False] * 3, "nothing known")])
def test_unknown_disparity_counts_as_0_px_and_what_is_not_scored_is_left_out(scored, words) -> None:
    ax = Figure().subplots()
    truth = np.array([[5.0, 6.0, 7.0]])
    shown = show_disparity_error(ax, np.array([[4.0, np.nan, 0.0]]), truth, np.array([scored]), Normalize(0, 2))
    assert [text.get_text() for text in ax.texts] == [words]
    errors = np.ma.filled(shown.get_array().astype(float), np.nan)
    np.testing.assert_array_equal(errors, [np.where(scored, [1, 6, 7], np.nan)])
