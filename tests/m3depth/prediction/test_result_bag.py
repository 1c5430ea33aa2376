"""From a bag to a bag: what is predicted, and what the readers of two other projects find in the result."""

import json

import cv2
import numpy as np
import pytest
from bag_of_planes import STAMPS, pose_of, write_planes

from m3depth.predict import predict
from m3depth.prediction.options import PredictOptions
from m3depth.prediction.sources.poses import mounted_camera_pose
from m3depth.stereo.classical import SGBM
from marssim.base.bags.messages import SECOND
from marssim.base.bags.reader import Bag, stamp_of
from marssim.base.bags.transform_reader import read_transforms
from marssim.base.rover_spec import ZHURONG


class Killed(SGBM):
    """SGBM that ends the run at its third pair, as a kill does."""

    calls, last = 0, 3

    def infer(self, left, right, rig):
        self.calls += 1
        if self.calls == self.last:
            raise SystemExit
        return super().infer(left, right, rig)


@pytest.fixture(scope="module")
def bag(tmp_path_factory, plane_samples):
    return write_planes(tmp_path_factory.mktemp("bag") / "planes", plane_samples)


def options(bag, out, **flags):
    return PredictOptions((bag,), out, **{"estimator": "sgbm", "write": ("depth", "cloud", "bag"), **flags})


@pytest.fixture(scope="module")
def result(bag, tmp_path_factory):
    """Folder of a prediction of the bag."""
    out = tmp_path_factory.mktemp("result")
    predict(options(bag, out), SGBM())
    return out


def by_rosbags(path):
    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as reader:
        return [(c.topic, c.msgtype, reader.deserialize(raw, c.msgtype)) for c, _, raw in reader.messages()]


def by_mcap(path):
    reader, decoder = pytest.importorskip("mcap.reader"), pytest.importorskip("mcap_ros2.decoder")
    with next(path.glob("*.mcap")).open("rb") as stream:
        messages = reader.make_reader(stream, decoder_factories=[decoder.DecoderFactory()]).iter_decoded_messages()
        return [(channel.topic, schema.name, content) for schema, channel, _, content in messages]


def on_topic(messages, topic):
    return [message for name, _, message in messages if name == topic]


def test_a_bag_gives_the_maps_of_its_images_and_cameras(bag, result, plane_samples, tmp_path):
    for eye in ("left", "right"):
        (tmp_path / eye).mkdir()
        for number, sample in enumerate(plane_samples):
            cv2.imwrite(str(tmp_path / eye / f"{number}.png"), getattr(sample, eye)[..., ::-1])
    flags = {"left": "left/*.png", "right": "right/*.png", "focal": 100.0, "baseline": 0.27, "write": ("depth",)}
    predict(options(tmp_path, tmp_path / "out", **flags), SGBM())
    for number, stamp in enumerate(STAMPS):
        folder = result / f"frame_{number:06d}"
        assert (folder / "depth.npy").read_bytes() == (tmp_path / f"out/{number}/depth.npy").read_bytes()
        record = json.loads((folder / "prediction.json").read_text())
        assert (record["stamp_ns"], record["rig"]["fx"], record["rig"]["baseline"]) == (
            stamp,
            100.0,
            pytest.approx(0.27),
        )
        np.testing.assert_allclose(record["camera_to_rover"], ZHURONG.mount.left_eye(0.27), atol=1e-9)
        np.testing.assert_allclose(record["pose"], pose_of(number) @ ZHURONG.mount.left_eye(0.27), atol=1e-9)
    assert (result / "fused_cloud.ply").is_file()


@pytest.mark.parametrize("read", [by_rosbags, by_mcap])
def test_the_result_has_the_types_stamps_and_frames_of_the_source(result, read):
    messages = read(result / "bag")
    assert {topic: kind for topic, kind, _ in messages} == {
        "/stereo/depth/image_rect": "sensor_msgs/msg/Image", "/stereo/depth/camera_info": "sensor_msgs/msg/CameraInfo",
        "/stereo/disparity": "stereo_msgs/msg/DisparityImage", "/stereo/points2": "sensor_msgs/msg/PointCloud2",
        "/tf": "tf2_msgs/msg/TFMessage", "/tf_static": "tf2_msgs/msg/TFMessage",
    }  # fmt: skip
    for topic in ("/stereo/depth/image_rect", "/stereo/depth/camera_info", "/stereo/disparity", "/stereo/points2"):
        found = [m.header for m in on_topic(messages, topic)]
        assert [h.stamp.sec * SECOND + h.stamp.nanosec for h in found] == STAMPS
        assert {h.frame_id for h in found} == {"left_camera_optical"}


