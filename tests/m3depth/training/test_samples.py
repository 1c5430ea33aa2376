from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
import torch

from m3depth.training.augmentation import AugmentConfig, crop, random_crop, resized
from m3depth.training.batch import whole_batch
from m3depth.training.losses import consistency_residual
from m3depth.training.packing import SCORED, TRAINED, pack, reduction_of
from m3depth.training.samples import (
    JoinedPairs,
    PackedCache,
    batches,
    check_labels,
    make_batch,
    sample_index,
    without_labels,
)
from marssim.base.camera import NATECAM


def test_packing_keeps_the_truth(plane_samples) -> None:
    sample = plane_samples[0]
    batch = whole_batch(pack(sample))
    torch.testing.assert_close(batch.left[0].permute(1, 2, 0), torch.from_numpy(sample.left) / 255)
    known = np.isfinite(sample.depth)
    assert np.abs(batch.target.disparity[0, 0].numpy() - sample.disparity)[known].max() <= 1e-6
    np.testing.assert_array_equal(batch.target.sky[0, 0].numpy(), ~known)
    np.testing.assert_array_equal(batch.target.label[0, 0].numpy(), sample.valid & (sample.disparity <= 192))
    np.testing.assert_array_equal(batch.target.rock[0, 0].numpy(), sample.rock > 0)
    cosine = (batch.target.normal[0].permute(1, 2, 0).numpy() * sample.normal).sum(-1)[known]
    assert cosine.min() > np.cos(np.radians(0.6))


def test_far_and_too_near_pixels_are_not_trained(plane_samples) -> None:
    sample = plane_samples[0]
    depth = np.full_like(sample.depth, 5.0)
    depth[0], depth[1], depth[2] = 60.0, 0.1, np.inf
    disparity = sample.rig.depth_to_disparity(depth)
    flags = pack(replace(sample, depth=depth, disparity=disparity)).flags
    assert (flags[0] & 3 == 0).all()
    assert (flags[1] & 3 == 0).all()
    assert (flags[2] & 3 == 2).all()
    assert (flags[3:] & 1).all()


def test_what_one_eye_sees_and_the_rover_are_marked(plane_samples) -> None:
    sample = plane_samples[0]
    occluded, rock = np.zeros_like(sample.occluded), sample.rock.copy()
    occluded[40:44, 60:70] = True
    rock[50:] = -1
    target = whole_batch(pack(replace(sample, occluded=occluded, rock=rock))).target
    beside = np.arange(sample.left.shape[1]) < np.where(np.isfinite(sample.disparity), sample.disparity, 0)
    np.testing.assert_array_equal(target.one_eye[0, 0].numpy(), occluded | beside)
    assert beside.any() and not beside.all()
    np.testing.assert_array_equal(target.rover[0, 0].numpy(), rock < 0)


def test_the_disparity_of_the_images_is_trained_and_not_that_of_the_depth(plane_samples) -> None:
    sample = plane_samples[0]
    known = np.isfinite(sample.depth)
    seen = np.where(known, sample.disparity - 5.0, 0).astype(np.float32)
    target = whole_batch(pack(replace(sample, disparity=seen))).target
    trained = (pack(replace(sample, disparity=seen)).flags & TRAINED) > 0
    assert np.abs(target.disparity[0, 0].numpy() - seen)[trained].max() <= 1e-6
    assert (known & (seen <= 0)).any() and not trained[seen <= 0].any()


def test_unknown_depth_is_neither_trained_nor_sky_and_unknown_normals_leave_depth_trained(plane_samples) -> None:
    sample = plane_samples[0]
    depth, normal = sample.depth.copy(), sample.normal.copy()
    ground = np.isfinite(depth)
    depth[40:50] = np.nan
    normal[50:] = 0
    disparity = sample.rig.depth_to_disparity(depth)
    target = whole_batch(pack(replace(sample, depth=depth, disparity=disparity, normal=normal))).target
    assert not target.label[0, 0, 40:50].any() and not target.sky[0, 0, 40:50].any()
    np.testing.assert_array_equal(target.label[0, 0, 50:].numpy(), (sample.valid & ground)[50:])
    assert not target.normal[0, :, 50:].any()


