import matplotlib
import numpy as np
import pytest

from marssim.base.images.colours import (
    DEPTH_MAP,
    DISPARITY_MAP,
    TICKS,
    depth_bar,
    depth_colours,
    depth_ticks,
    normal_colours,
)


def test_depth_colours_tell_near_from_far_from_sky_from_unknown():
    depth = np.array([[0.5, 1.0, 3.0, 14.0, 16.0, np.inf, np.nan]], np.float32)
    colours = depth_colours(depth)
    assert colours.shape == (1, 7, 3) and colours.dtype == np.uint8
    near, one, three, far, beyond, sky, unknown = colours[0].astype(int)
    assert np.array_equal(near, one) and min(one[:2]) > 200 > one[2]  # yellow; nearer than `near` is no other colour
    assert far[2] > far[0] and far.sum() < one.sum() / 2  # violet, dark
    assert len({tuple(c) for c in (one, three, far)}) == 3
    assert (beyond == 90).all() and (sky == 90).all() and (unknown == 0).all()


def test_depth_colours_are_logarithmic():
    ramp = depth_colours(np.geomspace(1, 15, 200, dtype=np.float32)[None])[0].astype(int)
    moved = np.abs(np.diff(ramp, axis=0)).sum(axis=1)
    thirds = [moved[:66].sum(), moved[66:133].sum(), moved[133:].sum()]
    assert min(thirds) > 0.15 * sum(thirds) > 100


def test_matplotlib_draws_depth_in_the_same_colours_and_disparity_in_their_reverse():
    share = np.linspace(0, 1, 256)
    drawn = matplotlib.colormaps[DEPTH_MAP](share)[:, :3] * 255
    assert np.abs(depth_colours(15 ** share[None]).reshape(-1, 3) - drawn).max() < 4
    assert np.allclose(matplotlib.colormaps[DISPARITY_MAP](1 - share)[:, :3] * 255, drawn)


def test_the_scale_of_depth_has_the_colours_of_its_ticks():
    bar, columns = depth_bar(300, height=7)
    assert bar.shape == (7, 300, 3) and len(columns) == len(TICKS) and (columns[0], columns[-1]) == (0, 299)
    ticks = depth_colours(np.array([TICKS], float))[0].astype(int)
    assert np.abs(bar[3, columns].astype(int) - ticks).max() < 8


@pytest.mark.parametrize(
    ("depths", "ticks"),
    [
        ([0.31, 0.42], (0.3, 0.4, 0.5)),
        ([0.07, 0.35, np.inf, np.nan], (0.07, 0.1, 0.15, 0.2, 0.3, 0.4)),
        ([0.5, 0.95], (0.5, 0.7, 1)),
        ([0.2, 0.2], (0.2, 0.3)),
        ([1.0, 1.0], (1, 1.5)),
        ([0.3, 1.2], TICKS),
        ([np.inf], TICKS),
    ],
)
def test_a_scale_of_what_is_all_near_has_round_ends_around_it(depths, ticks):
    assert depth_ticks([np.array(depths), np.array([np.nan])]) == pytest.approx(ticks)


def test_a_scale_of_near_depths_has_the_colours_of_its_ticks():
    ticks = depth_ticks([np.array([0.06, 0.4])])
    bar, columns = depth_bar(300, ticks=ticks)
    colours = depth_colours(np.array([ticks]), ticks[0], ticks[-1])[0].astype(int)
    assert np.abs(bar[3, columns].astype(int) - colours).max() < 8 and len({tuple(c) for c in colours}) == len(ticks)


def test_normal_colours():
    normal = np.array([[[0, 0, -1], [0, -1, 0], [1, 0, 0], [0, 0, 0], [np.nan, 0, 1]]], np.float32)
    towards, up, right, sky, broken = normal_colours(normal)[0].astype(int)
    assert towards.argmax() == 2 and up.argmax() == 1 and right.argmax() == 0
    assert min(towards[2], up[1], right[0]) == 255 and not sky.any() and not broken.any()
