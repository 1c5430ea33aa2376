"""What speaks against a rectified pair, from matches that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from raw_pairs import opencv_pair

from m3depth.rectification.checked import _findings
from m3depth.rectification.pair import Matches, RectifiedPair
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
