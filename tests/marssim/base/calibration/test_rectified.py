"""Calibration files of others, read to the depth that they mean."""

import json
import re
from time import process_time

import cv2
import numpy as np
import pytest

from marssim.base.calibration.camera_info import parse_raw_camera
from marssim.base.calibration.read_pair import read_raw_calibration
from marssim.base.calibration.rectified import Calibration, align_right, read_calibration
from marssim.base.camera import NATECAM, PinholeCamera, StereoRig

KITTI = """\
P0: 707.0493 0 604.0814 0 0 707.0493 180.5066 0 0 0 1 0
P1: 707.0493 0 604.0814 -379.7842 0 707.0493 180.5066 0 0 0 1 0
P2: 7.070493e+02 0 6.040814e+02 4.575831e+01 0 7.070493e+02 1.805066e+02 -3.454157e-01 0 0 1 4.981016e-03
P3: 7.070493e+02 0 6.040814e+02 -3.341081e+02 0 7.070493e+02 1.805066e+02 2.330660e+00 0 0 1 3.201153e-03
Tr_velo_to_cam: 6.9e-03 -9.9e-01 -2.7e-03 -2.4e-02 -1.1e-03 2.7e-03 -9.9e-01 -6.1e-02 9.9e-01 1.1e-03 -9.8e-03 -0.33
"""
RAW = "calib_time: 09-Jan-2012 13:57:47\nS_rect_02: 1.242e+03 3.75e+02\n" + KITTI.replace("P", "P_rect_0")
MIDDLEBURY = """\
cam0=[3979.911 0 1244.772; 0 3979.911 1019.507; 0 0 1]
cam1=[3979.911 0 1369.115; 0 3979.911 1019.507; 0 0 1]
doffs=124.343
baseline=193.001
width=2964
height=1988
ndisp=270
"""


def write(path, text):
    path.write_text(text)
    return path


@pytest.mark.parametrize("text", [KITTI, RAW])
def test_kitti_colour_and_grey(tmp_path, text):
    path = write(tmp_path / "calib.txt", text)
    colour = read_calibration(path, image=tmp_path / "image_2" / "0.png")
    assert (colour.fx, colour.fy, colour.cx, colour.cy) == (707.0493, 707.0493, 604.0814, 180.5066)
    assert colour.baseline == pytest.approx((45.75831 + 334.1081) / 707.0493) and colour.shift == 0
    grey = read_calibration(path, image=tmp_path / "image_00" / "data" / "0.png")
    assert grey.baseline == pytest.approx(379.7842 / 707.0493)
    without_colour = [line for line in text.splitlines() if not line.startswith(("P2", "P_rect_02"))]
    only_grey = write(tmp_path / "grey.txt", "\n".join(without_colour))
    assert read_calibration(only_grey).baseline == pytest.approx(grey.baseline)


def test_a_line_that_ends_late_is_read_in_one_pass(tmp_path):
    """It would take hours if each blank were tried as the beginning of the end."""
    line = "isint=0" + " " * 2_000_000 + "x\n"
    assert read_calibration(write(tmp_path / "calib.txt", MIDDLEBURY + line)) == read_calibration(
        write(tmp_path / "calib.txt", MIDDLEBURY)
    )


def test_middlebury(tmp_path):
    parsed = read_calibration(write(tmp_path / "calib.txt", MIDDLEBURY))
    assert parsed == Calibration(3979.911, 3979.911, 1244.772, 1019.507, pytest.approx(0.193001), 124.343, (2964, 1988))
    without = "\n".join(line for line in MIDDLEBURY.splitlines() if line.startswith(("cam", "base")))
    found = read_calibration(write(tmp_path / "eth3d.txt", without))
    assert found.size is None and found.shift == pytest.approx(124.343)  # of the two cameras
    alone = "\n".join(line for line in without.splitlines() if not line.startswith("cam1"))
    assert read_calibration(write(tmp_path / "alone.txt", alone)).shift == 0