def test_rigs_that_see_farther_are_trained_farther(plane_samples) -> None:
    """What is trained ends at 4 px, 40 m for NaTeCam, and at 40 m for rigs that see less there."""
    sample = plane_samples[0]
    long = replace(sample.rig, baseline=5.0)
    depth = np.full_like(sample.depth, 100.0)
    far = replace(sample, rig=long, depth=depth, disparity=long.depth_to_disparity(depth))  # 5 px
    assert (pack(far).flags & 1).all()
    assert not (pack(replace(far, rig=sample.rig, disparity=sample.rig.depth_to_disparity(depth))).flags & 1).any()


def test_crops_move_the_principal_point(plane_samples) -> None:
    """The gradient that normals demand still fits the disparity: the cropped camera is the right one."""
    part = whole_batch(crop(pack(plane_samples[0]), 30, 17, 32, 64))
    target = part.target
    residual, usable = consistency_residual(target.disparity, target.normal, target.camera)
    inner = usable & target.label
    assert inner.any()
    # int8 normals are off by up to half a degree
    assert residual.abs()[inner.expand_as(residual)].max() < 0.02
    wrong = target.camera + torch.tensor([0.0, 0, 17, 30])
    residual, _ = consistency_residual(target.disparity, target.normal, wrong)
    assert residual.abs()[inner.expand_as(residual)].max() > 0.02


@pytest.mark.parametrize("size", [(40, 60), (80, 120), (77, 125)])
def test_resized_pairs_are_those_of_the_resized_camera(plane_samples, size) -> None:
    """Disparity, camera and normals still belong to the plane that they were taken of."""
    sample = plane_samples[0]
    part = resized(pack(sample), size)
    assert part.left.shape == part.right.shape == (*size, 3) and part.disparity.shape == size
    rig = sample.rig.resized(size[1], size[0])
    c = rig.camera
    assert part.camera == pytest.approx((c.fx, c.fy, c.cx, c.cy))
    normal = sample.normal[-1, 0].astype(float)  # of the plane, 1.2 m away
    expected = rig.depth_to_disparity(np.maximum(1.2 / -(c.rays() @ normal), 0.01))
    inner = (part.flags & TRAINED) > 0
    assert inner.mean() > 0.5
    got = part.disparity
    assert np.abs(got - expected)[inner].max() < 0.1  # beside the sky
    assert np.median(np.abs(got - expected)[inner]) < 0.004
    target = whole_batch(part).target
    residual, usable = consistency_residual(target.disparity, target.normal, target.camera)
    flat = usable & target.label
    assert residual.abs()[flat.expand_as(residual)].median() < 0.01
    # the right eye shows at x - d what the left one shows at x
    x = np.arange(20, size[1] - 5)
    y = size[0] - 3
    moved = np.interp(x - got[y, x], np.arange(size[1]), part.right[y, :, 0].astype(float))
    inside = x - got[y, x] > 1
    error = np.abs(moved - part.left[y, x, 0])[inside]
    other = np.abs(part.right[y, x, 0].astype(float) - part.left[y, x, 0])[inside]
    assert error.mean() < 0.5 * other.mean()


def test_enlarged_pixels_out_of_reach_are_neither_trained_nor_scored(plane_samples) -> None:
    sample = plane_samples[0]
    depth = np.full_like(sample.depth, sample.rig.fb / 180)
    near = pack(replace(sample, depth=depth, disparity=sample.rig.depth_to_disparity(depth)))
    assert (near.flags & TRAINED).all() and not (resized(near, (80, 120)).flags & TRAINED).any()
    assert (near.flags & SCORED).any() and not (resized(near, (80, 120)).flags & SCORED).any()
    assert (resized(near, (60, 90)).flags & TRAINED).all()


