"""From a bag to a bag: what is predicted, and what the readers of two other projects find in the result."""

import json

import cv2
import numpy as np
import pytest
from bag_of_planes import STAMPS, pose_of, write_planes

from m3depth.predict import predict
from m3depth.prediction.options import PredictOptions
from m3depth.stereo.classical import SGBM
from marssim.base.bags.messages import SECOND
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


def of(messages, topic):
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
        found = [m.header for m in of(messages, topic)]
        assert [h.stamp.sec * SECOND + h.stamp.nanosec for h in found] == STAMPS
        assert {h.frame_id for h in found} == {"left_camera_optical"}


@pytest.mark.parametrize("read", [by_rosbags, by_mcap])
def test_points_and_disparity_of_the_result_agree_with_depth_and_truth(result, read, plane_samples):
    """Projected by the CameraInfo of the bag, without the code that made them."""
    messages = read(result / "bag")
    parts = [
        of(messages, f"/stereo/{name}") for name in ("points2", "depth/image_rect", "depth/camera_info", "disparity")
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
    camera = of(by_rosbags(result / "bag"), "/stereo/points2")[2]
    local = np.frombuffer(bytes(camera.data), "<f4").reshape(-1, 4)[:, :3]
    for frame, name, pose in (("world", "map", pose_of(2)), ("rover", "base_link", np.eye(4))):
        predict(options(bag, tmp_path / frame, cloud_frame=frame), SGBM())
        cloud = of(by_rosbags(tmp_path / frame / "bag"), "/stereo/points2")[2]
        eye = pose @ ZHURONG.mount.left_eye(0.27)
        points = np.frombuffer(bytes(cloud.data), "<f4").reshape(-1, 4)[:, :3]
        assert cloud.header.frame_id == name
        np.testing.assert_allclose(points, local @ eye[:3, :3].T + eye[:3, 3], atol=1e-3)


def test_the_frames_of_the_bag_hold_also_beside_a_mount(bag, result, tmp_path, capsys):
    """The clouds are stamped base_link, and the result has the frames of the source."""
    predict(options(bag, tmp_path / "out", cloud_frame="rover", mount=(0.0, 2.0, 45.0)), SGBM())
    assert "say where the cameras are on the rover: --mount is not used" in capsys.readouterr().err
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
    assert len(of(messages, "/stereo/disparity")) == 2 and not of(messages, "/stereo/points2")
    predict(options(bag, tmp_path / "b", write=("depth",), every=4), SGBM())
    assert not (tmp_path / "b/bag").exists()
    with pytest.raises(ValueError, match="bag needs depth, which it is made of"):
        options(bag, tmp_path, write=("cloud", "bag"))


def test_a_pair_without_points_has_an_empty_cloud(bag, tmp_path):
    predict(options(bag, tmp_path, max_range=0.001, every=4), SGBM())
    (cloud,) = of(by_rosbags(tmp_path / "bag"), "/stereo/points2")
    assert (cloud.width, cloud.height, len(cloud.data)) == (0, 1, 0)


def test_fixed_frames_without_a_time_do_not_make_the_bag_begin_in_1970(plane_samples, tmp_path):
    from rosbags.highlevel import AnyReader

    def untimed(topic, message):
        if topic == "/tf_static":
            for item in message.transforms:
                item.header.stamp.sec = item.header.stamp.nanosec = 0
        return message

    source = write_planes(tmp_path / "planes", plane_samples, untimed)
    predict(options(source, tmp_path / "out", write=("depth", "bag"), every=4), SGBM())
    with AnyReader([tmp_path / "out/bag"]) as reader:
        assert reader.start_time == STAMPS[0]
    assert len(of(by_rosbags(tmp_path / "out/bag"), "/tf_static")) == 1
