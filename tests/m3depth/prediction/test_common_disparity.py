"""A common disparity is given back exactly, in depth and normals."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from m3depth.prediction.common_disparity import given_back, nearest_without, taken_out
from m3depth.prediction.one_pair import prepare
from m3depth.prediction.options import PredictOptions
from m3depth.stereo.prediction import Prediction
from marssim.base.calibration.rectified import Calibration
from marssim.base.camera import PinholeCamera, StereoRig

RIG = StereoRig(PinholeCamera(60, 40, 500.0, 510.0, -90.0, 22.0), 0.24)


def plane(normal: np.ndarray, distance: float, shift: float) -> Prediction:
    """What a method finds of a plane n . P = -distance in images without a common disparity: a plane too."""
    rays = RIG.camera.rays()
    disparity = -RIG.fb * (rays @ normal) / distance - shift
    slope = -RIG.fb * normal / distance - [0, 0, shift]  # disparity = slope . ray
    found = np.broadcast_to(-slope / np.linalg.norm(slope), (40, 60, 3))
    return Prediction(*(x.astype(np.float32) for x in (RIG.fb / disparity, disparity, found, np.ones((40, 60)))))


@pytest.mark.parametrize("shift", [0.0, 40.0])
def test_a_plane_is_where_it_was(shift):
    normal, distance = np.array([0.1, -0.5, -0.86]), 1.2
    normal /= np.linalg.norm(normal)
    out = given_back(plane(normal, distance, shift), RIG, shift)
    assert out.depth == pytest.approx(-distance / (RIG.camera.rays() @ normal), rel=1e-5)
    assert np.abs(out.normal - normal).max() < 1e-5
    assert out.disparity == pytest.approx(RIG.fb / out.depth, rel=1e-5)


def test_sky_and_unknown_stay():
    given = plane(np.array([0.0, 0.0, -1.0]), 2.0, 40.0)
    given.depth[0], given.disparity[0] = np.inf, 0
    given.depth[1], given.disparity[1], given.normal[1] = np.nan, np.nan, np.nan
    out = given_back(given, RIG, 40.0)
    assert np.isposinf(out.depth[0]).all() and (out.disparity[0] == 0).all()
    assert np.isnan(out.depth[1]).all() and np.isnan(out.disparity[1]).all() and np.isnan(out.normal[1]).all()
    assert out.depth[2:] == pytest.approx(2.0, rel=1e-6)


def test_what_was_found_at_no_disparity_is_unknown():
    given = plane(np.array([0.0, 0.0, -1.0]), 2.0, 40.0)
    given.disparity[0], given.depth[0] = 0.1, RIG.fb / 0.1
    out = given_back(given, RIG, 40.0)
    assert np.isnan(out.depth[0]).all() and np.isfinite(out.depth[1:]).all()


def steps(*disparities: int, width: int = 300) -> tuple[np.ndarray, np.ndarray]:
    """A pair of images of bands of noise, from top to bottom, each with a disparity of its own [px]."""
    noise = np.random.default_rng(0).integers(0, 256, (40 * len(disparities), 3 * width), dtype=np.uint8)
    noise = cv2.GaussianBlur(noise, (3, 3), 0)
    right = np.vstack([
        noise[40 * n : 40 * (n + 1), width + d : 2 * width + d] for n, d in enumerate(disparities)
    ])  # fmt: skip
    return noise[:, width : 2 * width], right


def test_only_a_large_shift_stays_out_of_the_images():
    pair = steps(5, 30)
    assert taken_out(40.0, *pair) == 40 and taken_out(14.0, *pair) == 0 and taken_out(-90.0, *pair) == 0
    assert RIG.fb / nearest_without(1.0, RIG, 40.0) == pytest.approx(RIG.fb / 1.0 - 40)


@pytest.mark.parametrize("width", [300, 900])  # the larger images are reduced for the look
def test_so_much_stays_out_that_no_disparity_is_negative(width):
    scale = width // 300
    found = taken_out(40.0 * scale, *steps(-12 * scale, 30, 60, width=width))
    assert found == pytest.approx((40 - 12 - 6) * scale, abs=2 * scale)  # with a margin of 2 % of the width


def test_what_the_images_do_not_show_says_nothing():
    left, right = steps(-12, 30, 60)
    shown = np.ones(left.shape, bool)
    shown[:42] = False  # the band of negative disparities
    assert taken_out(40.0, left, right, (shown, None)) == taken_out(40.0, left, right, (None, shown)) == 40.0
    assert taken_out(40.0, *steps(-12)) < taken_out(40.0, *steps(12)) == 40.0
    assert taken_out(40.0, *steps(-45, 10)) >= 0.0  # farther than the horizon


@pytest.mark.parametrize("size", [(1, 1), (1, 5), (3, 7), (40, 2), (5, 300)])
def test_images_of_any_size_are_looked_at(size):
    left, right = (np.random.default_rng(n).integers(0, 256, (*size, 3), dtype=np.uint8) for n in range(2))
    for shift in (0.5 * size[1], 5.0 * size[1]):
        assert 0 <= taken_out(shift, left, right) <= shift


def test_far_ground_is_far_whatever_the_calibration_says_of_the_principal_points():
    """Images of the left camera that are cut farther to the right have a shift that the far ground does not have."""
    left, right = steps(-6, 20)
    calibration = Calibration(300.0, 300.0, 110.0, 39.5, 0.27, 40.0, (300, 80))
    options = PredictOptions((Path("l.png"), Path("r.png")), Path("out"), unchecked=True)
    pair = prepare(left, right, calibration, options, ("left", "right"))
    assert pair.common + pair.moved == 40.0 and 25 < pair.common <= 30


def test_a_mask_of_the_right_image_counts_where_the_match_lies():
    noise = np.random.default_rng(0).integers(0, 256, (80, 400), dtype=np.uint8)
    noise = cv2.GaussianBlur(noise, (3, 3), 0)
    left, right = noise[:, :300].copy(), noise[:, 30:330].copy()  # disparity 30 everywhere
    right[20:60, 140:200] = left[20:60, 100:160]  # but -40 on a patch
    shown = np.ones(left.shape, bool)
    shown[10:70, 130:210] = False
    assert taken_out(60.0, left, right) < 60
    assert taken_out(60.0, left, right, (None, shown)) == 60
