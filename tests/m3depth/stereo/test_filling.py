"""Unknown pixels are filled from the background."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from m3depth.checked_inference import EstimatorError
from m3depth.estimator import for_pair, gets_truth
from m3depth.stereo.classical import SGBM
from m3depth.stereo.filling import fill_background, filled_prediction
from m3depth.stereo.prediction import Prediction
from m3depth.wrapped_estimators import FilledEstimator, UnfilledEstimator
from marssim.base.camera import PinholeCamera, StereoRig

RIG = StereoRig(PinholeCamera.centred(4, 1, 100.0), 0.27)
NAN = np.nan


def sparse_prediction() -> Prediction:
    """Sky, a match, and two pixels that are unknown."""
    disparity = np.array([[0, 9, NAN, NAN]], np.float32)
    depth = np.array([[np.inf, 3, NAN, NAN]], np.float32)
    return Prediction(depth, disparity, None, np.array([[0.5, 0.9, 0, 0.2]], np.float32))


def test_fill_takes_the_smaller_neighbour():
    nan = np.nan
    row = np.array([[nan, 5, nan, nan, 3, nan]])
    assert fill_background(row).tolist() == [[5, 5, 3, 3, 3, 3]]


def test_fill_of_empty_rows_takes_the_smaller_row():
    rows = np.array([[np.nan] * 2, [4, 6], [np.nan] * 2, [5, 2], [np.nan] * 2])
    assert fill_background(rows).tolist() == [[4, 6], [4, 6], [4, 2], [5, 2], [5, 2]]
    assert np.isnan(fill_background(np.full((2, 3), np.nan))).all()


@given(hnp.arrays(np.float32, (5, 7), elements=st.one_of(st.just(np.float32(np.nan)), st.floats(0, 100, width=32))))
@settings(max_examples=60, deadline=None)
def test_fill_keeps_what_is_known_and_invents_nothing(values):
    filled = fill_background(values)
    known = np.isfinite(values)
    assert np.array_equal(filled[known], values[known])
    if known.any():
        assert np.isin(filled, values[known]).all()


def test_a_prediction_is_filled_where_it_is_unknown_and_nowhere_else() -> None:
    filled = filled_prediction(sparse_prediction(), RIG)
    assert filled.disparity.tolist() == [[0, 9, 9, 9]]
    np.testing.assert_allclose(filled.depth, [[np.inf, 3, 3, 3]])
    np.testing.assert_allclose(filled.confidence, [[0.5, 0.9, 0, 0]])
    assert filled.normal is None and filled.depth.dtype == filled.confidence.dtype == np.float32
    whole = filled_prediction(filled, RIG)
    assert whole is filled


@pytest.mark.parametrize("unknown", [NAN, -1.0, 0.0])  # -1 and 0 as OpenCV's matchers have it
def test_unknown_depth_is_filled_whatever_disparity_stands_there(unknown) -> None:
    sparse = sparse_prediction()
    sparse.disparity[0, 2:] = unknown
    sparse.disparity[0, 0] = unknown  # of the sky, which is known by its depth
    filled = filled_prediction(sparse, RIG)
    assert filled.disparity.tolist() == [[0, 9, 9, 9]]
    np.testing.assert_allclose(filled.depth, [[np.inf, 3, 3, 3]])


def test_unknown_normals_of_filled_pixels_are_those_of_its_depth() -> None:
    rig = StereoRig(PinholeCamera.centred(16, 12, 20.0), 0.27)
    normal = np.array([0.2, -0.4, -0.9]) / np.linalg.norm([0.2, -0.4, -0.9])
    depth = (-2.0 / (rig.camera.rays() @ normal)).astype(np.float32)
    normals = np.broadcast_to(normal, (12, 16, 3)).astype(np.float32)
    sparse = Prediction(depth.copy(), rig.depth_to_disparity(depth), normals.copy(), np.ones_like(depth))
    for values in (sparse.depth, sparse.disparity, sparse.normal):
        values[3:9, 8] = NAN
    sparse.normal[10, 3] = NAN  # where there was depth
    filled = filled_prediction(sparse, rig)
    assert np.isfinite(filled.normal[3:9, 8]).all() and np.isnan(filled.normal[10, 3]).all()
    assert np.rad2deg(np.arccos((filled.normal[3:9, 8] @ normal).min())) < 25
    np.testing.assert_array_equal(np.delete(filled.normal, 8, axis=1), np.delete(sparse.normal, 8, axis=1))


def test_a_filled_estimator_is_the_estimator_but_for_its_holes() -> None:
    class Sparse:
        normals_are_fitted = True

        def infer(self, left, right, rig):
            return sparse_prediction()

    image = np.zeros((1, 4), np.uint8)
    estimator = FilledEstimator(Sparse())
    assert np.isfinite(estimator.infer(image, image, RIG).disparity).all() and estimator.normals_are_fitted
    with pytest.raises(EstimatorError, match=r"Sparse\.infer returned depth of shape"):
        estimator.infer(np.zeros((2, 4), np.uint8), np.zeros((2, 4), np.uint8), RIG)


def test_a_filled_estimator_passes_the_true_depth_on() -> None:
    class Given:
        takes_truth = True
        disparity: np.ndarray | None = None

        def with_truth(self, disparity):
            given = Given()
            given.disparity = disparity
            return given

        def infer(self, left, right, rig):
            return replace(sparse_prediction(), disparity=self.disparity)

    image, sample = np.zeros((1, 4), np.uint8), SimpleNamespace(disparity=np.array([[0, 7, NAN, NAN]], np.float32))
    estimator = FilledEstimator(Given())
    assert gets_truth(estimator)
    assert for_pair(estimator, sample).infer(image, image, RIG).disparity.tolist() == [[0, 7, 7, 7]]
    other = FilledEstimator(UnfilledEstimator(SGBM()))
    assert for_pair(other, sample) is other and not gets_truth(other)
