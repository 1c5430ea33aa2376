"""What must not be mixed in one folder of an evaluation."""

import hashlib
import re

import pytest

from envs.drives.resume import check_folder, noted_settings
from envs.evaluate import EvaluateConfig, evaluate
from marssim.base.files.json_file import DatasetError, read_json

SETTINGS = {"seed": 3, "scene": "gale", "goal_distance": 20.0}


def sha256(content):
    return hashlib.sha256(content).hexdigest()


@pytest.fixture
def file(tmp_path):
    return tmp_path / "evaluate.json"


def test_the_same_settings_go_on_and_others_are_named_with_what_they_were(file):
    noted_settings(file, SETTINGS, ("ground_truth", "navigator"))
    assert noted_settings(file, {**SETTINGS, "goal_distance": 20}, ("sgbm", "straight")) == {}
    before = file.read_bytes()
    message = re.escape(f"{file}: the folder's episodes were driven with no --drift, --goal-distance 20; choose")
    with pytest.raises(DatasetError, match=f"^{message}"):
        noted_settings(file, {**SETTINGS, "goal_distance": 30.0, "drift": 0.1}, ("sgbm",))
    assert file.read_bytes() == before


def test_errors_that_are_left_out_now_are_named(file):
    noted_settings(file, {**SETTINGS, "drift": 0.1}, ())
    with pytest.raises(DatasetError, match=r"driven with --drift 0\.1; choose"):
        noted_settings(file, SETTINGS, ())


def test_retrained_weights_do_not_inherit_the_drives_of_the_old_ones(file, tmp_path):
    weights = tmp_path / "w.safetensors"
    weights.write_bytes(b"first")
    name = f"m3depth:{weights}"
    assert noted_settings(file, SETTINGS, (name,)) == {name: sha256(b"first")}
    assert noted_settings(file, SETTINGS, (name,)) == {name: sha256(b"first")}
    weights.write_bytes(b"second")
    with pytest.raises(DatasetError, match=r"w\.safetensors drove with other weights then"):
        noted_settings(file, SETTINGS, (name,))
    assert noted_settings(file, SETTINGS, ("sgbm",)) == {}
    assert read_json(file)["weights"] == {name: sha256(b"first")}  # those that drove are still known


def test_a_policy_that_was_trained_on_does_not_either(file, tmp_path):
    policy = tmp_path / "policy.zip"
    policy.write_bytes(b"first")
    assert noted_settings(file, SETTINGS, ("straight", str(policy))) == {str(policy): sha256(b"first")}
    policy.write_bytes(b"second")
    with pytest.raises(DatasetError, match=r"policy\.zip drove with other weights"):
        noted_settings(file, SETTINGS, (str(policy),))


def test_an_edited_class_is_not_reported_by_the_drives_of_what_it_was(tmp_path, monkeypatch):
    code = tmp_path / "own_driver.py"
    code.write_text("from envs.drivers.builtin import StraightDriver as Own\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    config = EvaluateConfig(
        tmp_path / "out", ("own_driver:Own",), ("ground_truth",), episodes=1, k=(0.01,), goal_distance=4.0,
        dynamics="kinematic", videos=False,
    )  # fmt: skip
    assert evaluate(config)["weights"] == {"own_driver:Own": sha256(code.read_bytes())}
    evaluate(config)
    code.write_text("from envs.drivers.builtin import RandomDriver as Own\n")
    with pytest.raises(DatasetError, match="own_driver:Own drove with other code then"):
        evaluate(config)


def test_a_folder_of_something_else_is_refused_and_an_evaluations_is_not(tmp_path):
    check_folder(tmp_path / "new", "evaluate.json")
    check_folder(tmp_path, "evaluate.json")
    (tmp_path / ".lock").touch()
    (tmp_path / ".evaluate.json.77.part").touch()  # of a run that was killed as it began
    check_folder(tmp_path, "evaluate.json")
    (tmp_path / "results.json").touch()
    with pytest.raises(DatasetError, match="not empty and holds no evaluation"):
        check_folder(tmp_path, "evaluate.json")
    (tmp_path / "evaluate.json").touch()
    check_folder(tmp_path, "evaluate.json")
