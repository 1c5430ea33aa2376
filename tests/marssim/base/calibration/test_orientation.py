"""The views of both rectified cameras."""

import cv2
import numpy as np
import pytest

from marssim.base.calibration.cameras import PosedPair, first_camera, second_camera
from marssim.base.calibration.lenses.radial_tangential import RadialTangential
from marssim.base.calibration.orientation import rectified_view


@pytest.mark.parametrize("pitch_deg", [2.0, -2.0])
def test_the_middles_of_both_images_lie_equally_far_from_the_middle_row(pitch_deg: float) -> None:
    """The common orientation is turned by half the pitch, so that one middle lies above its axis, the other below."""
    lens, size = RadialTangential(300.0, 300.0, 239.5, 179.5, (0.0, 0.0, 0.0, 0.0)), (480, 360)
    rotation = cv2.Rodrigues(np.array([np.deg2rad(pitch_deg), 0.0, 0.0]))[0]
    pair = PosedPair(first_camera(lens, size), second_camera(lens, rotation, -rotation @ [0.2, 0.0, 0.0], size))
    view = rectified_view(pair, focal=300.0)
    assert view.left.cy == view.right.cy == pytest.approx(179.5)
    assert view.left.cx == view.right.cx == pytest.approx(239.5)
