"""Calibrations of raw pairs: written in each format and read back, and what is no calibration."""

import json
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from marssim.base.calibration.camera_info import camera_info_texts
from marssim.base.calibration.cameras import PosedCamera, PosedPair, first_camera, from_vectors, second_camera
from marssim.base.calibration.kalibr import kalibr_text
from marssim.base.calibration.lenses.fisheye import Fisheye
from marssim.base.calibration.lenses.radial_tangential import RadialTangential
from marssim.base.calibration.opencv_file import opencv_text
from marssim.base.calibration.orientation import common_orientation, rectified_view
from marssim.base.calibration.pds3_label import camera_group
from marssim.base.calibration.read_pair import (
    calibration_of_distorted_images,
    has_label,
    is_of_raw_cameras,
    read_label,
    read_raw_calibration,
)
from marssim.base.camera import NATECAM

SIZE = (640, 480)
TURN = cv2.Rodrigues(np.array([0.01, 0.03, -0.02]))[0]
RADTAN = (-0.21, 0.05, 1e-3, -7e-4)
POINTS = np.random.default_rng(2).uniform(-1, 1, (40, 3)) * [1.2, 0.9, 0.5] + [0.1, 0, 3]


def pair(lens=RadialTangential, terms=RADTAN):
    lenses = (lens(505.0, 503.5, 321.25, 238.0, terms), lens(499.0, 500.5, 317.0, 242.5, terms))
    return PosedPair(first_camera(lenses[0], SIZE), second_camera(lenses[1], TURN, np.array([-0.12, 1e-3, 2e-3]), SIZE))


def assert_same(read: PosedPair, wanted: PosedPair, tolerance: float = 1e-6) -> None:
    """Both pairs show the same points at the same pixels, up to the frame in which the rig is described."""
    turn = wanted.left.rotation.T @ read.left.rotation  # frame of `read` to that of `wanted`
    moved = (POINTS - wanted.left.centre) @ turn + read.left.centre
    for eye in ("left", "right"):
        assert np.abs(getattr(read, eye).project(moved) - getattr(wanted, eye).project(POINTS)).max() < tolerance
        assert getattr(read, eye).size == SIZE
    assert read.baseline == pytest.approx(wanted.baseline, rel=1e-9)


@pytest.mark.parametrize("lens", [RadialTangential, Fisheye])
def test_opencv_as_we_write_it(tmp_path, lens):
    path = tmp_path / "stereo.yml"
    path.write_text(opencv_text(pair(lens)))
    assert_same(read_raw_calibration([path]), pair(lens))
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)  # OpenCV reads it too
    assert storage.getNode("K2").mat()[0, 0] == 499.0 and storage.getNode("D1").mat().shape == (1, 4)


@pytest.mark.parametrize("ending", ["yml", "xml", "json"])
@pytest.mark.parametrize("split", [False, True])
def test_opencv_as_opencv_writes_it(tmp_path, ending, split):
    wanted = pair()
    k = [np.array([[x.fx, 0, x.cx], [0, x.fy, x.cy], [0, 0, 1]]) for x in (wanted.left.lens, wanted.right.lens)]
    files = [tmp_path / f"intrinsics.{ending}", tmp_path / f"extrinsics.{ending}"]
    values = [{"M1": k[0], "D1": np.array([RADTAN]), "M2": k[1], "D2": np.array([RADTAN]).T}, {}]
    values[1 if split else 0].update(R=TURN, T=np.array([[-0.12], [1e-3], [2e-3]]))
    for file, content in zip(files, values):
        storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_WRITE)
        storage.write("image_width", SIZE[0])
        storage.write("image_height", SIZE[1])
        for name, matrix in content.items():
            storage.write(name, matrix)
        storage.release()
    assert_same(read_raw_calibration(files if split else files[:1]), wanted)


