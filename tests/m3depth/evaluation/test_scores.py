"""The figures of a method beside the metrics: fitted normals, the map of errors, rocks, confidence."""

from dataclasses import replace

import numpy as np
import pytest
from rock_samples import ahead, rock_sample, without_rocks
from rock_world import RockWorld

from m3depth.evaluation.running_sums import DEPTH_BIN, ErrorMap
from m3depth.evaluation.scores import ScoredPair, Scores
from m3depth.evaluation.scoring import evaluate
from m3depth.stereo.plane_normals import fitted_normals
from m3depth.stereo.prediction import Prediction
from marssim.base.files.json_file import DatasetError


def truth(sample, **changes) -> Prediction:
    exact = Prediction(sample.depth, sample.disparity, sample.normal, np.ones(sample.depth.shape, np.float32))
    return replace(exact, **changes)


def scored(sample, prediction, fit=True) -> dict:
    scores = Scores(fit=fit)
    scores.add(prediction, ScoredPair(sample))
    return scores.result()


def test_fitted_normals_do_not_depend_on_the_methods_own(plane_samples):
    """On a plane the fit is exact except at the borders; wrong normals of the method do not change it."""
    sample = plane_samples[0]
    figures = scored(sample, truth(sample, normal=-sample.normal))
    assert figures["normal"]["all"]["pooled"]["mean"] == pytest.approx(180)
    assert figures["fitted_normal"]["all"]["pooled"]["median"] < 0.5
    alone = Scores()
    own = alone.add(truth(sample, normal=fitted_normals(sample.disparity, sample.rig.camera)), ScoredPair(sample))
    assert figures["fitted_normal"]["all"]["pooled"] == alone.result()["normal"]["all"]["pooled"]
    fitted = Scores(fit=True).add(truth(sample, normal=None), ScoredPair(sample))
    assert "normal_mean" not in fitted and fitted["fitted_normal_mean"] == own["normal_mean"] > 0
    assert scored(sample, truth(sample), fit=False)["fitted_normal"]["all"]["pixels"] == 0


def test_evaluate_fits_normals_once_for_the_truth_and_not_for_matchers_that_fit_themselves(plane_samples):
    class Fits:
        normals_are_fitted = True

        def infer(self, left, right, rig):
            return truth(plane_samples[0], normal=fitted_normals(plane_samples[0].disparity, rig.camera))

    done = evaluate(plane_samples[:1], {"fits": Fits()})
    assert done.results["fits"]["fitted_normal"]["all"]["pixels"] == 0
    assert done.true_depth_normals == done.results["fits"]["normal"]
    assert done.results["fits"]["normals_are_fitted"] and "fitted_normal_mean" not in done.pairs[0]["fits"]


def test_an_offset_of_the_images_counts_for_depth_and_not_for_disparity(plane_samples):
    """A method that finds the disparity of the images has no error in it, but depth f B / disparity is wrong."""
    sample = plane_samples[0]
    offset = replace(sample, disparity=np.where(np.isfinite(sample.depth), sample.disparity - 0.5, 0))
    found = truth(sample, disparity=offset.disparity, depth=sample.rig.disparity_to_depth(offset.disparity))

    class Finds:
        def infer(self, left, right, rig):
            return found

    done = evaluate([offset], {"finds": Finds()})
    figures = done.results["finds"]["depth"]["all"]["pooled"]
    assert figures["epe"] == 0 and figures["bad1"] == 0
    known = sample.valid & (sample.disparity <= 192)
    assert figures["abs_rel"] == pytest.approx((0.5 / offset.disparity[known]).mean(), rel=0.01)
    assert done.true_depth_normals["all"]["pooled"]["median"] < 0.5  # these are of the true depth
    assert scored(offset, truth(offset))["fitted_normal"]["all"]["pooled"]["median"] < 0.5


def test_the_error_map_counts_every_pixel_once():
    errors = ErrorMap()
    errors.add(np.array([0.6, 0.6, 14.99, 15.0, 15.5]), np.array([0.0, 0.011, 200.0, 1.0, 1.0]))
    counts = np.array(errors.result()["counts"])
    assert counts.sum() == 4  # 15.5 m is beyond
    column = int(0.6 / DEPTH_BIN)
    edges = np.geomspace(1e-3, 1e2, 61)
    assert counts[0, column] == 1 and counts[np.searchsorted(edges, 0.011) - 1, column] == 1
    assert counts[-1, -1] == 1 and counts[:, -1].sum() == 2


def test_the_interval_of_a_depth_ends_with_it(plane_samples):
    """3 m belong to 2 m to 3 m, and 15 m to the last interval."""
    sample = plane_samples[0]
    depth = np.where(np.isinf(sample.depth), sample.depth, np.float32(3))
    depth[-5] = 15
    disparity, valid = sample.rig.depth_to_disparity(depth), np.isfinite(depth)
    sample = replace(sample, depth=depth, disparity=disparity, valid=valid)
    intervals = scored(sample, truth(sample))["intervals"]
    pixels = {interval["to_m"]: interval["pixels"] for interval in intervals if interval["pixels"]}
    assert pixels == {3: (depth == 3).sum(), 15: depth.shape[1]}