def test_crops_are_scaled_within_what_was_asked_for(plane_samples) -> None:
    packed = pack(plane_samples[0])
    shares = []
    for seed in range(40):
        part = random_crop(packed, (32, 48), AugmentConfig(scale=0.3), np.random.default_rng(seed))
        assert part.left.shape == (32, 48, 3)
        shares.append(part.camera[0] / packed.camera[0])
    assert 1 / 1.33 < min(shares) < 0.9 and 1.1 < max(shares) < 1.33
    assert 10 < sum(share == 1 for share in shares) < 30
    whole = random_crop(packed, (64, 96), AugmentConfig(scale=0.3), np.random.default_rng(1))
    assert whole.left.shape == (64, 96, 3)  # the images allow no reduction


def test_batches_are_a_function_of_seed_and_step(plane_samples) -> None:
    cache = PackedCache(plane_samples, 1 << 30)
    settings = {"size": 2, "crop_size": (32, 64), "config": AugmentConfig(), "seed": 3}
    stream = batches(cache, 4, **settings, threads=2)
    for step in (4, 5, 6):
        got, expected = next(stream), make_batch(cache, step, **settings)
        torch.testing.assert_close(got.left, expected.left)
        torch.testing.assert_close(got.target.camera, expected.target.camera)
    stream.close()
    assert not torch.equal(make_batch(cache, 7, **settings).left, make_batch(cache, 8, **settings).left)
    ranks = [make_batch(cache, 2, **settings, rank=rank, world=2).left for rank in (0, 1)]
    both = make_batch(cache, 2, **{**settings, "size": 4}).left
    torch.testing.assert_close(torch.cat(ranks), both)


def test_larger_pairs_are_trained_farther_out_than_the_volume_reaches(large_samples) -> None:
    sample = large_samples[0]
    packed = pack(sample)
    assert packed.reduction == 2 == reduction_of(sample.rig) and reduction_of(NATECAM) == 1
    assert [reduction_of(NATECAM.resized(size, size)) for size in (1024, 2048, 4096)] == [2, 4, 4]
    depth = np.full_like(sample.depth, sample.rig.fb / 300)
    near = pack(replace(sample, depth=depth, disparity=sample.rig.depth_to_disparity(depth)))
    assert (near.flags & TRAINED).all()
    part = random_crop(near, (32, 96), AugmentConfig(scale=0), np.random.default_rng(0))
    assert part.reduction == 2 and part.left.shape == (64, 192, 3) and (part.flags & TRAINED).all()
    less = random_crop(near._replace(reduction=4), (32, 96), AugmentConfig(scale=0), np.random.default_rng(0))
    assert less.reduction == 2 and less.left.shape == (64, 192, 3)
    whole = random_crop(near, (128, 192), AugmentConfig(scale=0), np.random.default_rng(0))
    assert whole.reduction == 1 and not (whole.flags & TRAINED).any()  # no room for a reduced crop of that size


