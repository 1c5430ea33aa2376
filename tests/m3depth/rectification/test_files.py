from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import raw_pairs
from PIL import Image

from m3depth.rectification.files import labelled_camera_pose, make_report, rig_dict, write_pair
from m3depth.rectification.pair import Matches, RectifiedPair
from m3depth.rectification.raw_image import RawImage
from m3depth.rectification.row_errors import row_errors
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


def test_the_report_gives_a_common_disparity_back_in_depth_and_in_the_rig_file():
    """Z = f B / (d + shift): here 40 px times 0.4 m over -2 px and 5 px."""
    made = pair("")
    at = np.tile([[10.0, 7.0]], (5, 1))
    errors = row_errors(at, at)
    shifted = replace(
        made, view=made.view.with_shift(5.0), matches=Matches(at, at + np.array([2.0, 0.0]), at, at, errors, errors)
    )  # fmt: skip
    image = RawImage(Path("left.png"), made.left, made.left_valid)
    report = make_report(image, image, shifted, "none")
    assert report["depth_of_matches_m"]["percentile_50"] == pytest.approx(40 * 0.4 / 3, abs=1e-3)
    assert report["disparity_of_matches_px"]["percentile_50"] == -2 and report["common_disparity_taken_out_px"] == 5
    assert rig_dict(shifted)["shift"] == 5
    converging = replace(shifted, cameras=raw_pairs.opencv_pair(vergence_deg=9))
    assert make_report(image, image, converging, "none")["vergence_deg"] == pytest.approx(9, abs=0.1)


def test_colours_are_written_in_their_order(tmp_path):
    made = pair("")
    colours = np.random.default_rng(0).integers(0, 256, (20, 30, 3), dtype=np.uint8)
    image = RawImage(Path("left.png"), colours, made.left_valid)
    write_pair(tmp_path, image, image, replace(made, left=colours, right=colours), {}, with_picture=False)
    for eye in ("left", "right"):
        with Image.open(tmp_path / f"{eye}.png") as written:
            np.testing.assert_array_equal(np.asarray(written), colours)
