"""Degraded images: each kind does what its name says."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from m3depth.stereo.degradation import Degradation

IMAGE = np.random.default_rng(0).integers(60, 196, (48, 64, 3), dtype=np.uint8)


def degraded(image, **how):
    """The left eye of a pair of twice the same."""
    return Degradation(**how).apply(image, image, rng())[0]


def rng() -> np.random.Generator:
    return np.random.default_rng(1)


def test_without_settings_a_degradation_changes_nothing():
    assert np.array_equal(Degradation().apply(IMAGE, IMAGE, rng()), [IMAGE, IMAGE])
    assert Degradation.parse("") == Degradation()


@given(st.floats(0.05, 1))
@settings(max_examples=20, deadline=None)
def test_contrast_scales_deviation_and_keeps_the_mean(contrast):
    out = degraded(IMAGE, contrast=contrast).astype(float)
    assert out.std() == pytest.approx(contrast * IMAGE.std(), abs=0.5)
    assert out.mean() == pytest.approx(IMAGE.mean(), abs=0.5)


def test_noise_has_the_deviation_asked_for():
    grey = np.full((200, 200), 128, np.uint8)
    assert degraded(grey, noise=2.5).std() == pytest.approx(2.5, rel=0.05)


def test_blur_spreads_a_point_by_its_sigma():
    point = np.zeros((61, 61), np.uint8)
    point[28:33, 28:33] = 250
    out = degraded(point, blur=4).astype(float)
    x = np.arange(61) - 30
    assert (out.sum(0) * x**2).sum() / out.sum() == pytest.approx(16 + 2, rel=0.15)


def test_only_the_right_eye_is_out_of_adjustment():
    smooth = cv2.GaussianBlur(np.repeat(IMAGE, 4, axis=0), (0, 0), 3)
    left, right = Degradation(vertical=2.0, gain=0.9).apply(smooth, smooth, rng())
    assert np.array_equal(left, smooth)
    inside = right[8:-8].astype(float)
    assert np.abs(inside - 0.9 * smooth[6:-10]).max() <= 1  # what was at row y is at row y + 2


def test_half_a_row_blurs_little():
    """Of a wave of 8 px, which lines drawn between the rows would lower by 8 %."""
    wave = np.tile(128 + 100 * np.sin(2 * np.pi * np.arange(64) / 8)[:, None], (1, 16)).astype(np.uint8)
    right = Degradation(vertical=0.5).apply(wave, wave, rng())[1][16:-16].astype(float)
    np.testing.assert_allclose(right[:, 8], 128 + 100 * np.sin(2 * np.pi * (np.arange(16, 48) - 0.5) / 8), atol=3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("dust=1", "unknown field 'dust'"),
        ("blur=-1", "blur must lie in"),
        ("blur=1e9", r"blur must lie in \[0, 100\], got 1e+09".replace("+", r"\+")),
        ("blur=1,noise=2,blur=1", "`degrade`: blur is given twice"),
        ("noise=nan", "noise"),
        ("vertical=nan", "vertical must lie"),
        ("vertical=-40", "vertical must lie"),
        ("gain=-1", "gain must lie in"),
    ],
)
def test_settings_that_cannot_work_are_named(text, message):
    with pytest.raises(ValueError, match=rf"^`degrade`: .*{message.removeprefix('`degrade`: ')}"):
        Degradation.parse(text)
