"""Pairs of bags: what else may be in one, and one line for each thing that is wrong."""

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from bag_of_planes import STAMPS, write_planes

from m3depth.predict import main
from m3depth.prediction.options import PredictOptions
from m3depth.prediction.sources.bag_pairs import BagPairs
from m3depth.prediction.sources.inputs import find_inputs
from marssim.base.bags.messages import SECOND
from marssim.base.bags.reader import stamp_of
from marssim.base.rover_spec import ZHURONG


@pytest.fixture
def make(tmp_path, plane_samples):
    """Write a bag of planes, with a change of its messages."""
    return lambda change=None, count=2: write_planes(tmp_path / "planes", plane_samples[:count], change)


def error_of(bag, capsys, *flags) -> str:
    """Run the command, and return the one line that it prints."""
    out = bag.parent / "out"
    assert main([str(bag), "--out", str(out), "--method", "sgbm", *flags]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"error: {bag}") and error.count("\n") == 1 and not out.exists(), error
    return error


def only(ending, edit):
    """A change of the messages of the topics that end so."""

    def change(topic, message):
        return edit(message) if topic.endswith(ending) else message

    return change


def with_values(**values):
    def edit(message):
        for name, value in values.items():
            setattr(message, name, value)
        return message

    return edit


@pytest.mark.parametrize(
    ("ending", "values", "said"),
    [
        ("right/image_rect", None, "has images of the left eye (/stereo/left/image_rect), none of the right one"),
        ("camera_info", None, "has no sensor_msgs/CameraInfo beside /stereo/left/image_rect; name two topics with"),
        ("right/camera_info", None, "has no sensor_msgs/CameraInfo beside /stereo/right/image_rect"),
        ("image_rect", {"encoding": "yuv422"}, ", /stereo/left/image_rect: encoding 'yuv422' is not supported"),
        ("camera_info", {"p": np.zeros(12)}, ", /stereo/left/camera_info: P has no positive focal length"),
        ("right/camera_info", {"p": np.eye(3, 4).ravel()}, "the left camera's CameraInfo (Tx = 0) comes first"),
    ],
)  # fmt: skip
def test_what_is_missing_or_unusable_is_named_before_anything_is_written(make, capsys, ending, values, said):
    edit = with_values(**values) if values else lambda message: None
    assert said in error_of(make(only(ending, edit)), capsys)


def test_exchanged_eyes_are_found_by_their_cameras(make, capsys):
    bag = make()
    flags = "--left", "/stereo/right/image_rect", "--right", "/stereo/left/image_rect"
    assert "the left camera's CameraInfo (Tx = 0) comes first" in error_of(bag, capsys, *flags)


def test_stamps_that_were_never_set_and_stamps_far_apart_are_reported(make, capsys):
    def unset(message):
        message.header.stamp.sec = message.header.stamp.nanosec = 0
        return message

    bag = make(only("image_rect", unset))
    assert "all 2 images of /stereo/left/image_rect have the stamp 0 s" in error_of(bag, capsys)
    shutil.rmtree(bag)

    def late(message):
        message.header.stamp.nanosec += 30_000_000
        return message

    bag = make(only("right/image_rect", late))
    assert "lie within 0.01 s of each other; the nearest two are 0.03 s apart" in error_of(bag, capsys)
    assert BagPairs(bag, tolerance=0.05).count == 2


