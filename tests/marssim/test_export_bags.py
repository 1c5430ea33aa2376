"""A dataset as ROS 2 bags, read by `rosbags` alone and compared with its files."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from marssim.base.dataset.dataset import StereoDataset, write_index
from marssim.base.dataset.sample import read_sample
from marssim.base.files.json_file import read_json, write_json
from marssim.base.rover_spec import ZHURONG
from marssim.export import ExportConfig, export, main


def messages(path: Path) -> dict[str, list]:
    from rosbags.highlevel import AnyReader

    found: dict[str, list] = {}
    with AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            found.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype))
    return found


def matrix(place, turn) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3] = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
    out[:3, 3] = place.x, place.y, place.z
    return out


def camera_in_map(found: dict[str, list], view: int) -> np.ndarray:
    """Return the pose of the left camera by the frames of the bag, from the camera outwards."""
    frames = {t.child_frame_id: t for m in (found["/tf_static"][0], found["/tf"][view]) for t in m.transforms}
    pose, frame = np.eye(4), "left_camera_optical"
    while frame != "map":
        pose = matrix(frames[frame].transform.translation, frames[frame].transform.rotation) @ pose
        frame = frames[frame].header.frame_id
    return pose


@pytest.fixture(scope="module")
def bags(closed_form_set, tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("bags") / "out"
    assert export(ExportConfig(closed_form_set, "rosbag2", out)) == 8
    return out


def test_each_scene_is_a_bag_in_the_folder_of_its_split(bags, closed_form_set):
    assert {p.parent.relative_to(bags).as_posix() for p in bags.rglob("metadata.yaml")} == {
        "train/00000", "train/00003", "val/00002", "test/00001"
    }  # fmt: skip
    assert sum(map(len, read_json(bags / "samples.json").values())) == 8
    about = (bags / "README.md").read_text()
    assert "/stereo/left/image_rect" in about and "`samples.json` lists" in about and "isparity" not in about
    assert not list(bags.rglob(".*.part"))


def test_a_bag_holds_images_cameras_depth_and_poses_of_its_views(bags, closed_form_set):
    found = messages(bags / "test/00001")
    for view in range(2):
        sample = read_sample(closed_form_set / f"scenes/00001/{view:02d}")
        shape = sample.depth.shape
        for eye in ("left", "right"):
            image = found[f"/stereo/{eye}/image_rect"][view]
            assert (image.header.stamp.sec, image.header.stamp.nanosec) == (1 + view, 0)
            np.testing.assert_array_equal(image.data.reshape(*shape, 3), getattr(sample, eye))
            p = found[f"/stereo/{eye}/camera_info"][view].p.reshape(3, 4)
            np.testing.assert_array_equal(p[:, :3], sample.rig.camera.K)
            assert p[0, 3] == (0 if eye == "left" else -sample.rig.fb)
        np.testing.assert_array_equal(
            found["/stereo/depth/image_rect"][view].data.view("<f4").reshape(shape), sample.depth
        )
        np.testing.assert_allclose(camera_in_map(found, view), sample.meta["pose"], atol=1e-9)
        rover = found["/ground_truth/pose"][view]
        body = matrix(rover.pose.position, rover.pose.orientation)
        assert rover.header.frame_id == "map" and body[:3, 0] @ np.array(sample.meta["pose"])[:3, 2] > 0.9


def test_a_drive_has_its_times_and_a_recorded_rover_its_pose(closed_form_set, tmp_path):
    copy = shutil.copytree(closed_form_set, tmp_path / "drive")
    names = StereoDataset(copy).names[:2]
    body = np.eye(4)
    body[:3, 3] = 4, 5, 0.1
    for number, name in enumerate(names):
        file = copy / "scenes" / name / "sample.json"
        write_json(
            file, {**read_json(file), "timestamp": 7.25 * number, "rover": {"pan_deg": 9, "pose": body.tolist()}}
        )
    write_index(copy, {"seed": 1, "trajectory": True}, names)
    export(ExportConfig(copy, "rosbag2", tmp_path / "out"))
    found = messages(tmp_path / "out/train/00000")
    assert [(m.header.stamp.sec, m.header.stamp.nanosec) for m in found["/odom"]] == [(1, 0), (8, 250_000_000)]
    position = found["/ground_truth/pose"][1].pose.position
    assert (position.x, position.y, position.z) == pytest.approx((4, 5, 0.1))
    np.testing.assert_allclose(camera_in_map(found, 1), read_json(file)["pose"], atol=1e-9)


def test_the_rover_of_a_drive_is_where_its_cameras_are_said_to_be_on_it(closed_form_set, tmp_path):
    copy = shutil.copytree(closed_form_set, tmp_path / "drive")
    (name,) = StereoDataset(copy).names[:1]
    file = copy / "scenes" / name / "sample.json"
    mount = replace(ZHURONG.mount, height=0.4, pitch=0.6).left_eye(0.3)
    write_json(file, {**read_json(file), "camera_to_rover": mount.tolist()})
    write_index(copy, {"seed": 1, "trajectory": True}, [name])
    export(ExportConfig(copy, "rosbag2", tmp_path / "out"))
    found = messages(tmp_path / "out/train/00000")
    rover = found["/ground_truth/pose"][0].pose
    body = matrix(rover.position, rover.orientation)
    np.testing.assert_allclose(body @ mount, read_json(file)["pose"], atol=1e-9)


def test_an_interrupted_export_adds_the_bags_that_are_missing(bags, closed_form_set, tmp_path):
    copy = shutil.copytree(bags, tmp_path / "out")
    shutil.rmtree(copy / "val/00002")
    (copy / "val/.00002.123.part/00002").mkdir(parents=True)  # as a kill leaves it
    kept = (copy / "train/00000/00000.mcap").stat().st_mtime_ns
    export(ExportConfig(closed_form_set, "rosbag2", copy, workers=1))
    assert (copy / "train/00000/00000.mcap").stat().st_mtime_ns == kept and not list(copy.rglob(".*.part"))
    for path in bags.rglob("*.mcap"):
        assert (copy / path.relative_to(bags)).read_bytes() == path.read_bytes()


def test_a_broken_view_and_one_without_a_pose_or_with_a_malformed_field_are_named(closed_form_set, tmp_path, capsys):
    copy = shutil.copytree(closed_form_set, tmp_path / "set")
    file = copy / "scenes/00000/01/sample.json"
    meta = read_json(file)
    line = [str(copy), "--format", "rosbag2", "--out", str(tmp_path / "out"), "--split", "train"]
    write_json(file, {**meta, "pose": None})
    assert main(line) == 2
    assert f"error: {file}: pose must be 4 rows of 4 finite numbers\n" in capsys.readouterr().err
    for field, value, problem in (
        ("timestamp", None, "timestamp must be a number from 0 to 2e+09 s"),
        ("timestamp", 1e300, "timestamp must be a number from 0 to 2e+09 s"),
        ("rover", {}, "rover.pose must be 4 rows of 4 finite numbers"),
    ):
        write_json(file, {**meta, field: value})
        assert main(line) == 2
        assert f"error: {file}: {problem}\n" in capsys.readouterr().err
    write_json(file, meta)
    (file.parent / "left.png").write_bytes((file.parent / "right.png").read_bytes())
    assert main(line) == 2
    assert f"error: {file.parent / 'left.png'}: its content is not what sample.json records" in capsys.readouterr().err
    assert not list((tmp_path / "out").rglob("00000"))
