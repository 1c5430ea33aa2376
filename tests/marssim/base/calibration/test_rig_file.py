"""Rig files: lenses, vergence and rotations, calibrations in their place, and what is refused in one line."""

import json
from dataclasses import replace

import numpy as np
import pytest

from marssim.base.calibration.calibration_files import FORMS, calibration_texts
from marssim.base.calibration.camera_info import camera_info_texts
from marssim.base.calibration.cameras import PosedPair
from marssim.base.calibration.lenses.fisheye import Fisheye
from marssim.base.calibration.lenses.radial_tangential import RadialTangential
from marssim.base.calibration.read_pair import read_raw_calibration
from marssim.base.calibration.rig_file import RawRig, read_rig_file
from marssim.base.camera import PinholeCamera, StereoRig

SIDES = {"width": 320, "height": 240, "fx": 300.0, "fy": 301.0, "cx": 158.0, "cy": 121.0, "baseline": 0.2}
LENS = {"distortion_model": "plumb_bob", "distortion_coefficients": [-0.22, 0.06, 0, 0]}
RIGHT = {"fx": 296.0, "fy": 295.5, "cx": 161.0, "cy": 118.0, **LENS}
TURNS = {"vergence_deg": 4.0, "rotation_deg": [0.5, 0.2, -0.7]}
POINTS = np.random.default_rng(2).uniform([-0.5, -0.4, 2], [0.5, 0.4, 6], (40, 3))  # rectified frame [m]


@pytest.fixture
def read(tmp_path):
    """Reads a rig file of these fields."""

    def read(**fields):
        (tmp_path / "rig.json").write_text(json.dumps({**SIDES, **fields}))
        return read_rig_file([tmp_path / "rig.json"])

    return read


def pixels(raw: RawRig) -> np.ndarray:
    """(2, N, 2) where both cameras show POINTS."""
    points = POINTS @ raw.view.rotation + raw.cameras.left.centre
    return np.stack([camera.project(points) for camera in (raw.cameras.left, raw.cameras.right)])


def test_without_lenses_and_turns_it_is_the_rig_itself(read):
    assert read() == StereoRig(PinholeCamera(320, 240, 300.0, 301.0, 158.0, 121.0), 0.2)


def test_lenses_are_those_of_the_file(read):
    raw = read(**LENS, right=RIGHT)
    terms = (-0.22, 0.06, 0.0, 0.0)
    assert raw.cameras.left.lens == RadialTangential(300.0, 301.0, 158.0, 121.0, terms)
    assert raw.cameras.right.lens == RadialTangential(296.0, 295.5, 161.0, 118.0, terms)
    assert read(**LENS).cameras.right.lens == read(**LENS).cameras.left.lens
    fisheye = read(distortion_model="equidistant", distortion_coefficients=[0.01, 0, 0, 0])
    assert fisheye.cameras.left.lens == Fisheye(300.0, 301.0, 158.0, 121.0, (0.01, 0.0, 0.0, 0.0))


def test_each_camera_is_turned_towards_the_other_by_half_of_the_vergence(read):
    raw = read(vergence_deg=4.0)
    half = np.deg2rad(2.0)
    assert raw.cameras.left.axis == pytest.approx([np.sin(half), 0, np.cos(half)])
    assert raw.cameras.right.axis == pytest.approx([-np.sin(half), 0, np.cos(half)])
    assert raw.cameras.right.centre == pytest.approx([0.2, 0, 0]) and raw.rig.baseline == pytest.approx(0.2)


def test_the_right_camera_is_turned_about_its_own_axes(read):
    """Turned by 3 deg about z, clockwise as seen from behind, it shows the world turned the other way."""
    straight, turned = (read(rotation_deg=[0, 0, angle]).cameras.right for angle in (1e-9, 3.0))
    above = np.array([0.2, -0.5, 2.0])
    (u, v), (u0, v0) = turned.project(above), straight.project(above)
    assert u < u0 and v == pytest.approx(v0, abs=1)
    lowered = read(rotation_deg=[-1.0, 0, 0]).cameras.right  # about x, which points right: it looks down
    assert lowered.axis[1] == pytest.approx(np.sin(np.deg2rad(1.0)))


@pytest.mark.parametrize("model", ["plumb_bob", "equidistant"])
def test_every_form_of_calibration_holds_the_same_cameras(read, tmp_path, model):
    lens = {"distortion_model": model, "distortion_coefficients": [-0.05, 0.02, 0, 0]}
    raw = read(**lens, right={**RIGHT, **lens}, **TURNS)
    texts = calibration_texts(raw)
    assert set(texts) == {name for names in FORMS.values() for name in names}
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    for form, names in FORMS.items():
        again = read_rig_file([tmp_path / name for name in names])
        assert pixels(again) == pytest.approx(pixels(raw), abs=1e-6), form
        assert again.rig.to_dict() == pytest.approx(raw.rig.to_dict(), abs=1e-6), form


def test_forms_that_cannot_hold_a_lens_are_left_out(read):
    tangential = read(distortion_model="plumb_bob", distortion_coefficients=[-0.2, 0.05, 1e-3, 0])
    assert {"cahvore_left.lbl", "cahvore_right.lbl"}.isdisjoint(calibration_texts(tangential))
    rational = read(distortion_model="rational_polynomial", distortion_coefficients=[-0.2, 0.05, 0, 0, 0.01, 0, 0, 0])
    assert set(calibration_texts(rational)) == {"opencv.yml", "ros_left.yaml", "ros_right.yaml"}


