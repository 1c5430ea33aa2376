import numpy as np

from marssim.base.images.colours import depth_colours, normal_colours


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
