from dataclasses import replace

import numpy as np
import pytest

from marssim.base.camera import NATECAM
from marssim.base.dataset.sample import StereoSample
from marssim.generation.contact_sheet import contact_sheet

SIDE = 24


def sample(value: int) -> StereoSample:
    depth = np.full((SIDE, SIDE), 5.0, np.float32)
    normal = np.zeros((SIDE, SIDE, 3), np.float32)
    normal[..., 2] = -1
    image = np.full((SIDE, SIDE, 3), value, np.uint8)
    nothing = np.zeros((SIDE, SIDE), bool)
    return StereoSample(
        image, image, depth, depth, normal, ~nothing, nothing, nothing.astype(np.int32), NATECAM.resized(SIDE, SIDE), {}
    )


@pytest.mark.parametrize(("count", "rows"), [(1, 1), (3, 1), (4, 2), (6, 2)])
def test_every_sample_has_its_place(count, rows):
    samples = [sample(10 + 30 * n) for n in range(count)]
    sheet = contact_sheet(samples, columns=3, tile=SIDE)
    columns = min(count, 3)
    assert sheet.dtype == np.uint8 and sheet.shape[0] % rows == 0 and sheet.shape[1] % columns == 0
    high, wide = sheet.shape[0] // rows, sheet.shape[1] // columns
    for n in range(count):
        cell = sheet[n // 3 * high :, n % 3 * wide :][:high, :wide]
        assert (cell == 10 + 30 * n).all(axis=-1).sum() >= 2 * SIDE * SIDE  # both eyes


def test_other_proportions_are_kept():
    wide = replace(
        sample(200),
        **{name: getattr(sample(200), name)[: SIDE // 2] for name in ("left", "right", "depth", "normal")},
    )
    assert contact_sheet([wide], tile=SIDE).shape[0] < contact_sheet([sample(200)], tile=SIDE).shape[0]


def test_no_samples_make_no_sheet():
    with pytest.raises(ValueError, match="at least one"):
        contact_sheet([])
