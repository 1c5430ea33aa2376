"""Depth that does not fit its images, made wrong by a known amount."""

import re
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plane_pairs import plane_sample

from m3depth.datasets.config import DataConfig
from m3depth.datasets.depth_check import depth_misfit
from m3depth.datasets.open import open_pairs
from m3depth.stereo.degradation import Degradation
from marssim.base.dataset.sample import StereoSample
from marssim.base.files.json_file import DatasetError

SAMPLES = [plane_sample(seed, 192, 256, 220.0) for seed in range(3)]


def misfit(change: Callable[[StereoSample], StereoSample]) -> str | None:
    """What the check says about the samples after a change of each."""
    return depth_misfit([change(sample) for sample in SAMPLES])


def with_depth(sample: StereoSample, depth: np.ndarray) -> StereoSample:
    return replace(sample, depth=depth, disparity=sample.rig.depth_to_disparity(depth))


def with_slant(sample: StereoSample) -> np.ndarray:
    """The distance along the ray."""
    rays = sample.rig.camera.rays()
    return (sample.depth * np.sqrt((rays**2).sum(-1))).astype(np.float32)


def test_true_depth_fits():
    assert misfit(lambda sample: sample) is None


@pytest.mark.parametrize("faults", ["contrast=.33,blur=1,noise=2.5", "vertical=1", "gain=1.3"])
def test_true_depth_fits_degraded_images(faults):
    degradation = Degradation.parse(faults)

    def degraded(sample: StereoSample) -> StereoSample:
        left, right = degradation.apply(sample.left, sample.right, np.random.default_rng(0))
        return replace(sample, left=left, right=right)

    assert misfit(degraded) is None


@given(st.floats(-3, 3).filter(lambda power: abs(power) > 0.05))
@settings(max_examples=6)
def test_a_wrong_unit_or_baseline_is_found_with_its_factor(power):
    message = misfit(lambda sample: with_depth(sample, sample.depth * np.float32(10**power)))
    factor = re.search(r"disparities that match are (\S+) times as large", message)
    assert float(factor[1]) == pytest.approx(10**power, rel=0.03)
    assert "3 pairs" in message and "unit of the maps" in message and "baseline" in message


@pytest.mark.parametrize("number", [1, 2])
def test_some_pairs_in_another_unit_are_found(number):
    """Two pairs of six are: one alone may be matched wrongly."""
    samples = [*SAMPLES, *SAMPLES]
    for i in range(number):
        samples[2 * i + 1] = with_depth(samples[2 * i + 1], samples[2 * i + 1].depth / 2)
    message = depth_misfit(samples)
    if number == 1:
        assert message is None
    else:
        assert re.match(
            "the true depth of 2 of 6 pairs, one of them .*, does not fit the images: the disparities", message
        )
        assert float(re.search(r"match are (\S+) times as large", message)[1]) == pytest.approx(0.5, rel=0.03)


@pytest.mark.parametrize("shift", [-12, 6])
def test_differing_principal_points_are_found_with_their_difference(shift):
    message = misfit(lambda sample: replace(sample, right=np.roll(sample.right, -shift, axis=1)))
    found = re.search(r"match are (\S+) px (larger|smaller)", message)
    assert float(found[1]) == pytest.approx(abs(shift), abs=0.6)
    assert found[2] == ("larger" if shift > 0 else "smaller") and "cx" in message


def test_a_shift_is_in_pixels_of_the_images():
    wide = [plane_sample(seed, 384, 512, 440.0) for seed in range(3)]
    moved = [replace(sample, right=np.roll(sample.right, -12, axis=1)) for sample in wide]
    found = re.search(r"match are (\S+) px larger", depth_misfit(moved))
    assert float(found[1]) == pytest.approx(12, abs=1.2)


def test_distances_along_the_ray_are_found():
    message = misfit(lambda sample: with_depth(sample, with_slant(sample)))
    assert message.endswith("the maps hold the distance along the ray, not the depth along the optical axis")


def test_exchanged_eyes_are_found():
    message = misfit(lambda sample: replace(sample, left=sample.right, right=sample.left))
    assert message.endswith("exchange the left and the right images")


def test_maps_of_other_pairs_are_found():
    maps = [sample.disparity for sample in SAMPLES]
    others = [replace(sample, disparity=np.flipud(maps[i - 1])) for i, sample in enumerate(SAMPLES)]
    assert re.search(r"\d+% of the matches agree with it; check the calibration, and that", depth_misfit(others))


def test_nothing_is_said_where_little_matches_or_is_known():
    assert misfit(lambda sample: with_depth(sample, np.full_like(sample.depth, np.inf))) is None
    grey = np.full_like(SAMPLES[0].left, 128)
    assert misfit(lambda sample: replace(with_depth(sample, sample.depth * 2), left=grey, right=grey)) is None
    assert depth_misfit([]) is None


def test_what_the_right_eye_does_not_see_does_not_count():
    def hidden(sample: StereoSample) -> StereoSample:
        most = np.arange(sample.depth.shape[1]) < 224
        depth = np.where(most, sample.depth / 3, sample.depth)
        return replace(with_depth(sample, depth), occluded=np.broadcast_to(most, depth.shape))

    assert misfit(hidden) is None
    assert misfit(lambda sample: replace(hidden(sample), occluded=np.zeros_like(sample.occluded))) is not None