@pytest.mark.parametrize("matrices", [("P1", "P2", "Q"), ("Q",)])
@pytest.mark.parametrize("flags", [0, cv2.CALIB_ZERO_DISPARITY])
@pytest.mark.parametrize("ending", ["yml", "xml", "json"])
def test_opencv_after_stereo_rectify(tmp_path, matrices, flags, ending):
    """A point that OpenCV's own matrices put into both images comes back at its depth."""
    camera = [np.array([[f, 0, 310.0], [0, f, 245], [0, 0, 1]]) for f in (500.0, 510.0)]
    turn = cv2.Rodrigues(np.array([0.01, 0.03, -0.02]))[0]
    none = np.zeros(5)
    _, _, p1, p2, q, *_ = cv2.stereoRectify(
        camera[0], none, camera[1], none, (640, 480), turn, np.array([[-0.12], [0.001], [0.002]]), flags=flags
    )
    path = tmp_path / f"stereo.{ending}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, matrix in (("P1", p1), ("P2", p2), ("Q", q)):
        if name in matrices:
            storage.write(name, matrix)
    storage.release()
    parsed = read_calibration(path)
    point = np.array([0.3, -0.2, 2.5, 1])
    left, right = ((p @ point)[:2] / (p @ point)[2] for p in (p1, p2))
    disparity = left[0] - right[0] + parsed.shift
    assert parsed.fx * parsed.baseline / disparity == pytest.approx(2.5, rel=1e-6)
    assert (left[0] - parsed.cx) / parsed.fx * 2.5 == pytest.approx(0.3, rel=1e-6)
    assert (left[1] - parsed.cy) / parsed.fy * 2.5 == pytest.approx(-0.2, rel=1e-6)


def test_json_of_opencv_may_hold_a_baseline_too(tmp_path):
    matrices = {"P1": np.array([[500, 0, 310, 0], [0, 500, 240, 0], [0, 0, 1, 0.0]])}
    matrices["P2"] = matrices["P1"] - np.eye(3, 4, 3) * 60
    content = {**{name: matrix.tolist() for name, matrix in matrices.items()}, "baseline": 0.12, "width": 640}
    parsed = read_calibration(write(tmp_path / "stereo.json", json.dumps(content)))
    assert (parsed.fx, parsed.cx, parsed.baseline) == (500, 310, pytest.approx(0.12))
    raw = write(tmp_path / "raw.json", json.dumps({"K1": np.eye(3).tolist(), "baseline": 0.12}))
    with pytest.raises(ValueError, match="is a calibration of images that are not rectified"):
        read_calibration(raw)


def test_a_dataset_says_what_its_rig_is(tmp_path):
    parsed = read_calibration(write(tmp_path / "sample.json", json.dumps({"rig": NATECAM.to_dict(), "sun": 3})))
    assert parsed.rig(512, 512) == NATECAM and parsed.size == (512, 512)


def test_the_right_eye_is_moved_by_the_difference_of_the_principal_points():
    """Fractions too: a ramp of 4 grey levels a pixel moves by that much."""
    ramp = np.repeat(np.arange(10, 250, 4, dtype=np.uint8)[None], 5, axis=0)
    moved = align_right(ramp, 3.25)
    assert moved.shape == ramp.shape and (moved[:, 3:50].astype(int) == ramp[:, 3:50].astype(int) + 13).all()
    assert align_right(ramp, 0.0) is ramp


def test_a_rig_file_of_the_simulator(tmp_path):
    parsed = read_calibration(write(tmp_path / "rig.json", json.dumps({"rig": {**NATECAM.to_dict(), "shift": 30}})))
    assert parsed.shift == 30
    parsed = read_calibration(write(tmp_path / "rig.json", json.dumps(NATECAM.to_dict())))
    assert parsed.rig(512, 512) == NATECAM and parsed.size == (512, 512)


def test_a_rig_file_with_lenses_is_no_calibration_of_rectified_images(tmp_path):
    rig = {**NATECAM.to_dict(), "distortion_model": "plumb_bob", "distortion_coefficients": [-0.2], "vergence_deg": 1.5}
    path = tmp_path / "lenses.json"
    path.write_text(json.dumps(rig))
    for read in (lambda: read_calibration(path), lambda: read_raw_calibration((path,))):
        with pytest.raises(ValueError, match=r"lenses\.json: describes raw cameras \(distortion_coefficients, verg"):
            read()


def test_a_rig_file_whose_lenses_are_ideal_is_one(tmp_path):
    rig = {**NATECAM.to_dict(), "distortion_model": "plumb_bob", "distortion_coefficients": [0, 0.0], "vergence_deg": 0}
    path = write(tmp_path / "rig.json", json.dumps({**rig, "rotation_deg": [0, 0, 0]}))
    assert read_calibration(path).rig(512, 512) == NATECAM


