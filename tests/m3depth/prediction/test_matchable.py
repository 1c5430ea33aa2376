"""Pairs as methods match them: masks, margins and rows go with the images."""

import numpy as np
import pytest

from m3depth.prediction.matchable import MatchablePair
from m3depth.stereo.prediction import Prediction
from m3depth.stereo.rows import RowFit
from marssim.base.calibration.rectified import Calibration

H, W = 40, 60


def images() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    return tuple(rng.integers(0, 255, (2, H, W), np.uint8))


def calibration(shift: float) -> Calibration:
    return Calibration(60.0, 60.0, 30.0, 20.0, 0.25, shift)


def flat(pair: MatchablePair, disparity: float) -> Prediction:
    maps = np.full((H, W), disparity, np.float32)
    return Prediction(pair.rig.disparity_to_depth(maps), maps, None, np.ones_like(maps))


@pytest.mark.parametrize("shift", [-4.0, 0.0, 2.0])
def test_a_small_difference_of_the_principal_points_is_taken_out_of_the_right_image(shift):
    left, right = images()
    pair = MatchablePair.from_images(left, right, calibration(shift))
    assert (pair.common, pair.moved) == (0.0, shift)
    moved = int(shift)
    inside = np.s_[:, 4:-4]
    assert np.array_equal(pair.right[inside], np.roll(right, -moved, axis=1)[inside])


def test_a_match_on_the_hidden_part_of_the_right_image_does_not_count_wherever_the_image_was_moved():
    left, right = images()
    shown = np.ones((H, W), bool)
    shown[:, :10] = False
    for shift, first in ((0.0, 10 + 5), (2.0, 8 + 5), (-4.0, 14 + 5)):
        pair = MatchablePair.from_images(left, right, calibration(shift), (None, shown))
        within = pair.matched_within(flat(pair, 5.0))
        border = 5 + int(max(0.0, -shift))  # pixels to the left of it have no match to judge
        expected = (np.arange(W) >= first) | (np.arange(W) < border)
        assert np.array_equal(within, np.broadcast_to(expected, (H, W)))


def test_what_the_left_image_does_not_show_never_counts():
    left, right = images()
    shown = np.ones((H, W), bool)
    shown[:7] = False
    pair = MatchablePair.from_images(left, right, calibration(0.0), (shown, None))
    assert np.array_equal(pair.shown, shown) and np.array_equal(pair.matched_within(flat(pair, 5.0)), shown)
    assert MatchablePair.from_images(left, right, calibration(0.0)).matched_within(flat(pair, 5.0)).all()


def test_upper_margins_repeat_the_scene_below_them_and_the_masks_stay():
    left, right = images()
    shown = np.ones((H, W), bool)
    shown[:7] = False
    pair = MatchablePair.from_images(left, right, calibration(2.0), (shown, shown))
    filled = pair.without_upper_margins()
    for before, image in ((pair.left, filled.left), (pair.right, filled.right)):
        assert (image[:7] == before[7]).all() and np.array_equal(image[7:], before[7:])
    assert filled.left_valid is shown and filled.right_valid is shown


def test_the_mask_is_aligned_with_the_rows():
    left = images()[0]
    right = np.repeat(np.arange(H, dtype=np.uint8)[:, None] * 5, W, axis=1)
    shown = np.ones((H, W), bool)
    shown[:10] = False
    pair = MatchablePair.from_images(left, right, calibration(0.0), (None, shown))
    fit = RowFit(offset=3.0, rotation=0.0, scale=0.0, size=3.0, largest=3.0, error=0.01, points=100)
    aligned = pair.with_aligned_rows(fit)
    np.testing.assert_allclose(aligned.right[5:-5].astype(float), right[8:-2], atol=1)  # it lay 3 px too low
    assert np.array_equal(aligned.right_valid[:, 30], np.arange(H) >= 7) and aligned.left is pair.left
