"""Sparsification curves against sorting, and properties that hold for any."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from m3depth.evaluation.sparsification import BINS, DROPPED, LOGIT, ConfidenceHistograms


def brute_force(order: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Mean of the errors that are left when the first of `order` are dropped."""
    ordered = values[order]
    return np.array([ordered[round(share * len(values)) :].mean() for share in DROPPED])


def curves(confidence: np.ndarray, error: np.ndarray) -> dict:
    out = ConfidenceHistograms()
    out.add(confidence, error)
    return out.result()


@given(st.integers(0, 1000))
@settings(max_examples=20)
def test_the_curve_is_that_of_sorted_pixels(seed):
    rng = np.random.default_rng(seed)
    error = rng.exponential(0.7, 20_000)
    confidence = 1 / (1 + np.exp(-(2 - error + rng.normal(0, 1, error.shape))))
    figures = curves(confidence, error)
    by_confidence, by_error = np.argsort(confidence), np.argsort(-error)
    assert figures["epe"] == pytest.approx(brute_force(by_confidence, error), rel=0.01)
    assert figures["bad1"] == pytest.approx(brute_force(by_confidence, error > 1.0), abs=3e-3)
    assert figures["oracle_epe"] == pytest.approx(brute_force(by_error, error), rel=0.01)
    assert figures["oracle_bad1"] == pytest.approx(brute_force(by_error, error > 1.0), abs=1e-3)
    assert figures["bad1_without_10"] == pytest.approx(figures["bad1"][2] / figures["bad1"][0])
    for name, values in (("ause_epe", error), ("ause_bad1", error > 1.0)):
        apart = (brute_force(by_confidence, values) - brute_force(by_error, values)).mean()
        assert figures[name] == pytest.approx(apart / values.mean(), rel=0.03)


@given(
    hnp.arrays(np.float32, 50, elements=st.floats(0, 1, width=32), fill=st.nothing()),
    hnp.arrays(np.float64, 50, elements=st.floats(0, 200), fill=st.nothing()),
)
@example(np.array([0.0, 1e-45] * 25, np.float32), np.ones(50))
@example(np.full(50, 0.3, np.float32), np.ones(50))
def test_nothing_lies_below_the_oracle(confidence, error):
    figures = curves(confidence, error)
    if not figures:
        with np.errstate(divide="ignore"):
            logit = np.clip(np.log(confidence / (1 - confidence.astype(float))), -LOGIT, LOGIT)
        assert np.ptp(logit) < 2 * LOGIT / BINS  # as of 0 and 1e-45, which share a bin
        return
    slack = 1e-6 + 0.02 * np.array(figures["epe"])  # width of the oracle's bins
    assert (np.array(figures["epe"]) >= np.array(figures["oracle_epe"]) - slack).all()
    assert (np.array(figures["bad1"]) >= np.array(figures["oracle_bad1"]) - 1e-9).all()
    assert figures["epe"][0] == pytest.approx(error.mean()) and figures["bad1"][0] == pytest.approx((error > 1).mean())


def test_a_perfect_confidence_reaches_the_oracle():
    error = np.linspace(0, 3, 30_001)
    figures = curves(1 / (1 + np.exp(5 * (error - 1.5))), error)
    assert figures["ause_epe"] == pytest.approx(0, abs=5e-3) and figures["ause_bad1"] == pytest.approx(0, abs=5e-3)
    worst = curves(1 / (1 + np.exp(-5 * (error - 1.5))), error)
    assert worst["ause_epe"] > 0.5 and worst["bad1_without_10"] > 1


def test_equal_confidences_are_dropped_in_equal_shares():
    """Filled pixels (confidence 0) are a quarter and all off by 2 px; half of the others by 1.5 px."""
    error = np.repeat([2.0, 1.5, 0.0], [1000, 1500, 1500])
    figures = curves(np.repeat([0.0, 1.0], [1000, 3000]), error)
    assert figures["bad1"][2] == pytest.approx((600 + 1500) / 3600)
    assert figures["bad1"][5:] == pytest.approx([0.5] * 15)
    shuffled = np.random.default_rng(0).permutation(4000)
    again = curves(np.repeat([0.0, 1.0], [1000, 3000])[shuffled], error[shuffled])
    assert again["epe"] == pytest.approx(figures["epe"])


def test_a_constant_confidence_has_no_curve():
    assert curves(np.ones(10), np.ones(10)) == {}
    assert ConfidenceHistograms().result() == {}


def test_images_add_up_and_invalid_confidences_are_accepted():
    rng = np.random.default_rng(1)
    confidence, error = rng.uniform(-0.2, 1.2, 400), rng.exponential(1, 400)
    confidence[:5] = np.nan
    whole, parts = ConfidenceHistograms(), ConfidenceHistograms()
    whole.add(confidence, error)
    for i in range(0, 400, 100):
        parts.add(confidence[i : i + 100], error[i : i + 100])
    assert parts.result()["epe"] == pytest.approx(whole.result()["epe"])


def test_pixels_without_a_confidence_are_dropped_first():
    out = ConfidenceHistograms()
    out.add(np.repeat([np.nan, 0.9], [1000, 3000]), np.repeat([2.0, 0.0], [1000, 3000]))
    assert out.result()["bad1"][5:] == pytest.approx([0.0] * 15)