def test_which_calibrations_are_of_raw_cameras_alone(tmp_path):
    files = {name: tmp_path / name for name in ("opencv.yml", "both.yml", "chain.yaml", "left.yaml", "right.yaml")}
    files["opencv.yml"].write_text(opencv_text(pair()))
    files["both.yml"].write_text(opencv_text(pair()) + "P1: [1, 2]\nP2: [3, 4]\n")
    files["chain.yaml"].write_text(kalibr_text(pair()))
    for name, text in zip(("left.yaml", "right.yaml"), camera_info_texts(pair(), rectified_view(pair()))):
        files[name].write_text(text)
    assert is_of_raw_cameras([files["opencv.yml"]]) and is_of_raw_cameras([files["chain.yaml"]])
    assert not is_of_raw_cameras([files["both.yml"]])
    assert calibration_of_distorted_images([files["both.yml"]]) == files["both.yml"]
    infos = [files["left.yaml"], files["right.yaml"]]
    assert not is_of_raw_cameras(infos) and calibration_of_distorted_images(infos) == files["left.yaml"]
    for file in infos:  # cameras whose images are rectified as they are
        text = file.read_text()
        for field, data in (
            ("distortion_coefficients", [0] * 5),
            ("rectification_matrix", [1, 0, 0, 0, 1, 0, 0, 0, 1]),
        ):
            text = re.sub(rf"({field}:.*?data: )\[[^]]*\]", rf"\g<1>{data}", text, flags=re.DOTALL)
        file.write_text(text)
    assert calibration_of_distorted_images(infos) is None
    (tmp_path / "kitti.txt").write_text("P2: 7 0 6 0 0 7 3 0 0 0 1 0\nP3: 7 0 6 -3 0 7 3 0 0 0 1 0\n")
    assert not is_of_raw_cameras([tmp_path / "kitti.txt"])


def test_opencv_with_the_matrices_of_stereo_rectify_instead_of_the_pose(tmp_path):
    wanted = pair()
    k = [np.array([[x.fx, 0, x.cx], [0, x.fy, x.cy], [0, 0, 1]]) for x in (wanted.left.lens, wanted.right.lens)]
    d = np.array(RADTAN)
    r1, r2, p1, p2, *_ = cv2.stereoRectify(k[0], d, k[1], d, SIZE, TURN, np.array([[-0.12], [1e-3], [2e-3]]))
    names = {"K1": k[0], "K2": k[1], "D1": d, "D2": d, "R1": r1, "R2": r2, "P1": p1, "P2": p2}
    path = tmp_path / "stereo.json"
    path.write_text(json.dumps({"image_size": SIZE, **{name: matrix.tolist() for name, matrix in names.items()}}))
    assert_same(read_raw_calibration([path]), wanted)


def test_a_rotation_vector_and_the_fisheye_flag(tmp_path):
    wanted = pair(Fisheye)
    k = [[[x.fx, 0, x.cx], [0, x.fy, x.cy], [0, 0, 1]] for x in (wanted.left.lens, wanted.right.lens)]
    content = {"K1": k[0], "K2": k[1], "D1": RADTAN, "D2": RADTAN, "R": [0.01, 0.03, -0.02], "T": [-0.12, 1e-3, 2e-3]}
    path = tmp_path / "stereo.json"
    path.write_text(json.dumps({**content, "width": 640, "height": 480}))
    assert_same(read_raw_calibration([path], fisheye=True), wanted)


@pytest.mark.parametrize(
    ("lens", "terms"),
    [(RadialTangential, RADTAN), (Fisheye, RADTAN), (RadialTangential, (-0.2, 0.05, 0, 0, 0.01, 0.02, 0, 0))],
)
def test_camera_infos_of_ros(tmp_path, lens, terms):
    wanted = pair(lens, terms)
    files = [tmp_path / "left.yaml", tmp_path / "right.yaml"]
    for file, text in zip(files, camera_info_texts(wanted, rectified_view(wanted))):
        file.write_text(text)
    assert_same(read_raw_calibration(files), wanted)


