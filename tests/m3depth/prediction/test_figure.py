import cv2
import numpy as np
import pytest

from m3depth.prediction.figure import prediction_figure
from m3depth.stereo.prediction import Prediction


@pytest.mark.parametrize("size", [(2000, 1), (1, 2000)])
def test_the_figure_of_an_image_with_few_columns_or_rows_is_of_usual_size(tmp_path, size):
    depth = np.full(size, 3.0, np.float32)
    prediction = Prediction(depth, depth, np.dstack([depth] * 3), np.ones(size, np.float32))
    prediction_figure(np.zeros(size, np.uint8), prediction, tmp_path / "figure.png")
    assert max(cv2.imread(str(tmp_path / "figure.png")).shape) < 6000
