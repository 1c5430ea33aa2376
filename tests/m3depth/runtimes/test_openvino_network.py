"""The network run by OpenVINO against PyTorch's."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import torch
from turned_pairs import RIG, slope, turned

from m3depth.estimator import load_estimator
from m3depth.export import textured_pair
from m3depth.stereo.rows import align_rows
from marssim.base.camera import PinholeCamera, StereoRig

pytest.importorskip("m3depth.runtimes.openvino_import", reason="OpenVINO is not installed")
from m3depth.runtimes.openvino_network import OpenVinoM3Depth

pytestmark = pytest.mark.usefixtures("graphs_folder", "installed")

FP32, BF16 = torch.float32, torch.bfloat16
OTHER_SIZES = [  # each converts and compiles two graphs, which takes seconds: many differences in each
    {"refine_steps": 0, "lookup_levels": 0, "convex_upsampling": False, "fine_width": 0},
    {
        "wavelet_levels": (2, 3), "output_head": 1, "score_kernel": 3, "heads_see_all": True, "lookup_levels": 0,
        "implied_geometry": False, "match_channels": 0, "residual_width": 0, "refine_steps": 1,
    },
]  # fmt: skip
SCORED = {**OTHER_SIZES[0], "score_kernel": 3}  # of a small graph, which two tests convert to bf16


def pair(height, width, baseline=0.27, seed=0):
    """A pair of noise, shifted by 5 px, with the rig of its size."""
    right = np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)
    return np.roll(right, 5, 1), right, StereoRig(PinholeCamera.centred(width, height, 1.1 * width), baseline)


def differences(one, other):
    """Mean difference of disparity [px], normals and confidence where both are known."""
    known = np.isfinite(one.disparity) & np.isfinite(other.disparity)
    assert (np.isfinite(one.disparity) == np.isfinite(other.disparity)).mean() > 0.999
    names = ("disparity", "normal", "confidence")
    return [float(np.abs(getattr(one, name) - getattr(other, name))[known].mean()) for name in names]


@pytest.fixture
def in_fp32(monkeypatch):
    """PyTorch computes in fp32."""
    monkeypatch.setattr("m3depth.network.stereo_network.fast_dtype", lambda device: None)


@pytest.mark.parametrize("sizes", [{}, *OTHER_SIZES], ids=lambda sizes: " ".join(sizes) or "usual sizes")
def test_maps_from_coarse_to_fine_are_those_of_pytorch(small_network, sizes, in_fp32):
    network, images = small_network(**sizes), pair(131, 147, baseline=0.9)
    assert max(differences(network.infer(*images), OpenVinoM3Depth(network, FP32).infer(*images))) < 1e-3


def test_a_volume_scored_by_a_convolution_runs_in_bf16(small_network):
    network, images = small_network(**SCORED), pair(48, 64)
    assert differences(network.infer(*images), OpenVinoM3Depth(network, BF16).infer(*images))[0] < 0.05


def test_nearest_and_max_pixels_do_the_same(small_network, in_fp32):
    network, images = small_network(), pair(96, 128)
    limits = {"nearest": 0.3, "max_pixels": 48 * 64}
    expected, actual = network.infer(*images, **limits), OpenVinoM3Depth(network, FP32).infer(*images, **limits)
    assert actual.depth.shape == (96, 128) and max(differences(expected, actual)) < 1e-3


def test_rows_are_aligned_alike(small_network, in_fp32):
    network, (left, right) = small_network(), slope()
    given = turned(right, RIG, 1.3, 0.0)
    expected = network.infer(left, align_rows(left, given, RIG)[0], RIG)
    for estimator in (network, OpenVinoM3Depth(network, FP32)):
        aligned = estimator.infer(left, given, RIG, align_rows=True)
        assert max(differences(expected, aligned)) < 1e-3
        assert aligned.row_fit is not None and abs(aligned.row_fit.offset - 1.3) < 0.1
        as_given = estimator.infer(left, given, RIG)
        assert as_given.row_fit is None and differences(expected, as_given)[0] > 1e-2


def test_disparities_of_the_shipped_network_are_not_rounded_with_its_convolutions(in_fp32, monkeypatch):
    monkeypatch.setattr("m3depth.runtimes.openvino_network.fast_dtype", lambda device: BF16)
    left, right = ((255 * eye[0]).astype(np.uint8).transpose(1, 2, 0) for eye in textured_pair(1, 256, 320))
    images = left, right, StereoRig(PinholeCamera.centred(320, 256, 350.0), 0.27)
    network = load_estimator("m3depth", runtime="pytorch")
    network.config = replace(network.config, refine_steps=1)  # each step is converted again
    fast = OpenVinoM3Depth(network)
    assert fast.dtype == BF16
    disparity, normal, confidence = differences(network.infer(*images), fast.infer(*images))
    assert disparity < 0.01 and max(normal, confidence) < 0.01


@pytest.mark.parametrize("precision", [FP32, BF16])
def test_passes_over_large_images_run_in_pytorch(small_network, monkeypatch, precision):
    """A graph keeps the scores of all pairs of pixels of a row."""
    network, images = small_network(**({} if precision == FP32 else SCORED)), pair(131, 147, baseline=0.9)
    monkeypatch.setattr("m3depth.network.stereo_network.fast_dtype", lambda device: None if precision == FP32 else BF16)
    monkeypatch.setattr("m3depth.runtimes.openvino_network.LARGEST", 100 * 100)
    split = OpenVinoM3Depth(network, precision)
    split.infer(*images)
    assert all(height * width <= 100 * 100 for _, height, width in split._requests) and split._requests
    monkeypatch.setattr("m3depth.runtimes.openvino_network.LARGEST", 1)
    alone = OpenVinoM3Depth(network, precision)
    assert differences(network.infer(*images), alone.infer(*images)) == [0, 0, 0] and not alone._requests


def test_passes_over_wide_images_run_in_pytorch(small_network, monkeypatch):
    """They have more scores than others of as many pixels."""
    monkeypatch.setattr("m3depth.network.stereo_network.fast_dtype", lambda device: None)
    monkeypatch.setattr("m3depth.runtimes.openvino_network.LARGEST_SCORES", 16 * 100**2)
    fast = OpenVinoM3Depth(small_network(), FP32)
    fast.infer(*pair(64, 480, baseline=0.01))
    assert not fast._requests
    fast.infer(*pair(480, 64, baseline=0.01))
    assert list(fast._requests) == [(False, 480, 64)]


def test_wrong_input_is_refused_as_by_pytorch(small_network):
    fast = OpenVinoM3Depth(small_network(), FP32)
    left, right, rig = pair(64, 96)
    with pytest.raises(ValueError, match="nearest must be positive, got 0"):
        fast.infer(left, right, rig, nearest=0)
    with pytest.raises(ValueError, match="max_pixels must be at least 2048, got -1"):
        fast.infer(left, right, rig, max_pixels=-1)
    for wrong, message in ((right[:, :-1], "is 95 x 64,"), (right.astype(float), "must be a uint8 array")):
        with pytest.raises(ValueError, match=f"^right image {message}"):
            fast.infer(left, wrong, rig)


def test_weights_are_run_by_openvino_where_it_is_installed(small_network, tmp_path, monkeypatch):
    monkeypatch.setattr("m3depth.runtimes.openvino_network.fast_dtype", lambda device: None)
    small_network().save_pretrained(tmp_path / "net.safetensors")
    estimator = load_estimator(f"m3depth:{tmp_path / 'net.safetensors'}")
    assert isinstance(estimator, OpenVinoM3Depth) and estimator.dtype == FP32


def test_few_compiled_sizes_are_kept(small_network, monkeypatch):
    monkeypatch.setattr("m3depth.runtimes.openvino_network.SIZES", 1)
    fast = OpenVinoM3Depth(small_network(**OTHER_SIZES[0]), FP32)  # of the smallest graph
    for width in (64, 72):
        fast.infer(*pair(48, width))
        assert list(fast._requests) == [(False, 48, width)]


def test_threads_may_share_an_estimator_and_processes_get_their_own(small_network):
    fast = OpenVinoM3Depth(small_network(**OTHER_SIZES[0]), FP32)
    images = pair(64, 96)
    first = fast.infer(*images).disparity
    before = first.copy()
    fast.infer(*pair(64, 96, seed=5))
    np.testing.assert_array_equal(first, before)  # the next pair does not write into the last one's maps
    with ThreadPoolExecutor(3) as pool:
        results = list(pool.map(lambda _: fast.infer(*images).disparity, range(3)))
    results.append(pickle.loads(pickle.dumps(fast)).infer(*images).disparity)
    for result in results:
        np.testing.assert_array_equal(result, first)