@pytest.mark.parametrize("lens", [RadialTangential, Fisheye])
def test_kalibr(tmp_path, lens):
    path = tmp_path / "camchain.yaml"
    path.write_text(kalibr_text(pair(lens)))
    assert_same(read_raw_calibration([path]), pair(lens))


def test_a_rig_of_the_simulator_is_two_pinholes(tmp_path):
    path = tmp_path / "rig.json"
    path.write_text(json.dumps({**NATECAM.to_dict(), "shift": 3.0}))
    read = read_raw_calibration([path])
    assert read.baseline == NATECAM.baseline and read.right.lens.cx == NATECAM.camera.cx + 3
    assert np.allclose(common_orientation(read), np.eye(3))


def rover_pair(kind=2, r=(1e-6, 0.05, -0.017), e=(1e-4, -2e-4, 3e-5)):
    """Two CAHVORE cameras in a frame with z down, as a rover's, that look ahead and down."""
    linearity = {1: 1.0, 2: 0.0, 3: 0.4}[kind]
    axis = np.array([0.83, 0.01, 0.55]) / np.linalg.norm([0.83, 0.01, 0.55])
    right = np.array([0.0, 1.0, 0.0])
    right = right - (right @ axis) * axis
    right /= np.linalg.norm(right)
    h, v = 350 * right + 319.5 * axis, 352 * np.cross(axis, right) + 239.5 * axis
    optical = axis + 0.001 * right
    both = [
        from_vectors(
            np.array([0.9, y, -1.9]), axis, h, v, optical / np.linalg.norm(optical), r, e, linearity, SIZE, "ROVER"
        )
        for y in (-0.2, 0.22)
    ]
    return PosedPair(*both)


def detached_label(camera: PosedCamera, **keys) -> str:
    keys = {"FRAME_ID": "LEFT", "START_TIME": "2023-02-17T05:22:09.508", "ROVER_MOTION_COUNTER": "(33,2841,1)", **keys}
    head = "\r\n".join(f"{key} = {value}" for key, value in keys.items())
    image = f"OBJECT = IMAGE\r\n LINES = {SIZE[1]}\r\n LINE_SAMPLES = {SIZE[0]}\r\nEND_OBJECT = IMAGE"
    return f"PDS_VERSION_ID = PDS3\r\n/* GROUP = no group */\r\n{head}\r\n{camera_group(camera)}\r\n{image}\r\nEND\r\n"


def pds4_label(camera: PosedCamera) -> str:
    lens, turn = camera.lens, camera.rotation
    vectors = {
        "Center": ("position", camera.centre), "Axis": ("unit", lens.a @ turn), "Horizontal": ("pixel", lens.h @ turn),
        "Vertical": ("pixel", lens.v @ turn), "Optical": ("unit", lens.o @ turn),
    }  # fmt: skip
    model = "".join(
        f"<geom:Vector_{name}>"
        + "".join(f"<geom:{axis}_{unit}>{float(x)!r}</geom:{axis}_{unit}>" for axis, x in zip("xyz", vector))
        + f"</geom:Vector_{name}>"
        for name, (unit, vector) in vectors.items()
    )
    for name, terms in (("Radial", lens.r), ("Entrance", lens.e)):
        values = "".join(f"<geom:c{i}>{x!r}</geom:c{i}>" for i, x in enumerate(terms))
        model += f"<geom:{name}_Terms>{values}</geom:{name}_Terms>"
    axes = "".join(
        f"<Axis_Array><axis_name>{name}</axis_name><elements>{n}</elements></Axis_Array>"
        for name, n in (("Line", SIZE[1]), ("Sample", SIZE[0]))
    )
    return (
        '<?xml version="1.0"?><Product_Observational xmlns="http://pds.nasa.gov/pds4/pds/v1" xmlns:geom="http://g">'
        f"<File_Area_Observational><Array_2D_Image>{axes}</Array_2D_Image></File_Area_Observational>"
        "<geom:Camera_Model_Parameters><geom:model_type>CAHVORE</geom:model_type><geom:CAHVORE_Model>"
        f"<geom:cahvore_model_type>2</geom:cahvore_model_type>{model}"
        "</geom:CAHVORE_Model></geom:Camera_Model_Parameters></Product_Observational>"
    )


