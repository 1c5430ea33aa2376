import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from marssim.base.camera import NATECAM, PinholeCamera, StereoRig
from marssim.base.pose import look_pose

positive = st.floats(0.3, 80)
pixels = st.tuples(st.floats(0, 511), st.floats(0, 511))


def test_natecam_is_the_papers_rig():
    assert NATECAM.fb == pytest.approx(160.893)
    assert np.rad2deg(NATECAM.camera.fov) == pytest.approx((46.5, 46.5), abs=0.02)
    assert (NATECAM.camera.cx, NATECAM.camera.cy) == (255.5, 255.5)
    assert NATECAM.depth_to_disparity(np.array(15.0)) == pytest.approx(10.726, abs=1e-3)


@given(pixels, positive)
def test_unprojected_pixels_project_back(pixel, depth):
    camera = NATECAM.camera
    u, v = round(pixel[0]), round(pixel[1])
    point = camera.rays()[v, u] * depth
    assert camera.project(point) == pytest.approx((u, v), abs=1e-9)
    assert point[2] == depth


def test_points_behind_the_camera_and_in_its_plane_have_no_pixel():
    assert np.isnan(NATECAM.camera.project(np.array([[0.1, 0.2, -1.0], [0.1, 0.2, 0.0]]))).all()


@given(positive)
def test_disparity_and_depth_are_inverse(depth):
    assert NATECAM.disparity_to_depth(NATECAM.depth_to_disparity(np.array(depth))) == pytest.approx(depth)


def test_disparity_follows_from_the_focal_length_along_the_rows():
    rig = StereoRig(PinholeCamera(64, 48, 500.0, 400.0, 31.5, 23.5), baseline=0.2)
    assert rig.disparity_to_depth(np.array(10.0)) == rig.depth_to_disparity(np.array(10.0)) == 10


@given(pixels, positive)
def test_a_point_is_shifted_by_its_disparity_in_the_right_eye(pixel, depth):
    pose = look_pose(np.array([1.0, -2.0, 1.2]), 0.7, 0.3, 0.1)
    right = NATECAM.right_pose(pose)
    camera = NATECAM.camera
    ray = np.array([(pixel[0] - camera.cx) / camera.fx, (pixel[1] - camera.cy) / camera.fy, 1])
    world = pose[:3, :3] @ (ray * depth) + pose[:3, 3]
    in_right = right[:3, :3].T @ (world - right[:3, 3])
    u, v = camera.project(in_right)
    assert v == pytest.approx(pixel[1], abs=1e-6)
    assert pixel[0] - u == pytest.approx(float(NATECAM.depth_to_disparity(np.array(depth))), abs=1e-6)


def test_no_match_is_infinitely_far_and_back():
    disparity = np.array([0.0, -1.0, np.nan])
    assert np.isinf(NATECAM.disparity_to_depth(disparity)).all()
    assert (NATECAM.depth_to_disparity(np.array([np.inf, np.nan, -1.0])) == 0).all()


def test_integers_are_converted_as_floats_are_and_floats_keep_their_precision():
    whole = np.array([0, 3, 64])
    for convert in (NATECAM.disparity_to_depth, NATECAM.depth_to_disparity):
        assert np.array_equal(convert(whole), convert(whole.astype(float)))
        assert convert(whole.astype(np.float32)).dtype == np.float32


@given(st.integers(0, 100), st.integers(0, 100))
def test_cropping_keeps_the_rays(x, y):
    part = NATECAM.camera.cropped(x, y, 64, 48)
    assert np.allclose(part.rays(), NATECAM.camera.rays()[y : y + 48, x : x + 64])


@given(st.integers(16, 1024), st.integers(16, 1024))
def test_resizing_keeps_the_field_of_view(width, height):
    assert NATECAM.camera.resized(width, height).fov == pytest.approx(NATECAM.camera.fov)


def test_rig_survives_json_and_names_a_missing_field():
    assert StereoRig.from_dict(NATECAM.to_dict()) == NATECAM
    broken = NATECAM.to_dict()
    del broken["baseline"]
    with pytest.raises(ValueError, match="baseline"):
        StereoRig.from_dict(broken)


@pytest.mark.parametrize("name", NATECAM.to_dict())
@pytest.mark.parametrize("value", ["a", "5", None, [], True, float("inf"), -float("inf"), float("nan"), 10**400])
def test_a_malformed_field_of_a_rig_is_named(name, value):
    with pytest.raises(ValueError, match=rf"^stereo rig: field '{name}' must be a .* number"):
        StereoRig.from_dict({**NATECAM.to_dict(), name: value})


def test_a_rig_out_of_range_or_of_another_form_is_refused():
    for name, value in (("width", 0), ("height", -3), ("fx", 0), ("fy", -1.0), ("baseline", 0), ("baseline", 120)):
        with pytest.raises(ValueError, match=f"stereo rig: {name} must be"):
            StereoRig.from_dict({**NATECAM.to_dict(), name: value})
    with pytest.raises(ValueError, match="'height' must be a whole number"):
        StereoRig.from_dict({**NATECAM.to_dict(), "height": 511.5})
    with pytest.raises(ValueError, match="is a list"):
        StereoRig.from_dict([1, 2])


@pytest.mark.parametrize(
    "bad",
    [{"fx": 0.0}, {"width": 0}, {"height": float("nan")}, {"fy": float("nan")}, {"cx": float("nan")}, {"cy": np.inf}],
)
def test_impossible_cameras_are_refused_by_the_fields_name(bad):
    with pytest.raises(ValueError, match=f"^{next(iter(bad))} must be"):
        PinholeCamera(**{"width": 4, "height": 4, "fx": 1.0, "fy": 1.0, "cx": 1.5, "cy": 1.5, **bad})


@pytest.mark.parametrize(
    "bad", [{"width": 65537}, {"height": 1 << 40}, {"cx": 1e300}, {"cy": -1.1e6}, {"fx": 1.1e9}, {"fy": 1e300}]
)
def test_cameras_beyond_all_reason_are_refused_by_the_fields_name(bad):
    with pytest.raises(ValueError, match=rf"^{next(iter(bad))} must (be at most (65536|1e\+09)|lie within)"):
        PinholeCamera(**{"width": 4, "height": 4, "fx": 1.0, "fy": 1.0, "cx": 1.5, "cy": 1.5, **bad})


def test_depth_of_another_size_is_refused():
    with pytest.raises(ValueError, match="must have the shape"):
        NATECAM.camera.unproject(np.ones((3, 4)))


def test_images_have_whole_numbers_of_pixels():
    camera = PinholeCamera(96.0, 64.0, 50.0, 50.0, 47.5, 31.5)
    assert (type(camera.width), type(camera.height)) == (int, int) and camera.rays().shape == (64, 96, 3)
    with pytest.raises(ValueError, match=r"^width must be a whole number of pixels, got 96\.5$"):
        PinholeCamera(96.5, 64, 50.0, 50.0, 47.5, 31.5)


def test_masked_values_are_no_match_and_numbers_of_numpy_are_plain_in_json():
    values = np.ma.array([10.0, 20.0], mask=[True, False])
    for masked in (values, values.astype(int)):
        assert NATECAM.disparity_to_depth(masked) == pytest.approx([np.inf, NATECAM.fb / 20])
        assert NATECAM.depth_to_disparity(masked) == pytest.approx([0, NATECAM.fb / 20])
    rig = StereoRig(PinholeCamera.centred(np.int64(64), 64, np.float32(100.0)), np.float64(0.25))
    assert StereoRig.from_dict(json.loads(json.dumps(rig.to_dict()))) == rig
