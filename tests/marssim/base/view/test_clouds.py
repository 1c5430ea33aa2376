import numpy as np
import pytest

from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.images.colours import confidence_colours, depth_colours, normal_colours
from marssim.base.view.clouds import shown_pixels, view_of_maps

RIG = StereoRig(PinholeCamera.centred(40, 30, 50.0), 0.2)


def test_pixels_without_depth_and_those_too_far_become_no_points():
    depth = np.array([[1.0, np.inf, np.nan], [0.0, -2.0, 31.0]], np.float32)
    assert shown_pixels(depth).tolist() == [[True, False, False], [False, False, False]]


@pytest.mark.parametrize("most", [1, 40, 299, 1199])
def test_too_many_points_are_thinned_evenly(most):
    pixels = shown_pixels(np.full((30, 40), 2.0, np.float32), most=most)
    assert 0.2 * most <= pixels.sum() <= most
    rows, columns = np.nonzero(pixels)
    steps = {*np.diff(np.unique(rows)).tolist(), *np.diff(np.unique(columns)).tolist()}
    assert len(steps) <= 1


def test_every_map_gives_colours_that_are_those_of_its_pictures():
    rng = np.random.default_rng(0)
    depth = rng.uniform(1, 20, (30, 40)).astype(np.float32)
    depth[0, :5] = np.inf
    image = rng.integers(0, 256, (30, 40, 3)).astype(np.uint8)
    normal = np.zeros((30, 40, 3), np.float32)
    normal[..., 2] = -1
    confidence = rng.uniform(0, 1, (30, 40)).astype(np.float32)
    view, pixels = view_of_maps(RIG, depth, image, normal, confidence, scale=(2, 10))
    assert list(view.layers) == ["image", "depth", "normals", "confidence"]
    assert pixels.sum() == 1195 == len(view.points)
    for name, colours in (
        ("image", image),
        ("depth", depth_colours(depth, 2, 10)),
        ("normals", normal_colours(normal)),
        ("confidence", confidence_colours(confidence)),
    ):
        assert np.array_equal(view.layers[name].colours, colours[pixels]), name
    assert "2 m yellow to 10 m violet" in view.layers["depth"].legend
    assert np.allclose(RIG.camera.project(view.points), np.argwhere(pixels)[:, ::-1], atol=1e-3)
    assert np.allclose(view.points[:, 2], depth[pixels])


def test_a_pair_of_depth_alone_has_one_choice_and_a_pair_of_sky_no_points():
    view, _ = view_of_maps(RIG, np.full((30, 40), np.inf, np.float32))
    assert list(view.layers) == ["depth"] and len(view.points) == 0 and len(view.layers["depth"].colours) == 0


def test_confidence_goes_from_blue_to_yellow_and_nan_counts_as_zero():
    low, high, unknown = confidence_colours(np.array([[0, 1, np.nan]], np.float32))[0].astype(int)
    assert low[2] > low[0] and high[0] > high[2] and np.array_equal(low, unknown)