@pytest.mark.parametrize("kind", [1, 2, 3])
def test_labels_of_pds3(tmp_path, kind):
    wanted = rover_pair(kind)
    files = [tmp_path / "left.LBL", tmp_path / "right.LBL"]
    for file, camera in zip(files, (wanted.left, wanted.right)):
        file.write_text(detached_label(camera))
    read = read_raw_calibration(files)
    points = POINTS @ wanted.left.rotation + wanted.left.centre
    for eye in ("left", "right"):
        shown = getattr(read, eye).project(points)
        assert np.isfinite(shown).all()
        assert np.abs(shown - getattr(wanted, eye).project(points)).max() < 1e-7


@pytest.mark.parametrize(
    ("pointer", "least"),
    [("3", 2 * 1280), ("2561 <BYTES>", 2560), ("2561<BYTES>", 2560), ('("OTHER.IMG", 3)', None), ('"OTHER.IMG"', None)],
)
def test_the_bytes_that_a_product_must_have_count_from_its_pointer(tmp_path, pointer, least):
    text = detached_label(rover_pair().left, **{"RECORD_BYTES": 1280, "^IMAGE": pointer})
    (tmp_path / "left.IMG").write_text(text.replace("LINES =", "SAMPLE_BITS = 16\r\n LINES ="))
    label = read_label(tmp_path / "left.IMG")
    assert label.file_bytes == (None if least is None else least + 2 * SIZE[0] * SIZE[1])


def test_a_label_is_known_by_its_beginning_even_if_it_is_cut(tmp_path):
    left = rover_pair().left
    for text, known in ((detached_label(left), True), (pds4_label(left), True), ("P1: 1 2 3", False)):
        (tmp_path / "file").write_text(text[:60])
        assert has_label(tmp_path / "file") == known


def test_labels_of_pds4(tmp_path):
    wanted = rover_pair()
    files = [tmp_path / "left.xml", tmp_path / "right.xml"]
    for file, camera in zip(files, (wanted.left, wanted.right)):
        file.write_text(pds4_label(camera))
    read = read_raw_calibration(files)
    points = POINTS @ wanted.left.rotation + wanted.left.centre
    assert np.abs(read.right.project(points) - wanted.right.project(points)).max() < 1e-7
    assert read.left.size == SIZE


def test_positions_of_pds4_in_another_unit(tmp_path):
    wanted = rover_pair()
    files = [tmp_path / "left.xml", tmp_path / "right.xml"]

    def write(unit):
        for file, camera in zip(files, (wanted.left, wanted.right)):
            file.write_text(re.sub("_position>(?=[-0-9])", f'_position unit="{unit}">', pds4_label(camera)))

    write("cm")
    assert read_raw_calibration(files).baseline == pytest.approx(wanted.baseline / 100)
    write("ft")
    with pytest.raises(ValueError, match=r"left\.xml: Vector_Center: unit ft is unknown; m, cm, mm, km are known"):
        read_raw_calibration(files)


def test_camera_infos_of_plumb_bob_have_five_numbers():
    lens = RadialTangential(500.0, 500.0, 319.5, 239.5, (-0.2, 0.05, 1e-3, 2e-3))
    cameras = PosedPair(first_camera(lens, SIZE), second_camera(lens, np.eye(3), np.array([-0.12, 0, 0]), SIZE))
    for text in camera_info_texts(cameras, rectified_view(cameras)):
        assert "distortion_model: plumb_bob" in text and "cols: 5\n  data: [-0.2, 0.05, 0.001, 0.002, 0.0]" in text