def test_the_sums_of_pairs_by_depth_are_those_of_the_result(plane_samples):
    scores = Scores()
    pairs = [
        scores.add(truth(sample, depth=sample.depth * (1 + 0.01 * n)), ScoredPair(sample))["counts"]["intervals"]
        for n, sample in enumerate(plane_samples[:3], start=1)
    ]
    for i, result in enumerate(scores.result()["intervals"]):
        assert result["pixels"] == sum(pair["pixels"][i] for pair in pairs)
        if result["pixels"]:
            error = sum(pair["absolute_error_m"][i] for pair in pairs)
            assert error == pytest.approx(result["pooled"]["mae"] * result["pixels"])
    assert all(len(values) == 15 for pair in pairs for values in pair.values())


def test_rocks_and_confidence_are_in_the_result():
    x, y = ahead(4.0, 0.0)
    sample = rock_sample(RockWorld(domes=np.array([[x, y, 0.4, 0.3]])))
    depth = without_rocks(sample).astype(np.float32)
    confidence = np.where(sample.rock > 0, np.float32(0.1), np.float32(0.9))
    missed = truth(sample, depth=depth, disparity=sample.rig.depth_to_disparity(depth), confidence=confidence)
    figures = scored(sample, missed)
    assert figures["rocks"]["standing_0.2_m_within_8_m"]["rocks"] == 1
    assert figures["rocks"]["standing_0.2_m_within_8_m"]["found"] == 0
    curve = figures["sparsification"]
    assert curve["bad1"][0] > 0 and curve["bad1"][-1] == pytest.approx(0, abs=1e-12)
    result = scored(sample, truth(sample))
    assert result["rocks"]["standing_0.2_m_within_8_m"]["found"] == 1 and result["sparsification"] == {}


def test_the_curve_of_the_confidence_is_that_of_the_disparity(plane_samples):
    sample = plane_samples[0]
    confidence = np.where(np.arange(sample.depth.shape[1]) % 2, np.float32(0.2), np.float32(0.8))
    wrong_depth = truth(sample, depth=1.5 * sample.depth, confidence=confidence * np.ones_like(sample.depth))
    curve = scored(sample, wrong_depth)["sparsification"]
    assert curve["epe"][0] == curve["bad1"][0] == 0


def test_a_pair_reports_its_figures_by_kind_and_its_counts():
    sample = rock_sample(RockWorld(domes=np.array([[*ahead(4.0, 0.0), 0.35, 0.3]])))
    sample = replace(sample, normal=np.broadcast_to(np.float32([0, 0, -1]), sample.normal.shape))
    far = np.where(np.isinf(sample.depth), np.float32(np.inf), sample.depth * np.float32(1.1))
    scores = Scores()
    record = scores.add(truth(sample, depth=far, normal=sample.normal), ScoredPair(sample))
    assert record["kinds"]["rock"]["abs_rel"] == pytest.approx(0.1, rel=1e-4)
    assert record["kinds"]["rock"].keys() == {"abs_rel", "epe", "bad1", "normal_mean"}
    assert "slab" not in record["kinds"] and "occluded" not in record["kinds"]  # there are none
    result = scores.result()
    assert record["kinds"]["visible"]["epe"] == result["depth"]["visible"]["pooled"]["epe"]
    assert record["counts"]["sky"]["pixels"] == result["sky"]["pixels"] == np.isinf(sample.depth).sum()
    (rock,) = record["counts"]["rocks"]["rocks"]
    assert rock.found and record["counts"]["rocks"]["images"] == 1


def test_pixels_without_depth_have_no_fitted_normal_either(plane_samples):
    sample = plane_samples[0]
    for left_out in (slice(0, 0), slice(0, 40), slice(None)):
        depth, disparity = sample.depth.copy(), sample.disparity.copy()
        depth[left_out] = disparity[left_out] = np.nan
        figures = scored(sample, truth(sample, depth=depth, disparity=disparity))["fitted_normal"]["all"]["pooled"]
        share = np.isnan(depth)[sample.valid].mean()
        assert figures["mean"] == pytest.approx(180 * share, abs=2)


def test_the_fitted_normal_of_what_is_predicted_as_sky_points_at_the_camera(plane_samples):
    sample = plane_samples[0]
    sky = np.full_like(sample.depth, np.inf)
    figures = scored(sample, truth(sample, depth=sky, disparity=np.zeros_like(sky)))["fitted_normal"]["all"]["pooled"]
    rays, normal = sample.rig.camera.rays()[sample.valid], sample.normal[sample.valid].astype(float)
    cosine = -(rays * normal).sum(axis=-1) / np.linalg.norm(rays, axis=-1) / np.linalg.norm(normal, axis=-1)
    assert figures["mean"] == pytest.approx(np.degrees(np.arccos(cosine)).mean(), abs=1e-3)


def test_ids_of_surfaces_that_cannot_be_used_stay_an_error_of_the_dataset(plane_samples):
    sample = replace(plane_samples[0], meta={**plane_samples[0].meta, "surface_ids": {"slabs": [1]}})
    with pytest.raises(DatasetError, match="surface_ids"):
        evaluate([sample], {"true": Truthful(sample)})


class Truthful:
    """Returns the truth of a sample."""

    def __init__(self, sample):
        self.sample = sample

    def infer(self, left, right, rig):
        return truth(self.sample)