def test_a_crop_of_a_larger_pair_is_reduced_with_some_rows_at_full_resolution(large_samples) -> None:
    """Both show the same plane: the disparity of the rows is twice that of the crop, at the same places."""
    batch = make_batch(PackedCache(large_samples, 1 << 30), 3, 3, (64, 96), AugmentConfig(scale=0), 5)
    assert batch.left.shape == (3, 3, 64, 96) and [band.crop for band in batch.finer] == [0, 1, 2]
    for band in batch.finer:
        rows = band.left.shape[-2]
        assert band.size == (128, 192) and band.left.shape[-1] == 192 and band.top % 8 == 0 and rows % 32 == 0
        finer = torch.nn.functional.avg_pool2d(band.target.disparity, 2)[0, 0]
        known = torch.nn.functional.avg_pool2d(band.target.label.float(), 2)[0, 0] == 1
        part = slice(band.top // 2, (band.top + rows) // 2)
        reduced = 2 * batch.target.disparity[band.crop, 0, part]
        known &= batch.target.label[band.crop, 0, part]
        assert known.float().mean() > 0.4
        assert (finer - reduced)[known].abs().median() < 0.02
        images = torch.nn.functional.avg_pool2d(band.left, 2)[0]
        assert (images - batch.left[band.crop, :, part]).abs().mean() < 0.01
        residual, usable = consistency_residual(band.target.disparity, band.target.normal, band.target.camera)
        assert residual.abs()[(usable & band.target.label).expand_as(residual)].median() < 0.01


def test_parts_of_a_batch_keep_their_rows(plane_samples, large_samples) -> None:
    mixed = [plane_samples[0], large_samples[1], plane_samples[2], large_samples[3]]
    cache = PackedCache(mixed, 1 << 30)
    batch = make_batch(cache, 0, 4, (32, 64), AugmentConfig(), 1)
    crops = [band.crop for band in batch.finer]
    assert 0 < len(crops) < 4
    parts = batch.split(2)
    assert [band.crop + 2 * n for n, part in enumerate(parts) for band in part.finer] == crops


def test_every_epoch_holds_every_sample() -> None:
    for epoch in range(3):
        assert sorted(sample_index(7, epoch * 7 + i, seed=0) for i in range(7)) == list(range(7))
    assert [sample_index(7, i, 0) for i in range(7)] != [sample_index(7, 7 + i, 0) for i in range(7)]


def test_augmented_images_are_in_range_and_change(plane_samples) -> None:
    cache = PackedCache(plane_samples, 1 << 30)
    lefts = [make_batch(cache, step, 1, (64, 96), AugmentConfig(), 0).left for step in range(12)]
    assert all(float(x.min()) >= 0 and float(x.max()) <= 1 for x in lefts)
    contrasts = [float(x.std()) for x in lefts]
    assert max(contrasts) > 1.5 * min(contrasts)


def test_cache_reads_once_and_respects_its_limit(plane_samples) -> None:
    class Counted(list):
        reads = 0

        def __getitem__(self, index):
            Counted.reads += 1
            return super().__getitem__(index)

    size = pack(plane_samples[0]).nbytes
    cache = PackedCache(Counted(plane_samples), int(2.5 * size))
    for index in (0, 1, 2, 0, 1, 2):
        cache[index]
    assert (Counted.reads, cache.used) == (4, 2 * size)


def test_too_large_a_crop_is_named(plane_samples) -> None:
    with pytest.raises(ValueError, match="--crop 128 96"):
        make_batch(PackedCache(plane_samples, 0), 0, 1, (128, 96), AugmentConfig(), 0)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("contrast", 0.0),
        ("contrast", 1.3),
        ("blur", -1.0),
        ("noise", float("nan")),
        ("grey", 1.1),
        ("eye_gain", -0.1),
        ("eye_gain", 1.1),
        ("gamma", 1000.0),
        ("scale", 1000.0),
    ],
)
def test_augmentation_that_cannot_work_names_its_flag(name, value) -> None:
    with pytest.raises(ValueError, match=f"--augment.{name.replace('_', '-')} must be"):
        AugmentConfig(**{name: value})


def test_several_sequences_are_one_in_their_order() -> None:
    joined = JoinedPairs(["ab", "", "cde"])
    assert [joined[i] for i in range(len(joined))] == list("abcde")
    assert [joined[i] for i in range(-5, 0)] == list("abcde")
    for outside in (5, -6):
        with pytest.raises(IndexError, match=f"5 samples, none has the index {outside}"):
            joined[outside]
    with pytest.raises(IndexError, match="0 samples"):
        JoinedPairs([])[0]


def test_a_first_pair_without_labels_does_not_end_a_training(plane_samples) -> None:
    nowhere = np.full_like(plane_samples[0].depth, np.nan)
    blank = replace(plane_samples[0], depth=nowhere, disparity=np.zeros_like(nowhere))
    for samples, is_refused in (([blank, plane_samples[1]], False), ([blank] * 9, True)):
        with pytest.raises(ValueError, match="no pixel of 8 pairs, from this one on") if is_refused else nullcontext():
            check_labels(PackedCache(samples, 1 << 30), samples)
    samples = JoinedPairs([plane_samples[:2], [plane_samples[0], blank, blank], [blank, plane_samples[1]]])
    first, second = without_labels(PackedCache(samples, 1 << 30), samples)
    assert "2 of the first 3 pairs have no pixel that can be trained; check the maps" in first
    assert "1 of the first 2 pairs has no pixel that can be trained; check the maps" in second
