"""Every way to name the pairs, and what is said where it names none."""

import json
import shutil
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from m3depth.prediction.options import PredictOptions
from m3depth.prediction.sources.inputs import Inputs, find_inputs
from m3depth.prediction.sources.pair_input import PairInput
from m3depth.prediction.sources.poses import mounted_camera_pose
from m3depth.prediction.sources.raw_pairs import RawPairs
from m3depth.rectification.options import RawOptions, RectifyOptions
from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.files.json_file import DatasetError, read_json, write_json
from marssim.base.rover_spec import ZHURONG

RIG = StereoRig(PinholeCamera.centred(30, 20, 40.0), 0.2)


def image(path: Path, level: int = 0) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), np.full((20, 30), level, np.uint8))
    return path


def find(*images, **flags):
    return find_inputs(PredictOptions(tuple(map(Path, images)), **{"out": Path("out"), **flags}))


def rectification() -> RawPairs:
    """Of raw cameras with a calibration."""
    return RawPairs(RectifyOptions((), Path("out"), calib=(Path("stereo.yml"),)), keeps_geometry=False)


def test_two_images_are_one_pair(tmp_path):
    inputs = find(tmp_path / "a.png", tmp_path / "b.png")
    assert inputs.single and inputs.pairs[0].name == "" and inputs.pairs[0].right == tmp_path / "b.png"


def test_patterns_pair_the_same_text_and_leave_masks_out(tmp_path, monkeypatch):
    for name in ("7", "8"):
        for eye in "LR":
            image(tmp_path / f"sol/{name}_{eye}.png")
            image(tmp_path / f"sol/{name}_{eye}_valid.png")
    pairs = find(tmp_path, left="sol/*_L.png", right="sol/*_R.png").pairs
    assert [(p.name, p.left.name, p.right.name, p.number) for p in pairs] == [
        ("7_L", "7_L.png", "7_R.png", 0), ("8_L", "8_L.png", "8_R.png", 1),
    ]  # fmt: skip
    for name in ("7", "8"):
        for eye in ("left", "right"):
            image(tmp_path / f"{eye}/{name}.png")
        image(tmp_path / f"left/{name}_valid.png")  # the right eye sees all of it
    assert [p.name for p in find(tmp_path, left="left/*.png", right="right/*.png").pairs] == ["7", "8"]
    monkeypatch.chdir(tmp_path)
    assert [p.name for p in find(left="*/7_L.png", right="*/7_R.png").pairs] == ["sol/7_L"]
    assert [p.name for p in find(left="./sol/*_L.png", right="sol//*_R.png").pairs] == ["7_L", "8_L"]
    assert [p.name for p in find(left=f"{tmp_path}/sol/*_L.png", right=f"{tmp_path}/sol/*_R.png").pairs] == [
        "7_L", "8_L",
    ]  # fmt: skip


def test_a_pattern_starts_from_the_given_folder_beside_an_absolute_one(tmp_path, monkeypatch):
    for eye in "LR":
        image(tmp_path / f"sol/7_{eye}.png")
    monkeypatch.chdir(tmp_path.parent)
    for left, right in (("sol/*_L.png", f"{tmp_path}/sol/*_R.png"), (f"{tmp_path}/sol/*_L.png", "sol/*_R.png")):
        (pair,) = find(tmp_path, left=left, right=right).pairs
        assert (pair.name, pair.left, pair.right) == ("7_L", tmp_path / "sol/7_L.png", tmp_path / "sol/7_R.png")


def test_a_list_names_pairs_from_its_folder(tmp_path):
    for name in ("a/1.png", "b/1.png", "a/2.png", "b/2.png"):
        image(tmp_path / name)
    (tmp_path / "calib").mkdir()
    (tmp_path / "calib/2.txt").write_text("cam0=[40 0 15; 0 40 10; 0 0 1]\nbaseline=200\nwidth=30\nheight=20\n")
    (tmp_path / "pairs.txt").write_text("a/1.png b/1.png\n\n# the second\na/2.png b/2.png disparity/2.pfm\n")
    first, second = find(tmp_path / "pairs.txt").pairs
    assert (first.name, second.name, first.calibration) == ("a/1", "a/2", None)
    assert second.calibration(30, 20).baseline == 0.2