@pytest.mark.parametrize("read", [by_rosbags, by_mcap])
def test_points_and_disparity_of_the_result_agree_with_depth_and_truth(result, read, plane_samples):
    """Projected by the CameraInfo of the bag, without the code that made them."""
    messages = read(result / "bag")
    parts = [
        on_topic(messages, f"/stereo/{name}")
        for name in ("points2", "depth/image_rect", "depth/camera_info", "disparity")
    ]
    for cloud, image, info, disparity, sample in zip(*parts, plane_samples, strict=True):
        depth = np.frombuffer(bytes(image.data), "<f4").reshape(image.height, image.width)
        p = np.reshape(info.p if hasattr(info, "p") else info.P, (3, 4))
        rows = np.frombuffer(bytes(cloud.data), "<f4").reshape(-1, 4)
        u, v, w = p @ np.column_stack([rows[:, :3], np.ones(len(rows))]).T
        column, row = np.round(u / w).astype(int), np.round(v / w).astype(int)
        assert len(rows) > 500 and np.abs(u / w - column).max() < 1e-3 > np.abs(v / w - row).max()
        np.testing.assert_allclose(rows[:, 2], depth[row, column], rtol=1e-5)
        colours = np.frombuffer(bytes(cloud.data), np.uint8).reshape(-1, 16)[:, 14:11:-1]
        np.testing.assert_array_equal(colours, sample.left[row, column])
        d = np.frombuffer(bytes(disparity.image.data), "<f4").reshape(depth.shape)
        np.testing.assert_array_equal(np.isnan(depth), d < disparity.min_disparity)
        seen = np.isfinite(depth)
        np.testing.assert_allclose(disparity.f * disparity.t / d[seen], depth[seen], rtol=1e-5)
        assert np.median(np.abs(depth[row, column] / sample.depth[row, column] - 1)) < 0.03


def test_a_cloud_of_another_frame_names_it(bag, result, tmp_path):
    camera = on_topic(by_rosbags(result / "bag"), "/stereo/points2")[2]
    local = np.frombuffer(bytes(camera.data), "<f4").reshape(-1, 4)[:, :3]
    for frame, name, pose in (("world", "map", pose_of(2)), ("rover", "base_link", np.eye(4))):
        predict(options(bag, tmp_path / frame, cloud_frame=frame), SGBM())
        cloud = on_topic(by_rosbags(tmp_path / frame / "bag"), "/stereo/points2")[2]
        eye = pose @ ZHURONG.mount.left_eye(0.27)
        points = np.frombuffer(bytes(cloud.data), "<f4").reshape(-1, 4)[:, :3]
        assert cloud.header.frame_id == name
        np.testing.assert_allclose(points, local @ eye[:3, :3].T + eye[:3, 3], atol=1e-3)


def test_the_frames_of_the_bag_hold_also_beside_a_mount(bag, result, tmp_path, capsys):
    """The clouds are stamped base_link, and the result has the frames of the source."""
    predict(options(bag, tmp_path / "out", cloud_frame="rover", mount=(0.0, 2.0, 45.0)), SGBM())
    assert "say where the cameras are on the rover; --mount is not used" in capsys.readouterr().err
    records = [json.loads((out / "frame_000001/prediction.json").read_text()) for out in (result, tmp_path / "out")]
    assert records[1]["camera_to_rover"] == records[0]["camera_to_rover"] and not records[1]["mount_assumed"]


def test_a_killed_run_makes_the_same_bag(bag, result, tmp_path, monkeypatch):
    with pytest.raises(SystemExit):
        predict(options(bag, tmp_path), Killed())
    assert not (tmp_path / "bag").exists()
    monkeypatch.setattr(Killed, "last", None)
    for _ in range(2):  # a run with nothing left to predict makes it too
        predict(options(bag, tmp_path), Killed())
        for name in ("bag.mcap", "metadata.yaml"):
            assert (tmp_path / "bag" / name).read_bytes() == (result / "bag" / name).read_bytes()


def test_without_clouds_or_bag_there_is_none(bag, tmp_path):
    predict(options(bag, tmp_path / "a", write=("depth", "bag"), every=3), SGBM())
    messages = by_rosbags(tmp_path / "a/bag")
    assert len(on_topic(messages, "/stereo/disparity")) == 2 and not on_topic(messages, "/stereo/points2")
    predict(options(bag, tmp_path / "b", write=("depth",), every=4), SGBM())
    assert not (tmp_path / "b/bag").exists()
    with pytest.raises(ValueError, match="bag needs depth, which it is made of"):
        options(bag, tmp_path, write=("cloud", "bag"))


def test_a_pair_without_points_has_an_empty_cloud(bag, tmp_path):
    predict(options(bag, tmp_path, max_range=0.001, every=4), SGBM())
    (cloud,) = on_topic(by_rosbags(tmp_path / "bag"), "/stereo/points2")
    assert (cloud.width, cloud.height, len(cloud.data)) == (0, 1, 0)


@pytest.mark.parametrize(("topic", "seconds"), [("/tf_static", 0), ("/tf_static", 1_700_000_000), ("/tf", 1_000_000)])
def test_frames_of_another_clock_do_not_make_the_bag_last_for_decades(plane_samples, tmp_path, topic, seconds):
    from rosbags.highlevel import AnyReader

    def timed(of_message, message):
        if of_message == topic == "/tf_static" or (of_message == topic and stamp_of(message.transforms[0]) > STAMPS[2]):
            for item in message.transforms:
                item.header.stamp.sec, item.header.stamp.nanosec = seconds, 0
        return message

    source = write_planes(tmp_path / "planes", plane_samples, timed)
    predict(options(source, tmp_path / "out", write=("depth", "bag"), every=2), SGBM())
    with AnyReader([tmp_path / "out/bag"]) as reader:
        assert (reader.start_time, reader.end_time) == (STAMPS[0], STAMPS[3 if topic == "/tf_static" else 2] + 1)
    (fixed,) = on_topic(by_rosbags(tmp_path / "out/bag"), "/tf_static")
    assert len(fixed.transforms) == 3


