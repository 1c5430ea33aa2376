"""Predictions that are checked, and errors that say where a method was at work."""

import numpy as np
import pytest

from m3depth.checked_inference import EstimatorError, checked_prediction, errors_at, inferred
from m3depth.stereo.prediction import Prediction
from marssim.base.camera import PinholeCamera, StereoRig


class NoEstimator:
    pass


MAP = np.ones((4, 6), np.float32)


@pytest.mark.parametrize(
    ("checked", "message"),
    [
        (MAP, r"NoEstimator.infer returned an array of shape \(4, 6\): it must be a Prediction"),
        ((MAP, MAP), "returned a tuple: it must be a Prediction"),
        (
            Prediction(MAP[:3], MAP, None, MAP),
            r"returned depth of shape \(3, 6\): it must be \(4, 6\)",
        ),
        (Prediction(MAP, None, None, MAP), r"returned a NoneType as disparity: it must be a float array of .*\(4, 6\)"),
        (Prediction(MAP, MAP, MAP, MAP), r"normal of shape \(4, 6\): it must be \(4, 6, 3\)"),
        (Prediction(-3 * MAP, MAP, None, MAP), "^NoEstimator.infer returned a depth of -3 m: unknown is NaN, and sky"),
        (Prediction(MAP, MAP, None, 100 * MAP), r"returned a confidence of 100: it must lie in \[0, 1\]"),
        (Prediction(MAP, MAP, None, MAP.astype(object)), "returned an array of object as confidence"),
    ],
)
def test_a_wrong_prediction_is_named(checked, message):
    with pytest.raises(EstimatorError, match=message) as caught:
        checked_prediction(NoEstimator(), checked, (4, 6))
    assert "\n" not in str(caught.value)


def test_a_pixel_without_depth_has_no_disparity():
    depth, disparity = np.array([[np.nan, np.inf, 3.0]]), np.array([[-1.0, 0.0, 9.0]])
    checked = checked_prediction(NoEstimator(), Prediction(depth, disparity, None, np.ones((1, 3))), (1, 3))
    np.testing.assert_array_equal(checked.disparity, np.array([[np.nan, 0, 9]], np.float32))
    assert checked.disparity.dtype == np.float32 and disparity[0, 0] == -1


def test_a_confidence_that_is_no_number_counts_as_0():
    confidence = np.array([[np.nan, 0.5, 1.0]])
    checked = checked_prediction(NoEstimator(), Prediction(confidence, confidence, None, confidence), (1, 3))
    np.testing.assert_array_equal(checked.confidence, np.array([[0, 0.5, 1]], np.float32))
    assert np.isnan(confidence[0, 0])


class Writes:
    """Writes into the images, and fails for those of one grey level, as a method of a user may."""

    def infer(self, left, right, rig):
        if left.min() == left.max():
            raise ValueError("no texture")
        left[:] = right[:] = 0
        return Prediction(MAP, MAP, None, MAP)


class Stops:
    def infer(self, left, right, rig):
        raise RuntimeError("out of luck")


def test_errors_say_where_a_method_was_at_work():
    pair = np.zeros((4, 6), np.uint8), np.zeros((4, 6), np.uint8), StereoRig(PinholeCamera.centred(6, 4, 5.0), 0.2)
    with (
        pytest.raises(RuntimeError, match=r"^out of luck\nraised at Stops, pair 3$") as stopped,
        errors_at("Stops, pair 3"),
    ):
        inferred(Stops(), *pair)
    assert stopped.value.__notes__ == ["raised at Stops, pair 3"]
    with pytest.raises(EstimatorError, match=r"^pair 3: Writes\.infer raised ValueError"), errors_at("pair 3"):
        inferred(Writes(), *pair)


def test_a_users_class_works_on_copies_and_its_error_names_it():
    left, right = (np.arange(24, dtype=np.uint8).reshape(4, 6) + n for n in range(2))
    rig = StereoRig(PinholeCamera.centred(6, 4, 5.0), 0.2)
    assert inferred(Writes(), left, right, rig).depth is MAP
    assert left[3, 5] == 23 and right[3, 5] == 24
    with pytest.raises(
        EstimatorError, match=r"^Writes\.infer raised .*: no texture \(test_checked_inference\.py, line \d+\)$"
    ):
        inferred(Writes(), np.zeros_like(left), right, rig)


def test_a_prediction_with_or_without_normals_passes():
    for normal in (None, np.zeros((4, 6, 3))):
        checked = checked_prediction(NoEstimator(), Prediction(MAP.astype(float), MAP, normal, MAP > 0), (4, 6))
        for name in ("depth", "disparity", "confidence"):
            values = getattr(checked, name)
            assert values.dtype == np.float32 and (values == MAP).all()
        assert checked.normal is None if normal is None else checked.normal.dtype == np.float32
    assert checked_prediction(NoEstimator(), checked, (4, 6)).disparity is checked.disparity  # not copied
