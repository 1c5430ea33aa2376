"""Methods side by side on a pair without true depth: unknown is unknown, and sky is sky."""

import cv2
import numpy as np

from m3depth.figures.side_by_side import MethodMaps, PairMaps, normal_panel, side_by_side_figure
from m3depth.stereo.prediction import Prediction
from marssim.base.images.colours import depth_colours, normal_colours

NORMAL = np.broadcast_to(np.float32([0, -0.6, -0.8]), (40, 50, 3))


def prediction(normal=NORMAL) -> Prediction:
    """Sky above, ground at 4 m, a strip of unknown pixels, and a strip that the method filled without a match."""
    depth = np.full((40, 50), 4, np.float32)
    depth[:10] = np.inf
    depth[20:25] = np.nan
    confidence = np.ones((40, 50), np.float32)
    confidence[30:35] = 0
    return Prediction(depth, 100 / depth, normal, confidence)


def test_sky_is_grey_and_what_is_unknown_or_filled_is_black():
    maps = MethodMaps.from_prediction(prediction())
    for picture, ground in (
        (depth_colours(maps.depth, 1, 10), depth_colours(np.full((1, 1), 4.0), 1, 10)[0, 0]),
        (normal_panel(maps), normal_colours(NORMAL)[0, 0]),
    ):
        assert (picture[:10] == 90).all() and (picture[20:25] == 0).all() and (picture[30:35] == 0).all()
        assert (picture[10:20] == ground).all() and (picture[35:] == ground).all()


def test_large_maps_are_kept_small_and_their_values_are_not_mixed():
    depth = np.tile(np.float32([2, 8]), (1000, 800))
    maps = MethodMaps.from_prediction(Prediction(depth, 100 / depth, None, np.ones_like(depth)))
    assert maps.depth.shape == (400, 640) and set(np.unique(maps.depth)) <= {2, 8}


def test_the_figure_shows_the_image_and_the_maps_of_every_method(tmp_path, drawn_figures):
    left = np.full((40, 50), 77, np.uint8)
    pairs = [
        PairMaps.from_predictions(f"pair {n}", left, {"Ours": prediction(), "Bare": prediction(None)}) for n in range(2)
    ]
    picture = side_by_side_figure(pairs, tmp_path / "figure.png")
    assert np.array_equal(cv2.imread(str(tmp_path / "figure.png"))[..., ::-1], picture)
    (figure,) = drawn_figures
    images = [ax for ax in figure.axes if ax.images]
    assert len(images) == 2 * (1 + 2 * 2)
    assert [ax.get_title() for ax in images if ax.get_title()] == ["left image", "Ours", "Bare"]
    written = [text.get_text() for ax in images for text in ax.texts]
    assert written.count("no normals") == 2 and {"pair 0", "pair 1"} <= set(written)
    # both methods measure 4 m, so the scale goes from 3.9 m to 4.1 m
    shown = images[1].images[0].get_array()
    assert (shown[-1, 0] == depth_colours(np.full((1, 1), 4.0), 3.9, 4.1)[0, 0]).all()


def test_long_names_stay_inside_their_image_and_keep_both_ends(tmp_path, drawn_figures):
    name = "ZL0_0711_0730054943_723RAD_N0332864ZCAM03014_048085A02/rectified/left"
    shapes = ((60, 80), (80, 60))  # the second one leaves a part of its panel free
    pairs = [
        PairMaps.from_predictions(name, np.full(shape, 77, np.uint8), {"Bare": prediction(None)}) for shape in shapes
    ]
    side_by_side_figure(pairs, tmp_path / "figure.png")
    (figure,) = drawn_figures
    figure.canvas.draw()
    for axes in (ax for ax in figure.axes if ax.images):
        for text in (text for text in axes.texts if text.get_text().startswith("ZL0_0711")):
            assert text.get_text().endswith("/left")
            assert text.get_window_extent().x1 < axes.get_window_extent().x1
