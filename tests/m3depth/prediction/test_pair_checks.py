"""Checks of a pair, on pairs that were corrupted by a known amount."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from m3depth.prediction.pair_checks import check_pair, matched_shares, rows_of
from m3depth.stereo.eye_order import exchanged
from marssim.base.camera import PinholeCamera, StereoRig

H, W = 240, 320
RIG = StereoRig(PinholeCamera.centred(W, H, 300.0), 0.2)


def pair(matrix=((1, 0, -12), (0, 1, 0)), seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A blurred noise wall, and its image under an affine map (of pixels), both with a margin cut off."""
    noise = np.random.default_rng(seed).integers(0, 255, (H + 80, W + 80)).astype(np.float32)
    wall = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 1.5), None, 0, 255, cv2.NORM_MINMAX)
    moved = cv2.warpAffine(wall, np.array(matrix, float), wall.shape[::-1], flags=cv2.INTER_CUBIC)
    return tuple(np.clip(image[40:-40, 40:-40], 0, 255).astype(np.uint8) for image in (wall, moved))


def findings(left: np.ndarray, right: np.ndarray, rig: StereoRig = RIG, aligned: bool = False):
    """What check_pair says, with the rows that rows_of finds."""
    return check_pair(left, right, rig, rows_of(left, right, rig), aligned)


@given(st.floats(-6, 6), st.integers(0, 5))
@settings(max_examples=5)
def test_rows_that_lie_apart_are_measured(rows, seed):
    fit = rows_of(*pair(((1, 0, -12), (0, 1, rows)), seed), RIG)
    assert fit is not None and fit.points > 100
    # all rows move alike here, not as a pitched camera moves them
    assert fit.size == pytest.approx(abs(rows), rel=0.02, abs=0.06)


def test_rows_that_lie_far_apart_are_measured():
    fit = rows_of(*pair(((1, 0, -12), (0, 1, 28))), RIG)
    assert fit is not None and fit.size == pytest.approx(28, rel=0.03)


def test_a_roll_shows_in_the_corners():
    angle = np.deg2rad(1.0)
    centre = np.array([(W + 79) / 2, (H + 79) / 2])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    matrix = np.column_stack([turn, centre - turn @ centre])
    matrix[0, 2] -= 12
    fit = rows_of(*pair(matrix), RIG)
    assert fit.largest == pytest.approx(np.sin(angle) * W / 2, rel=0.1)
    assert fit.size == pytest.approx(np.sin(angle) * W / 12**0.5, rel=0.1)


def test_a_rectified_pair_gives_no_warning():
    assert findings(*pair()) == []
    assert findings(*(np.repeat(image[..., None], 3, axis=2) for image in pair())) == []


def test_noise_and_low_contrast_give_no_warning():
    rng = np.random.default_rng(1)
    dull = [np.clip(100 + 0.3 * (i - 100.0) + 2.5 * rng.standard_normal(i.shape), 0, 255) for i in pair()]
    assert findings(*(image.astype(np.uint8) for image in dull)) == []


def test_exchanged_eyes_are_reported():
    left, right = pair()
    assert not exchanged(matched_shares(left, right, RIG))
    assert exchanged(matched_shares(right, left, RIG))
    [(fatal, message)] = check_pair(right, left, RIG, names=("a.png", "b.png"))
    assert fatal and message == "a.png and b.png match the wrong way round: exchange left and right"


@pytest.mark.parametrize(("rows", "fatal"), [(1.2, False), (4.0, True)])
def test_rows_give_a_warning_from_one_limit_and_an_error_from_another(rows, fatal):
    [(serious, message)] = findings(*pair(((1, 0, -12), (0, 1, rows))))
    assert serious == fatal and "not rectified" in message


def test_rows_that_are_taken_out_give_no_warning_unless_the_pair_is_not_rectified():
    assert findings(*pair(((1, 0, -12), (0, 1, 1.2))), aligned=True) == []
    [(fatal, _)] = findings(*pair(((1, 0, -12), (0, 1, 4.0))), aligned=True)
    assert fatal


def test_limits_grow_with_images_that_will_be_reduced():
    left, right = (cv2.resize(image, None, fx=8, fy=8, interpolation=cv2.INTER_CUBIC) for image in pair())
    right = np.roll(right, 5, axis=0)
    big = RIG.resized(8 * W, 8 * H)
    [(fatal, message)] = findings(left, right, big)
    assert not fatal and "5.0 px apart (root mean square over the image, fitted to " in message


def test_images_without_matches_have_no_rows():
    flat = np.full((H, W), 90, np.uint8)
    left, _ = pair()
    assert rows_of(flat, flat, RIG) is None and rows_of(left, flat, RIG) is None
    assert rows_of(left, pair(seed=9)[1], RIG) is None
    assert check_pair(left, flat, RIG) == [(True, "right is of one grey level: there is nothing to match")]
    [(fatal, message)] = findings(left, pair(seed=9)[1])
    assert fatal and "is it a pair?" in message


def test_one_image_for_both_eyes_is_meaningless():
    left, _ = pair()
    assert check_pair(left, left.copy(), RIG) == [(True, "left and right are one and the same image")]


def test_features_that_match_keep_a_pair_from_being_meaningless(monkeypatch):
    monkeypatch.setattr("m3depth.prediction.pair_checks.matched_shares", lambda *_: (0.02, 0.01))
    assert [fatal for fatal, _ in findings(*pair())] == [False]
    assert [fatal for fatal, _ in findings(pair()[0], pair(seed=9)[1])] == [True]


def test_tiny_images_are_checked_without_an_error():
    rig = StereoRig(PinholeCamera.centred(5, 3, 10.0), 0.2)
    image = np.arange(15, dtype=np.uint8).reshape(3, 5)
    assert all(not fatal for fatal, _ in findings(image, image[:, ::-1].copy(), rig))
