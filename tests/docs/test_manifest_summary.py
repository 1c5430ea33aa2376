"""The figures of a manifest, from records of pairs that are known."""

import json
from pathlib import Path

import numpy as np
import pytest

from m3depth.evaluation.bootstrap import interval, resampled_means

ROCK = [0.25, 5.0, True, 0.01, True]  # height, distance, found, error, seen by both eyes


def record(abs_rel: float, rocks=(), edges=(), false=(), **sky) -> dict:
    counts = {"images": 1, "rocks": [*rocks], "edges": [*edges], "false": [*false]}
    sky = {"pixels": 100, "missed": 1, "ground": 1000, "ground_as_sky": 0} | sky
    return {
        "abs_rel": abs_rel, "bad1": 0.05, "normal_mean": 8.0,
        "kinds": {"visible": {"epe": 10 * abs_rel}, "rock": {"normal_mean": 20.0}},
        "counts": {"rocks": counts, "sky": sky},
    }  # fmt: skip


def result(
    size: str, pairs: dict[str, tuple[dict, dict]], place: str = "gale", name: str = "clean", gets_truth: bool = False
) -> dict:
    """A part whose pairs have records of M3Depth and SGBM, by name."""
    depth = [
        {"pair": pair, "scene": pair[:5], "M3Depth": ours, "SGBM": theirs} for pair, (ours, theirs) in pairs.items()
    ]
    shown = [
        {
            "pair": pair, "scene": pair[:5], "m3depth:w": ours["counts"]["rocks"], "sgbm": theirs["counts"]["rocks"],
            "ground_truth": ours["counts"]["rocks"],
        }
        for pair, (ours, theirs) in pairs.items()
    ]  # fmt: skip
    estimators = {"M3Depth": {"name": "m3depth:w"}, "SGBM": {"name": "sgbm"}}
    methods = {"M3Depth": {"gets_truth": gets_truth}, "SGBM": {"gets_truth": False}}
    return {
        "size": size, "set": name, "place": place,
        "depth": {"estimators": estimators, "methods": methods, "per_pair": depth},
        "map": {"methods": {"m3depth:w": {}, "sgbm": {}, "ground_truth": {}}, "per_pair": shown},
    }  # fmt: skip


def test_errors_are_means_over_images_with_their_ratio_to_sgbms(manifest_summary):
    errors = ((0.01, 0.05), (0.02, 0.08), (0.03, 0.12), (0.06, 0.23))
    pairs = {f"0000{i}/00": (record(own), record(theirs)) for i, (own, theirs) in enumerate(errors)}
    ours = manifest_summary.summary([result("512", pairs)])["parts"]["512"]["clean"]["depth"]["M3Depth"]
    assert ours["abs_rel"]["value"] == pytest.approx(0.03) and ours["epe_visible"]["value"] == pytest.approx(0.3)
    assert ours["abs_rel"]["ratio"] == pytest.approx(0.25)
    low, high = ours["abs_rel"]["ratio_interval"]
    assert 0.19 < low < 0.245 and 0.25 < high < 0.3  # paired: a sample with large errors has them in both
    means = resampled_means(np.array([0.01, 0.02, 0.03, 0.06]))
    assert ours["abs_rel"]["interval"] == pytest.approx(interval(means, 0.03, 4, within=(0, np.inf)))
    assert ours["normal_slab"]["value"] is None and ours["normal_slab"]["ratio"] is None  # none are in view
    assert ours["normal_rock"]["value"] == 20 and ours["places"]["gale"]["abs_rel"] == pytest.approx(0.03)


def test_a_pair_without_a_figure_does_not_count_to_its_mean(manifest_summary):
    empty = {"kinds": {}, "counts": record(0)["counts"]}
    pairs = {"00000/00": (record(0.02), record(0.02)), "00001/00": (empty, empty)}
    ours = manifest_summary.summary([result("512", pairs)])["parts"]["512"]["clean"]["depth"]["M3Depth"]
    assert ours["abs_rel"]["value"] == pytest.approx(0.02) and ours["abs_rel"]["interval"] is None


def test_only_scenes_that_have_a_figure_count_to_its_interval(manifest_summary):
    def with_slabs(error):
        return record(0.01) | {"kinds": {"slab": {"normal_mean": error}}}

    def slabs(pairs):
        return manifest_summary.summary([result("512", pairs)])["parts"]["512"]["clean"]["depth"]["M3Depth"]

    errors = ((20.0, 41.0), (22.0, 40.0), (27.0, 45.0), (30.0, 52.0))
    some = {f"0000{i}/00": tuple(map(with_slabs, pair)) for i, pair in enumerate(errors)}
    others = {f"{i:05}/00": (record(0.01), record(0.02)) for i in range(10, 40)}
    alone, beside = slabs(some)["normal_slab"], slabs(some | others)["normal_slab"]
    assert alone == beside and alone["interval"] is not None and alone["ratio_interval"] is not None
    few = dict([*some.items()][:3])
    assert slabs(few | others)["normal_slab"]["interval"] is None  # of three scenes
    one_sided = slabs(some | {"00090/00": (with_slabs(90.0), record(0.02))})["normal_slab"]
    assert one_sided["ratio"] == alone["ratio"] and one_sided["value"] > alone["value"]


