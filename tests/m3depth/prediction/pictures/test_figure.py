from dataclasses import replace

import cv2
import numpy as np
import pytest

from m3depth.prediction.pictures.figure import LINE, depth_range_shown, prediction_figure, prediction_picture
from m3depth.stereo.prediction import Prediction
from marssim.base.images.colours import BEYOND

SKY = [BEYOND] * 3


def wall(height: int = 180, width: int = 240) -> Prediction:
    """A wall at 4 m below sky; unknown in the middle."""
    depth = np.full((height, width), 4, np.float32)
    depth[:40] = np.inf
    depth[90:110, 100:120] = np.nan
    normal = np.broadcast_to(np.float32([0, 0, -1]), (height, width, 3)).copy()
    normal[~np.isfinite(depth)] = 0
    confidence = np.where(np.isnan(depth), 0, 0.8).astype(np.float32)
    return Prediction(depth, 20 / depth, normal, confidence)


def test_unknown_is_black_in_every_map_and_sky_is_grey():
    picture = prediction_picture(np.full((180, 240), 77, np.uint8), wall(), (1.0, 15.0))
    image, depth = picture[LINE : LINE + 180, :240], picture[LINE : LINE + 180, -240:]
    normals, sure = picture[2 * LINE + 180 :][:180, :240], picture[2 * LINE + 180 :][:180, -240:]
    assert (image == 77).all()
    assert (depth[100, 110] == 0).all() and (depth[5, 5] == SKY).all() and depth[150, 5].max() > 100
    assert (normals[100, 110] == 0).all() and (normals[150, 5] == [127, 127, 255]).all()
    assert (sure[100, 110] == 0).all() and sure[150, 5].max() > 100


@pytest.mark.parametrize(("nearest", "farthest"), [(600.0, 1500.0), (310.0, 1000.0), (5000.0, 90000.0)])
def test_far_scenes_have_a_scale_of_their_own(nearest, farthest):
    depth = np.linspace(nearest, farthest, 1000, dtype=np.float32).reshape(20, 50)
    (near, far), (low, high) = depth_range_shown(depth), np.percentile(depth, [2, 98])
    assert 0.8 * low < near <= low < high <= far < 1.2 * high


def test_the_scale_spans_what_the_map_shows():
    assert depth_range_shown(np.array([[1.2, 9.0], [np.inf, np.nan]])) == (1, 10)
    assert depth_range_shown(np.linspace(12, 80, 1000)) == (10, 100)
    assert depth_range_shown(np.linspace(20, 900, 1000))[1] == 300
    assert depth_range_shown(np.full((3, 3), np.nan)) == (1, 15)
    near, far = depth_range_shown(np.linspace(0.011, 0.049, 1000))
    assert 0 < near < 0.013 and 0.048 < far < 0.06
    assert depth_range_shown(np.full((3, 3), 2.0)) == (1.9, 2.1)
    assert depth_range_shown(np.linspace(1.19, 1.3, 1000)) == (1.1, 1.4)  # not 1 to 2 m, of one colour


@pytest.mark.parametrize(("shape", "normal"), [((20, 30), True), ((20, 30), False), ((300, 900), True)])
def test_a_prediction_of_nothing_can_be_drawn_at_any_size(tmp_path, shape, normal):
    unknown = np.full(shape, np.nan, np.float32)
    nothing = replace(wall(), depth=unknown, disparity=unknown, confidence=unknown * 0)
    nothing = replace(nothing, normal=np.zeros((*shape, 3), np.float32) if normal else None)
    prediction_figure(np.zeros(shape, np.uint8), nothing, tmp_path / "figure.png", (1.0, 15.0))
    picture = cv2.imread(str(tmp_path / "figure.png"))
    assert 480 < picture.shape[1] < 1400 and picture.max() == 255


@pytest.mark.parametrize("size", [(2000, 1), (1, 2000), (5000, 300)])
def test_the_picture_of_an_image_with_few_columns_or_rows_is_of_usual_size(size):
    depth = np.full(size, 3.0, np.float32)
    prediction = Prediction(depth, depth, np.dstack([depth] * 3), np.ones(size, np.float32))
    picture = prediction_picture(np.zeros(size, np.uint8), prediction, (1.0, 15.0))
    assert 480 < picture.shape[1] < 1400 and picture.shape[0] < 4000
