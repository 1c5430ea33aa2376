"""The misalignment of rows, on pairs of a known one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from turned_pairs import RIG, H, W, slope, turned

from m3depth.stereo.rows import RowFit, align_rows, columns_in_given_image, row_misalignment
from marssim.base.camera import PinholeCamera, StereoRig


def difference(fit: RowFit, offset: float, rotation: float, scale: float = 0.0) -> float:
    """The largest error of the rows that a fit gives at the middle and at the borders [px]."""
    return max(
        abs(fit.offset - offset),
        abs(fit.rotation - rotation) * W / 2,
        abs(fit.scale - scale) * H / 2,
    )


@given(st.floats(-3, 3), st.floats(-0.01, 0.01), st.integers(0, 4))
@settings(max_examples=8, deadline=None)
def test_offset_and_rotation_are_found(offset, rotation, seed):
    left, right = slope(seed)
    fit = row_misalignment(left, turned(right, RIG, offset, rotation), RIG)
    assert fit is not None and fit.points > 100
    assert difference(fit, offset, rotation) < 0.06
    assert fit.error < 0.06


def test_a_magnification_is_found_where_there_is_one():
    left, right = slope()
    fit = row_misalignment(left, turned(right, RIG, 1.0, 0.004, 0.008), RIG)
    assert fit is not None and difference(fit, 1.0, 0.004, 0.008) < 0.1
    fit = row_misalignment(left, turned(right, RIG, 1.0, 0.004), RIG)
    assert fit is not None and fit.scale == 0


def test_size_is_that_of_the_rows_over_the_image():
    left, right = slope()
    fit = row_misalignment(left, turned(right, RIG, 2.0, 0.0), RIG)
    # the rows of a pitched camera move by offset (1 + y^2)
    y = (np.arange(H) - RIG.camera.cy) / RIG.camera.fy
    assert fit.size == pytest.approx(2 * np.sqrt(np.mean((1 + y**2) ** 2)), abs=0.05)
    assert fit.largest == pytest.approx(2 * (1 + y[0] ** 2), abs=0.15)


@pytest.mark.parametrize("seed", range(4))
def test_a_rectified_pair_stays_as_it_is(seed):
    left, right = slope(seed)
    aligned, fit = align_rows(left, right, RIG)
    assert aligned is right and fit is None


@pytest.mark.parametrize("colour", [False, True])
def test_the_aligned_image_is_that_of_the_ideal_camera(colour):
    left, right = slope()
    given = turned(right, RIG, 1.3, 0.006)
    if colour:
        left, given = (np.repeat(image[..., None], 3, axis=2) for image in (left, given))
    aligned, fit = align_rows(left, given, RIG)
    assert fit is not None and aligned.shape == given.shape and aligned.dtype == np.uint8
    inside = (slice(8, -8), slice(8, -8))
    rest = np.abs(aligned.reshape(H, W, -1)[..., 0][inside].astype(float) - right[inside])
    unaligned = np.abs(given.reshape(H, W, -1)[..., 0][inside].astype(float) - right[inside])
    assert rest.mean() < 0.2 * unaligned.mean()


def test_an_aligned_pair_is_aligned():
    left, right = slope(1)
    once, fit = align_rows(left, turned(right, RIG, -0.8, 0.003), RIG)
    assert fit is not None
    again, nothing = align_rows(left, once, RIG)
    assert nothing is None and again is once


def test_a_larger_image_has_the_fit_of_a_smaller_one():
    big = RIG.resized(6 * W, 6 * H)  # larger than the images that are worked on
    left, right = slope(rig=big, blur=5.0)
    fit = row_misalignment(left, turned(right, big, 3.0, 0.004), big)
    assert (
        fit is not None
        and fit.offset == pytest.approx(3.0, abs=0.15)
        and fit.rotation == pytest.approx(0.004, abs=2e-4)
    )


def test_a_wider_search_finds_rows_that_lie_farther_apart():
    left, right = slope(2)
    far = turned(right, RIG, 24.0, 0.0)
    fit = row_misalignment(left, far, RIG, reach=30)
    assert fit is not None and fit.offset == pytest.approx(24, abs=0.3)
    assert row_misalignment(left, far, RIG) is None


def test_noise_dust_and_a_gain_between_the_eyes_change_little():
    rng = np.random.default_rng(3)
    left, right = slope()
    right = turned(right, RIG, 0.7, -0.003)
    left, right = (
        np.clip(gain * image + 60 + rng.normal(0, 1.5, image.shape), 0, 255).astype(np.uint8)
        for gain, image in ((0.4, left), (0.5, right))
    )
    fit = row_misalignment(left, right, RIG)
    assert fit is not None and difference(fit, 0.7, -0.003) < 0.1


def test_images_without_matches_have_no_fit():
    left, right = slope()
    flat = np.full((H, W), 90, np.uint8)
    assert row_misalignment(flat, flat, RIG) is None
    assert row_misalignment(left, flat, RIG) is None and row_misalignment(flat, right, RIG) is None
    assert row_misalignment(left, slope(9)[1], RIG) is None
    noise = np.random.default_rng(0).integers(85, 95, (2, H, W), dtype=np.uint8)
    assert row_misalignment(*noise, RIG) is None
    assert align_rows(flat, flat, RIG) == (flat, None)


@pytest.mark.parametrize(("width", "height"), [(1, 1), (5, 3), (12, 400), (400, 12), (40, 30)])
def test_small_and_narrow_images_have_no_fit_or_a_small_one(width, height):
    rig = StereoRig(PinholeCamera.centred(width, height, 380.0), 0.27)
    image = np.random.default_rng(0).integers(0, 255, (height, width), dtype=np.uint8)
    fit = row_misalignment(image, image, rig)
    assert fit is None or fit.size < 0.1


def test_bad_input_is_named():
    left, right = slope()
    with pytest.raises(ValueError, match="left image must be a uint8 array"):
        row_misalignment(left.astype(float), right, RIG)
    with pytest.raises(ValueError, match="right image is 319 x 256"):
        row_misalignment(left, right[:, 1:], RIG)
    for reach in (0, -1, np.nan, np.inf):
        with pytest.raises(ValueError, match="reach must be positive"):
            row_misalignment(left, right, RIG, reach)


def test_columns_of_the_given_image_are_those_that_the_turned_camera_has():
    fit = RowFit(0.0, 0.01, 0.0, 1.0, 1.0, 0.01, 100)
    u, v = np.meshgrid(np.arange(W, dtype=float), np.arange(H, dtype=float))
    x, y = u - RIG.camera.cx, v - RIG.camera.cy
    expected = RIG.camera.cx + np.cos(0.01) * x - np.sin(0.01) * y
    np.testing.assert_allclose(columns_in_given_image(u, RIG, fit), expected, atol=1e-9)
    none = RowFit(0.0, 0.0, 0.0, 0.0, 0.0, 0.01, 100)
    np.testing.assert_allclose(columns_in_given_image(u, RIG, none), u, atol=1e-9)


def test_a_fit_says_what_it_is():
    fit = RowFit(0.7, np.deg2rad(0.05), 0.0, 0.74, 0.95, 0.03, 300)
    assert str(fit) == "0.74 +- 0.03 px (offset +0.70 px, rotation +0.050 deg)"
    assert fit.significant
    assert not RowFit(0.7, 0.0, 0.0, 0.74, 0.95, 0.3, 30).significant  # may be an accident
    assert not RowFit(0.05, 0.0, 0.0, 0.05, 0.06, 0.01, 300).significant  # does not matter