def test_labels_of_vicar(tmp_path):
    wanted = rover_pair()
    files = [tmp_path / "left.VIC", tmp_path / "right.VIC"]
    for file, camera in zip(files, (wanted.left, wanted.right)):
        keys = re.findall(r"^  (\w+) = (.*)$", camera_group(camera), re.MULTILINE)
        model = "  ".join(f"{key}={value}".replace('"', "'") for key, value in keys)
        label = f"FORMAT='HALF'  NL=480  NS=640  NB=1  RECSIZE=1280  NLB=0  PROPERTY='GEOMETRIC_CAMERA_MODEL'  {model}"
        file.write_text(f"LBLSIZE=2560  {label}  TASK='X'  NL=3".ljust(2560, "\0"))
    points = POINTS @ wanted.left.rotation + wanted.left.centre
    read = read_raw_calibration(files)
    assert np.abs(read.left.project(points) - wanted.left.project(points)).max() < 1e-7 and read.left.size == SIZE


def vicar(tmp_path, text: str):
    (tmp_path / "left.VIC").write_text(f"LBLSIZE=512  NL=4  NS=6  RECSIZE=6  {text}".ljust(512, "\0"))
    return read_label(tmp_path / "left.VIC")


@pytest.mark.parametrize("text", ["PROPERTY='NL'  Q=1", "IDENTIFICATION='x'", "IMAGE_DATA='x'"])
def test_a_value_of_vicar_with_the_name_of_a_property_leaves_the_rest_of_the_label(tmp_path, text):
    label = vicar(tmp_path, f"{text}  PROPERTY='INSTRUMENT_STATE_PARMS'  INSTRUMENT_ID='NAV_LEFT'")
    assert label.size == (6, 4) and label.eye == "left" and label.file_bytes == 512 + 4 * 6


def test_no_key_of_a_label_is_taken_for_the_size_of_its_file(tmp_path):
    (tmp_path / "left.LBL").write_text(detached_label(rover_pair().left, file_bytes="many"))
    assert read_label(tmp_path / "left.LBL").file_bytes is None


YAML = opencv_text(pair())


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (YAML.replace("radtan", "omnidir"), "distortion_model omnidir is not supported; radtan, plumb_bob"),
        (YAML.replace("rows: 3\n   cols: 3", "rows: 2\n   cols: 3", 1), "field K1 must have 2 x 3 numbers, has 9"),
        (YAML.replace("rows: 3\n", "rows: true\n", 1), "field K1 must have whole numbers of rows and cols"),
        (YAML.replace("505.0", ".nan"), "field K1 has a value that is no finite number"),
        (YAML.replace("505.0", "wide"), "field K1 must hold numbers only"),
        (YAML.replace("R: ", "X: "), "holds neither R and T nor R1, R2 and P2"),
        (YAML.replace("K2", "C2"), "field K2 or M2 .* is missing"),
        (YAML.replace("640", "many"), "image_width must hold numbers only"),
        (YAML.replace("-0.12", "-120.0"), "stand .* m apart; is the translation in millimetres"),
        (YAML.replace("T: ", "T: &a ") + "again: *a\n", r"has aliases"),
        (YAML.replace("640", "!!bool wide"), "is not YAML: a value is not of the type that its tag"),
        (YAML.replace("640", "!!int ''"), "is not YAML: a value is not of the type that its tag"),
        (YAML.replace("640", "!!float ''"), "is not YAML: a value is not of the type that its tag"),
        (YAML.replace("640", "!!timestamp now"), "is not YAML: a value is not of the type that its tag"),
        ("<?xml version='1.0' encoding='foo'?><opencv_storage/>", "is not XML: unknown encoding: foo"),
        ("%YAML:1.0\n---\nK1: " + "[" * 10**5, "nested too deeply"),
        ("<?xml version='1.0'?><opencv_storage>" + "<a>" * 10**5, "nested too deeply"),
        ("<!DOCTYPE x [<!ENTITY a 'b'>]><opencv_storage>&a;</opencv_storage>", "has a document type"),
        ('{"K1":' * 10**5, "nested too deeply"),
        (kalibr_text(pair()).replace("pinhole", "omni"), "cam0: camera_model omni .* is not supported"),
        (kalibr_text(pair()).partition("cam1:")[0], "field cam1 is missing"),
        ("nothing of this\n", "is not a calibration of KITTI"),
        ("", "is not a calibration of KITTI"),
    ],
)
def test_what_is_no_calibration_is_one_line(tmp_path, text, says):
    path = tmp_path / "stereo.yml"
    path.write_text(text)
    with pytest.raises(ValueError, match=says) as caught:
        read_raw_calibration([path])
    assert str(caught.value).startswith(str(path)) or "apart" in says
    assert "\n" not in str(caught.value)


