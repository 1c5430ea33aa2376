"""Degraded images: contrast, blur and noise do what their names say."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from m3depth.degradation import Degradation

IMAGE = np.random.default_rng(0).integers(60, 196, (48, 64, 3), dtype=np.uint8)


def rng() -> np.random.Generator:
    return np.random.default_rng(1)


def test_nothing_asked_changes_nothing():
    assert np.array_equal(Degradation().apply(IMAGE, rng()), IMAGE)
    assert Degradation.parse("") == Degradation()


@given(st.floats(0.05, 1))
@settings(max_examples=20, deadline=None)
def test_contrast_scales_deviation_and_keeps_the_mean(contrast):
    out = Degradation(contrast=contrast).apply(IMAGE, rng()).astype(float)
    assert out.std() == pytest.approx(contrast * IMAGE.std(), abs=0.5)
    assert out.mean() == pytest.approx(IMAGE.mean(), abs=0.5)


def test_noise_has_the_deviation_asked_for():
    grey = np.full((200, 200), 128, np.uint8)
    assert Degradation(noise=2.5).apply(grey, rng()).std() == pytest.approx(2.5, rel=0.05)


def test_blur_spreads_a_point_by_its_sigma():
    point = np.zeros((61, 61), np.uint8)
    point[28:33, 28:33] = 250
    out = Degradation(blur=4).apply(point, rng()).astype(float)
    x = np.arange(61) - 30
    assert (out.sum(0) * x**2).sum() / out.sum() == pytest.approx(16 + 2, rel=0.15)


@pytest.mark.parametrize(
    ("text", "message"), [("dust=1", "unknown field 'dust'"), ("blur=-1", "blur must be"), ("noise=nan", "noise")]
)
def test_mistakes_are_named(text, message):
    with pytest.raises(ValueError, match=message):
        Degradation.parse(text)
