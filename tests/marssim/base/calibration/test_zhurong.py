"""Labels of Zhurong: made by hand, as public code reads them."""

import re

import cv2
import numpy as np
import pytest

from marssim.base.calibration.cameras import nearest_rotation
from marssim.base.calibration.orientation import common_orientation
from marssim.base.calibration.read_pair import read_raw_calibration

TURN = cv2.Rodrigues(np.array([0.01, 0.03, -0.02]))[0]
ZHURONG = """<?xml version="1.0"?><Product><Array_2D_Image><Axis_Array><axis_name>Line</axis_name>
<elements>2048</elements></Axis_Array><Axis_Array><axis_name>Sample</axis_name><elements>2048</elements></Axis_Array></Array_2D_Image>
<focal_length>13.174201</focal_length><pixel_size>5.5</pixel_size><x0>0.010239</x0><y0>0.022188</y0>
<Exterior_Orientation_Elements><camera_center_position_x>1.0</camera_center_position_x><camera_center_position_y>YY
</camera_center_position_y><camera_center_position_z>1.8</camera_center_position_z><camera_rotation_angle_x>70
</camera_rotation_angle_x><camera_rotation_angle_y>0</camera_rotation_angle_y><camera_rotation_angle_z>-90
</camera_rotation_angle_z></Exterior_Orientation_Elements></Product>"""


def test_labels_of_zhurong(tmp_path):
    """As the module assumes: a camera turned by 70 deg about x, then by -90 deg about z, looks along x and down."""
    files = [tmp_path / "left.2CL", tmp_path / "right.2CL"]
    for file, y in zip(files, (0.135, -0.135)):
        file.write_text(ZHURONG.replace("YY", str(y)))
    read = read_raw_calibration(files)
    assert read.baseline == pytest.approx(0.27) and read.left.lens.focal() == pytest.approx(2395.31, abs=0.01)
    assert read.left.axis == pytest.approx([np.sin(np.deg2rad(70)), 0, -np.cos(np.deg2rad(70))])
    assert common_orientation(read)[0] == pytest.approx([0, -1, 0]) and "about x, then y, then z" in read.left.note


@pytest.mark.parametrize("name", ["focal_length", "camera_center_position_x"])
def test_an_empty_field_of_zhurong_is_named(tmp_path, name):
    files = [tmp_path / "left.2CL", tmp_path / "right.2CL"]
    for file in files:
        file.write_text(re.sub(f"<{name}>.*?</{name}>", f"<{name}> </{name}>", ZHURONG.replace("YY", "0.1")))
    with pytest.raises(ValueError, match=rf"left\.2CL: field {name} is missing"):
        read_raw_calibration(files)


def zhurong_label(centre, angles: dict[str, float], directions: dict[str, np.ndarray]) -> str:
    """A label with namespace, as of a product: angles by the end of their names, directions by the corner."""
    tags = {**{f"camera_center_position_{a}": v for a, v in zip("xyz", centre)},
            **{f"camera_rotation_angle_{name}": value for name, value in angles.items()}}  # fmt: skip
    fields = "".join(f"<{name} unit='x'>{value!r}</{name}>" for name, value in tags.items())
    text = re.sub(r"<Exterior_Orientation_Elements>.*</Exterior", f"<Exterior_Orientation_Elements>{fields}</Exterior",
                  ZHURONG, flags=re.DOTALL)  # fmt: skip
    points = "".join(
        f"<{name}>{''.join(f'<{a}>{float(v)!r}</{a}>' for a, v in zip('xyz', vector))}</{name}>"
        for name, vector in directions.items()
    )
    pointing = f"<Vector_Cartesian_3_Pointing>{points}</Vector_Cartesian_3_Pointing>" if points else ""
    return text.replace("<Product>", "<Product xmlns='http://pds.nasa.gov/pds4/pds/v1'>").replace(
        "<Exterior", f"{pointing}<Exterior"
    )