def renamed(**names):
    """A change of the messages of frames and odometry that gives frames other names."""

    def change(topic, message):
        for item in getattr(message, "transforms", [message] if topic == "/odom" else []):
            item.header.frame_id = names.get(item.header.frame_id, item.header.frame_id)
            item.child_frame_id = names.get(item.child_frame_id, item.child_frame_id)
        return message

    return change


@pytest.mark.parametrize("name", ["rover1/base_link", "base_footprint"])
def test_the_rover_may_have_another_name(plane_samples, tmp_path, name):
    source = write_planes(tmp_path / "planes", plane_samples[:2], renamed(base_link=name))
    predict(options(source, tmp_path / "out", cloud_frame="rover"), SGBM())
    messages = by_rosbags(tmp_path / "out/bag")
    assert {cloud.header.frame_id for cloud in on_topic(messages, "/stereo/points2")} == {name}
    record = json.loads((tmp_path / "out/frame_000001/prediction.json").read_text())
    np.testing.assert_allclose(record["camera_to_rover"], ZHURONG.mount.left_eye(0.27), atol=1e-9)
    assert not record["mount_assumed"]


def test_the_result_has_the_frames_of_odometry_too(plane_samples, tmp_path):
    def without_tf_of_the_rover(topic, message):
        if topic == "/tf":
            message.transforms = [item for item in message.transforms if item.child_frame_id == "left_camera"]
        return message

    source = write_planes(tmp_path / "planes", plane_samples[:2], without_tf_of_the_rover)
    predict(options(source, tmp_path / "out", cloud_frame="world"), SGBM())
    assert {cloud.header.frame_id for cloud in on_topic(by_rosbags(tmp_path / "out/bag"), "/stereo/points2")} == {
        "odom"
    }
    tree = read_transforms(Bag(tmp_path / "out/bag"))
    for number, stamp in enumerate(STAMPS[:2]):
        expected = pose_of(number) @ ZHURONG.mount.left_eye(0.27)
        np.testing.assert_allclose(tree.pose("left_camera_optical", stamp, "odom"), expected, atol=1e-9)


def test_a_camera_without_frames_stands_on_the_rover_by_its_mount(plane_samples, tmp_path):
    source = write_planes(
        tmp_path / "planes", plane_samples[:1], lambda topic, m: None if topic in ("/tf", "/tf_static", "/odom") else m
    )
    predict(options(source, tmp_path / "out", cloud_frame="rover", mount=(0.5, 2.0, 45.0)), SGBM())
    assert on_topic(by_rosbags(tmp_path / "out/bag"), "/stereo/points2")[0].header.frame_id == "base_link"
    found = read_transforms(Bag(tmp_path / "out/bag")).pose("left_camera_optical", STAMPS[0], "base_link")
    np.testing.assert_allclose(found, mounted_camera_pose((0.5, 2.0, 45.0), 0.27), atol=1e-9)


def test_a_camera_in_frames_without_a_rover_gives_no_clouds_on_it(plane_samples, tmp_path):
    source = write_planes(tmp_path / "planes", plane_samples[:1], renamed(base_link="drone"))
    with pytest.raises(
        ValueError, match=r"^--cloud-frame rover: left_camera_optical of .* is not known in a frame of a rove"
    ):
        predict(options(source, tmp_path / "out", cloud_frame="rover"), SGBM())
    predict(options(source, tmp_path / "out", cloud_frame="rover", write=("depth", "cloud")), SGBM())
    predict(options(source, tmp_path / "maps", cloud_frame="rover", write=("depth", "bag")), SGBM())
    frames = [
        item.child_frame_id for m in on_topic(by_rosbags(tmp_path / "maps/bag"), "/tf_static") for item in m.transforms
    ]
    assert frames.count("left_camera_optical") == 1  # in the frame of the source alone


def test_points_that_32_bits_cannot_tell_apart_are_reported(plane_samples, tmp_path, capsys):
    def far(topic, message):
        if topic == "/tf":
            for item in message.transforms:
                item.transform.translation.x += 500e3 if item.child_frame_id == "odom" else 0
        return message

    source = write_planes(tmp_path / "planes", plane_samples[:1], far)
    predict(options(source, tmp_path / "out", cloud_frame="world"), SGBM())
    warning = capsys.readouterr().err
    assert "m from the origin of map, where the 32-bit numbers of its clouds are 31 mm apart" in warning
    predict(options(source, tmp_path / "near", cloud_frame="rover"), SGBM())
    assert "32-bit" not in capsys.readouterr().err