@pytest.mark.parametrize("prefix", ["../data/", "{}/data/"])
def test_a_list_of_pairs_elsewhere_names_their_folders(tmp_path, prefix):
    (tmp_path / "lists").mkdir()
    for folder in ("00", "01/a"):
        for eye in ("left", "right"):
            (tmp_path / "data" / folder).mkdir(parents=True, exist_ok=True)
            image(tmp_path / "data" / folder / f"raw_{eye}.png")
    start = prefix.format(tmp_path)
    lines = [f"{start}{folder}/raw_left.png {start}{folder}/raw_right.png\n" for folder in ("00", "01/a")]
    (tmp_path / "lists/pairs.txt").write_text("".join(lines))
    assert [pair.name for pair in find(tmp_path / "lists/pairs.txt").pairs] == ["00/raw_left", "01/a/raw_left"]
    (tmp_path / "lists/pairs.txt").write_text(lines[0])
    assert [pair.name for pair in find(tmp_path / "lists/pairs.txt").pairs] == ["raw_left"]


def test_what_rectify_wrote_is_one_pair_or_a_folder_of_pairs(tmp_path):
    for name in ("a", "b"):
        for eye in ("left", "right"):
            image(tmp_path / name / f"{eye}.png")
        (tmp_path / name / "rig.json").write_text(json.dumps(RIG.to_dict()))
    assert find(tmp_path / "a").single
    assert [pair.name for pair in find(tmp_path).pairs] == ["a", "b"]


def test_a_dataset_gives_names_calibrations_and_poses(plane_set):
    inputs = find(plane_set, split="test")
    (first, *_) = inputs.pairs
    assert first.name == "00001/00" and first.group == "00001"
    calibration = first.calibration(64, 48)
    assert calibration.baseline == 0.27
    pose = inputs.pose(first, calibration.rig(64, 48), PredictOptions((plane_set,), Path("out")))
    np.testing.assert_array_equal(pose, np.eye(4))
    assert inputs.read(first).left.shape == (48, 64, 3)


