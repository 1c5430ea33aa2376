"""Lens models that fold over inside the image."""

import numpy as np
import pytest

from marssim.base.calibration.lenses.coverage import check_lens, unseen_share
from marssim.base.calibration.lenses.radial_tangential import RadialTangential

SIZE = (400, 400)


def lens(k1: float) -> RadialTangential:
    return RadialTangential(200.0, 200.0, 199.5, 199.5, (k1, 0.0, 0.0, 0.0))


def test_the_share_is_that_beyond_the_fold():
    """x (1 + k1 x^2) turns back at x = sqrt(-1 / (3 k1)), and shows nothing beyond 2 / 3 of that."""
    assert unseen_share(lens(-0.05), SIZE) == 0  # 1.72 of the half width: the corners are at 1.41
    for k1 in (-0.5, -1.0, -4.0):
        radius = 200 * 2 / 3 * np.sqrt(-1 / (3 * k1))
        assert unseen_share(lens(k1), SIZE) == pytest.approx(1 - np.pi * radius**2 / 400**2, abs=0.02)


def test_it_is_refused_in_a_line():
    check_lens(lens(-0.1), SIZE, "D1")  # the outermost corners alone
    with pytest.raises(ValueError, match=r"^D1 folds over inside the image of 400 x 400 px: 89 % of its pixels"):
        check_lens(lens(-1.0), SIZE, "D1")
