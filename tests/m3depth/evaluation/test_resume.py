"""The file of an unfinished evaluation, and the states of its sums."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from m3depth.evaluation.resume import UNFINISHED, SavedState, SavedStateError
from m3depth.evaluation.rock_scores import RockCounts, RockOutcome
from m3depth.evaluation.scores import ScoredPair, Scores
from m3depth.stereo.classical import SGBM

ASKED = {"--seed": 0, "--baselines": ["sgbm"]}
PLAIN = st.none() | st.booleans() | st.integers(-(2**60), 2**60) | st.floats(allow_nan=False) | st.text(max_size=5)
ARRAYS = st.sampled_from(["float64", "int64", "bool"]).flatmap(
    lambda kind: st.integers(0, 4).map(lambda n: np.arange(6 * n).reshape(2, 3 * n).astype(kind))
)
STATES = st.recursive(
    PLAIN | ARRAYS, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3)
)


def alike(one, other):
    if isinstance(one, np.ndarray):
        return isinstance(other, np.ndarray) and one.dtype == other.dtype and np.array_equal(one, other)
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(alike(value, other[key]) for key, value in one.items())
    if isinstance(one, list):
        return len(one) == len(other) and all(map(alike, one, other))
    return type(one) is type(other) and one == other


@settings(max_examples=60, deadline=None)
@given(st.dictionaries(st.text(max_size=4), STATES, max_size=4))
def test_a_saved_state_comes_back(tmp_path_factory, state):
    file = SavedState(tmp_path_factory.mktemp("out"), ASKED)
    assert file.load() is None
    file.save({"kept": state})
    assert alike({"kept": state}, SavedState(file.path.parent, ASKED).load())
    file.remove()
    assert file.load() is None


def test_another_evaluation_does_not_continue_from_it(tmp_path):
    SavedState(tmp_path, {**ASKED, "--unit": 32.0}).save({})
    with pytest.raises(SavedStateError, match=r"with another --seed, another --unit; choose another --out, or delete"):
        SavedState(tmp_path, {**ASKED, "--seed": 1}).load()
    assert (tmp_path / UNFINISHED).is_file()


def test_a_file_of_an_earlier_version_belongs_to_another_evaluation(tmp_path, monkeypatch):
    """It names its dependencies otherwise, and is not damaged."""
    with monkeypatch.context() as patch:
        patch.setattr("m3depth.evaluation.resume.DEPENDENCIES", "asked")
        SavedState(tmp_path, ASKED).save({})
    with pytest.raises(SavedStateError, match="belongs to an unfinished evaluation with another"):
        SavedState(tmp_path, ASKED).load()


@pytest.mark.parametrize("change", ["cut", "other bytes", "another npz", "pickled", "an array", "a list"])
def test_a_damaged_file_is_named_and_nothing_in_it_is_executed(tmp_path, change):
    path = tmp_path / UNFINISHED
    file = SavedState(tmp_path, ASKED)
    file.save({"a": np.arange(1000)})
    if change == "cut":
        path.write_bytes(path.read_bytes()[:-200])
    elif change == "other bytes":
        path.write_bytes(b"no archive")
    elif change == "another npz":
        np.savez(path, other=np.zeros(3))
    elif change == "an array":
        with path.open("wb") as out:
            np.save(out, np.zeros(3))
    elif change == "a list":
        np.savez(path, plain=np.array("[1]"))
    else:
        np.savez(path, plain=np.array([{"state": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(SavedStateError, match=r"unfinished\.npz: is not a readable state of an evaluation; delete it"):
        file.load()


@settings(max_examples=100, deadline=None)
@given(st.floats(0, 1, exclude_max=True), st.integers(1, 255))
def test_a_file_with_any_other_byte_is_damaged(tmp_path_factory, place, change):
    file = SavedState(tmp_path_factory.mktemp("out"), ASKED)
    file.save({"a": np.arange(20)})
    data = bytearray(file.path.read_bytes())
    data[int(place * len(data))] ^= change
    file.path.write_bytes(data)
    with pytest.raises(SavedStateError, match=r"unfinished\.npz: is not a readable state"):
        file.load()


def test_saves_are_some_time_apart(tmp_path, monkeypatch):
    now = 100.0
    monkeypatch.setattr("m3depth.evaluation.resume.time.monotonic", lambda: now)
    file = SavedState(tmp_path, ASKED)
    now += 29
    file.save_now_and_then(lambda: {"at": now})
    assert file.load() is None
    now += 1
    file.save_now_and_then(lambda: {"at": now})
    now += 29
    file.save_now_and_then(lambda: {"at": now})
    assert file.load() == {"at": 130.0}


def test_the_state_of_rocks_comes_back(tmp_path):
    sums, again = (
        RockCounts(2, [RockOutcome(0.3, 4.0, True, 0.01, False)], [RockOutcome(0.1, 2.0, False, -0.1)], [(0.25, 3.0)]),
        RockCounts(),
    )
    file = SavedState(tmp_path, ASKED)
    file.save(sums.state_dict())
    again.load_state_dict(file.load())
    assert again == sums and again.result() == sums.result() and again.rocks[0].both_eyes is False


def test_scores_continue_from_a_saved_state(plane_samples, tmp_path):
    """The result is the same to the last bit, sky and confidence included."""

    def add(scores, samples):
        for sample in samples:
            scores.add(SGBM().infer(sample.left, sample.right, sample.rig), ScoredPair(sample))

    whole, before, after = Scores(fit=True), Scores(fit=True), Scores(fit=True)
    add(whole, plane_samples)
    add(before, plane_samples[:1])
    file = SavedState(tmp_path, ASKED)
    file.save(before.state_dict())
    after.load_state_dict(file.load())
    add(after, plane_samples[1:])
    assert json.dumps(after.result()) == json.dumps(whole.result())
    assert whole.result()["depth"]["all"]["images"] == len(plane_samples) > 1
