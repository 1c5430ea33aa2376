"""Each part of the augmentation, alone, does what it says and nothing else."""

import math
from dataclasses import asdict, replace

import numpy as np
import pytest
from plane_pairs import plane_sample

from m3depth.training.augmentation import AugmentConfig, augment, random_crop, resized
from m3depth.training.packing import pack

OFF = AugmentConfig(
    contrast=1, brightness=0, gamma=0, eye_gain=0, noise=0, blur=0, grey=0, vertical=0, occlude=0, bottom=0, scale=0
)
H, W = 48, 64


def pair() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    texture = rng.integers(90, 140, (H, W + 6, 3), dtype=np.uint8)
    return texture[:, :W].copy(), texture[:, 6:].copy()


def draws(**part: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Twenty augmented pairs under one part alone; float in [0, 1]."""
    left, right = pair()
    return [augment(left, right, replace(OFF, **part), np.random.default_rng(seed)) for seed in range(20)]


def plain() -> tuple[np.ndarray, np.ndarray]:
    left, right = pair()
    return left / np.float32(255), right / np.float32(255)


def changed(eyes: list[np.ndarray], plain_eye: np.ndarray) -> list[bool]:
    return [bool(np.abs(eye - plain_eye).max() > 1e-5) for eye in eyes]


def test_contrast_scales_both_eyes_alike() -> None:
    left, right = plain()
    shares = []
    for a, b in draws(contrast=0.4):
        share = a.std() / left.std()
        assert b.std() / right.std() == pytest.approx(share, rel=1e-3)
        np.testing.assert_allclose(a.mean(), left.mean(), atol=0.02)
        shares.append(share)
    assert 0.39 < min(shares) < 0.7 and max(shares) < 1.26


def test_brightness_shifts_both_eyes_alike() -> None:
    left, right = plain()
    shifts = [(a - left, b - right) for a, b in draws(brightness=0.1)]
    for a, b in shifts:
        assert a.std() < 1e-5 and b.std() < 1e-5 and a.mean() == pytest.approx(b.mean(), abs=1e-5)
        assert abs(a.mean()) <= 0.1 + 1e-6
    assert max(abs(a.mean()) for a, _ in shifts) > 0.05


def test_eye_gain_is_of_the_right_eye_alone() -> None:
    left, right = plain()
    drawn = draws(eye_gain=0.1)
    assert not any(changed([a for a, _ in drawn], left))
    gains = [float((b / right).mean()) for _, b in drawn]
    assert all(0.899 < gain < 1.101 for gain in gains) and max(gains) - min(gains) > 0.05


def test_noise_is_each_eyes_own() -> None:
    left, right = plain()
    drawn = draws(noise=0.05)
    noisy = [(a - left, b - right) for a, b in drawn if np.abs(a - left).max() > 1e-5]
    assert 4 < len(noisy) < 16
    for a, b in noisy:
        assert a.std() == pytest.approx(b.std(), rel=0.1) and a.std() < 0.051
        assert abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < 0.1


def test_blur_smooths_both_eyes() -> None:
    left, right = plain()
    drawn = [(a, b) for a, b in draws(blur=1.5) if np.abs(a - left).max() > 1e-5]
    assert 2 < len(drawn) < 14
    for a, b in drawn:
        assert np.abs(np.diff(a, axis=1)).mean() < 0.99 * np.abs(np.diff(left, axis=1)).mean()
        assert np.abs(np.diff(b, axis=1)).mean() < 0.99 * np.abs(np.diff(right, axis=1)).mean()


def test_grey_drops_the_colour_of_both_eyes() -> None:
    drawn = draws(grey=0.5)
    grey = [np.ptp(a, axis=2).max() < 1e-6 for a, _ in drawn]
    assert 4 < sum(grey) < 16
    assert grey == [np.ptp(b, axis=2).max() < 1e-6 for _, b in drawn]


def test_vertical_moves_the_right_eye_by_less_than_was_asked_for() -> None:
    left, right = plain()
    drawn = draws(vertical=0.8)
    assert not any(changed([a for a, _ in drawn], left))
    moved = [b for _, b in drawn if np.abs(b - right).max() > 1e-5]
    assert 4 < len(moved) < 16
    inside, shifts = np.s_[2:-2], []
    for b in moved:
        fits = []
        for side in (-1, 1):  # between two rows: a share of the way to the next one, by least squares
            step = (np.roll(right, side, 0) - right)[inside]
            share = float((step * (b - right)[inside]).sum() / (step * step).sum())
            fits.append((np.abs(right[inside] + share * step - b[inside]).max(), side * share))
        worst, shift = min(fits)
        assert worst < 0.01
        shifts.append(shift)
    assert max(map(abs, shifts)) <= 0.82 and min(shifts) < -0.2 and max(shifts) > 0.2


def test_patches_hide_part_of_the_right_eye_alone() -> None:
    left, right = plain()
    drawn = draws(occlude=0.5)
    assert not any(changed([a for a, _ in drawn], left))
    hidden = [np.abs(b - right).max(-1) > 1e-5 for _, b in drawn if np.abs(b - right).max() > 1e-5]
    assert 4 < len(hidden) < 16
    for mask in hidden:
        assert 0 < mask.mean() < 0.15  # two patches of a quarter of each side at most


def test_nothing_leaves_the_range() -> None:
    left, right = pair()
    for seed in range(20):
        for eye in augment(255 - 4 * (left - 90), right, AugmentConfig(), np.random.default_rng(seed)):
            assert eye.dtype == np.float32 and eye.min() >= 0 and eye.max() <= 1


def test_a_zero_has_no_sign() -> None:
    names = [name for name in asdict(AugmentConfig()) if name != "contrast"]
    values = asdict(AugmentConfig(**dict.fromkeys(names, -0.0)))
    assert all(math.copysign(1, values[name]) == 1 for name in names)


def test_parts_of_the_augmentation_can_be_turned_off(plane_samples) -> None:
    sample = plane_samples[0]
    for seed in range(8):  # several draws: each part has a chance of its own
        eyes = augment(sample.left, sample.right, OFF, np.random.default_rng(seed))
        for eye, image in zip(eyes, (sample.left, sample.right)):
            np.testing.assert_allclose(eye, image / np.float32(255), atol=1e-6)


def test_resizing_invents_no_disparity_between_two_surfaces(plane_samples) -> None:
    sample = plane_samples[0]
    height, width = sample.depth.shape
    disparity = np.where(np.arange(width) < width // 2, 20.0, 60.0) * np.ones((height, width))
    packed = pack(replace(sample, depth=sample.rig.disparity_to_depth(disparity), disparity=disparity))
    larger = resized(packed, (round(1.25 * height), round(1.25 * width)))
    assert set(np.unique(larger.disparity)) == {25, 75}


@pytest.mark.parametrize("size", [(16, 96), (64, 32), (64, 96)])
def test_crops_as_wide_or_as_high_as_the_image_fit_into_it(size):
    packed = pack(plane_sample(0))
    assert packed.left.shape[:2] == (64, 96)
    for seed in range(12):
        part = random_crop(packed, size, AugmentConfig(scale=0.5), np.random.default_rng(seed))
        assert part.left.shape[:2] == size and part.camera[0] >= packed.camera[0] * 0.999
