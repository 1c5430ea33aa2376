"""What speaks against a rectified pair, from matches that are made up."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from raw_pairs import opencv_pair

from m3depth.rectification.checked import _findings, rectified
from m3depth.rectification.options import RawOptions, RectifyOptions
from m3depth.rectification.pair import Matches, RectifiedPair
from m3depth.rectification.raw_image import RawImage
from m3depth.rectification.row_errors import row_errors
from marssim.base.calibration.orientation import rectified_view

PAIR = opencv_pair()


def matched(disparity: float, shift: float = 0.0, before: float = 0.0, after: float = 0.0, focal: float | None = None):
    """Return a pair with matches of a disparity, whose rows lie `before` and `after` apart [px]."""
    view = rectified_view(PAIR, focal)
    shown = np.ones((view.left.height, view.left.width), bool)
    left = np.random.default_rng(0).uniform(50, 200, (500, 2))
    right, raw = left - [disparity, -after], left - [disparity, -before]
    matches = Matches(left, right, left, raw, row_errors(left, raw), row_errors(left, right))
    image = np.zeros(shown.shape, np.uint8)
    return RectifiedPair(image, image, shown, shown, view.with_shift(shift), matches, None, PAIR)


@pytest.mark.parametrize(("disparity", "shift", "is_exchanged"), [(-3, 0, True), (3, 0, False), (-3, 8, False)])
def test_eyes_are_exchanged_where_the_disparities_with_their_common_part_are_negative(disparity, shift, is_exchanged):
    messages = [message for _, message in _findings(matched(disparity, shift), "a and b")]
    assert any("exchange left and right" in message for message in messages) == is_exchanged


@pytest.mark.parametrize(("factor", "is_found"), [(0.5, True), (1.0, True), (1.8, False)])
def test_rows_may_lie_as_much_farther_apart_as_the_image_is_enlarged(factor, is_found):
    focal = factor * PAIR.left.lens.focal()
    pair = matched(5.0, before=0.2, after=0.9, focal=focal)
    assert any("rectified already" in message for _, message in _findings(pair, "a and b")) == is_found
    assert not _findings(replace(pair, matches=matched(5.0, before=0.2, after=0.5).matches), "a and b")


def test_the_second_mask_is_that_of_the_right_image(tmp_path, monkeypatch):
    given = {}

    def keep(left, right, *_):
        given.update(left=left.valid, right=right.valid)
        raise InterruptedError

    monkeypatch.setattr("m3depth.rectification.checked.rectify_pair", keep)
    for number in range(2):
        mask = np.full((6, 8), 255, np.uint8)
        mask[:, number] = 0
        cv2.imwrite(str(tmp_path / f"{number}.png"), mask)
    images = [RawImage(Path(f"{eye}.png"), np.zeros((6, 8), np.uint8), np.ones((6, 8), bool)) for eye in ("a", "b")]
    masks = tmp_path / "0.png", tmp_path / "1.png"
    options = RectifyOptions((images[0].path, images[1].path), tmp_path, raw=RawOptions(align=True), mask=masks)
    with pytest.raises(InterruptedError):
        rectified(options, *images)
    for number, eye in enumerate(("left", "right")):
        assert np.flatnonzero(~given[eye][0]).tolist() == [number]
