import json
from dataclasses import replace

import pytest

import envs.evaluate
from envs.evaluate import evaluate, main
from envs.evaluation.config import EvaluateConfig
from envs.evaluation.suite_drives import values_of, with_suite
from marssim.base.files.json_file import DatasetError


def test_a_suite_fixes_courses_and_conditions(small_suite, make_suite_config, tmp_path):
    config = with_suite(make_suite_config(small_suite, tmp_path))
    assert (config.seed, config.episodes, config.dynamics) == (5, 2, "kinematic")
    assert [cell.name for cell in config.cells] == ["condition=clear", "condition=rare_looks"]
    assert len(config.tasks) == 8
    assert values_of(config, config.cells[1])["look_every"] == 1.0
    assert with_suite(make_suite_config(small_suite, tmp_path, split="test", condition=("clear",))).episodes == 1
    for episodes in (1, 2):
        assert with_suite(make_suite_config(small_suite, tmp_path, episodes=episodes)).episodes == episodes


def test_the_results_of_a_suite_hold_every_episode(suite_run):
    content = json.loads((suite_run / "results.json").read_text())
    assert content["suite"]["name"] == "small-v1" and content["suite"]["split"] == "dev"
    keys = {(e["condition"], e["course"], e["driver"]) for e in content["episodes"]}
    assert len(keys) == len(content["episodes"]) == 8
    for episode in content["episodes"]:
        rare = episode["condition"] == "rare_looks"
        assert (episode["looks"] < episode["steps"] + 1) == rare
        assert episode["success"] == (episode["outcome"] == "goal")
    assert [row["cell"]["condition"] for row in content["results"]] == ["clear", "clear", "rare_looks", "rare_looks"]
    page = (suite_run / "results.md").read_text()
    assert page.startswith("Driven with --suite small-v1, --split dev.\n")
    assert "| straight | ground_truth | rare_looks |" in page


def test_finished_drives_of_a_suite_are_not_left_out(small_suite, make_suite_config, tmp_path, capsys, monkeypatch):
    config = make_suite_config(small_suite, tmp_path)
    (tmp_path / "episodes").mkdir()
    tasks = with_suite(config).tasks
    for task in tasks:
        (tmp_path / "episodes" / task.file).write_text("{}")
    (tmp_path / "results.md").write_text("")
    monkeypatch.setattr("envs.evaluate.evaluate", lambda config: {"results": []})
    envs.evaluate._work(config)
    assert capsys.readouterr().err == "" and len(tasks) > 1
    envs.evaluate._work(replace(config, episodes=1))
    assert f"also holds {len(tasks) // 2} drive" in capsys.readouterr().err


def test_a_simulator_that_builds_another_scene_stops_the_evaluation(small_suite, make_suite_config, tmp_path):
    content = json.loads(small_suite.read_text())
    for episode in content["episodes"]:
        episode["scene"] = ["0" * 16] * 2
    changed = tmp_path / "changed-v1.json"
    changed.write_text(json.dumps(content))
    with pytest.raises(
        DatasetError, match="suite small-v1: course 0 of dev, clear, is not the one that this simulator builds"
    ):
        evaluate(make_suite_config(changed, tmp_path / "out", driver=("straight",), condition=("clear",), episodes=1))


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--k", "0.1"], "--k: small-v1 fixes it; leave it out with --suite"),
        (["--lens-dust", "0.1"], "--lens-dust: small-v1 fixes it"), (["--seed", "1"], "--seed: small-v1 fixes it"),
        (["--split", "train"], "--split 'train' is unknown; suite small-v1 has dev, test"),
        (["--condition", "claer"], "--condition 'claer' is unknown (did you mean clear?); small-v1 has clear, rare"),
        (["--episodes", "3"], "--episodes must be at most 2, as many as small-v1 has, got 3"),
        (["--shard", "3/2"], "--shard must be I/N, such as 2/8 for the second part of eight, got '3/2'"),
        (["--shard", "1"], "--shard must be I/N"),
        (["--film-courses", "7"], "--film-courses must lie in [0, 1], got 7"),
        (["--shard", "5/9"], "--shard 5/9 has no episode: use 4 parts or fewer"),
    ],
)  # fmt: skip
def test_what_a_suite_fixes_is_refused_in_one_line(small_suite, tmp_path, capsys, flags, message):
    code = main(["--suite", str(small_suite), "--perception", "ground_truth", "--out", str(tmp_path / "out"), *flags])
    error = capsys.readouterr().err
    assert code == 2 and message in error and error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_conditions_are_driven_without_a_suite_too(tmp_path):
    config = with_suite(EvaluateConfig(tmp_path, condition=("storm", "rare_looks"), k=(0.1,)))
    assert [cell.name for cell in config.cells] == [
        "condition=storm, k=0.1, slope=preset", "condition=rare_looks, k=0.1, slope=preset"
    ]  # fmt: skip
    assert values_of(config, config.cells[0]) == {"optical_depth": 3.0}