@pytest.mark.parametrize("text", ['{"a":' * 10**5, '{"rig": ' + "[" * 50 + "]" * 50 + "}"])
def test_json_nested_too_deeply_is_refused(tmp_path, text):
    with pytest.raises(ValueError, match=r"deep\.json: is nested too deeply"):
        read_calibration(write(tmp_path / "deep.json", text))


def camera_info(tx: float) -> str:
    """As camera_calibration saves it."""
    return f"""\
image_width: 640
image_height: 480
camera_name: narrow_stereo/left
camera_matrix:
  rows: 3
  cols: 3
  data: [500.0, 0., 319.5, 0., 500.0, 239.5, 0., 0., 1.]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.1, 0.05, 0.0, 0.0, 0.0]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1., 0., 0., 0., 1., 0., 0., 0., 1.]
projection_matrix:
  rows: 3
  cols: 4
  data: [480.5, 0.00000,
         310.25, {tx}, 0.,
         481.5, 245.75, 0., 0., 0., 1., 0.]
"""


ROWS = (480.5, 0, 310.25, -57.66, 0, 481.5, 245.75, 0, 0, 0, 1, 0)
ROS_1 = f"height: 480\nwidth: 640\ndistortion_model: x\nK: [1.0, 0.0]\nP: {list(ROWS)}\n"
ROS_2 = "height: 480\nwidth: 640\np:\n" + "".join(f"- {x}\n" for x in ROWS)
ROS_2 += "binning_x: 0\n"


def test_camera_infos_of_ros(tmp_path):
    left = write(tmp_path / "left.yaml", camera_info(0.0))
    right = write(tmp_path / "right.yaml", camera_info(-57.66))
    wanted = Calibration(480.5, 481.5, 310.25, 245.75, pytest.approx(0.12), 0.0, (640, 480))
    assert read_calibration(left, right) == wanted
    assert read_calibration(right) == wanted
    assert read_calibration(left, baseline=0.12) == wanted
    for name, text in (("one", ROS_1), ("two", ROS_2)):
        assert read_calibration(write(tmp_path / f"{name}.yaml", text)) == wanted
    with pytest.raises(
        ValueError,
        match=r"left\.yaml: is the left camera's CameraInfo \(Tx = 0\); give the right camera's, which holds",
    ):
        read_calibration(left)
    with pytest.raises(ValueError, match=r"right\.yaml: the left camera's CameraInfo .* comes first"):
        read_calibration(right, left)
    with pytest.raises(ValueError, match=r"calib\.txt: is not a CameraInfo of ROS"):
        read_calibration(write(tmp_path / "calib.txt", MIDDLEBURY), right)


def test_the_camera_info_of_binned_images_of_a_region_is_that_of_these_images(tmp_path):
    full = StereoRig(PinholeCamera(640, 480, 480.5, 481.5, 310.25, 245.75), 0.12)
    wanted = full.cropped(100, 50, 400, 300).resized(200, 150)
    roi = "roi:\n  x_offset: 100\n  y_offset: 50\n  height: 300\n  width: 400\n  do_rectify: false\n"
    text = ROS_2.replace("binning_x: 0\n", f"binning_x: 2\nbinning_y: 2\n{roi}")
    found = read_calibration(write(tmp_path / "part.yaml", text))
    assert found.size == (200, 150) and found.baseline == pytest.approx(0.12)
    np.testing.assert_allclose(found.rig(200, 150).camera.K, wanted.camera.K, atol=1e-9)
    whole = text.replace("400", "0").replace("300", "0").replace("binning_x: 2\nbinning_y: 2", "binning_x: 1")
    assert read_calibration(write(tmp_path / "whole.yaml", whole)).size == (640, 480)


@pytest.mark.parametrize("size", [{"image_width": 640, "image_height": 480}, {"imageSize": [640, 480]}, {}])
@pytest.mark.parametrize("matrices", [("P1", "P2"), ("Q",)])
def test_a_calibration_of_opencv_knows_the_size_of_its_images(tmp_path, size, matrices):
    p1 = [[500, 0, 310, 0], [0, 500, 240, 0], [0, 0, 1, 0]]
    p2 = [[500, 0, 310, -60], *p1[1:]]
    q = [[1, 0, 0, -310], [0, 1, 0, -240], [0, 0, 0, 500], [0, 0, 1 / 0.12, 0]]
    content = {name: matrix for name, matrix in (("P1", p1), ("P2", p2), ("Q", q)) if name in matrices}
    parsed = read_calibration(write(tmp_path / "stereo.json", json.dumps({**content, **size})))
    assert parsed.size == ((640, 480) if size else None) and parsed.baseline == pytest.approx(0.12)