@pytest.mark.parametrize("step", [2, 4])
def test_sparse_truth_is_checked_wherever_its_pixels_lie(step):
    """As where a lidar knows a pixel of each block of four, which a reduction by two or four may all miss."""
    large = [plane_sample(seed, 192 * step, 256 * step, 220.0 * step) for seed in range(2)]

    def sparse(sample: StereoSample, factor: float) -> StereoSample:
        depth = np.full_like(sample.depth, np.nan)
        depth[1::step, 1::step] = factor * sample.depth[1::step, 1::step]
        return with_depth(sample, depth)

    assert depth_misfit([sparse(sample, 1.0) for sample in large]) is None
    found = re.search(r"match are (\S+) times as large", depth_misfit([sparse(sample, 2.0) for sample in large]))
    assert float(found[1]) == pytest.approx(2, rel=0.03)


def test_disparities_that_are_not_finite_are_unknown():
    def gaps(sample: StereoSample) -> StereoSample:
        disparity = 2 * sample.disparity
        disparity[::2], disparity[1::4] = np.inf, np.nan
        return replace(sample, disparity=disparity)

    assert "match are 0.4" in misfit(gaps) or "match are 0.5" in misfit(gaps)


def test_grey_images_may_have_a_channel():
    assert misfit(lambda s: replace(s, left=s.left[..., :1], right=s.right[..., :1])) is None


def test_pairs_of_a_users_class_may_have_a_config_of_their_own():
    class Pairs(list):
        config = None
        path = "mine"

    Pairs.config = {"anything": 1}
    doubled = Pairs(with_depth(sample, 2 * sample.depth) for sample in SAMPLES)
    assert depth_misfit(doubled).startswith("mine: the true depth of 3 pairs") and "--unit" not in depth_misfit(doubled)


@pytest.fixture
def files(tmp_path):
    """The samples as files: depth in metres, disparity in pixels."""
    for seed, sample in enumerate(SAMPLES):
        cv2.imwrite(str(tmp_path / f"l{seed}.png"), sample.left)
        cv2.imwrite(str(tmp_path / f"r{seed}.png"), sample.right)
        np.save(tmp_path / f"z{seed}.npy", sample.depth)
        np.save(tmp_path / f"d{seed}.npy", sample.disparity)
    return tmp_path


@pytest.mark.parametrize(
    ("maps", "flags", "factor"),
    [
        ("depth", {}, None), ("depth", {"unit": 100.0}, 0.01), ("depth", {"unit": 1000.0}, 0.001),
        ("depth", {"unit": 0.01}, 100), ("disparity", {}, None), ("disparity", {"unit": 1 / 256}, 1 / 256),
        ("disparity", {"unit": 16.0}, 16), ("disparity", {"baseline": 2.7}, None),
    ],
)  # fmt: skip
def test_units_of_files_are_checked(files, maps, flags, factor):
    pattern = {"depth": "z*.npy", "disparity": "d*.npy"}[maps]
    rig = {"focal": 220.0, "baseline": 0.27}
    config = DataConfig(left="l*.png", right="r*.png", **{maps: pattern}, **{**rig, **flags})
    message = depth_misfit(open_pairs(files, "all", config))
    if factor is None:
        assert message is None
        return
    assert message.startswith(f"{files}: the true depth of 3 pairs does not fit") and "(--unit)" in message
    assert float(re.search(r"match are (\S+) times", message)[1]) == pytest.approx(factor, rel=0.03)
    assert ("baseline" in message) == (maps == "depth")


def test_flags_for_distances_are_named_where_they_are_taken(files):
    shared = {"left": "l*.png", "right": "r*.png", "depth": "z*.npy", "focal": 220.0, "baseline": 0.27}
    wrong = open_pairs(files, "all", DataConfig(**shared, depth_along="ray"))
    assert depth_misfit(wrong).endswith("along the optical axis; leave out --depth-along ray")
    for seed, sample in enumerate(SAMPLES):
        np.save(files / f"z{seed}.npy", with_slant(sample))
    assert depth_misfit(open_pairs(files, "all", DataConfig(**shared))).endswith("; give --depth-along ray")
    assert depth_misfit(open_pairs(files, "all", DataConfig(**shared, depth_along="ray"))) is None


def test_only_the_pairs_that_are_named_are_read(files):
    (files / "l1.png").write_bytes(b"cut")
    config = DataConfig(left="l*.png", right="r*.png", depth="z*.npy", focal=220.0, baseline=0.27, unit=2.0)
    pairs = open_pairs(files, "all", config)
    assert "the true depth of 2 pairs" in depth_misfit(pairs, [0, 2])
    with pytest.raises(DatasetError, match=r"l1\.png"):
        depth_misfit(pairs)


def test_datasets_of_marssim_are_not_matched_again(plane_set, monkeypatch):
    monkeypatch.setattr("m3depth.datasets.depth_check.SGBM", None)
    assert depth_misfit(open_pairs(plane_set, "train")) is None
