import cv2
import numpy as np
import pytest
from turned_pairs import RIG, H, W, slope, turned

from m3depth.predict import predict
from m3depth.prediction.masks import (
    is_valid_mask,
    moved_mask,
    read_valid,
    seen_by_mask,
    unknown_where,
    unmeasured,
    without_upper_margin,
)
from m3depth.prediction.options import PredictOptions
from m3depth.stereo.prediction import Prediction


def flat(disparity: float = 3.0) -> Prediction:
    d = np.full((4, 20), disparity, np.float32)
    d[0] = 0
    depth = np.where(d > 0, 30 / np.maximum(d, 1), np.inf).astype(np.float32)
    return Prediction(depth, d, np.ones((4, 20, 3), np.float32), np.full((4, 20), 0.4, np.float32))


def test_unknown_pixels_hold_nothing_in_any_map():
    where = np.zeros((4, 20), bool)
    where[:2, 3] = True
    out = unknown_where(flat(), where)
    assert np.isnan(out.depth[where]).all() and np.isnan(out.disparity[where]).all()
    assert (out.normal[where] == 0).all() and (out.confidence[where] == 0).all()
    assert np.array_equal(out.depth[~where], flat().depth[~where]) and (out.confidence[~where] == np.float32(0.4)).all()


def test_low_confidence_is_unmeasured_but_sky_is_not():
    assert not unmeasured(flat()).any()
    low = unmeasured(flat(), 0.5)
    assert low[1:].all() and not low[0].any()
    filled = flat()
    filled.confidence[2] = 0
    assert unmeasured(filled)[2].all() and not unmeasured(filled)[[0, 1, 3]].any()


@pytest.mark.parametrize("colours", [(), (3,)])
def test_the_upper_margin_repeats_the_pixel_below_it(colours):
    image = np.random.default_rng(0).integers(0, 255, (6, 5, *colours), dtype=np.uint8)
    valid = np.ones((6, 5), bool)
    assert without_upper_margin(image, None) is image and without_upper_margin(image, valid) is image
    valid[:3, 1], valid[:, 2], valid[2:4, 3], valid[0, 4] = False, False, False, False
    expected = image.copy()
    expected[:3, 1], expected[0, 4] = image[3, 1], image[1, 4]
    assert np.array_equal(without_upper_margin(image, valid), expected)


@pytest.mark.parametrize("shift", [0.0, 2.0])
def test_a_pixel_is_unknown_where_the_right_image_shows_nothing_at_its_match(shift):
    right = np.ones((4, 20), bool)
    right[:, 10:12] = False
    hidden = ~seen_by_mask(flat(), right, shift)
    # x_right = x - 3 in the moved image, which lies 2 px farther left than the given one
    assert np.flatnonzero(hidden[1]).tolist() == [10 - int(shift) + 3, 11 - int(shift) + 3]
    assert np.flatnonzero(hidden[0]).tolist() == [10 - int(shift), 11 - int(shift)]  # sky has disparity 0


def test_masks_of_the_user_and_of_rectify_add_up(tmp_path):
    image = tmp_path / "a.png"
    own, beside = np.full((6, 8), 255, np.uint8), np.full((6, 8), 255, np.uint8)
    own[:, :2], beside[0] = 0, 0
    cv2.imwrite(str(tmp_path / "mask.png"), own)
    assert read_valid(image, None, (6, 8)) is None
    cv2.imwrite(str(image), own)
    cv2.imwrite(str(tmp_path / "a_valid.png"), beside)
    valid = read_valid(image, tmp_path / "mask.png", (6, 8))
    assert valid.sum() == 6 * 5 and not valid[0].any() and not valid[:, :2].any()
    assert is_valid_mask(tmp_path / "a_valid.png") and not is_valid_mask(image)
    assert not is_valid_mask(tmp_path / "b_valid.png")
    cv2.imwrite(str(tmp_path / "c[0].png"), own)
    assert is_valid_mask(tmp_path / "c[0]_valid.png")
    with pytest.raises(ValueError, match=r"mask.png: is 8 x 6, its image is 9 x 6"):
        read_valid(image, tmp_path / "mask.png", (6, 9))


def test_the_mask_of_the_right_image_is_turned_with_its_rows(tmp_path):
    """Row 100 of the pair is row 102 of the right image as it was given, and of its mask."""
    left, right = slope()
    valid = np.full((H, W), 255, np.uint8)
    valid[102:132] = 0
    files = [tmp_path / f"{name}.png" for name in ("left", "right", "valid")]
    for file, image in zip(files, (left, turned(right, RIG, 2.0, 0.0), valid), strict=True):
        cv2.imwrite(str(file), image)
    full = tmp_path / "full.png"
    cv2.imwrite(str(full), np.full((H, W), 255, np.uint8))
    flags = {"focal": RIG.camera.fx, "baseline": RIG.baseline, "estimator": "sgbm", "write": ("depth",)}
    prediction = predict(PredictOptions(tuple(files[:2]), tmp_path / "out", mask=(full, files[2]), **flags))
    unknown = np.isnan(prediction.depth[:, 100:-20]).mean(axis=1)
    assert (unknown[101:129] > 0.99).all() and (unknown[[97, 98, 131, 132]] < 0.2).all()


def test_the_method_sees_no_margin_above_the_scene(tmp_path):
    """Both images are black above row 20, as after a rectification: the right one as it is moved."""
    seen = []

    class Watching:
        def infer(self, left, right, rig):
            seen.append((left, right))
            depth = np.full((H, W), 5, np.float32)
            return Prediction(depth, rig.depth_to_disparity(depth), None, np.ones_like(depth))

    left, right = slope()
    valid = np.full((H, W), 255, np.uint8)
    valid[:20] = 0
    files = [tmp_path / f"{name}.png" for name in ("left", "right", "valid")]
    for file, image in zip(files, (left, right, valid), strict=True):
        image = image.copy()
        image[:20] = 0
        cv2.imwrite(str(file), image)
    flags = {"focal": RIG.camera.fx, "baseline": RIG.baseline, "write": ("depth",), "unchecked": True}
    options = PredictOptions(tuple(files[:2]), tmp_path / "out", mask=(files[2], files[2]), **flags)
    prediction = predict(options, Watching())
    for image in seen[0]:
        assert (image[:20] == image[20]).all() and image[20].any()
    assert np.isnan(prediction.depth[:20]).all() and np.isfinite(prediction.depth[20:]).all()


def test_beyond_the_border_of_a_right_image_that_was_moved_there_is_no_match_to_judge():
    right = np.ones((4, 20), bool)
    right[:, 0] = False  # the border, which a move to the right repeats
    hidden = ~seen_by_mask(flat(), right, -4.0)
    assert np.flatnonzero(hidden[1]).tolist() == [4 + 3]


def test_a_mask_that_moves_by_a_part_of_a_pixel_lets_nothing_of_the_hidden_part_through():
    valid = np.ones((4, 30), bool)
    valid[:, 10:20] = False
    for shift in (2.3, 2.0, -2.3):
        hidden = np.arange(30) + shift  # column of the given image that each column of the moved one shows
        assert np.array_equal(~moved_mask(valid, shift)[1], (hidden >= 9.5) & (hidden < 19.5))