def test_camera_infos_with_other_principal_points_shift(tmp_path):
    left = write(tmp_path / "left.yaml", camera_info(0.0))
    right = write(tmp_path / "right.yaml", camera_info(-57.66).replace("310.25", "313.75"))
    assert read_calibration(left, right).shift == 3.5


def projections(**right):
    """P1 and P2 of a pair, with other values of P2 by their places, as f or y."""
    values = {"f": 500.0, "row": 239.5, "x": -60.0, "y": 0.0, **right}
    p1 = [[500.0, 0, 319.5, 0], [0, 500.0, 239.5, 0], [0, 0, 1, 0]]
    p2 = [[values["f"], 0, 319.5, values["x"]], [0, values["f"], values["row"], values["y"]], [0, 0, 1, 0]]
    return json.dumps({"P1": p1, "P2": p2})


@pytest.mark.parametrize(
    ("right", "message"),
    [
        ({"f": 400.0}, "the focal lengths of the two cameras are 500 and 400 px"),
        ({"row": 236.5}, "the principal points' rows of the two cameras are 239.5 and 236.5 px"),
        ({"x": 0.0, "y": -60.0}, "one camera stands above the other"),
    ],
)
def test_cameras_that_no_rectified_pair_has_are_refused(tmp_path, right, message):
    assert read_calibration(write(tmp_path / "pair.json", projections(f=500.01))).baseline == pytest.approx(0.12, 1e-3)
    path = write(tmp_path / "mixed.json", projections(**right))
    with pytest.raises(ValueError, match=message) as caught:
        read_calibration(path)
    assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)


def test_camera_infos_for_images_of_two_sizes_are_refused(tmp_path):
    left = write(tmp_path / "left.yaml", camera_info(0.0))
    right = write(tmp_path / "right.yaml", camera_info(-57.66).replace("640", "1280"))
    with pytest.raises(ValueError, match="are for images of 640 x 480 and 1280 x 480 px: both must have one size"):
        read_calibration(left, right)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nothing of this\n", "is not a calibration of KITTI"),
        ("cam0:\n  intrinsics: [1, 2\n", "is not YAML in line"),
        ("", "is not a calibration of KITTI"),
        ("P2: 1 2 3\nP3: 1 2 3\n", "P2 must have 12 numbers, has 3"),
        ("P2: " + "1 " * 12 + "\n", "lacks the projection matrices of two cameras"),
        (KITTI.replace("707.0493 0", "0 0").replace("7.070493e+02 0", "0 0"), "no positive focal length"),
        (MIDDLEBURY.replace("baseline", "base"), "field baseline is missing"),
        (MIDDLEBURY.replace("193.001", "wide"), "field baseline must be a number, got 'wide'"),
        (MIDDLEBURY.replace("124.343", ""), "field doffs must be a number, got ''"),
        (MIDDLEBURY.replace("124.343", "0"), "doffs is 0 px, and the cx of cam0 and cam1 are 124.343 px apart"),
        (MIDDLEBURY.replace("cam1=[3979", "cam1=[3970"), "cam0 and cam1 differ in more than"),
        (MIDDLEBURY.replace("1019.507; 0 0 1]\ndoffs", "1020.507; 0 0 1]\ndoffs"), "cam0 and cam1 differ in more than"),
        (
            KITTI.replace("7.070493e+02 1.805066e+02 2.33", "7.080493e+02 1.805066e+02 2.33"),
            "the vertical focal lengths",
        ),
        (MIDDLEBURY.replace("=2964", "=2964.5"), "width and height must be whole numbers, got 2964.5 and 1988"),
        (MIDDLEBURY.replace("; 0 0 1]", "]"), "cam0 must have 9 numbers, has 6"),
        (MIDDLEBURY.replace("cam0=[3979.911 0", "cam0=[0 0"), "fx must be positive and finite"),
        (MIDDLEBURY.replace("doffs=124.343", "doffs=nan"), "shift must be finite"),
        (MIDDLEBURY.replace("193.001", "nan"), "baseline must be finite"),
        (KITTI.replace("6.040814e+02", "6.040814e+09"), "cx must lie within"),
        ("%YAML:1.0\n---\nM1: 3\n", "rectify the images first"),
        ("%YAML:1.0\n---\nP1: [1, 2\n", "is not YAML in line 3: "),
        ('{"rig": {"width": 5}}', "'height' is missing"),
        ('{"baseline": 0.2, "width": 5}', "'height' is missing"),
        (camera_info(-57.66).replace("245.75, ", ""), "projection_matrix must have 12 numbers, has 11"),
        (camera_info(-57.66).replace("480.5", "0.0"), "the camera is not calibrated"),
    ],
)
def test_what_cannot_be_used_is_one_line(tmp_path, text, message):
    path = write(tmp_path / "calib.txt", text)
    with pytest.raises(ValueError, match=message) as caught:
        read_calibration(path)
    assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)


