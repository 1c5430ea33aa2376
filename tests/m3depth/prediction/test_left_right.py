"""Left-right consistency on scenes whose disparities are known."""

import numpy as np
import pytest

from m3depth.prediction.left_right import left_right_difference
from m3depth.stereo.classical import SGBM
from m3depth.stereo.prediction import Prediction
from marssim.base.camera import PinholeCamera, StereoRig

H, W = 24, 96
RIG = StereoRig(PinholeCamera(W, H, 100.0, 100.0, 40.0, 12.0), 0.3)
NEAR, FAR, POST = 8, 3, slice(40, 56)  # [px]; columns of the post in the left image


def step(error=0.0):
    """An estimator that knows a post in front of a wall, from either eye; `error` [px] is added to the left eye's."""
    left = np.full((H, W), FAR, np.float32)
    left[:, POST] = NEAR
    from_right = np.full((H, W), FAR, np.float32)
    from_right[:, POST.start - NEAR : POST.stop - NEAR] = NEAR
    calls = []

    def look(first, second, rig):
        calls.append((first, second, rig))
        disparity = left + np.float32(error) if len(calls) == 1 else from_right[:, ::-1]
        return Prediction(rig.disparity_to_depth(disparity), disparity, None, np.ones((H, W), np.float32))

    return look, calls


def test_what_both_eyes_see_agrees_and_what_the_post_hides_does_not():
    look, calls = step()
    left, right = (np.random.default_rng(i).integers(0, 255, (H, W), dtype=np.uint8) for i in range(2))
    difference = left_right_difference(look, left, right, RIG, look(left, right, RIG))
    hidden = slice(POST.start - NEAR + FAR, POST.start)  # the wall left of the post
    assert (difference[:, hidden] == NEAR - FAR).all()
    visible = np.delete(difference, np.r_[:FAR, hidden], axis=1)
    assert (visible == 0).all() and np.isnan(difference[:, :FAR]).all()
    first, second, rig = calls[1]
    assert np.array_equal(first, right[:, ::-1]) and np.array_equal(second, left[:, ::-1])
    assert rig.camera.cx == W - 1 - RIG.camera.cx and rig.baseline == RIG.baseline


def test_what_a_method_only_filled_in_the_right_eye_is_unknown():
    look, calls = step()
    left, right = np.zeros((2, H, W), np.uint8)

    def filling(first, second, rig):
        prediction = look(first, second, rig)
        if len(calls) > 1:
            prediction.confidence[:, : W // 2] = 0  # the mirrored right image: its right half
        return prediction

    difference = left_right_difference(filling, left, right, RIG, filling(left, right, RIG))
    assert np.isnan(difference[:, W // 2 + NEAR :]).all() and (difference[:, FAR : POST.start - NEAR] == 0).all()


def test_an_error_of_one_eye_is_measured():
    look, _ = step(error=0.75)
    image = np.zeros((H, W), np.uint8)
    difference = left_right_difference(look, image, image, RIG, look(image, image, RIG))
    assert np.nanmedian(difference) == pytest.approx(0.75)


def test_unknown_pixels_stay_unknown_and_sky_agrees_with_sky():
    nothing, sky = np.full((H, W), np.nan, np.float32), np.zeros((H, W), np.float32)
    image = np.zeros((H, W), np.uint8)
    for disparity, far, expected in ((nothing, np.nan, np.nan), (sky, np.inf, 0.0)):
        depth = np.full((H, W), far, np.float32)
        prediction = Prediction(depth, disparity, None, sky)
        np.testing.assert_array_equal(
            left_right_difference(lambda *_, t=prediction: t, image, image, RIG, prediction), expected
        )


def test_a_matcher_agrees_with_itself_on_a_plane(plane_samples):
    sample, sgbm = plane_samples[0], SGBM()
    difference = left_right_difference(
        sgbm.infer, sample.left, sample.right, sample.rig, sgbm.infer(sample.left, sample.right, sample.rig)
    )
    visible = np.isfinite(difference) & ~sample.occluded & sample.valid
    assert (difference[visible] < 1).mean() > 0.97


def test_the_columns_that_a_moved_right_image_repeats_are_beyond_its_border():
    look, _ = step()
    image = np.zeros((H, W), np.uint8)
    prediction = look(image, image, RIG)
    difference = left_right_difference(look, image, image, RIG, prediction, begins=10.0)
    assert np.isnan(difference[:, : 10 + FAR]).all() and (difference[:, 10 + FAR] == 0).all()
