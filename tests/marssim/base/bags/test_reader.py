"""Our reader: what it returns of whole bags, and one line for each kind of broken one."""

import shutil
import sys

import numpy as np
import pytest

from marssim.base.bags import library
from marssim.base.bags.images import cloud_arrays, disparity_array, image_array
from marssim.base.bags.reader import Bag, is_bag, stamp_of
from marssim.base.files.json_file import DatasetError


@pytest.fixture
def copy(drive, tmp_path):
    return shutil.copytree(drive.path, tmp_path / "copy")


def test_what_was_written_is_read(drive):
    bag = Bag(drive.path)
    assert bag.topics["/odom"] == "nav_msgs/Odometry" and len(bag.topics) == 16
    assert bag.topics_of("sensor_msgs/CameraInfo") == [
        f"/stereo/{eye}/camera_info" for eye in ("depth", "left", "right")
    ]
    entries = bag.entries(["/stereo/right/image_rect"])
    assert [entry.stamp for entry in entries] == drive.stamps
    for entry, image in list(zip(entries, drive.right, strict=True))[::-1]:  # in any order
        message = bag.message(entry)
        assert stamp_of(message) == entry.stamp
        np.testing.assert_array_equal(image_array(message), image)
    for (_, message), depth, left in zip(bag.messages(["/stereo/points2"]), drive.depth, drive.left, strict=True):
        points, colours = cloud_arrays(message)
        seen = np.isfinite(depth)
        np.testing.assert_allclose(
            points, (drive.rig.camera.rays() * np.where(seen, depth, 0)[..., None])[seen], rtol=1e-6
        )
        np.testing.assert_array_equal(colours, left[seen])
    for (_, message), depth in zip(bag.messages(["/stereo/disparity"]), drive.depth, strict=True):
        expected = np.where(np.isnan(depth), np.nan, drive.rig.depth_to_disparity(depth))
        np.testing.assert_allclose(disparity_array(message), expected, rtol=1e-6)
    bag.close()
    bag.close()


def test_a_single_file_of_a_bag_is_read_too(drive):
    (file,) = drive.path.glob("*.mcap")
    assert is_bag(file) and is_bag(drive.path) and not is_bag(drive.path.parent)
    assert [e.stamp for e in Bag(file).entries(["/odom"])] == drive.stamps


def sqlite_copy(bag, folder):
    """Write the messages of a bag into one that stores them by SQLite, as ROS 2 did by default up to Humble."""
    from rosbags.rosbag2 import Reader, StoragePlugin, Writer

    with Reader(bag) as source, Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as written:
        connections = {
            c.topic: written.add_connection(c.topic, c.msgtype, typestore=library.typestore())
            for c in source.connections
        }
        for connection, stamp, raw in source.messages():
            written.write(connections[connection.topic], stamp, raw)
    return folder


def test_a_bag_of_sqlite_is_read_and_a_broken_one_named(drive, tmp_path):
    copy = sqlite_copy(drive.path, tmp_path / "copy")
    (file,) = copy.glob("*.db3")
    for path in (copy, file):
        bag, images = Bag(path), ["/stereo/left/image_rect"]
        assert [entry.stamp for entry in bag.entries(images)] == drive.stamps
        for (_, message), image in zip(bag.messages(images), drive.left, strict=True):
            np.testing.assert_array_equal(image_array(message), image)
        bag.close()
    data = file.read_bytes()
    for broken in (b"", data[:3000], b"no database" * 400, data[:16] + bytes(4000)):
        file.write_bytes(broken)
        assert "is not readable as a ROS 2 bag" in error_of(copy)


def error_of(path) -> str:
    with pytest.raises(DatasetError) as caught:
        bag = Bag(path)
        bag.entries(["/stereo/left/image_rect"])
    message = str(caught.value)
    assert message.startswith(str(path)) and "\n" not in message
    return message


def test_a_bag_without_its_metadata_says_how_to_get_it(copy):
    (copy / "metadata.yaml").unlink()
    assert is_bag(copy)
    assert error_of(copy).endswith(
        "metadata.yaml: no such file; `ros2 bag reindex` makes it, or give the .mcap file in the folder"
    )


@pytest.mark.parametrize(
    "text", ["", "a: [", "rosbag2_bagfile_information: 3", "rosbag2_bagfile_information: {version: 99}"]
)
def test_broken_metadata_are_named(copy, text):
    (copy / "metadata.yaml").write_text(text)
    assert "is not readable as a ROS 2 bag" in error_of(copy)


def test_a_truncated_file_is_named_wherever_it_ends(copy):
    (file,) = copy.glob("*.mcap")
    data = file.read_bytes()
    for length in (0, 5, 9, 40, len(data) // 2, len(data) - 8, len(data) - 1):
        file.write_bytes(data[:length])
        assert "is not readable as a ROS 2 bag" in error_of(copy)


def test_a_missing_file_of_a_bag_and_other_files_are_named(copy, tmp_path):
    (file,) = copy.glob("*.mcap")
    file.unlink()
    assert file.name in error_of(copy)
    other = tmp_path / "other.mcap"
    other.write_bytes(b"no bag at all" * 10)
    assert "is not readable as a ROS 2 bag" in error_of(other)
    other = tmp_path / "old.bag"
    other.write_bytes(b"#ROSBAG V2.0\n")
    assert is_bag(other) and "is a bag of ROS 1; `rosbags-convert` makes" in error_of(other)


def test_definitions_in_a_bag_become_no_code(drive, monkeypatch):
    monkeypatch.delitem(sys.modules, "rosbags.usertypes", raising=False)
    bag = Bag(drive.path)
    assert len(list(bag.messages(["/stereo/left/camera_info"]))) == len(drive.stamps)
    assert "rosbags.usertypes" not in sys.modules  # the module that rosbags makes of them
    bag.close()


def test_a_type_that_a_bag_defines_otherwise_is_named(drive):
    bag = Bag(drive.path)
    definition = next(c.msgdef for c in bag._reader.connections if c.msgtype == "sensor_msgs/msg/Image")
    library.check_definition("sensor_msgs/msg/Image", definition)
    other = definition._replace(data=definition.data.replace("uint32 width", "uint64 width"))
    assert other != definition
    with pytest.raises(ValueError, match=r"sensor_msgs/msg/Image has other fields than in ROS 2 Jazzy"):
        library.check_definition("sensor_msgs/msg/Image", other)
    with pytest.raises(ValueError, match=r"a_b/msg/C is no type of ROS 2 Jazzy"):
        library.check_definition("a_b/msg/C", definition)


def test_compressed_messages_and_files_are_read_by_their_folder_alone(drive, tmp_path):
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer

    for mode in (CompressionMode.MESSAGE, CompressionMode.FILE):
        path = tmp_path / mode.name
        unopened = Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3)
        unopened.set_compression(mode, CompressionFormat.ZSTD)
        with Reader(drive.path) as reader, unopened as writer:
            topics = {}
            for connection, stamp, raw in reader.messages():
                if connection.topic not in topics:
                    topics[connection.topic] = writer.add_connection(
                        connection.topic, connection.msgtype, typestore=library.typestore()
                    )
                writer.write(topics[connection.topic], stamp, raw)
        assert [entry.stamp for entry in Bag(path).entries(["/stereo/left/image_rect"])] == drive.stamps
        (file,) = path.glob("*.db3*")
        assert is_bag(file)
        with pytest.raises(
            DatasetError, match=rf"^{file}: (its messages are|is) compressed, as only the metadata.yaml"
        ):
            Bag(file).entries(["/stereo/left/image_rect"])
