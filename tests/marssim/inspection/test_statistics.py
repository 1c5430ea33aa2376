from collections.abc import Iterable
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from marssim.base.camera import NATECAM
from marssim.base.dataset.dataset import StereoDataset
from marssim.base.dataset.sample import StereoSample
from marssim.base.images.texture import lbp_entropy
from marssim.inspection.statistics import DEPTH_STEP, SampleStatistics, table
from marssim.render.detector.codes import GAMMA

SIZE = (6, 10)


def statistics_of(samples: Iterable[StereoSample]) -> SampleStatistics:
    out = SampleStatistics()
    for sample in samples:
        out.add(sample)
    return out


def made(depth: np.ndarray, rock: np.ndarray | None = None, occluded: np.ndarray | None = None) -> StereoSample:
    """Return a sample of a given depth map."""
    rig = NATECAM.resized(depth.shape[1], depth.shape[0])
    nothing = np.zeros(depth.shape, bool)
    normal = np.zeros((*depth.shape, 3), np.float32)
    normal[..., 2] = -1
    image = np.full((*depth.shape, 3), 100, np.uint8)
    return StereoSample(
        image, image, depth, rig.depth_to_disparity(depth), normal, (depth >= 0.5) & (depth <= 15),
        nothing if occluded is None else occluded, (nothing if rock is None else rock).astype(np.int32), rig,
        {"sun_elevation_deg": 30.0, "preset": "gale"},
    )  # fmt: skip


def test_shares_are_counted_as_defined():
    depth = np.full(SIZE, 4.0, np.float32)
    depth[0] = np.inf  # 10 of 60: sky
    depth[1] = 20.0  # 10: farther than 15 m
    depth[2, :3] = 0.3  # 3: within 15 m, too near to be valid
    rock, occluded = np.zeros(SIZE, bool), np.zeros(SIZE, bool)
    rock[1:3, :4], occluded[3, :5] = True, True
    report = statistics_of([made(depth, rock, occluded)]).report()
    assert report["sky"] == pytest.approx(10 / 60) and report["within_15m_of_all"] == pytest.approx(40 / 60)
    assert report["within_15m_of_not_sky"] == pytest.approx(40 / 50) and report["valid"] == pytest.approx(37 / 60)
    assert report["rock"] == pytest.approx(4 / 40) and report["occluded"] == pytest.approx(5 / 50)
    assert report["presets"] == {"gale": 1} and report["sun_elevation_deg"]["most"] == 30
    counts = report["depth_histogram"]["counts"]
    assert counts[round(4 / DEPTH_STEP)] == 37 and counts[round(20 / DEPTH_STEP)] == 10 and sum(counts) == 50


def test_the_distribution_is_that_of_the_depths():
    depth = np.linspace(0.01, 49.99, 600).reshape(20, 30).astype(np.float32)
    statistics = statistics_of([made(depth)])
    at = np.array([0.0, 5.0, 15.0, 40.0])
    assert statistics.share_within(at) == pytest.approx([(depth < d).mean() for d in at], abs=2 / 600)
    percentiles = {str(p): np.percentile(depth, p) for p in (1, 50, 99)}
    assert statistics.report()["depth_percentiles_m"] == pytest.approx(percentiles, abs=DEPTH_STEP / 4)


@given(st.floats(0.5, 14), st.floats(0.5, 14))
def test_the_disparity_range(first, second):
    samples = [made(np.full(SIZE, z, np.float32)) for z in (first, second)]
    report = statistics_of(samples).report()["disparity_px"]
    ends = sorted(float(s.disparity.max()) for s in samples)
    assert (report["least"], report["most"]) == pytest.approx(ends)
    assert sum(report["counts"]) == 2 * SIZE[0] * SIZE[1] and len(report["counts"]) == int(ends[1]) + 1
    assert report["share_192_and_more"] == pytest.approx(np.mean([e >= 192 for e in ends]))


def test_nothing_but_sky():
    report = statistics_of([made(np.full(SIZE, np.inf, np.float32))]).report()
    assert report["sky"] == 1 and report["disparity_px"]["least"] is None and report["gradient"] == {}
    assert "sky" in table({"all": statistics_of([made(np.full(SIZE, np.inf, np.float32))])}, {"all": 1})


