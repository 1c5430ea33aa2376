import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from marssim.base.images.texture import entropy, gradient, lbp_entropy, local_binary_patterns, uniform_labels

EVERYWHERE = np.ones((64, 64), bool)


def test_the_gradient_of_a_ramp():
    ramp = np.round(np.add.outer(3.0 * np.arange(20), 4.0 * np.arange(20))).astype(np.uint8)
    assert gradient(ramp)[1:-1, 1:-1] == pytest.approx(5.0)


def test_lbp_entropy_of_patterns_that_are_known():
    flat = np.full((64, 64), 80, np.uint8)
    assert lbp_entropy(flat, EVERYWHERE) == 0  # one pattern: all neighbours at least as bright
    ramp = np.tile(np.arange(64, dtype=np.uint8) * 2, (64, 1))
    assert lbp_entropy(ramp, EVERYWHERE) == 0  # one pattern again: the right half and the two above and below
    half = np.where(np.arange(64) < 32, ramp, 80).astype(np.uint8)
    assert 0 < lbp_entropy(half, EVERYWHERE) < 1.3
    assert lbp_entropy(flat, ~EVERYWHERE) == 0 and lbp_entropy(flat[:2], EVERYWHERE[:2]) == 0


def test_lbp_of_noise_and_its_invariances():
    noise = np.random.default_rng(0).integers(0, 256, (200, 200)).astype(np.uint8)
    everywhere = np.ones(noise.shape, bool)
    value = lbp_entropy(noise, everywhere)
    assert 2.0 < value < np.log2(10)
    assert lbp_entropy((noise // 2 + 60).astype(np.uint8) * 1, everywhere) == pytest.approx(value, abs=0.1)
    assert lbp_entropy(np.rot90(noise).copy(), everywhere) == pytest.approx(value, abs=1e-9)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2)
    assert lbp_entropy(smooth, everywhere) > 1.5 and lbp_entropy(smooth, everywhere) != value


def test_lbp_counts_only_where_it_is_asked():
    noise = np.random.default_rng(0).integers(0, 256, (64, 64)).astype(np.uint8)
    noise[:, :32] = 80
    where = np.zeros((64, 64), bool)
    where[:, :30] = True
    assert lbp_entropy(noise, where) == 0 < lbp_entropy(noise, ~where)


def pattern_by_hand(image: np.ndarray, y: int, x: int) -> int:
    """Return the code of one pixel, with bilinear neighbours."""
    code = 0
    for p in range(8):
        v, u = y - np.sin(np.pi * p / 4), x + np.cos(np.pi * p / 4)
        top, left = int(np.floor(v + 1e-9)), int(np.floor(u + 1e-9))
        a, b = v - top, u - left
        value = 0.0
        for dy, dx, share in ((0, 0, (1 - a) * (1 - b)), (0, 1, (1 - a) * b), (1, 0, a * (1 - b)), (1, 1, a * b)):
            if share > 1e-9:
                value += share * image[top + dy, left + dx]
        code |= int(value >= image[y, x] - 1e-9) << p
    return code


@given(hnp.arrays(np.uint8, (5, 6)))
def test_patterns_against_a_pixel_at_a_time(image):
    codes = local_binary_patterns(image)
    by_hand = [[pattern_by_hand(image.astype(float), y, x) for x in range(1, 5)] for y in range(1, 4)]
    assert codes.tolist() == by_hand


def test_58_codes_are_uniform():
    labels = uniform_labels()
    assert (labels < 9).sum() == 58 and labels.min() == 0 and labels.max() == 9
    assert [int((labels == n).sum()) for n in range(10)] == [1, 8, 8, 8, 8, 8, 8, 8, 1, 198]


@given(hnp.arrays(np.uint8, (7, 7)), st.integers(1, 3))
def test_labels_do_not_depend_on_how_the_image_is_turned(image, turns):
    labels = uniform_labels()
    here = labels[local_binary_patterns(image)]
    there = labels[local_binary_patterns(np.rot90(image, turns))]
    assert np.array_equal(np.rot90(here, turns), there)


def test_entropy_of_known_histograms():
    assert entropy(np.zeros(8, int)) == 0
    assert entropy(np.arange(8)) == pytest.approx(3)
    assert entropy(np.array([0, 0, 1, 2])) == pytest.approx(1.5)
