from dataclasses import replace

import numpy as np
import raw_pairs

from m3depth.rectification.files import labelled_camera_pose, rig_dict
from m3depth.rectification.pair import RectifiedPair
from marssim.base.calibration.cameras import PosedPair
from marssim.base.calibration.orientation import RectifiedView
from marssim.base.camera import PinholeCamera

CAMERA = PinholeCamera.centred(30, 20, 40.0)
# the camera looks along x of a frame with x ahead, y right and z down: its x is y, its y is z, and its z is x
AHEAD = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])


def pair(frame: str) -> RectifiedPair:
    cameras = raw_pairs.cahvore_pair()
    left = replace(cameras.left, frame=frame, centre=np.array([0.9, 0.3, -1.9]))
    empty = np.zeros((20, 30), np.uint8)
    view = RectifiedView(AHEAD, CAMERA, CAMERA, 0.4)
    posed = PosedPair(left, replace(cameras.right, frame=frame))
    return RectifiedPair(empty, empty, empty > 0, empty > 0, view, None, None, posed)


def test_labels_in_the_rovers_frame_place_the_camera_on_the_rover():
    pose = labelled_camera_pose(pair("ROVER_NAV_FRAME 33 2841"))
    np.testing.assert_allclose(pose @ [0, 0, 2, 1], [2.9, -0.3, 1.9, 1])  # 2 m ahead, at the height of the camera
    np.testing.assert_allclose(pose @ [1, 1, 0, 1], [0.9, -1.3, 0.9, 1])  # to the right, and down
    np.testing.assert_allclose(rig_dict(pair("ROVER_NAV_FRAME 33"))["camera_to_rover"], pose)


def test_other_frames_do_not():
    for frame in ("", "MAST_FRAME 3", "SITE_FRAME 33"):
        assert "camera_to_rover" not in rig_dict(pair(frame))