def test_poses_of_the_camera_become_those_of_the_rovers_world(tmp_path):
    pair = (image(tmp_path / "l.png"), image(tmp_path / "r.png"))
    (tmp_path / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 3\n")  # 3 m along the optical axis
    for axes, place in (("camera", [3, 0.1, 1.5]), ("z-up", [0, 0, 3])):
        flags = {"poses": tmp_path / "poses.txt", "mount": (0.0, 1.5, 0.0), "pose_axes": axes, "out": Path("out")}
        inputs = find(*pair, **flags)
        pose = inputs.pose(inputs.pairs[0], RIG, PredictOptions(pair, **flags))
        np.testing.assert_allclose(pose[:3, 3], place, atol=1e-9)


def test_poses_of_the_camera_start_from_the_first_pairs_place_on_the_rover(tmp_path):
    """The mast of the second pair stood elsewhere: its pose is of the camera, so that changes nothing."""
    for name, height in (("a", 1.5), ("b", 9.0)):
        for eye in ("left", "right"):
            image(tmp_path / name / f"{eye}.png")
        on_rover = mounted_camera_pose((0.0, height, 0.0), RIG.baseline)
        content = {"camera_to_rover": on_rover.tolist()}
        (tmp_path / name / "rig.json").write_text(json.dumps(content))
    (tmp_path / "poses.txt").write_text(2 * "1 0 0 0 0 1 0 0 0 0 1 3\n")
    flags = {"poses": tmp_path / "poses.txt", "pose_axes": "camera", "out": Path("out")}
    inputs = find(tmp_path, **flags)
    first, second = (inputs.pose(pair, RIG, PredictOptions((tmp_path,), **flags)) for pair in inputs.pairs)
    np.testing.assert_allclose(first[:3, 3], [3, 0.1, 1.5], atol=1e-9)
    np.testing.assert_array_equal(first, second)


def test_an_edited_calibration_or_mask_is_another_input(tmp_path):
    pair = [image(tmp_path / f"{eye}.png") for eye in ("left", "right")]
    inputs = find(*pair)
    states = [inputs.state()]
    for file in ("rig.json", "left_valid.png"):
        (tmp_path / file).write_text("{}")
        states.append(inputs.state())
    assert all(a != b for a, b in pairwise(states))


def test_an_edited_calibration_beside_a_recording_or_a_raw_pair_is_another_input(tmp_path):
    video = cv2.VideoWriter(str(tmp_path / "both.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 8, (64, 48))
    for level in (0, 99):
        video.write(np.full((48, 64, 3), level, np.uint8))
    video.release()
    raw = Inputs((PairInput("0", *(image(tmp_path / f"{eye}.png") for eye in "lr")),), rectification=rectification())
    for inputs in (find(tmp_path / "both.avi"), raw):
        states = [inputs.state()]
        for content in ("{}", '{"shift": 3}'):  # its camera_to_rover is read in any case
            (tmp_path / "rig.json").write_text(content)
            states.append(inputs.state())
        assert all(a != b for a, b in pairwise(states))
        (tmp_path / "rig.json").unlink()


def test_an_edited_calibration_of_a_benchmark_is_another_input(tmp_path):
    for folder in ("image_2", "image_3", "disp_occ_0"):
        image(tmp_path / f"training/{folder}/000000_10.png")
    calib = tmp_path / "training/calib_cam_to_cam/000000.txt"
    calib.parent.mkdir()
    calib.write_text("P2: 40 0 15 0 0 40 10 0 0 0 1 0\nP3: 40 0 15 -8 0 40 10 0 0 0 1 0\n")
    first = find(tmp_path).state()
    calib.write_text(calib.read_text().replace("-8", "-16"))
    second = find(tmp_path).state()
    assert first["images"] == second["images"] and first != second


def test_natecam_is_a_setting_wherever_the_command_runs(tmp_path, monkeypatch):
    pair = [image(tmp_path / f"{eye}.png") for eye in ("left", "right")]
    states = [find(*pair).state()]
    for folder in (tmp_path, tmp_path.parent):
        monkeypatch.chdir(folder)
        states.append(find(*pair, calib=(Path("natecam"),)).state())
    assert states[0] != states[1] == states[2]


def test_a_pose_of_a_dataset_that_is_none_is_named(tmp_path):
    pair = tuple(image(tmp_path / f"{eye}.png") for eye in ("left", "right"))
    (tmp_path / "sample.json").write_text('{"pose": [[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]]}')
    inputs = Inputs((PairInput("0", *pair, sample=tmp_path / "sample.json"),))
    with pytest.raises(DatasetError, match=r"sample.json: pose must be a rotation"):
        inputs.pose(inputs.pairs[0], RIG, PredictOptions(pair, Path("out")))


@pytest.mark.parametrize(
    ("case", "message"),
    [
        ("half", r"a_L.png: has no partner in .*\*_R.png"),
        ("nothing", r"no file matches \*_Q.png"),
        ("one image", "a_L.png: is one file; give the right image too"),
        ("missing", "gone: no such file or folder"),
        ("plain folder", "for other folders give --left and --right"),
        ("list", r"list.txt, line 1: expected left and right, got 'a_L.png'"),
        ("missing in list", r"gone.png: no such file; .*list.txt names it"),
        ("poses", "poses.txt: holds 2 poses for 1 pair"),
        ("no folder", "--format oaisys needs the dataset's folder before --left and --right"),
        ("every", "--every is for videos"),
        ("split", "--split is for datasets: it takes a part of one"),
        ("split of patterns", "--split is for datasets"),
        ("split of a list", "--split is for datasets"),
        ("stamps", "--stamp-tolerance is for ROS 2 bags: it pairs their images"),
        ("layout", "--format kitti is for datasets: it is the layout of one; leave it out"),
        ("empty list", "empty.txt: names no pair of images"),
        ("mask", "gone.png: no such mask"),
        ("fisheye", "--fisheye is of raw images: give the calibration of their cameras with --calib"),
    ],
)
def test_what_is_no_source_of_pairs_is_named(tmp_path, case, message):
    image(tmp_path / "a_L.png")
    image(tmp_path / "b_R.png")
    (tmp_path / "list.txt").write_text("a_L.png gone.png" if case == "missing in list" else "a_L.png")
    (tmp_path / "empty.txt").write_text("\n")
    (tmp_path / "poses.txt").write_text(2 * "0 0 0 0 0 0 0 1\n")
    patterns = {"left": "*_L.png", "right": "*_R.png"}
    arguments = {
        "half": lambda: find(tmp_path, **patterns),
        "no folder": lambda: find(format="oaisys", **patterns),
        "every": lambda: find(tmp_path / "a_L.png", tmp_path / "b_R.png", every=2),
        "split": lambda: find(tmp_path / "a_L.png", tmp_path / "b_R.png", split="test"),
        "split of patterns": lambda: find(tmp_path, left="a_*.png", right="a_*.png", split="test"),
        "split of a list": lambda: find(tmp_path / "empty.txt", split="test"),
        "stamps": lambda: find(tmp_path / "a_L.png", tmp_path / "b_R.png", stamp_tolerance=0.05),
        "layout": lambda: find(tmp_path / "a_L.png", tmp_path / "b_R.png", format="kitti"),
        "nothing": lambda: find(tmp_path, left="*_Q.png", right="*_R.png"),
        "one image": lambda: find(tmp_path / "a_L.png"),
        "missing": lambda: find(tmp_path / "gone"),
        "plain folder": lambda: find(tmp_path),
        "list": lambda: find(tmp_path / "list.txt"),
        "empty list": lambda: find(tmp_path / "empty.txt"),
        "mask": lambda: find(tmp_path / "a_L.png", tmp_path / "a_L.png", mask=(tmp_path / "gone.png",)),
        "fisheye": lambda: find(tmp_path / "a_L.png", tmp_path / "a_L.png", raw=RawOptions(fisheye=True)),
        "missing in list": lambda: find(tmp_path / "list.txt"),
        "poses": lambda: find(tmp_path / "a_L.png", tmp_path / "a_L.png", poses=tmp_path / "poses.txt"),
    }
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        arguments[case]()


@pytest.mark.parametrize("calib", [("natecam",), ("left.yaml", "right.yaml")])
def test_a_dataset_without_a_calibration_takes_that_of_the_flag(tmp_path, calib):
    for sensor in ("sensorLeft", "sensorRight"):
        image(tmp_path / "batch_0001" / sensor / f"0001{sensor}_rgb_00.png")
    for name in calib if len(calib) == 2 else ():
        (tmp_path / name).write_text("")
    files = tuple(Path(name) if name == "natecam" else tmp_path / name for name in calib)
    assert [pair.name for pair in find(tmp_path, calib=files).pairs] == ["batch_0001/0001"]
    with pytest.raises(DatasetError, match="layout oaisys needs --calib"):
        find(tmp_path)


def test_two_pairs_of_one_name_are_refused(tmp_path):
    for name in ("l/1.png", "l/1.jpg", "r/1.png", "r/1.jpg"):
        image(tmp_path / name)
    with pytest.raises(ValueError, match="two pairs have the name 1"):
        find(tmp_path, left="l/*.*", right="r/*.*")


def test_the_place_of_the_cameras_on_the_rover_is_that_of_the_sample_or_assumed(plane_set, tmp_path):
    data = tmp_path / "data"
    shutil.copytree(plane_set, data)
    options = PredictOptions((data,), Path("out"), cloud_frame="rover")
    inputs = find(data)
    first, second = inputs.pairs[:2]
    assert inputs.is_mount_assumed(first, options)
    np.testing.assert_array_equal(inputs.on_rover(first, RIG, options), ZHURONG.mount.left_eye(RIG.baseline))
    for pair, change in ((first, "camera_to_rover"), (second, "rover")):
        meta = read_json(pair.sample)
        expected = mounted_camera_pose((0.3, 0.7, 40.0), RIG.baseline)
        of_rover = {"pan_deg": 0.0, "pose": (np.array(meta["pose"]) @ np.linalg.inv(expected)).tolist()}
        meta[change] = expected.tolist() if change == "camera_to_rover" else of_rover
        write_json(pair.sample, meta)
        assert not inputs.is_mount_assumed(pair, options)
        np.testing.assert_allclose(inputs.on_rover(pair, RIG, options), expected, atol=1e-9)
    write_json(first.sample, {**read_json(first.sample), "camera_to_rover": [1]})
    with pytest.raises(DatasetError, match=r"sample.json: camera_to_rover: pose must be 4 rows"):
        inputs.on_rover(first, RIG, options)


def test_a_mount_that_is_given_is_of_level_raw_cameras_and_a_recorded_one_of_the_rectified(tmp_path):
    pair = (image(tmp_path / "l.png"), image(tmp_path / "r.png"))
    angle, raw_frame = 0.2, np.eye(4)
    raw_frame[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    options = PredictOptions(pair, Path("out"), mount=(0.0, 1.5, 10.0))
    inputs = find(*pair, mount=(0.0, 1.5, 10.0))
    level = inputs.on_rover(inputs.pairs[0], RIG, options)
    raw = replace(inputs.pairs[0], raw_frame=raw_frame)
    np.testing.assert_allclose((inputs.on_rover(raw, RIG, options) @ np.linalg.inv(raw_frame))[:3, :3], level[:3, :3],
                               atol=1e-12)  # fmt: skip
    recorded = replace(raw, on_rover=level)
    np.testing.assert_array_equal(inputs.on_rover(recorded, RIG, replace(options, mount=None)), level)


def test_a_rig_file_beside_the_images_is_reported_if_flags_give_the_rest(tmp_path, capsys):
    pair = [image(tmp_path / f"{eye}.png") for eye in ("a", "b")]
    scale = {"focal": 40.0, "baseline": 0.2}
    find(*pair, **scale)
    assert not capsys.readouterr().err
    write_json(tmp_path / "rig.json", {})
    find(*pair, **scale)
    assert capsys.readouterr().err.startswith(f"note: {tmp_path / 'rig.json'}, which lies beside the images, gives")
    find(*pair)
    find(*pair, **scale, cx=15.0, cy=10.0)
    write_json(tmp_path / "report.json", {})  # of m3depth.rectify
    find(*pair, **scale)
    assert not capsys.readouterr().err


def test_right_images_without_a_left_one_are_reported(tmp_path, capsys):
    for name in ("a_L", "a_R", "a_R_valid"):
        image(tmp_path / f"{name}.png")
    patterns = {"left": "*_L.png", "right": "*_R.png"}
    assert len(find(tmp_path, **patterns).pairs) == 1 and not capsys.readouterr().err
    image(tmp_path / "b_R.png")
    assert len(find(tmp_path, **patterns).pairs) == 1
    assert capsys.readouterr().err == (
        f"warning: {tmp_path / 'b_R.png'}: has no left image in {tmp_path / '*_L.png'} and is left out\n"
    )
    image(tmp_path / "c_R.png")
    find(tmp_path, **patterns)
    assert capsys.readouterr().err.endswith(" and is left out, like 1 more\n")


def test_pairs_of_patterns_come_in_the_order_of_their_numbers(tmp_path):
    for number in (8, 9, 10, 100, 11):
        for eye in ("left", "right"):
            image(tmp_path / f"{eye}/frame_{number}.png")
    (tmp_path / "poses.txt").write_text("".join(f"{n} {n} 0 0 0 0 0 1\n" for n in range(5)))
    pairs = find(tmp_path, left="left/*.png", right="right/*.png", poses=tmp_path / "poses.txt").pairs
    assert [pair.name for pair in pairs] == [f"frame_{number}" for number in (8, 9, 10, 11, 100)]
    assert [pair.pose[0, 3] for pair in pairs] == [0, 1, 2, 3, 4]
    for number in (8, 9, 10):
        for eye in ("left", "right"):
            image(tmp_path / f"rectified/frame_{number}/{eye}.png")
        write_json(tmp_path / f"rectified/frame_{number}/rig.json", {})
    assert [pair.name for pair in find(tmp_path / "rectified").pairs] == ["frame_8", "frame_9", "frame_10"]


def test_times_with_decimals_keep_their_order(tmp_path):
    times = ["9.5", "12.05", "12.1", "12.25", "13.0"]
    for time in times:
        for eye in ("left", "right"):
            image(tmp_path / f"{eye}/{time}.png")
    assert [pair.name for pair in find(tmp_path, left="left/*.png", right="right/*.png").pairs] == times


def test_a_list_with_a_mark_of_its_encoding_is_read(tmp_path):
    pair = [image(tmp_path / f"{eye}.png") for eye in "ab"]
    (tmp_path / "list.txt").write_text("a.png b.png\n", encoding="utf-8-sig")
    assert [p.left for p in find(tmp_path / "list.txt").pairs] == pair[:1]
