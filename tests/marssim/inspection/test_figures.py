from dataclasses import replace

import cv2
import numpy as np
import pytest

from marssim.base.dataset.dataset import StereoDataset
from marssim.base.dataset.sample import read_sample
from marssim.inspection.figures import sample_figure, statistics_figure, warp_residual, warped
from marssim.inspection.statistics import SampleStatistics


def decoded(png: bytes) -> np.ndarray:
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return image


def test_warping_by_whole_and_by_half_pixels():
    image = np.arange(60, dtype=np.uint8).reshape(4, 5, 3)
    assert np.array_equal(warped(image, np.zeros((4, 5))), image)
    one = warped(image, np.ones((4, 5)))
    assert np.array_equal(one[:, 1:], image[:, :-1])
    half = warped(image, np.full((4, 5), 0.5))
    assert np.allclose(half[:, 1:], image[:, 1:] / 2.0 + image[:, :-1] / 2.0)


def test_the_residual_is_small_where_disparity_is_true(closed_form_set):
    """Both eyes see the same closed-form texture, so that only rounding, interpolation and edges are left."""
    sample = read_sample(closed_form_set / "scenes" / "00000" / "00")
    residual = warp_residual(sample)
    hidden = sample.occluded | np.isinf(sample.depth)
    assert np.isnan(residual[hidden]).all() and np.isfinite(residual[~hidden]).all()
    near = ~hidden & (sample.depth < 6)
    assert np.median(residual[near]) < 1.5
    sample.disparity[...] += 2
    assert np.median(warp_residual(sample)[near]) > 4 * np.median(residual[near])


def test_a_sample_is_drawn(closed_form_set):
    image = decoded(sample_figure(read_sample(closed_form_set / "scenes" / "00000" / "00"), "00000/00"))
    assert image.shape[1] == 1600 and image.std() > 30


def test_a_sample_without_a_sun_that_is_a_number_is_drawn(closed_form_set):
    """Another program may have written the dataset."""
    sample = read_sample(closed_form_set / "scenes" / "00000" / "00")
    for sun in (None, "30", 12.5):
        sample.meta["sun_elevation_deg"] = sun
        assert decoded(sample_figure(sample, "00000/00")).std() > 30


def test_a_sample_of_sky_alone_is_drawn(closed_form_set):
    sample = read_sample(closed_form_set / "scenes" / "00000" / "00")
    sample.depth[...], sample.disparity[...], sample.rock[...] = np.inf, 0, 0
    sample.occluded[...] = False
    assert decoded(sample_figure(sample, "sky")).std() > 10


def test_statistics_are_drawn(closed_form_set):
    statistics = {name: SampleStatistics() for name in ("all", "train", "val", "test")}
    for name, split in (("all", None), ("train", "train"), ("val", "val")):
        for sample in StereoDataset(closed_form_set, split):
            statistics[name].add(sample)
    image = decoded(statistics_figure(statistics, "set"))
    assert image.shape[:2] == (800, 1400) and image.std() > 20


@pytest.mark.filterwarnings("error")
def test_statistics_without_a_pixel_that_is_scored_are_drawn(closed_form_set):
    sample = StereoDataset(closed_form_set, "train")[0]
    alone = SampleStatistics()
    alone.add(replace(sample, depth=np.full_like(sample.depth, 50.0), valid=np.zeros_like(sample.valid)))
    assert not alone.disparity.any() and decoded(statistics_figure({"all": alone}, "set")).std() > 10


def test_one_split_alone_is_drawn_once(closed_form_set):
    train = SampleStatistics()
    for sample in StereoDataset(closed_form_set, "train"):
        train.add(sample)
    nothing = {"val": SampleStatistics(), "test": SampleStatistics()}
    assert statistics_figure({"all": train, "train": train, **nothing}, "set") == statistics_figure(
        {"train": train}, "set"
    )