def test_a_rotation_of_infinities_is_refused(tmp_path):
    """LAPACK's decomposition of it does not end."""
    texts = camera_info_texts(pair(), rectified_view(pair()))
    files = [tmp_path / "left.yaml", tmp_path / "right.yaml"]
    for file, text in zip(files, texts):
        file.write_text(re.sub(r"(rectification_matrix:\n.*\n.*\n  data: \[)[^,]*", r"\g<1>1e999", text))
    with pytest.raises(ValueError, match=r"left\.yaml: field rectification_matrix has a value that is no finite"):
        read_raw_calibration(files)


def test_a_large_or_binary_file_is_refused(tmp_path):
    (tmp_path / "large.yml").write_text("# \n" * 2_000_000)
    with pytest.raises(ValueError, match=r"large\.yml: has more than 4 MB"):
        read_raw_calibration([tmp_path / "large.yml"])
    (tmp_path / "image.png").write_bytes(b"\x89PNG\r\n\xff\xfe")
    with pytest.raises(ValueError, match=r"image\.png: is not a text file"):
        read_raw_calibration([tmp_path / "image.png"])
    with pytest.raises(FileNotFoundError, match="no such calibration file"):
        read_raw_calibration([tmp_path / "none.yml"])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda text: text.replace("MODEL_TYPE = CAHVORE", "MODEL_TYPE = PSPH"), "MODEL_TYPE PSPH is not supported"),
        (
            lambda text: re.sub(r"MODEL_COMPONENT_3 = .*", "MODEL_COMPONENT_3 = (1.0,2.0)", text),
            "COMPONENT_3 must be 3, is 2",
        ),
        (lambda text: re.sub(r"MODEL_COMPONENT_8 = .*", "MODEL_COMPONENT_8 = 7.0", text), "type .* must be 1, 2 or 3"),
        (lambda text: re.sub(r"MODEL_COMPONENT_8 = .*", "MODEL_COMPONENT_8 = 1.5", text), "1, 2 or 3, is 1.5"),
        (lambda text: text.replace("END\r\n", ""), "label without an end: is the file truncated"),
        (lambda text: text.replace("GEOMETRIC_CAMERA_MODEL", "OTHER"), "has no label with a camera model"),
        (lambda text: text.replace('"ROVER"', '"SITE"'), "different frames, ROVER and SITE"),
    ],
)
def test_what_is_no_label_is_one_line(tmp_path, change, says):
    wanted = rover_pair()
    files = [tmp_path / "left.LBL", tmp_path / "right.LBL"]
    files[0].write_text(detached_label(wanted.left))
    files[1].write_text(change(detached_label(wanted.right)))
    with pytest.raises(ValueError, match=says) as caught:
        read_raw_calibration(files)
    assert "\n" not in str(caught.value) and "right.LBL" in str(caught.value)


def test_exchanged_cameras_are_refused():
    with pytest.raises(ValueError, match="exchange left and right"):
        common_orientation(PosedPair(pair().right, pair().left))
    ahead = PosedPair(pair().left, second_camera(pair().right.lens, np.eye(3), np.array([0, 0, -0.3])))
    with pytest.raises(ValueError, match="do not stand side by side"):
        common_orientation(ahead)
    with pytest.raises(ValueError, match="both files of one eye"):
        PosedPair(pair().left, pair().left)


