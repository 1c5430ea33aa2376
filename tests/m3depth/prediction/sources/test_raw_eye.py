"""A bag of raw images with the CameraInfo that OpenCV's stereoRectify gives, against a scene in closed form."""

import json

import cv2
import numpy as np
import pytest
import trimesh
from raw_pairs import GROUND, SIZE, depth_of, drawn, opencv_pair

from m3depth.predict import main
from m3depth.prediction.options import PredictOptions
from m3depth.prediction.sources.bag_pairs import BagPairs
from m3depth.prediction.sources.inputs import find_inputs
from marssim.base.bags.messages import camera_info_message, image_message
from marssim.base.bags.reader import Bag
from marssim.base.bags.writer import BagWriter
from marssim.base.calibration.opencv_file import opencv_text
from marssim.base.calibration.orientation import rectified_view
from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.images.resampling import pixel_grid


@pytest.fixture(scope="module")
def raw(tmp_path_factory):
    """Path of the bag, the rotation of the rectified left camera, and P of both."""
    pair = opencv_pair()
    lenses = pair.left.lens, pair.right.lens
    ks = [np.array([[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1]]) for lens in lenses]
    terms = [np.array([*lens.coefficients, 0.0]) for lens in lenses]
    turn = pair.right.rotation @ pair.left.rotation.T
    shift = -turn @ pair.left.rotation @ (pair.right.centre - pair.left.centre)
    r1, r2, p1, p2, *_ = cv2.stereoRectify(ks[0], terms[0], ks[1], terms[1], SIZE, turn, shift[:, None], alpha=0.5)
    path = tmp_path_factory.mktemp("raw") / "bag"
    with BagWriter(path) as bag:
        for side, camera, k, d, r, p in zip(("left", "right"), (pair.left, pair.right), ks, terms, (r1, r2), (p1, p2)):
            message = camera_info_message(10**9, side, PinholeCamera(*SIZE, 1, 1, 0, 0))
            message.k, message.d, message.r, message.p = k.ravel(), d, r.ravel(), p.ravel()
            bag.write(f"/{side}/camera_info", 10**9, message)
            bag.write(
                f"/{side}/image_raw",
                10**9,
                image_message(10**9, side, np.clip(np.round(drawn(camera)), 0, 255).astype(np.uint8)),
            )
    return path, r1, p1, p2


def test_raw_images_are_rectified_on_the_way_in(raw, tmp_path, capsys):
    path, turn, left, right = raw
    assert main([str(path), "--method", "sgbm", "--out", str(tmp_path), "--write", "depth", "bag"]) == 0
    errors = capsys.readouterr().err
    assert (
        errors.startswith("note: the images of /left/image_raw and /right/image_raw are rectified")
        and "warning" not in errors
    )
    depth = np.load(tmp_path / "frame_000000/depth.npy")
    u, v = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    rays = np.stack([(u - left[0, 2]) / left[0, 0], (v - left[1, 2]) / left[1, 1], np.ones(u.shape)], axis=-1) @ turn
    normal, distance = GROUND
    true = -distance / (rays @ normal)
    seen = np.isfinite(depth) & (true > 0.5) & (true < 8)
    assert seen.mean() > 0.3
    assert np.median(np.abs(depth / true - 1)[seen]) < 0.01
    valid, _ = BagPairs(path).valid(0)
    assert 0.5 < valid.mean() < 0.999 and np.isnan(depth[~valid]).all()  # alpha leaves a border that shows nothing
    assert right[0, 3] == pytest.approx(-0.2 * right[0, 0], rel=1e-3)


def test_poses_of_a_file_are_those_of_the_raw_camera(raw, tmp_path):
    path, turn, *_ = raw
    (tmp_path / "poses.txt").write_text("1 0 0 5 0 1 0 6 0 0 1 7\n")
    for axes in ("z-up", "camera"):
        options = PredictOptions((path,), tmp_path, poses=tmp_path / "poses.txt", pose_axes=axes, write=("depth",))
        inputs = find_inputs(options)
        (pair,), rig = inputs.pairs, StereoRig(PinholeCamera(*SIZE, 1, 1, 0, 0), 0.2)
        expected = np.eye(4)
        expected[:3, :3], expected[:3, 3] = turn.T, (5, 6, 7)
        if axes == "camera":  # the world is the rover at the first pair
            expected = inputs.on_rover(pair, rig, options) @ np.linalg.inv(pair.raw_frame) @ expected
        np.testing.assert_allclose(inputs.pose(pair, rig, options), expected, atol=1e-6)


def changed(raw, path, topic=lambda name: name, edit=lambda name, message: message):
    """Write the bag of raw images with other names of topics, or other messages."""
    with BagWriter(path) as bag:
        pairs = BagPairs(raw[0])
        for name, message in pairs.bag.messages(list(pairs.bag.topics)):
            bag.write(topic(name), 10**9, edit(name, message))
    return path


