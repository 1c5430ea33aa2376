"""A common disparity is given back exactly, in depth and normals."""

import numpy as np
import pytest

from m3depth.prediction.common_disparity import given_back, nearest_without, taken_out
from m3depth.stereo.prediction import Prediction
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


def test_only_a_large_shift_stays_out_of_the_images():
    assert taken_out(40.0, 600) == 40 and taken_out(20.0, 600) == 0 and taken_out(-90.0, 600) == 0
    assert RIG.fb / nearest_without(1.0, RIG, 40.0) == pytest.approx(RIG.fb / 1.0 - 40)
