"""Figures against hand-made errors, against torchmetrics, and the rule that nothing is dropped."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from m3depth.evaluation.metrics import (
    DEPTH_TERMS,
    NORMAL_TERMS,
    angle_between,
    capped_depth,
    depth_terms,
    grey_deviation,
    normal_terms,
    pixel_kinds,
)
from m3depth.evaluation.running_sums import NEAR_GROUND, RunningSums
from m3depth.evaluation.scores import ScoredPair, Scores
from m3depth.stereo.prediction import Prediction
from marssim.base.camera import NATECAM, PinholeCamera, StereoRig
from marssim.base.dataset.sample import StereoSample

H, W = 40, 60
RIG = StereoRig(PinholeCamera.centred(W, H, NATECAM.camera.fx), NATECAM.baseline)


def make_sample(seed: int = 0) -> StereoSample:
    """Five rows of sky, ground from 15 m to 0.6 m (nearer than 192 px reach), a rock, a strip that is hidden."""
    rng = np.random.default_rng(seed)
    depth = np.repeat(np.geomspace(14.9, 0.6, H)[:, None], W, axis=1).astype(np.float32)
    depth[:5] = np.inf
    normal = rng.normal(size=(H, W, 3)).astype(np.float32)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    normal *= np.sign(-(normal * RIG.camera.rays()).sum(-1, keepdims=True))
    normal[:5] = 0
    rock = np.zeros((H, W), np.int32)
    rock[15:20, 20:30] = 3
    rock[15:20, 30:38] = 7
    occluded = np.zeros((H, W), bool)
    occluded[10:, :4] = True
    left = rng.integers(0, 255, (H, W, 3), dtype=np.uint8)
    left[:, 40:] = 90
    valid = (depth >= 0.5) & (depth <= 15)
    return StereoSample(
        left, left, depth, RIG.depth_to_disparity(depth), normal.astype(np.float32), valid, occluded, rock, RIG,
        {"surface_ids": {"rocks": [1, 5], "slabs": [6, 9], "ledges": [], "fragments": []}},
    )  # fmt: skip


def perfect(sample: StereoSample) -> Prediction:
    return Prediction(sample.depth, sample.disparity, sample.normal, np.ones((H, W), np.float32))


def scaled(sample: StereoSample, factor: float) -> Prediction:
    depth = (sample.depth * factor).astype(np.float32)
    return replace(perfect(sample), depth=depth, disparity=RIG.depth_to_disparity(depth))


def score(prediction: Prediction, sample: StereoSample) -> dict:
    scores = Scores()
    scores.add(prediction, ScoredPair(sample))
    return scores.result()


def named_terms(*maps: np.ndarray) -> dict[str, np.ndarray]:
    """The depth terms of predicted depth and disparity, then true ones, by name."""
    return dict(zip(DEPTH_TERMS, depth_terms(*maps).T, strict=True))


def test_perfect_prediction_has_perfect_scores_everywhere():
    sample = make_sample()
    sample = replace(sample, rock=np.where(np.arange(W) < 3, -1, sample.rock))  # the rover, at the left border
    result = score(perfect(sample), sample)
    for kind, sums in result["depth"].items():
        assert sums["pixels"] > 0, kind
        for figures in (sums["per_image"], sums["pooled"]):
            for name, value in figures.items():
                best = 1 if name.startswith("delta") or name == "density" else 0
                assert value == pytest.approx(best, abs=1e-6), (kind, name)
    for kind, sums in result["normal"].items():
        assert sums["pooled"]["mean"] == pytest.approx(0, abs=1e-4), kind
        assert sums["pooled"]["median"] < 0.02
        assert sums["per_image"]["within_11.25"] == 1
    sky = result["sky"]
    assert sky["pixels"] == 5 * W and sky["near_ground_pixels"] > 0
    assert sky["predicted_near"] == sky["missed"] == sky["near_ground_as_sky"] == 0


@given(st.floats(0.5, 3.0))
@settings(max_examples=30, deadline=None)
def test_depths_scaled_by_a_factor_have_the_errors_of_that_factor(factor):
    sample = make_sample()
    figures = score(scaled(sample, factor), sample)["depth"]["all"]["pooled"]
    true = sample.depth[pixel_kinds(sample)["all"]].astype(float)
    assert figures["abs_rel"] == pytest.approx(abs(factor - 1), abs=1e-4)
    assert figures["log10"] == pytest.approx(abs(np.log10(factor)), abs=1e-4)
    assert figures["sq_rel"] == pytest.approx((factor - 1) ** 2 * true.mean(), rel=1e-3, abs=1e-5)
    assert figures["rmse"] == pytest.approx(abs(factor - 1) * np.sqrt((true**2).mean()), rel=1e-3, abs=1e-4)
    worst = max(factor, 1 / factor)
    for i in (1, 2, 3):
        if abs(worst - 1.25**i) > 1e-3:
            assert figures[f"delta{i}"] == (worst < 1.25**i)


def test_true_depth_beyond_the_cap_is_capped_too():
    """In layouts that score every known depth, a perfect prediction at 200 m has no error."""
    true = np.array([200.0, 90.0, 0.001])
    perfect_terms = named_terms(true, np.ones(3), true, np.ones(3))
    for name in ("abs_rel", "sq_rel", "rmse", "log10", "mae", "epe"):
        assert (perfect_terms[name] == 0).all()
    assert (perfect_terms["delta1"] == 1).all()
    near = named_terms(np.array([40.0]), np.ones(1), true[:1], np.ones(1))
    assert near["abs_rel"][0] == 0.5 and near["mae"][0] == 40


def test_a_depth_off_by_the_very_factor_of_delta1_is_not_within_it():
    assert named_terms(np.array([5.0]), np.ones(1), np.array([4.0]), np.ones(1))["delta1"] == 0


def test_a_disparity_off_by_the_very_limit_is_not_beyond_it():
    true, off = np.full(3, 5.0), np.array([1.0, 2.0, 3.0])
    terms = named_terms(true, 32 + off, true, np.full(3, 32.0))
    shares = [terms[name].tolist() for name in ("bad1", "bad2", "bad3", "d1")]
    assert shares == [[0, 1, 1], [0, 0, 1], [0, 0, 0], [0, 0, 0]]


@pytest.mark.parametrize(("true", "off", "is_d1"), [(32, 3.01, 1), (100, 4.99, 0), (100, -5.01, 1), (20, 2.9, 0)])
def test_d1_counts_what_is_off_by_over_3_px_and_over_5_percent(true: float, off: float, is_d1: int) -> None:
    depth, disparity = np.array([5.0]), np.array([float(true)])
    assert named_terms(depth, disparity + off, depth, disparity)["d1"] == is_d1


def test_pixels_that_are_not_valid_enter_no_figure():
    """Of rows at 0.3, 5 and 40 m, those at 5 m alone are valid, and only the others are predicted wrongly."""
    sample = make_sample()
    depth = np.repeat(np.float32([0.3, 5, 40])[np.arange(H) % 3, None], W, axis=1)
    valid = depth == 5
    sample = replace(sample, depth=depth, disparity=RIG.depth_to_disparity(depth), valid=valid)
    kinds = pixel_kinds(sample)
    assert np.array_equal(kinds["all"], valid) and not kinds["near"].any()
    wrong = np.where(valid, depth, np.float32(2))
    result = score(replace(perfect(sample), depth=wrong, disparity=RIG.depth_to_disparity(wrong)), sample)
    assert result["depth"]["all"]["pooled"]["abs_rel"] == 0 and result["depth"]["near"]["pixels"] == 0


def test_the_deviation_of_the_grey_levels_is_that_within_9_px():
    image = np.random.default_rng(0).integers(0, 256, (20, 24), dtype=np.uint8)
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(image.astype(float), 4, mode="reflect"), (9, 9))
    assert grey_deviation(image) == pytest.approx(windows.std(axis=(2, 3)), rel=1e-3)


def test_kinds_partition_the_scored_pixels():
    sample = make_sample()
    kinds = pixel_kinds(sample)
    for parts in (("visible", "occluded"), ("rock", "slab", "ground", "rover")):
        assert np.array_equal(np.sum([kinds[part] for part in parts], axis=0), kinds["all"])
    assert kinds["slab"].sum() == 40 and kinds["rock"].sum() == 50
    assert not (kinds["near"] & kinds["all"]).any()
    assert np.array_equal(kinds["near"] | kinds["all"], sample.valid)
    assert (sample.depth[kinds["near"]] < NATECAM.fb / 192).all() and kinds["near"].any()
    assert kinds["texture_poor"][20, 50] and not kinds["texture_poor"][20, 20]


def test_the_rover_itself_is_neither_rock_nor_ground():
    sample = make_sample()
    rover = np.zeros((H, W), bool)
    rover[:10] = True
    kinds, before = (pixel_kinds(each) for each in (replace(sample, rock=np.where(rover, -1, sample.rock)), sample))
    for name in kinds:
        expected = before[name] & ~rover if name in ("rock", "ground") else before[name]
        if name == "rover":
            expected = before["all"] & rover
        assert np.array_equal(kinds[name], expected)
    assert (before["ground"] & rover).any() and kinds["rover"].any() and not before["rover"].any()


def test_intervals_cover_every_scored_pixel_once():
    sample = make_sample()
    result = score(scaled(sample, 1.1), sample)
    assert sum(i["pixels"] for i in result["intervals"]) == result["depth"]["all"]["pixels"]
    assert len(result["intervals"]) == 15
    for interval in result["intervals"]:
        if interval["pixels"]:
            assert interval["from_m"] * 0.1 < interval["pooled"]["mae"] <= interval["to_m"] * 0.1 + 1e-5


@pytest.mark.parametrize("unknown", [np.nan, np.inf, -np.inf, -3.0, 0.0])
def test_unknown_depth_is_an_error_not_a_gap(unknown):
    sample = make_sample()
    depth = sample.depth.copy()
    hole = np.s_[12:14, 10:20]
    depth[hole] = unknown
    result = score(
        replace(perfect(sample), depth=depth, disparity=np.where(depth == unknown, 0, sample.disparity)), sample
    )
    figures = result["depth"]["all"]
    true = sample.depth[hole].astype(float)
    assert figures["pixels"] == pixel_kinds(sample)["all"].sum()
    assert figures["pooled"]["abs_rel"] == pytest.approx(((80 - true) / true).sum() / figures["pixels"], rel=1e-6)
    assert figures["pooled"]["density"] == pytest.approx(1 - 20 / figures["pixels"])


def test_unknown_disparity_counts_as_0_px():
    true, unknown = np.full(3, 5.0), np.array([np.nan, np.inf, -np.inf])
    terms = named_terms(true, unknown, true, np.full(3, 32.0))
    assert (terms["epe"] == 32).all() and (terms["bad1"] == 1).all() and (terms["bad3"] == 1).all()


def test_unknown_normals_count_as_180_deg():
    sample = make_sample()
    normal = sample.normal.copy()
    normal[12, 10:20] = np.nan
    normal[13, 10:20] = 0
    sums = score(replace(perfect(sample), normal=normal), sample)["normal"]["all"]
    assert sums["pooled"]["mean"] == pytest.approx(20 * 180 / sums["pixels"], rel=1e-4)


def test_no_normals_give_no_figures():
    sample = make_sample()
    sums = score(replace(perfect(sample), normal=None), sample)["normal"]["all"]
    assert sums == {"pixels": 0, "images": 0, "per_image": {}, "pooled": {}}


def test_sky_predicted_near():
    sample = make_sample()
    depth = sample.depth.copy()
    depth[:5] = [[np.nan], [16.0], [14.0], [np.inf], [2.0]]
    assert score(replace(perfect(sample), depth=depth), sample)["sky"]["predicted_near"] == pytest.approx(0.4)
    assert score(replace(perfect(sample), depth=depth), sample)["sky"]["missed"] == pytest.approx(0.6)


def test_near_ground_that_is_taken_for_sky_is_counted_and_unknown_ground_is_not():
    sample = make_sample()
    near = np.argwhere(sample.depth < NEAR_GROUND)
    depth = sample.depth.copy()
    depth[tuple(near[:3].T)], depth[tuple(near[3:9].T)] = np.inf, np.nan
    sky = score(replace(perfect(sample), depth=depth), sample)["sky"]
    assert sky["near_ground_pixels"] == len(near)
    assert sky["near_ground_as_sky"] == pytest.approx(3 / len(near))


def test_per_image_and_pooled_differ_as_they_should():
    """One image with 10 pixels off by 1, one with 30 pixels off by 3."""
    sums = RunningSums(("rmse", "mae"))
    for count, error in ((10, 1.0), (30, 3.0)):
        sums.add_sums(count * np.array([error**2, error]), count, np.full(count, error**2))
    result = sums.result()
    assert result["per_image"] == pytest.approx({"rmse": 2, "mae": 2})
    assert result["pooled"] == pytest.approx({"rmse": np.sqrt(7), "mae": 2.5})
    assert (result["pixels"], result["images"]) == (40, 2)


def test_order_and_split_do_not_matter():
    samples = [make_sample(seed) for seed in range(3)]
    forward, backward = Scores(), Scores()
    for i in range(3):
        forward.add(scaled(samples[i], 1 + 0.1 * i), ScoredPair(samples[i]))
        backward.add(scaled(samples[2 - i], 1.2 - 0.1 * i), ScoredPair(samples[2 - i]))
    a, b = (s.result()["depth"]["rock"]["pooled"] for s in (forward, backward))
    assert a == pytest.approx(b)


@given(hnp.arrays(np.float64, st.integers(1, 200), elements=st.floats(0, 180)))
@settings(max_examples=60, deadline=None)
def test_streamed_median_is_within_a_bin(angles):
    sums = RunningSums(NORMAL_TERMS, median=True)
    sums.add_sums(normal_terms(angles).sum(axis=0), len(angles), angles)
    low, high = (np.quantile(angles, 0.5, method=m) for m in ("lower", "higher"))
    assert low - 0.011 <= sums.result()["pooled"]["median"] <= high + 0.011
    assert sums.result()["per_image"]["median"] == pytest.approx(np.median(angles))


@given(st.floats(0, 180), st.floats(0.1, 10))
@settings(max_examples=50, deadline=None)
def test_angle_between_turned_vectors(angle, length):
    turned = length * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle)), 0])
    assert angle_between(turned[None], np.array([[2.0, 0, 0]]))[0] == pytest.approx(angle, abs=1e-6)


@given(hnp.arrays(np.float32, 20, elements=st.floats(width=32)))
@settings(max_examples=60, deadline=None)
def test_terms_are_finite_whatever_is_predicted(depth):
    true = np.linspace(0.5, 15, 20)
    assert np.isfinite(depth_terms(depth, depth, true, 160 / true)).all()
    assert ((capped_depth(depth) >= 0.01) & (capped_depth(depth) <= 80)).all()


def test_against_torchmetrics():
    torch = pytest.importorskip("torch")
    regression = pytest.importorskip("torchmetrics.regression")
    rng = np.random.default_rng(1)
    true = rng.uniform(0.5, 15, 500)
    predicted = true * rng.uniform(0.6, 1.7, 500)
    means = dict(zip(DEPTH_TERMS, depth_terms(predicted, 160 / predicted, true, 160 / true).mean(axis=0), strict=True))
    p, t = torch.from_numpy(predicted), torch.from_numpy(true)
    assert means["rmse"] == pytest.approx(float(regression.MeanSquaredError()(p, t)))
    assert means["mae"] == pytest.approx(float(regression.MeanAbsoluteError()(p, t)))
    assert means["abs_rel"] == pytest.approx(float(regression.MeanAbsolutePercentageError()(p, t)), rel=1e-6)
    assert means["log10"] == pytest.approx(float(regression.MeanAbsoluteError()(p.log10(), t.log10())))
    assert means["epe"] == pytest.approx(float(regression.MeanAbsoluteError()(160 / p, 160 / t)))
    normals = rng.normal(size=(2, 500, 3))
    cosine = regression.CosineSimilarity(reduction="none")(*(torch.from_numpy(n) for n in normals))
    # torchmetrics computes the cosine in float32
    assert angle_between(*normals) == pytest.approx(np.degrees(np.arccos(cosine.numpy())), abs=1e-3)


def test_a_median_lies_between_the_borders_of_its_bin():
    sums = RunningSums(("mean",), median=True)
    angles = np.linspace(10.0001, 10.0099, 99)  # all within one bin
    sums.add_sums(np.array([angles.sum()]), 99, angles)
    assert sums.result()["pooled"]["median"] == pytest.approx(10.005, abs=1e-3)


def test_a_pixel_of_the_largest_disparity_is_scored():
    sample = make_sample()
    kinds = pixel_kinds(sample, float(sample.disparity[30, 10]))
    assert kinds["all"][30, 10] and not kinds["near"][30, 10]
    assert kinds["near"][31, 10] and not kinds["all"][31, 10]