def test_a_figure_that_is_the_same_in_all_scenes_has_no_interval(manifest_summary):
    pairs = {f"0000{i}/00": (record(0.01 * (i + 1), rocks=[ROCK]), record(0.04)) for i in range(6)}
    ours = manifest_summary.summary([result("512", pairs)])["parts"]["512"]["clean"]["depth"]["M3Depth"]
    assert (ours["found"]["value"], ours["false"]["value"], ours["near_ground_as_sky"]["value"]) == (1, 0, 0)
    assert ours["found"]["interval"] is ours["false"]["interval"] is ours["near_ground_as_sky"]["interval"] is None
    assert ours["abs_rel"]["interval"] is not None


def test_shares_are_of_all_pixels_and_rocks_together(manifest_summary):
    lost = [0.4, 7.0, False, -0.4, False]
    pairs = {
        "00000/00": (record(0.01, rocks=[ROCK, ROCK, lost], ground=3000, ground_as_sky=3), record(0.02)),
        "00001/00": (record(0.01, rocks=[[*lost[:4], True]], edges=[ROCK], false=[[0.3, 2.0]]), record(0.02)),
    }
    part = manifest_summary.summary([result("512", pairs)])["parts"]["512"]["clean"]
    ours = part["depth"]["M3Depth"]
    assert ours["near_ground_as_sky"]["value"] == pytest.approx(3 / 4000) and ours["missed_sky"]["value"] == 0.01
    assert ours["found"]["value"] == 0.5 and ours["found_both"]["value"] == pytest.approx(2 / 3)
    assert ours["edges_found_both"]["value"] == 1 and ours["false"]["value"] == 20  # one in two frames
    bins = {(b["from_m"], b["near_m"]): b["rocks"] for b in ours["bins"] if b["rocks"][1]}
    assert bins == {(0.2, 4.0): [2, 2], (0.3, 4.0): [0, 2]}
    assert part["map"]["M3Depth"] == {k: v for k, v in ours.items() if k in part["map"]["M3Depth"]}
    assert [*part["map"]] == ["M3Depth", "SGBM", "ground_truth"]


def test_larger_images_are_compared_with_the_same_views_alone(manifest_summary):
    small = {"00000/00": (record(0.01), record(0.02)), "00000/01": (record(0.5), record(0.5))}
    large = {"00000/00": (record(0.004), record(0.01))}
    parts = manifest_summary.summary([result("512", small), result("1024", large)])["parts"]
    assert parts["1024"]["clean"]["depth"]["M3Depth"]["same_scenes"] == pytest.approx(0.4)
    assert parts["512"]["clean"]["depth"]["M3Depth"]["same_scenes"] is None
    alone = manifest_summary.summary([result("1024", large)])["parts"]["1024"]["clean"]["depth"]["M3Depth"]
    assert alone["same_scenes"] is None and alone["abs_rel"]["interval"] is None  # a single scene


def test_scenes_of_two_places_are_different_scenes(manifest_summary):
    pairs = {"00000/00": (record(0.01), record(0.02))}
    part = manifest_summary.summary([result("512", pairs), result("512", pairs, place="utopia")])["parts"]["512"]
    assert (part["clean"]["pairs"], part["clean"]["scenes"]) == (2, 2)


def test_the_tables_show_every_figure_and_say_that_a_trial_is_one(manifest_summary):
    pairs = {f"0000{i}/00": (record(0.01 + i / 200, rocks=[ROCK]), record(0.04)) for i in range(4)}
    content = manifest_summary.summary([result("512", pairs), result("1024", pairs)])
    text = manifest_summary.markdown(
        {"limit": 2, "max_pixels": 4096, "runtime": "openvino 1", "versions": {"torch": "2", "numpy": None}, **content}
    )
    assert text.startswith("# Scores on the manifest: clean pairs of 512 and 1024 px\n")
    for term in (*manifest_summary.PIXELS.values(), *manifest_summary.ROCKS.values()):
        assert f"| {term.title} |" in text
    low, high = content["parts"]["512"]["clean"]["depth"]["M3Depth"]["abs_rel"]["interval"]
    assert f"| Abs Rel | 0.0175 ({low:.4f} to {high:.4f}) | 0.0400 |" in text
    assert f"| … over SGBM's | 0.4375 ({low / 0.04:.4f} to {high / 0.04:.4f}) |  |" in text
    assert "| rocks, 0.2 to 0.3 m, 4 to 8 m away | 4 of 4 | 0 of 0 |" in text
    assert "at the smallest size: M3Depth 1.000, SGBM 1.000." in text
    assert (
        "at most 4096 pixels of an image for the scores of depth. **A trial: at most 2 pairs of each place.**" in text
    )
    assert text.endswith("\nNetworks ran in openvino 1. torch 2.\n")


def test_a_method_that_gets_the_true_depth_is_marked(manifest_summary):
    pairs = {"00000/00": (record(0.0), record(0.04))}
    for given, title in ((True, "M3Depth, given the true depth"), (False, "M3Depth")):
        content = manifest_summary.summary([result("512", pairs, gets_truth=given)])
        text = manifest_summary.markdown({"limit": None, "runtime": None, "versions": {}, **content})
        assert f"|  | {title} | SGBM |" in text


@pytest.mark.parametrize("name", ["all_512", "maps", "all_1024", "all_2048", "clean", "dust", "sizes", "quarter"])
def test_the_headings_of_the_pages_say_which_pairs_they_score(manifest_summary, name):
    folder = Path(__file__).parents[2] / "docs/results/depth"
    content = json.loads((folder / f"{name}.json").read_text())
    title = manifest_summary.markdown({"runtime": None} | content).partition("\n")[0]
    assert (folder / f"{name}.md").read_text().partition("\n")[0] == title
