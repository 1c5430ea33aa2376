"""A file of results must agree with its episodes and its suite; the whole way, by envs.compare --check."""

import json
from pathlib import Path

import pytest

from envs.compare import main
from envs.comparison.suite_results import read_results

RECORDS = Path(__file__).parents[3] / "docs/results/marsnav-v1"


def changed(*keys, to):
    """A change of one value of the file, by the keys and indices that lead to it."""

    def change(content):
        *path, last = keys
        for key in path:
            content = content[key]
        content[last] = to

    return change


def by_network(content):
    """The drives are those of the shipped network, whose digest is left out."""
    for key in ("config", "driven_with", "results", "differences"):
        del content[key]
    for episode in content["episodes"]:
        episode.update(perception="m3depth", blind=0, abs_rel=0.1, rocks=0, rocks_missed=0, false_obstacles=0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (changed("config", "dynamics", to="physics"), 'config.dynamics must be "kinematic", as small-v1 fixes it, got'),
        (changed("config", "align_rows", to=False), "config.align_rows must be true, as small-v1 fixes it, got false"),
        (changed("config", "k", to=[0.01]), "config.k must be [], as small-v1 fixes it, got [0.01]"),
        (changed("config", "seed", to=9), "config.seed must be 5, as small-v1 fixes it, got 9"),
        (changed("config", "eyes", "lens_dust", to=0.5), "config.eyes.lens_dust must be 0.0, as small-v1 fixes it"),
        (changed("config", "condition", to=["clear"]), 'config.condition must be ["clear", "rare_looks"], as the '),
        (changed("config", "driver", to=["navigator"]), 'config.driver must be ["straight", "random"], as the suite'),
        (changed("config", "shard", to="1/2"), 'config.shard must be null, as the suite and the episodes in the'),
        (changed("driven_with", "drift", to=0.5), "driven_with.drift must be 0.0, as small-v1 fixes it, got 0.5"),
        (changed("driven_with", "disparity_noise", to=3), "driven_with.disparity_noise must be 0.0, as small-v1 fixes"),
        (changed("driven_with", "suite_sha256", to="0"), "driven_with.suite_sha256 must be "),
        (changed("results", 1, "success_rate", to=0.123), "results[1].success_rate must be "),
        (changed("results", 0, "outcomes", to={"tilt": 2}), "results[0].outcomes must be {"),
        (changed("results", 0, "min_clearance", to=0.123), "results[0].min_clearance must be "),
        (changed("results", 0, "cell", "k", to=0.01), 'results[0].cell must be {"k": null, "slope_deg": null, "cond'),
        (changed("results", 0, "cell", to={}), "results[0].cell has no condition"),
        (changed("results", to=[]), "results has no row of straight, ground_truth, clear"),
        (lambda c: c["results"].append(c["results"][0]), "results[4] must not be of straight, ground_truth, clear, as"),
        (changed("results", 0, "driver", to="me"), "results[0] must not be of me, ground_truth, clear, as no"),
        (changed("differences", to=[]), "differences must have an entry for each method after the first, 1 in all, "),
        (changed("differences", 0, "difference", to=0.7), "differences[0].difference must be "),
        (changed("differences", 0, "less", to=["random", "sgbm"]), 'differences[0].less must be ["straight", "ground_'),
        (changed("versions", to={}), "versions has no mars-m3depth"),
        (lambda c: c.pop("versions"), "the file has no versions, which envs.evaluate writes"),
        (lambda c: c.pop("code"), "the file has no code"),
        (changed("code", to={"abc": 8}), "code must be {"),
        (changed("code", to={"abc": 0}), "code.abc must be at least 1, got 0"),
        (by_network, "weights has no SHA-256 of m3depth, which drove"),
    ],
)  # fmt: skip
def test_what_stands_beside_the_episodes_must_agree_with_them_and_with_the_suite(
    suite_run, small_suite, tmp_path, capsys, change, message
):
    content = json.loads((suite_run / "results.json").read_text())
    change(content)
    path = tmp_path / "results.json"
    path.write_text(json.dumps(content))
    assert main([str(path), "--check", "--suite", str(small_suite)]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"error: {path}: {message}") and error.count("\n") == 1


def test_settings_and_figures_may_be_left_out_and_intervals_may_be_of_another_release(suite_run, small_suite, tmp_path):
    content = json.loads((suite_run / "results.json").read_text())
    del content["config"]["yaw_drift_deg"], content["driven_with"]["seed"], content["results"][0]["slip"]
    content["config"]["of_a_later_release"] = 3
    content["config"]["driver"].reverse()
    content["differences"][0].update(interval=[-1, 1], spl_interval=[-1, 1])
    path = tmp_path / "results.json"
    path.write_text(json.dumps(content))
    assert main([str(path), "--check", "--suite", str(small_suite)]) == 0
    for key in ("config", "driven_with", "results", "differences"):
        del content[key]
    path.write_text(json.dumps(content))
    assert main([str(path), "--check", "--suite", str(small_suite)]) == 0


def test_the_published_results_are_accepted():
    """But for the one that was driven with an earlier state of the suite."""
    files = sorted(file for file in RECORDS.glob("*.json") if not file.name.startswith("submitted-"))
    read = [read_results(file) for file in files if file.name != "dev-ground_truth-sgbm.json"]
    assert len(read) == 181 and sum(len(of_method) for file in read for of_method in file.episodes.values()) > 1120
