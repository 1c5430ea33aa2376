"""The views of both rectified cameras."""

import cv2
import numpy as np
import pytest

from marssim.base.calibration.cameras import PosedCamera, PosedPair, first_camera, second_camera
from marssim.base.calibration.lenses.radial_tangential import RadialTangential
from marssim.base.calibration.orientation import common_orientation, rectified_view


@pytest.mark.parametrize("pitch_deg", [2.0, -2.0])
def test_the_middles_of_both_images_lie_equally_far_from_the_middle_row(pitch_deg: float) -> None:
    """The common orientation is turned by half the pitch, so that one middle lies above its axis, the other below."""
    lens, size = RadialTangential(300.0, 300.0, 239.5, 179.5, (0.0, 0.0, 0.0, 0.0)), (480, 360)
    rotation = cv2.Rodrigues(np.array([np.deg2rad(pitch_deg), 0.0, 0.0]))[0]
    pair = PosedPair(first_camera(lens, size), second_camera(lens, rotation, -rotation @ [0.2, 0.0, 0.0], size))
    view = rectified_view(pair, focal=300.0)
    assert view.left.cy == view.right.cy == pytest.approx(179.5)
    assert view.left.cx == view.right.cx == pytest.approx(239.5)


def parallel(left_focal: float, right_focal: float, centre: tuple[float, float, float]) -> PosedPair:
    """Return two cameras without distortion that look along z, the right one at a place [m]."""
    lenses = [RadialTangential(f, f, 159.5, 119.5) for f in (left_focal, right_focal)]
    return PosedPair(
        PosedCamera(lenses[0], np.eye(3), np.zeros(3), (320, 240)),
        PosedCamera(lenses[1], np.eye(3), np.array(centre), (320, 240)),
    )


@pytest.mark.parametrize("focals", [(400.0, 300.0), (300.0, 400.0)])
def test_the_focal_length_is_at_most_that_of_the_shorter_lens(focals):
    """With the shorter one, the rectified image of the other lens is filled only in part."""
    view = rectified_view(parallel(*focals, (0.2, 0.0, 0.0)))
    assert 150 <= view.left.fx <= 300 and view.right.fx == view.left.fx


def test_smaller_images_have_a_focal_length_that_is_as_much_smaller():
    pair = parallel(300.0, 300.0, (0.2, 0.0, 0.0))
    assert rectified_view(pair).left.fx == pytest.approx(300, rel=0.01)
    assert rectified_view(pair, size=(160, 120)).left.fx == pytest.approx(150, rel=0.01)


@pytest.mark.parametrize(
    ("centre", "message"),
    [((-0.2, 0.0, 0.05), "exchange left and right"), ((-0.05, 0.0, 0.2), "do not stand side by side")],
)
def test_a_camera_before_the_other_is_not_called_exchanged(centre, message):
    with pytest.raises(ValueError, match=message):
        common_orientation(parallel(300.0, 300.0, centre))