@pytest.mark.parametrize(
    ("says", "message"),
    [
        ("distortion_model: radtan", "distortion_model radtan says that the lenses are no fisheyes; leave --fisheye"),
        ("model: plumb_bob", "model plumb_bob says that the lenses are no fisheyes; leave --fisheye out"),
        ("fisheye: 0", "fisheye 0 says that the lenses are no fisheyes; leave --fisheye out"),
    ],
)
def test_a_file_that_says_that_it_is_of_no_fisheye_is_not_read_as_one(tmp_path, says, message):
    path = tmp_path / "stereo.yml"
    path.write_text(opencv_text(pair()).replace("distortion_model: radtan", says))
    assert_same(read_raw_calibration([path]), pair())
    with pytest.raises(ValueError, match=rf"stereo\.yml: {message}"):
        read_raw_calibration([path], fisheye=True)


def test_the_fisheye_flag_does_not_override_kalibr(tmp_path):
    path = tmp_path / "camchain.yaml"
    path.write_text(kalibr_text(pair(Fisheye)))
    assert_same(read_raw_calibration([path], fisheye=True), pair(Fisheye))
    path.write_text(kalibr_text(pair()))
    with pytest.raises(ValueError, match=r"camchain.yaml: says which lens it is of, and that is no fisheye"):
        read_raw_calibration([path], fisheye=True)


def test_labels_of_msl_name_the_camera_model_otherwise(tmp_path):
    wanted = rover_pair()
    files = [tmp_path / "left.LBL", tmp_path / "right.LBL"]
    for file, camera in zip(files, (wanted.left, wanted.right)):
        file.write_text(detached_label(camera).replace("GEOMETRIC_CAMERA_MODEL", "GEOMETRIC_CAMERA_MODEL_PARMS"))
    assert_same(read_raw_calibration(files), wanted)


@pytest.mark.parametrize(("last", "fits"), [(0.0, True), (0.01, False)])
def test_a_fifth_coefficient_of_zero_fits_into_kalibrs_file(tmp_path, last, fits):
    wanted = pair(RadialTangential, (-0.2, 0.05, 0.001, -0.0007, last))
    if not fits:
        with pytest.raises(ValueError, match="four coefficients"):
            kalibr_text(wanted)
        return
    (tmp_path / "camchain.yaml").write_text(kalibr_text(wanted))
    assert_same(
        read_raw_calibration([tmp_path / "camchain.yaml"]), pair(RadialTangential, (-0.2, 0.05, 0.001, -0.0007))
    )


def test_a_skew_is_not_lost_in_a_file_that_holds_none():
    fisheye = pair(Fisheye)
    skewed = replace(fisheye.left, lens=replace(fisheye.left.lens, skew=6.0))
    with pytest.raises(ValueError, match="Kalibr's files hold no skew"):
        kalibr_text(replace(fisheye, left=skewed))


@pytest.mark.parametrize(
    ("change", "is_reported"),
    [({}, False), ({"D2": [[0.1, 0, 0, 0]]}, True), ({"R": TURN}, True), ({"T": [-0.1, 0.01, 0]}, True)],
)
def test_opencv_files_whose_cameras_take_no_rectified_images_are_reported(tmp_path, change, is_reported):
    k = np.array([[300.0, 0, 20], [0, 300, 10], [0, 0, 1]])
    content = {"K1": k, "D1": np.zeros((1, 4)), "K2": k, "D2": np.zeros((1, 4)), "R": np.eye(3), "T": [-0.1, 0, 0]}
    file = tmp_path / "stereo.yml"
    storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_WRITE)
    for name, matrix in (content | change).items():
        storage.write(name, np.atleast_1d(np.array(matrix, float)))
    storage.release()
    assert calibration_of_distorted_images([file]) == (file if is_reported else None)
