from dataclasses import replace

import numpy as np
import pytest

from marssim.camera import NATECAM
from marssim.contact_sheet import contact_sheet, depth_colours, normal_colours
from marssim.dataset import StereoSample

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


def test_depth_colours_tell_near_from_far_from_sky_from_unknown():
    depth = np.array([[0.5, 1.0, 3.0, 14.0, 16.0, np.inf, np.nan]], np.float32)
    colours = depth_colours(depth)
    assert colours.shape == (1, 7, 3) and colours.dtype == np.uint8
    near, one, three, far, beyond, sky, unknown = colours[0].astype(int)
    assert np.array_equal(near, one) and one[0] > one[2]  # red; nearer than `near` is no other colour
    assert far[2] > far[0] or far.sum() < one.sum()  # blue, dark
    assert len({tuple(c) for c in (one, three, far)}) == 3
    assert (beyond == 90).all() and (sky == 90).all() and (unknown == 0).all()


def test_depth_colours_are_logarithmic():
    ramp = depth_colours(np.geomspace(1, 15, 200, dtype=np.float32)[None])[0].astype(int)
    moved = np.abs(np.diff(ramp, axis=0)).sum(axis=1)
    assert moved[:66].sum() > 200 and moved[66:133].sum() > 200 and moved[133:].sum() > 200


def test_normal_colours():
    normal = np.array([[[0, 0, -1], [0, -1, 0], [1, 0, 0], [0, 0, 0], [np.nan, 0, 1]]], np.float32)
    towards, up, right, sky, broken = normal_colours(normal)[0].astype(int)
    assert towards.argmax() == 2 and up.argmax() == 1 and right.argmax() == 0
    assert min(towards[2], up[1], right[0]) == 255 and not sky.any() and not broken.any()


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
