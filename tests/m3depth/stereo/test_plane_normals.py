"""Normals of planes that are fitted to disparity: exact for planes, not bent by gaps, and facing the camera."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from m3depth.evaluation.metrics import angle_between
from m3depth.stereo.plane_normals import fitted_normals
from marssim.base.camera import PinholeCamera, StereoRig

RIG = StereoRig(PinholeCamera.centred(160, 96, 200.0), baseline=0.25)


@given(st.floats(-40, 40), st.floats(-60, 60), st.floats(1, 10))
@settings(max_examples=40, deadline=None)
def test_normals_of_any_plane(yaw_deg, pitch_deg, distance):
    """The plane n . P = -h, seen by a pinhole: its disparity is linear, so the fit has to be exact inside."""
    yaw, pitch = np.radians([yaw_deg, pitch_deg])
    normal = -np.array([np.sin(yaw), np.sin(pitch) * np.cos(yaw), np.cos(pitch) * np.cos(yaw)])
    depth = -distance / (RIG.camera.rays() @ normal)
    visible = (depth > 0).all()
    if not visible:
        return
    fitted = fitted_normals(RIG.depth_to_disparity(depth), RIG.camera)
    assert angle_between(fitted, np.broadcast_to(normal, fitted.shape))[8:-8, 8:-8].max() < 0.01


@pytest.mark.parametrize("holes", ["a tenth", "most", "every second row", "a half image"])
def test_gaps_do_not_bend_the_planes(holes):
    """Gaps counted as 0 px would tilt a window by tens of degrees."""
    normal = np.array([0.2, -0.8, -0.5]) / np.linalg.norm([0.2, -0.8, -0.5])
    depth = -1.5 / (RIG.camera.rays() @ normal)
    disparity = np.where(depth > 0, RIG.depth_to_disparity(depth), 0).astype(np.float32)
    draw = np.random.default_rng(0).random(disparity.shape)
    gap = {
        "a tenth": draw < 0.1,
        "most": draw < 0.8,
        "every second row": np.broadcast_to(np.arange(len(draw))[:, None] % 2 == 0, draw.shape),
        "a half image": np.broadcast_to(np.arange(draw.shape[1]) < draw.shape[1] // 2, draw.shape),
    }[holes]
    for none in (np.nan, 0.0, -1.0, np.inf):
        fitted = fitted_normals(np.where(gap, np.float32(none), disparity), RIG.camera)
        known = (disparity > 0) & ~gap
        assert known.sum() > 2000
        assert angle_between(fitted, np.broadcast_to(normal, fitted.shape))[known].max() < 0.05  # to the very border
        view = -RIG.camera.rays()[~known]
        assert angle_between(fitted[~known], view).max(initial=0) < 0.01


def test_pixels_on_one_line_determine_no_plane():
    disparity = np.full((96, 160), np.nan, np.float32)
    disparity[40] = 20.0
    disparity[60:62] = 20.0  # two rows do
    normal = fitted_normals(disparity, RIG.camera)
    view = -RIG.camera.rays()
    assert angle_between(normal[40], view[40]).max() < 0.01
    assert angle_between(normal[60], np.array([0.0, 0.0, -1.0])[None]).max() < 0.01


def test_normals_are_unit_and_face_the_camera_everywhere():
    disparity = np.random.default_rng(0).uniform(-5, 60, (96, 160)).astype(np.float32)
    disparity[20:40] = np.nan
    normal = fitted_normals(disparity, RIG.camera)
    assert np.allclose(np.linalg.norm(normal, axis=-1), 1, atol=1e-5)
    assert (np.einsum("ijk,ijk->ij", normal, RIG.camera.rays()) < 0).all()