def test_statistics_add_up(closed_form_set):
    dataset = StereoDataset(closed_form_set)
    one, whole = SampleStatistics(), statistics_of(dataset)
    for sample in dataset:
        one.add(sample)
    assert one.report() == whole.report() and whole.samples == 8
    assert whole.report()["asked_k"] == {"least": 0.07, "mean": pytest.approx(0.07), "most": 0.07}
    assert table({"all": whole, "val": SampleStatistics()}, {"all": 8, "val": 0}).splitlines()[1].split() == [
        "pairs",
        "8",
        "0",
    ]


@pytest.mark.parametrize("odd", [None, "0.07", [0.07], {}, float("nan"), -1, 10**400])
def test_values_that_are_no_numbers_do_not_count(odd):
    sample = made(np.full((32, 32), 4.0, np.float32))
    meta = {**sample.meta, "sun_elevation_deg": odd if odd != -1 else -91, "scene_config": {"rocks": {"k": odd}}}
    statistics = statistics_of([replace(sample, meta=meta)]).report()
    assert statistics["asked_k"] == {} and statistics["sun_elevation_deg"] == {} and statistics["cover"] == {}


def test_colours_do_not_matter_for_shapes():
    sample = made(np.full((32, 32), 4.0, np.float32))
    grey = np.random.default_rng(1).integers(0, 256, (32, 32)).astype(np.uint8)
    coloured = replace(sample, left=np.repeat(grey[..., None], 3, axis=2))
    assert statistics_of([coloured]).lbp == [lbp_entropy(grey, np.ones((32, 32), bool))]


def test_contrast_of_ground_is_that_of_near_ground_without_rocks():
    """Noise on near ground, five times as much on a rock and far away."""
    noise = np.random.default_rng(0).standard_normal((128, 192))
    depth, rock = np.full(noise.shape, 4.0, np.float32), np.zeros(noise.shape, bool)
    depth[:, 128:], rock[64:, :64] = 9.0, True
    strength = np.where(rock | (depth > 8), 0.25, 0.05)
    grey = np.clip(120 * np.exp(strength * noise / GAMMA), 0, 255).round().astype(np.uint8)
    sample = replace(made(depth, rock), left=np.repeat(grey[..., None], 3, axis=2))
    statistics = statistics_of([sample, made(depth[:60])])  # the second one is too small for a window
    ground = statistics.report()["ground"]
    assert ground["samples"] == 1 and ground["wavelength_px"] == [45.3, 22.6, 11.3, 5.7, 2.8]
    contrast = np.array(ground["contrast"])
    assert np.sqrt((contrast**2).sum()) == pytest.approx(0.05 * np.sqrt(np.pi / 4), rel=0.15)  # within the ring of 1/2
    assert np.allclose(contrast[1:] / contrast[:-1], 2, rtol=0.35)  # white noise: twice as much in each octave
    assert abs(ground["slope"]["mean"]) < 0.3 and "contrast of ground" in table({"all": statistics}, {"all": 2})
    assert len(ground["direction"]) == 4 and np.all(np.array(ground["direction"]) < 1.5)  # alike in all directions
    assert ground["shade"][0] < ground["shade"][1] < 1 < ground["shade"][2]


def test_the_table_shows_peakedness_and_the_width_of_edges():
    """Dots on plain ground are peaked, noise is not; a step blurred by 1 px rises over 2.56 px."""
    dots = np.zeros((128, 192))
    dots[tuple(np.random.default_rng(1).integers(8, 120, (2, 60)))] = 1
    step = np.where(np.arange(192) < 96, 60.0, 120.0) * np.ones((128, 1))
    grounds = {"dots": 100 + 80 * cv2.GaussianBlur(dots, (0, 0), 1), "step": cv2.GaussianBlur(step, (0, 0), 1)}
    grounds["noise"] = 100 + 3 * np.random.default_rng(0).standard_normal(dots.shape)
    statistics = {}
    for name, grey in grounds.items():
        image = np.repeat(np.clip(grey, 0, 255).round().astype(np.uint8)[..., None], 3, axis=2)
        statistics[name] = statistics_of([replace(made(np.full(dots.shape, 4.0, np.float32)), left=image)])
    report = {name: part.report() for name, part in statistics.items()}
    assert report["dots"]["ground"]["peakedness"][0] > 5 and abs(report["noise"]["ground"]["peakedness"][0]) < 1
    assert report["step"]["edge_width_px"]["mean"] == pytest.approx(2.56, rel=0.15)
    lines = table(statistics, dict.fromkeys(statistics, 1)).splitlines()
    assert any(line.startswith("peakedness of ground") for line in lines)
    assert any(line.startswith("width of edges") for line in lines)