def zhurong_directions(rotation: np.ndarray) -> dict[str, np.ndarray]:
    """What the outer corners and the middle of the image see, by a camera of rotation (3, 3), frame to camera."""
    focal, cx, cy = 13.174201 / 0.0055, 1023.5 + 0.010239 / 0.0055, 1023.5 - 0.022188 / 0.0055
    places = {
        "Up_Left_Point_Observe_Vector": (-0.5, -0.5), "Down_Left_Point_Observe_vector": (-0.5, 2047.5),
        "Up_Right_Point_Observe_Vector": (2047.5, -0.5), "Down_Right_Point_Observe_Vector": (2047.5, 2047.5),
        "Center_Point_Observe_Vector": (1023.5, 1023.5),
    }  # fmt: skip
    rays = {name: np.array([(u - cx) / focal, (v - cy) / focal, 1]) for name, (u, v) in places.items()}
    return {name: (ray / np.linalg.norm(ray)) @ rotation for name, ray in rays.items()}


def test_the_directions_in_labels_of_zhurong_give_the_orientation_whatever_the_angles_say(tmp_path):
    rotation = np.array([[0, -1, 0], [-0.34, 0, -0.94], [0.94, 0, -0.34]])  # along x, and down; z is up
    rotation = nearest_rotation(rotation / np.linalg.norm(rotation, axis=1, keepdims=True)) @ TURN
    files = [tmp_path / "left.2CL", tmp_path / "right.2CL"]
    centres = np.zeros(3), 0.27 * rotation[0]
    for file, centre in zip(files, centres):
        angles = {"pitch": 11.0, "roll": 22.0, "yaw": 33.0}
        file.write_text(zhurong_label(centre.tolist(), angles, zhurong_directions(rotation)))
    read = read_raw_calibration(files)
    assert np.abs(read.left.rotation - rotation).max() < 1e-9 and read.left.note == ""
    assert read.baseline == pytest.approx(0.27) and common_orientation(read) == pytest.approx(rotation, abs=1e-9)
    files[1].write_text(zhurong_label([0.0, 0.0, 0.27], angles, zhurong_directions(rotation)))
    with pytest.raises(ValueError, match=r"right.2CL: the positions of the cameras lie \d+ deg off the line"):
        read_raw_calibration(files)
    wrong = {name: vector * [1, 1, 1.1] for name, vector in zhurong_directions(rotation).items()}
    files[0].write_text(zhurong_label([0.0, 0.0, 0.0], angles, wrong))
    with pytest.raises(ValueError, match=r"left.2CL: .*misses the focal length and the principal point by \d"):
        read_raw_calibration(files)
    nowhere = {**zhurong_directions(rotation), "Center_Point_Observe_Vector": np.zeros(3)}
    files[0].write_text(zhurong_label([0.0, 0.0, 0.0], angles, nowhere))
    with pytest.raises(ValueError, match=r"left.2CL: .* has a direction without length"):
        read_raw_calibration(files)


def test_without_directions_the_orientation_of_zhurong_is_said_to_be_uncertain(tmp_path):
    files = [tmp_path / "left.2CL", tmp_path / "right.2CL"]
    angles = {"pitch": -110.0, "roll": 0.0, "yaw": 0.0}  # about x: from the zenith to 20 deg below the horizon
    for file, x in zip(files, (0.0, 0.27)):
        file.write_text(zhurong_label([x, 0.0, 1.8], angles, {}))
    read = read_raw_calibration(files)
    assert read.left.axis == pytest.approx([0, np.sin(np.deg2rad(110)), np.cos(np.deg2rad(110))])
    assert common_orientation(read)[0] == pytest.approx([1, 0, 0])
    assert (
        "is uncertain" in read.left.note and "about z by yaw, then about y by roll, then about x by" in read.left.note
    )
    files[0].write_text(zhurong_label([0.0, 0.0, 1.8], {"pitch": -110.0, "roll": 0.0}, {}))
    with pytest.raises(ValueError, match=r"field camera_rotation_angle_yaw is missing"):
        read_raw_calibration(files)