def test_a_calibration_of_equal_cameras_without_distortion_is_a_plain_rig(read, tmp_path):
    (tmp_path / "p.yml").write_text(
        "%YAML:1.0\n---\nimage_width: 320\nimage_height: 240\n"
        "K1: [300., 0., 158., 0., 301., 121., 0., 0., 1.]\nK2: [300., 0., 158., 0., 301., 121., 0., 0., 1.]\n"
        "R: [1., 0., 0., 0., 1., 0., 0., 0., 1.]\nT: [-0.2, 0., 0.]\n"
    )
    assert read_rig_file([tmp_path / "p.yml"]) == read()


@pytest.mark.parametrize(
    "text",
    [
        "%YAML:1.0\n---\nimage_width: 320\nimage_height: 240\n"
        "K1: [300., 0., 158., 0., 301., 121., 0., 0., 1.]\nK2: [300., 0., 158., 0., 301., 121., 0., 0., 1.]\n"
        "R: [1., 0., 0., 0., 1., 0., 0., 0., 1.]\nT: [0.2, 0., 0.]\n",
        "cam0=[300 0 158; 0 301 121; 0 0 1]\ndoffs=0\nbaseline=-200\nwidth=320\nheight=240\n",
    ],
)
def test_equal_cameras_whose_eyes_are_exchanged_are_refused(tmp_path, text):
    file = tmp_path / "rig.yml"
    file.write_text(text)
    with pytest.raises(ValueError, match=rf"^{file}: the right camera of the calibration stands left of the left one"):
        read_rig_file([file])


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"distortion_model": "plumb_bob"}, "field distortion_coefficients is missing beside distortion_model"),
        ({"distortion_coefficients": [0.1]}, "field distortion_model is missing beside distortion_coefficients"),
        ({**LENS, "distortion_model": "ford"}, "field distortion_model: 'ford' is unknown; choose from plumb_bob"),
        ({**LENS, "distortion_model": ["a"]}, "field distortion_model: ['a'] is unknown"),
        ({**LENS, "distortion_coefficients": [0.1, 0.2]}, "field distortion_coefficients: distortion has 0, 4, 5"),
        ({**LENS, "distortion_coefficients": ["a"]}, "field distortion_coefficients must hold numbers only"),
        (
            {**LENS, "distortion_coefficients": [-5, 0, 0, 0]},
            "field distortion_coefficients: the distortion folds over inside the image of 320 x 240 px: ",
        ),
        ({"right": {"fx": 300, "cx": 1, "cy": 1}}, "field right.fy is missing: a right lens of its own has fx, fy"),
        ({"right": {**RIGHT, "fx": -1}}, "field right.fx must be positive [px], got -1"),
        ({"right": {**RIGHT, "k1": 1}}, "unknown field right.k1; a lens has fx, fy"),
        ({"right": {**RIGHT, "distortion_coefficients": [9]}}, "field right.distortion_coefficients: distortion has"),
        ({"right": 3}, "field right must hold the fields of the right lens"),
        ({"vergence_deg": 80}, "field vergence_deg must be at most 45 deg, got 80"),
        ({"vergence_deg": None}, "field vergence_deg is missing"),
        ({"rotation_deg": [1, 2]}, "field rotation_deg must be 3, is 2"),
        ({"rotation_deg": [60, 0, 0]}, "field rotation_deg must be at most 45 deg, got 60"),
        ({**TURNS, "k1": 1}, "unknown field k1; a rig has width, height"),
    ],
)
def test_a_wrong_field_is_named_with_the_file(read, tmp_path, fields, says):
    with pytest.raises(ValueError) as error:
        read(**fields)
    message = str(error.value)
    assert message.startswith(f"{tmp_path / 'rig.json'}: ") and says in message and "\n" not in message


def test_calibrations_of_mixed_or_unknown_size_or_of_one_eye_are_refused(read, tmp_path):
    raw = read(**LENS, **TURNS)
    left, right = tmp_path / "left.yaml", tmp_path / "right.yaml"
    small = PosedPair(raw.cameras.left, replace(raw.cameras.right, size=(320, 200)))
    for file, text in zip((left, right), camera_info_texts(small, raw.view), strict=True):
        file.write_text(text)
    with pytest.raises(ValueError, match=rf"^{left} and {right}: the left camera has images of 320 x 240 px, "):
        read_rig_file([left, right])
    with pytest.raises(ValueError, match=rf"^{left}: is the CameraInfo of one camera"):
        read_rig_file([left])
    file = tmp_path / "opencv.yml"
    text = calibration_texts(raw)["opencv.yml"]
    file.write_text(text.replace("image_width", "wide"))
    assert read_raw_calibration([file]).left.size is None
    with pytest.raises(ValueError, match=rf"^{file}: the size of the images is missing"):
        read_rig_file([file])
    with pytest.raises(ValueError, match=rf"^{tmp_path / 'none.yml'}: no such"):
        read_rig_file([tmp_path / "none.yml"])
