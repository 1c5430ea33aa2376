"""Which topics are a pair, and which images belong together."""

import numpy as np
import pytest

from marssim.base.bags.messages import SECOND, camera_info_message, image_message
from marssim.base.bags.reader import Bag
from marssim.base.bags.stereo_topics import StereoTopics, find_stereo_topics, is_rectified, match_stamps
from marssim.base.bags.writer import BagWriter
from marssim.base.camera import NATECAM
from marssim.base.files.json_file import DatasetError

PIXELS = np.zeros((2, 3), np.uint8)
LEFT, RIGHT = "/left/image_rect", "/right/image_rect"


def bag_of(path, stamps):
    """A bag with images at times [s] for each topic, and a CameraInfo for those that end so."""
    with BagWriter(path) as bag:
        for topic, times in stamps.items():
            for number, time in enumerate(times):
                stamp = round(time * SECOND)
                made = camera_info_message(stamp, "eye", NATECAM.camera) if topic.endswith("info") else None
                bag.write(topic, number, made or image_message(stamp, "eye", PIXELS))
    return Bag(path)


@pytest.mark.parametrize(
    ("topics", "pair"),
    [
        ([LEFT, RIGHT], (LEFT, RIGHT)),
        (["/cam_left/image_raw", "/cam_right/image_raw", LEFT, RIGHT], (LEFT, RIGHT)),
        (["/s/left/image_rect", "/s/right/image_rect", "/s/left/image_rect_color", "/s/right/image_rect_color"],
         ("/s/left/image_rect_color", "/s/right/image_rect_color")),
        (["/camera/infra1/image_rect_raw", "/camera/infra2/image_rect_raw", "/camera/color/image_rect_raw"],
         ("/camera/infra1/image_rect_raw", "/camera/infra2/image_rect_raw")),
        (["/cam0/image_raw", "/cam1/image_raw", "/leftover/image", "/rightover/image"],
         ("/cam0/image_raw", "/cam1/image_raw")),
    ],
)  # fmt: skip
def test_the_pair_is_found_by_the_names_of_its_topics(tmp_path, topics, pair):
    found = find_stereo_topics(bag_of(tmp_path / "bag", {topic: [1] for topic in topics}))
    assert (found.left, found.right) == pair and found.left_info is None


@pytest.mark.parametrize(
    ("topic", "said"),
    [("/left/image_rect", True), ("/left/image_rect_color/compressed", True), ("/rectified/left/image", True),
     ("/infra1/image_rect_raw", True), ("/left/image_raw", False), ("/direct/left/image_raw", False),
     ("/rectangle/left/image_raw", False)],
)  # fmt: skip
def test_the_name_of_a_topic_says_whether_it_is_rectified(topic, said):
    assert is_rectified(topic) == said


def test_infos_lie_beside_the_images_or_where_they_are_named(tmp_path):
    names = [LEFT, RIGHT, "/left/camera_info", "/right/camera_info", "/other/info"]
    bag = bag_of(tmp_path / "bag", {name: [1] for name in names})
    assert find_stereo_topics(bag) == StereoTopics(LEFT, RIGHT, "/left/camera_info", "/right/camera_info")
    named = find_stereo_topics(bag, (RIGHT, LEFT), ("/left/camera_info", "/other/info"))
    assert named == StereoTopics(RIGHT, LEFT, "/left/camera_info", "/other/info")
    with pytest.raises(DatasetError, match="/nothing; it has /left/camera_info, /left/image_rect, /other/info"):
        find_stereo_topics(bag, (LEFT, "/nothing"))
    with pytest.raises(DatasetError, match="/left/image_rect is sensor_msgs/Image, not sensor_msgs/CameraInfo"):
        find_stereo_topics(bag, None, (LEFT, "/other/info"))


@pytest.mark.parametrize(
    ("topics", "said"),
    [
        ([LEFT], "has images of the left eye (/left/image_rect), none of the right one"),
        (["/camera/image"], "has no stereo pair; it has /camera/image: name two with --left and --right"),
        (["/a/left/image", "/a/right/image", "/b/left/image", "/b/right/image"],
         "has several stereo pairs (/a/left/image, /b/left/image): choose one with --left and --right"),
    ],
)  # fmt: skip
def test_no_pair_and_several_pairs_are_reported_with_what_there_is(tmp_path, topics, said):
    with pytest.raises(DatasetError) as error:
        find_stereo_topics(bag_of(tmp_path / "bag", {topic: [1] for topic in topics}))
    assert said in str(error.value) and str(error.value).startswith(f"{tmp_path / 'bag'}: ")


def matched(path, left, right, tolerance):
    bag = bag_of(path, {LEFT: left, RIGHT: right})
    pairs, alone = match_stamps(bag, find_stereo_topics(bag), tolerance)
    return [(a.stamp / SECOND, b.stamp / SECOND) for a, b in pairs], alone


def test_images_are_a_pair_if_each_is_the_nearest_of_the_other_within_the_tolerance(tmp_path):
    left, right = [3.0, 1.0, 2.0, 2.004, 9.0], [1.009, 2.005, 3.0, 5.0]
    expected = [(1.0, 1.009), (2.004, 2.005), (3.0, 3.0)]
    assert matched(tmp_path / "a", left, right, 0.01) == (expected, (2, 1))
    assert matched(tmp_path / "b", left, right, 0.005) == (expected[1:], (3, 2))
    assert matched(tmp_path / "c", left, right, 0.0) == (expected[2:], (4, 3))
    assert matched(tmp_path / "d", [1.0], [1.0], 0.0) == ([(1.0, 1.0)], (0, 0))


def test_stamps_that_match_nothing_or_were_never_set_are_reported(tmp_path):
    with pytest.raises(DatasetError, match=r"lie within 0\.01 s of each other; the nearest two are 0\.2 s apart"):
        matched(tmp_path / "a", [1.0, 2.0], [1.2, 2.5], 0.01)
    with pytest.raises(DatasetError, match=r"all 3 images of /left/image_rect have the stamp 0 s"):
        matched(tmp_path / "b", [0, 0, 0], [0, 0, 0], 0.01)