def test_intrinsics_and_extrinsics_of_opencv_in_two_files(tmp_path):
    """As OpenCV's sample stereo_calib writes them: the second holds what rectified images need."""
    camera, none = np.array([[500.0, 0, 310], [0, 500, 245], [0, 0, 1]]), np.zeros(5)
    moved = np.array([[-0.12], [0], [0]])
    _, _, p1, p2, q, *_ = cv2.stereoRectify(camera, none, camera, none, (640, 480), np.eye(3), moved)
    files = {
        "intrinsics": {"M1": camera, "D1": none, "M2": camera, "D2": none},
        "extrinsics": {"P1": p1, "P2": p2, "Q": q},
    }
    for name, matrices in files.items():
        storage = cv2.FileStorage(str(tmp_path / f"{name}.yml"), cv2.FILE_STORAGE_WRITE)
        for key, matrix in matrices.items():
            storage.write(key, matrix)
        storage.release()
    first, second = (tmp_path / f"{name}.yml" for name in files)
    assert read_calibration(first, second) == read_calibration(second, first) == read_calibration(second)
    with pytest.raises(
        ValueError, match=r"intrinsics\.yml: is not a CameraInfo of ROS, and neither file holds P1 and P2"
    ):
        read_calibration(first, first)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.txt: no such calibration file"):
        read_calibration(tmp_path / "none.txt")


def test_a_binary_file_is_refused_as_calibration(tmp_path):
    (tmp_path / "image.png").write_bytes(b"\x89PNG\r\n\xff\xfe")
    with pytest.raises(ValueError, match=r"image\.png: is not a text file [^\n]*, as a calibration file is$"):
        read_calibration(tmp_path / "image.png")


@pytest.mark.parametrize("shift", [0.1, 0.25, 0.3, 0.5, 0.911, 3.75, 7.25, -2.3])
def test_a_right_eye_that_is_moved_by_a_part_of_a_pixel_shows_what_it_should(shift):
    """A wave along the rows, whose phase tells by how much it was moved."""
    columns, turn = np.arange(400.0), 2 * np.pi * 17 / 320  # 17 waves of the columns that count, each rounded otherwise
    wave = np.broadcast_to(128 + 100 * np.sin(turn * columns), (5, 400)).round().astype(np.uint8)
    moved = align_right(wave, shift)[2, 40:-40].astype(float)
    phase = np.angle((moved * np.exp(-1j * turn * columns[40:-40])).sum()) + np.pi / 2
    assert phase / turn == pytest.approx(shift, abs=5e-3)


PROJECTION = "P: [500, 0, 320, 0, 0, 500, 240, 0, 0, 0, 1, 0]"


@pytest.mark.parametrize("start", ["", "P:", "K:", "projection_matrix:", "%YAML:1.0", "cam0", "cam0=", PROJECTION])
def test_many_blank_lines_take_no_time(tmp_path, start):
    """Matched by two parts of a pattern, they took 18 s at 3 kB, and eight times that at twice the size."""
    began = process_time()
    file = write(tmp_path / "blank.yaml", start + 40_000 * "\n" + "x\n")
    for read in (read_calibration, lambda file: read_raw_calibration([file])):
        with pytest.raises(ValueError):
            read(file)
    assert process_time() - began < 5


def test_coefficients_that_are_no_numbers_are_refused(tmp_path):
    for term in (".nan", "none"):
        text = camera_info(0.0).replace("[-0.1, 0.05, 0.0", f"[-0.1, {term}, 0.0")
        with pytest.raises(ValueError, match="distortion_coefficients must"):
            parse_raw_camera(text)
    rows = "D:\n- -0.1\n- .nan\n- 0.0\n- 0.0\n- 0.0\n"
    with pytest.raises(ValueError, match="distortion_coefficients must"):
        parse_raw_camera(re.sub(r"distortion_coefficients:(\n  .*){3}\n", rows, camera_info(0.0)))
