from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from turned_pairs import RIG, slope, slope_disparity, turned

from m3depth.network.inference import infer_pair, prediction_of, working_sizes
from m3depth.network.model import M3Depth
from m3depth.network.output import PlainMaps, StereoOutput
from m3depth.stereo.rows import align_rows
from m3depth.weights import SHIPPED_WEIGHTS
from marssim.base.camera import NATECAM, PinholeCamera, StereoRig


@pytest.mark.parametrize(
    ("width", "nearest", "max_pixels", "widths"),
    [
        (512, 0.84, None, [512]),
        (1024, 0.84, None, [513, 1024]),
        (2048, 0.84, None, [513, 2048]),
        (8192, 0.84, None, [513, 2050, 8192]),
        (2048, 0.84, 1024 * 1024, [513, 1024]),
        (2048, 0.84, 256 * 256, [256]),
        (512, 0.84, 1000, [31]),  # not 32 x 32, which is more
        (1024, 1.6, None, [978]),  # hardly larger: not worth another pass
        (1024, 3.0, None, [1024]),
    ],
)
def test_sizes_end_at_the_pixels_of_the_images(
    width: int, nearest: float, max_pixels: int | None, widths: list[int]
) -> None:
    sizes = working_sizes(NATECAM.resized(width, width), 192.0, nearest, max_pixels)
    assert [size[1] for size in sizes] == widths and all(rows == columns for rows, columns in sizes)


@pytest.mark.parametrize("baseline", [1.0, 5.0, 10.0])
def test_no_disparity_is_larger_than_the_width(baseline: float) -> None:
    """So the volume never works on fewer columns than it has hypotheses, however long the baseline."""
    assert working_sizes(replace(NATECAM, baseline=baseline), 192.0, 0.84) == [(192, 192), (512, 512)]
    assert working_sizes(replace(NATECAM.resized(160, 160), baseline=baseline), 192.0, 0.84) == [(160, 160)]


@pytest.mark.parametrize(("side", "baseline", "max_pixels"), [(28, 0.27, None), (256, 0.27, 2048), (384, 5.0, None)])
def test_the_shipped_network_measures_tiny_images_and_long_baselines(
    side: int, baseline: float, max_pixels: int | None
) -> None:
    """Maps on 4 x 4 cells at 1/8 are wrong, so images of no more are padded."""
    rig = StereoRig(PinholeCamera.centred(side, side, 1.16 * side), baseline)
    prediction = shipped().infer(*slope(rig=rig), rig, max_pixels=max_pixels)
    error = np.abs(prediction.disparity - slope_disparity(rig))[:, side // 4 :]
    assert np.nanmedian(error) < 0.02 * side and np.isfinite(error).mean() > 0.8


@cache
def shipped() -> M3Depth:
    return M3Depth.from_pretrained(SHIPPED_WEIGHTS)


def test_networks_without_refinement_work_at_one_size() -> None:
    assert working_sizes(NATECAM.resized(2048, 2048), 192.0, 0.84, refines=False) == [(513, 513)]


def test_a_disparity_grows_with_the_width_of_its_images() -> None:
    """From 35 x 16 to 70 x 33 px, whose height is more than doubled."""
    rig = NATECAM.resized(70, 33)
    prediction = prediction_of(PlainMaps(torch.full((1, 1, 16, 35), 5.0), None, None, None), rig)
    np.testing.assert_allclose(prediction.disparity, np.full((33, 70), 10), rtol=1e-6)
    np.testing.assert_allclose(prediction.depth, rig.fb / 10, rtol=1e-6)


@settings(max_examples=30, deadline=None)
@given(rate=st.floats(0.2, 5), factor=st.sampled_from([1, 2, 4]))
def test_the_confidence_of_enlarged_maps_is_that_of_exponential_errors(rate: float, factor: int) -> None:
    """Of errors of mean 1 / rate px in the small image, 1 - e^(-rate / factor) are below 1 px of the large one."""
    logit = torch.full((1, 1, 16, 32), float(np.log(np.expm1(rate))))  # of 1 - e^-rate
    out = PlainMaps(torch.full((1, 1, 16, 32), 5.0), None, logit, None)
    confidence = prediction_of(out, NATECAM.resized(32 * factor, 16 * factor)).confidence
    np.testing.assert_allclose(confidence, -np.expm1(-rate / factor), rtol=1e-4)


@pytest.mark.parametrize("apart", [0.0, 1.3])
def test_rows_are_aligned_before_the_network_sees_them(apart: float) -> None:
    left, right = slope()
    given = turned(right, RIG, apart, 0.0)
    seen: list[np.ndarray] = []

    def keep(_: torch.Tensor, right: torch.Tensor, camera: torch.Tensor, start: None) -> StereoOutput:
        seen.append((right[0, 0].numpy() * 255).round().astype(np.uint8))
        one = torch.ones(1, 1, *right.shape[-2:])
        normal = torch.cat([0 * one, 0 * one, -one], 1)
        return StereoOutput(one, normal, one, -one, (one, normal), [])

    for align in (False, True):
        infer_pair(keep, 192.0, False, torch.device("cpu"), left, given, RIG, align=align)
    expected, fit = align_rows(left, given, RIG)
    assert (fit is not None) == (apart > 0)
    np.testing.assert_array_equal(seen[0], given)
    np.testing.assert_array_equal(seen[1], expected)
