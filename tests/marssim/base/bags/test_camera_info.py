"""CameraInfo in a bag: P of the images that there are, by REP 104."""

import cv2
import numpy as np
import pytest

from marssim.base.bags.camera_info import raw_camera, rectified_camera, rectifies_to_another_camera, shows_raw_images
from marssim.base.bags.messages import camera_info_message
from marssim.base.camera import NATECAM


def info():
    return camera_info_message(1, "eye", NATECAM.camera, NATECAM.baseline)


def test_the_whole_image_has_p_as_it_is():
    camera = rectified_camera(info())
    assert camera.size == (512, 512)
    np.testing.assert_array_equal(camera.projection[:, :3], NATECAM.camera.K)
    assert camera.projection[0, 3] == -NATECAM.fb


def test_a_region_and_binning_give_the_camera_of_the_smaller_image():
    message = info()
    message.roi.x_offset, message.roi.y_offset, message.roi.width, message.roi.height = 100, 50, 200, 120
    message.binning_x, message.binning_y = 2, 4
    expected = NATECAM.cropped(100, 50, 200, 120).resized(100, 30)
    camera = rectified_camera(message)
    assert camera.size == (100, 30)
    np.testing.assert_allclose(camera.projection[:, :3], expected.camera.K, atol=1e-12)
    assert camera.projection[0, 3] == pytest.approx(-expected.fb)


@pytest.mark.parametrize("value", [0.0, -1.0])
def test_a_camera_without_calibration_is_reported(value):
    message = info()
    message.p[0] = value
    with pytest.raises(ValueError, match="P has no positive focal length: the camera is not calibrated"):
        rectified_camera(message)


def test_a_baseline_that_is_no_number_is_reported():
    message = info()
    message.p[3] = np.nan
    with pytest.raises(ValueError, match=r"^P holds numbers that are not finite: the camera is not calibrated"):
        rectified_camera(message)


def test_a_distortion_or_a_rotation_tells_raw_images():
    assert not shows_raw_images(info())
    bent, turned, empty = info(), info(), info()
    bent.d[0] = 0.1
    turned.r[1], turned.r[3] = 0.01, -0.01
    empty.r[:] = 0  # as some drivers leave it
    assert shows_raw_images(bent) and shows_raw_images(turned) and not shows_raw_images(empty)


@pytest.mark.parametrize("name", ["d", "r"])
def test_a_distortion_or_a_rotation_that_is_no_number_is_reported(name):
    message = info()
    getattr(message, name)[:] = np.nan
    for read in (shows_raw_images, raw_camera):
        with pytest.raises(ValueError, match=f"^{name.upper()} holds numbers that are not finite: the camera is not"):
            read(message)


@pytest.mark.parametrize(
    ("model", "terms"),
    [
        ("plumb_bob", (-0.2, 0.05, 1e-3, -2e-3, 0.01)), ("equidistant", (0.05, -0.02, 0.01, -0.003)),
        ("rational_polynomial", (0.1, -0.2, 1e-3, 0, 0.02, 0.3, -0.1, 0.01)),
    ],
)  # fmt: skip
def test_a_raw_camera_projects_as_opencv_does(model, terms):
    message = info()
    turn = cv2.Rodrigues(np.array([0.02, -0.03, 0.01]))[0]
    message.distortion_model, message.d, message.r = model, np.array(terms), turn.ravel()
    points = np.random.default_rng(0).uniform([-2, -2, 4], [2, 2, 6], (20, 3))
    local, k = points @ turn, np.array(message.k).reshape(3, 3)  # R takes raw to rectified coordinates
    still = np.zeros(3)
    if model == "equidistant":
        expected = cv2.fisheye.projectPoints(local[None], still, still, k, message.d)[0]
    else:
        expected = cv2.projectPoints(local, still, still, k, message.d)[0]
    np.testing.assert_allclose(raw_camera(message).project(points), expected.reshape(-1, 2), atol=1e-6)


def test_a_distortion_that_is_not_supported_is_named():
    message = info()
    message.distortion_model = "thin_prism"
    with pytest.raises(ValueError, match="distortion_model thin_prism is not supported; plumb_bob"):
        raw_camera(message)


def test_another_focal_length_or_middle_makes_another_camera():
    same, wider, aside = info(), info(), info()
    wider.p[0] = wider.p[5] = 0.8 * wider.p[0]
    aside.p[2] += 10
    assert [rectifies_to_another_camera(message) for message in (same, wider, aside)] == [False, True, True]
    assert not shows_raw_images(wider)