def test_broken_bags_are_reported(make, capsys):
    bag = make()
    file, metadata = bag / "planes.mcap", bag / "metadata.yaml"
    whole, text = file.read_bytes(), metadata.read_bytes()
    metadata.unlink()
    assert "metadata.yaml: no such file; `ros2 bag reindex` makes it" in error_of(bag, capsys)
    metadata.write_bytes(text)
    file.write_bytes(whole[: len(whole) // 2])
    assert "is not readable as a ROS 2 bag: File end magic is invalid; is it truncated?" in error_of(bag, capsys)


def test_without_rosbags_the_extra_is_named(make, capsys, monkeypatch):
    bag = make()
    monkeypatch.setitem(sys.modules, "rosbags", None)
    assert 'ROS 2 bags need rosbags, which is not installed; pip install "mars-m3depth[real]"' in error_of(bag, capsys)


def test_a_missing_bag_and_flags_of_bags_without_one_are_refused(tmp_path, capsys):
    for line, said in (
        (["no.mcap"], "no.mcap: no such file or folder"),
        (["a.png", "b.png", "--camera-info", "/a", "/b"], "--camera-info is for ROS 2 bags"),
        (["a.png", "b.png", "--stamp-tolerance", "11"], "--stamp-tolerance must lie in [0, 10] s"),
    ):
        assert main([*line, "--out", str(tmp_path / "out"), "--focal", "9", "--baseline", "1"]) == 2
        error = capsys.readouterr().err
        assert said in error and error.count("\n") == 1, error


def test_images_without_a_partner_are_counted_in_a_warning(make, capsys):
    bag = make(lambda topic, m: None if topic.endswith("right/image_rect") and m.header.stamp.sec == 1 else m, count=3)
    assert BagPairs(bag).count == 2
    assert capsys.readouterr().err.endswith(": 1 left and 0 right images have no partner within 0.01 s\n")


def test_a_camera_that_changes_counts_from_its_stamp_on(make):
    def zoom(message):
        if message.header.stamp.sec >= 2:
            message.p[0] *= 2
            message.p[3] *= 2
        return message

    pairs = BagPairs(make(only("camera_info", zoom), count=4))
    assert [pairs.calibration(n)(96, 64).fx for n in range(4)] == [100, 200, 200, 200]
    assert [pairs.calibration(n)(96, 64).baseline for n in range(4)] == pytest.approx([0.27] * 4)
    assert pairs.rate == 2.0 and [pairs.stamp(n) for n in range(4)] == STAMPS


def region(message):
    message.roi.x_offset, message.roi.y_offset, message.roi.width, message.roi.height = 10, 4, 80, 40


def binning(message):
    message.binning_x = 2


def size(message):
    message.height -= 10


@pytest.mark.parametrize(
    ("change", "expected"),
    [(region, ((80, 40), 100.0, 37.5)), (binning, ((48, 64), 50.0, 23.5)), (size, ((96, 54), 100.0, 47.5))],
)
def test_a_region_or_binning_that_changes_alone_counts_too(make, change, expected):
    def edit(message):
        if message.header.stamp.sec >= 2:
            change(message)
        return message

    pairs = BagPairs(make(only("camera_info", edit), count=4))
    before, after = (pairs.calibration(n)(0, 0) for n in (0, 3))
    assert (before.size, before.fx, before.cx) == ((96, 64), 100.0, 47.5)
    assert (after.size, after.fx, after.cx) == expected


def test_a_distortion_model_that_changes_alone_counts_too(make):
    def edit(message):
        message.d = np.array([0.01, 0.0, 0.0, 0.0])
        if message.header.stamp.sec >= 2:
            message.distortion_model = "equidistant"
        return message

    pairs = BagPairs(make(only("camera_info", edit), count=2), rectify="always")
    lenses = [type(pairs._eyes[0][n].raw._camera.lens).__name__ for n in range(len(pairs._eyes[0]))]
    assert lenses == ["RadialTangential", "Fisheye"]


def test_a_right_camera_that_changes_alone_counts_from_its_stamp_on(make):
    def edit(message):
        if message.header.stamp.sec >= 2:
            message.p[3] *= 2
        return message

    pairs = BagPairs(make(only("right/camera_info", edit), count=4))
    assert [pairs.calibration(n)(96, 64).baseline for n in range(4)] == pytest.approx([0.27, 0.54, 0.54, 0.54])


def test_a_calibration_file_replaces_camera_info(make, tmp_path):
    bag = make(only("camera_info", lambda m: None))
    file = tmp_path / "calib.txt"
    file.write_text("P0: 90 0 47.5 0 0 90 31.5 0 0 0 1 0\nP1: 90 0 47.5 -18 0 90 31.5 0 0 0 1 0\n")
    inputs = find_inputs(PredictOptions((bag,), tmp_path / "out", calib=(file,)))
    assert [pair.calibration for pair in inputs.pairs] == [None, None]


def test_another_pair_of_topics_is_another_input(make, tmp_path):
    bag = make()
    topics = "/stereo/left/image_rect", "/stereo/right/image_rect"
    states = [
        find_inputs(PredictOptions((bag,), tmp_path / "out", left=a, right=b, calib=calib)).state()
        for a, b, calib in ((*topics, ()), (*topics, ()), (*topics[::-1], (Path("natecam"),)))
    ]
    assert states[0] == states[1] and (states[2]["left"], states[2]["right"]) == topics[::-1]
    assert states[0]["images"] == states[2]["images"]


def test_the_folder_of_work_may_be_the_bag(make, tmp_path, monkeypatch):
    """Its name is empty, but a rig.json may lie beside it, as the bag has no frame of the rover."""
    monkeypatch.chdir(make(lambda topic, m: None if topic in ("/tf", "/tf_static", "/odom") else m))
    assert main([".", "--out", str(tmp_path / "out"), "--method", "sgbm", "--write", "depth"]) == 0


def test_the_camera_on_the_rover_is_known_before_the_first_pose_of_the_rover_and_after_the_last(make):
    def between(topic, message):
        if topic == "/tf" and stamp_of(message.transforms[0]) != STAMPS[1]:
            message.transforms = [item for item in message.transforms if item.header.frame_id == "base_link"]
        return message

    pairs = BagPairs(make(between, count=3))
    assert [pairs.pose(n) is None for n in range(3)] == [True, False, True]
    for number in range(3):
        np.testing.assert_allclose(pairs.on_rover(number), ZHURONG.mount.left_eye(0.27), atol=1e-9)


def test_pairs_at_which_the_mast_is_unknown_do_not_take_the_place_of_mount(make, tmp_path, capsys):
    def late(topic, message):
        if topic == "/tf" and stamp_of(message.transforms[0]) < STAMPS[1]:
            message.transforms = [item for item in message.transforms if item.child_frame_id != "left_camera"]
        return message

    bag = make(late, count=3)
    flags = ["--method", "sgbm", "--write", "depth", "cloud", "--mount", "0", "2", "45"]
    assert main([str(bag), "--out", str(tmp_path / "rover"), *flags, "--cloud-frame", "rover"]) == 0
    printed = capsys.readouterr()
    assert "--mount is not used" in printed.err and "2 of 3 pairs; 1 skipped" in printed.out
    assert "skipped: frame_000000: the frames of the bag do not say where the camera is on the rover" in printed.err
    assert main([str(bag), "--out", str(tmp_path / "camera"), *flags]) == 0
    records = [json.loads((tmp_path / f"camera/frame_00000{n}/prediction.json").read_text()) for n in range(3)]
    assert [record["mount_assumed"] for record in records] == [True, False, False]
    for record in records:
        np.testing.assert_allclose(record["camera_to_rover"], ZHURONG.mount.left_eye(0.27), atol=1e-9)


def test_a_mast_that_is_known_at_no_pair_leaves_the_place_to_mount(make, tmp_path, capsys):
    def later(topic, message):
        for item in getattr(message, "transforms", []):
            item.header.stamp.sec += 1000 if topic == "/tf" else 0
        return message

    flags = ["--method", "sgbm", "--write", "depth", "--mount", "0", "2", "45"]
    assert main([str(make(later)), "--out", str(tmp_path / "out"), *flags]) == 0
    assert "--mount" not in capsys.readouterr().err
    record = json.loads((tmp_path / "out/frame_000001/prediction.json").read_text())
    assert record["camera_to_rover"][2][3] == pytest.approx(2.0) and not record["mount_assumed"]


def test_poses_in_a_frame_of_the_earth_are_left_out(make, capsys):
    def on_earth(topic, message):
        if topic == "/tf":
            message.transforms = message.transforms[1:]
            message.transforms[0].header.frame_id = "utm"
            message.transforms[0].transform.translation.y += 4.6e6
        return message

    pairs = BagPairs(make(on_earth))
    assert pairs.world is None and pairs.pose(0) is None and pairs.on_rover(0) is not None
    assert "the cameras are over 1e+06 m from the origin of utm, so there are no poses" in capsys.readouterr().err


def test_frames_that_do_not_fit_are_reported(make, capsys):
    def two(topic, message):
        if topic == "/tf" and stamp_of(message.transforms[0]) == STAMPS[1]:
            message.transforms[1].header.frame_id = "vo"
        return message

    bag = make(two)
    assert BagPairs(bag).pose(0) is not None
    assert capsys.readouterr().err == f"warning: {bag}: base_link is recorded in odom and in vo; odom is used\n"
    shutil.rmtree(bag)
    BagPairs(bag := make(only("image_rect", lambda m: setattr(m.header, "frame_id", "eye") or m)))
    assert f"{bag}: no frame says where 'eye' is, which is that of /stereo/left/image_rect" in capsys.readouterr().err


def test_pairs_before_the_first_pose_stay_out_of_the_world(make, tmp_path, capsys):
    def late(topic, message):
        if topic not in ("/tf", "/odom"):
            return message
        return message if stamp_of(getattr(message, "transforms", [message])[0]) >= 2 * SECOND else None

    bag = make(late, count=3)
    flags = ["--method", "sgbm", "--write", "depth", "cloud"]
    assert main([str(bag), "--out", str(tmp_path / "out"), *flags]) == 0
    assert "note: fused_cloud.ply lacks 1 pair of 3, which have no pose" in capsys.readouterr().err
    assert (tmp_path / "out/fused_cloud.ply").is_file()
    assert main([str(bag), "--out", str(tmp_path / "world"), *flags, "--cloud-frame", "world"]) == 0
    printed = capsys.readouterr()
    assert "frame_000000 is skipped: frame_000000: has no pose, which --cloud-frame world needs" in printed.err
    assert "2 of 3 pairs; 1 skipped" in printed.out


def test_clouds_in_the_world_of_a_file_of_poses_do_not_come_into_a_bag_without_it(make, tmp_path, capsys):
    bag = make()
    (tmp_path / "poses.txt").write_text(2 * "1 0 0 9 0 1 0 9 0 0 1 9\n")
    flags = "--poses", str(tmp_path / "poses.txt"), "--cloud-frame", "world"
    out = ["--out", str(tmp_path / "out"), "--method", "sgbm"]
    assert main([str(bag), *out, *flags]) == 2
    error = capsys.readouterr().err
    assert f"world of {tmp_path}/poses.txt, which is no frame of the bag; leave bag out of --write" in error
    assert not (tmp_path / "out").exists()
    assert main([str(bag), *out, *flags, "--write", "depth", "cloud"]) == 0
    assert (tmp_path / "out/fused_cloud.ply").is_file() and not (tmp_path / "out/bag").exists()


@pytest.mark.parametrize("forms", [("pfm",), ("png", "pfm")])
def test_a_bag_of_maps_that_do_not_tell_sky_from_unknown_is_refused(make, tmp_path, forms):
    bag = make()
    with pytest.raises(ValueError, match=rf"^--map-format {' '.join(forms)}: the bag of the results [^\n]*; add npy"):
        find_inputs(PredictOptions((bag,), tmp_path / "out", map_format=forms))
    for flags in ({"map_format": (*forms, "tiff")}, {"map_format": forms, "write": ("depth",)}):
        assert find_inputs(PredictOptions((bag,), tmp_path / "out", **flags)).pairs


def test_without_frames_there_are_no_poses(make):
    pairs = BagPairs(make(lambda topic, m: None if topic in ("/tf", "/tf_static", "/odom") else m))
    assert pairs.world is None and pairs.pose(0) is None and pairs.on_rover(0) is None


def test_images_of_another_focal_length_than_p_are_rectified_where_that_is_asked_for(make):
    def edit(message):
        message.k[0] = message.k[4] = 1.25 * message.p[0]
        return message

    bag = make(only("camera_info", edit), count=1)
    for name in ("auto", "always"):
        pairs = BagPairs(bag, rectify=name)
        assert (pairs._eyes[0][0].raw is not None) == (name == "always")