def test_a_mask_is_of_the_raw_images(raw, tmp_path):
    mask = np.full(SIZE[::-1], 255, np.uint8)
    mask[250:, 100:300] = 0
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    flags = ["--method", "sgbm", "--write", "depth", "--mask", str(tmp_path / "mask.png")]
    assert main([str(raw[0]), "--out", str(tmp_path / "out"), *flags]) == 0
    depth = np.load(tmp_path / "out/frame_000000/depth.npy")
    eye = BagPairs(raw[0])._eyes[0][0].raw
    shown = eye.rectified(mask) > 127
    border = cv2.erode(eye.shown.astype(np.uint8), np.ones((9, 9))) > 0
    inside = cv2.erode((border & ~shown).astype(np.uint8), np.ones((9, 9))) > 0
    assert inside.sum() > 10_000 and np.isnan(depth[inside]).all()
    outside = cv2.erode((shown & border).astype(np.uint8), np.ones((9, 9))) > 0
    (tmp_path / "all.png").write_bytes(cv2.imencode(".png", np.full_like(mask, 255))[1].tobytes())
    flags[-1] = str(tmp_path / "all.png")
    assert main([str(raw[0]), "--out", str(tmp_path / "whole"), *flags]) == 0
    whole = np.load(tmp_path / "whole/frame_000000/depth.npy")
    both = np.isfinite(whole) & outside
    assert both.mean() > 0.3 and np.isclose(depth, whole)[both].mean() > 0.97


def test_the_name_of_the_topic_says_what_is_rectified_unless_the_flag_does(raw, tmp_path):
    direct = changed(raw, tmp_path / "direct", lambda name: f"/direct{name}")
    named = changed(raw, tmp_path / "named", lambda name: name.replace("image_raw", "image_rect"))
    assert BagPairs(direct).is_raw and not BagPairs(direct, rectify="never").is_raw
    assert not BagPairs(named).is_raw and BagPairs(named, rectify="always").is_raw
    for flags, said in ((["--rectify", "always"], "note: the images of"), (["--rectify", "auto"], "not rectified")):
        assert (main([str(named), "--method", "sgbm", "--out", str(tmp_path / "out"), *flags]) == 0) == ("note" in said)


def test_a_calibration_of_the_raw_cameras_replaces_camera_info(raw, tmp_path, capsys):
    """A bag of raw images whose CameraInfo were never filled in."""

    def empty(name, message):
        if name.endswith("camera_info"):
            message.k, message.p, message.d = np.zeros(9), np.zeros(12), np.zeros(0)
        return message

    bag = changed(raw, tmp_path / "bag", edit=empty)
    (tmp_path / "stereo.yml").write_text(opencv_text(opencv_pair()))
    flags = ["--calib", str(tmp_path / "stereo.yml"), "--method", "sgbm", "--write", "depth", "cloud", "bag"]
    assert main([str(bag), "--out", str(tmp_path / "out"), *flags]) == 0
    assert "warning" not in capsys.readouterr().err
    folder = tmp_path / "out/frame_000000"
    record, report = (json.loads((folder / n).read_text()) for n in ("prediction.json", "rectified/report.json"))
    assert report["rows"]["rectified"]["median_px"] < 0.06 and report["left"] == "the left image of frame_000000"
    assert record["rig"]["baseline"] == pytest.approx(0.2, rel=1e-3) and record["stamp_ns"] == 10**9
    depth, fx = np.load(folder / "depth.npy"), record["rig"]["fx"]
    true = depth_of(GROUND, rectified_view(opencv_pair(), fx, SIZE), pixel_grid(*SIZE))
    seen = np.isfinite(depth) & (true > 0.5) & (true < 8)
    assert seen.mean() > 0.3 and np.median(np.abs(depth / true - 1)[seen]) < 0.01
    with_bag = Bag(tmp_path / "out/bag")
    assert {"/stereo/depth/image_rect", "/stereo/disparity", "/stereo/points2"} <= set(with_bag.topics)
    cloud = trimesh.load(folder / "cloud.ply").vertices
    (message,) = (message for _, message in with_bag.messages(["/stereo/points2"]))
    assert message.header.frame_id == "left" and message.width * message.height == len(cloud) > 10_000


def test_images_of_another_size_than_their_camera_are_reported(raw, tmp_path, capsys):
    path, *_ = raw
    pairs = BagPairs(path)
    with BagWriter(tmp_path / "bag") as bag:
        for topic, message in pairs.bag.messages(list(pairs.bag.topics)):
            if topic.endswith("image_raw"):
                message.height -= 1
            bag.write(topic, 10**9, message)
    assert main([str(tmp_path / "bag"), "--method", "sgbm", "--out", str(tmp_path / "out")]) == 2
    assert (
        "/left/image_raw at 1.000 s: the image is 480 x 359, its CameraInfo says 480 x 360" in capsys.readouterr().err
    )
