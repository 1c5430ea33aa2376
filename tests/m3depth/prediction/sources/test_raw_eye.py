"""A bag of raw images with the CameraInfo that OpenCV's stereoRectify gives, against a scene in closed form."""

import cv2
import numpy as np
import pytest
from raw_pairs import GROUND, SIZE, drawn, opencv_pair

from m3depth.predict import main
from m3depth.prediction.sources.bag_pairs import BagPairs
from marssim.base.bags.messages import camera_info_message, image_message
from marssim.base.bags.writer import BagWriter
from marssim.base.camera import PinholeCamera


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
