from dataclasses import replace
from itertools import permutations
from pathlib import Path

import pytest

from envs.comparison.methods import fullest_runtime, in_track, methods_of
from envs.comparison.suite_results import SuiteResults
from marssim.base.files.json_file import DatasetError

METHOD = ("navigator", "m3depth")
WHOLE = {("clear", course) for course in range(4)}


def part(folder, courses, code="aa", weights="0", runtime="openvino 1", parts=2):
    """A part of an evaluation of four courses, in a folder of its own."""
    common = None if parts is None else {"conditions": ["clear"], "courses": 4, "parts": parts}
    episodes = {("clear", course): {"code": code, "folder": folder} for course in courses}
    return SuiteResults(
        Path(folder) / "results.json", "suite", "dev", {METHOD: episodes}, 280, common, {"m3depth": weights}, runtime
    )


def merged(*files):
    """The folders whose episodes were put together."""
    methods = methods_of(files).values()
    return {frozenset(episode["folder"] for episode in method.episodes.values()) for method in methods}


def test_parts_of_one_evaluation_are_one_method_also_if_the_code_changed_on_the_way():
    for code in ("aa", "bb"):
        methods = methods_of([part("one", (0, 2)), part("two", (1, 3), code)])
        assert list(methods) == ["navigator, m3depth"] and set(methods["navigator, m3depth"].episodes) == WHOLE


@pytest.mark.parametrize("other", [{"code": "bb"}, {"runtime": "pytorch 2"}, {"weights": "1"}])
def test_parts_of_two_evaluations_stay_apart_in_any_order(other):
    files = [part("a1", (0, 2)), part("a2", (1, 3)), part("b1", (0, 2), **other), part("b2", (1, 3), **other)]
    for order in permutations(files):
        assert merged(*order) == {frozenset({"a1", "a2"}), frozenset({"b1", "b2"})}


@pytest.mark.parametrize("other", [{"runtime": "pytorch 2"}, {"weights": "1"}, {"parts": 3}, {"parts": None}])
def test_parts_of_other_evaluations_do_not_fill_gaps(other):
    assert merged(part("a1", (0, 2)), part("b2", (1, 3), **other)) == {frozenset({"a1"}), frozenset({"b2"})}


def test_a_part_is_compared_with_all_that_it_would_join():
    files = [part("a1", (0,)), part("a2", (1,), runtime=None), part("b3", (2,), runtime="pytorch 2")]
    for order in permutations(files):
        assert merged(*order) == {frozenset({"a1"}), frozenset({"a2"}), frozenset({"b3"})}


def test_parts_that_nothing_tells_apart_are_refused():
    files = [part("a1", (0, 2)), part("a2", (1, 3)), part("b1", (0, 2)), part("b2", (1, 3))]
    with pytest.raises(DatasetError, match=r"b1.results.json: holds episodes of navigator, m3depth that a1.results"):
        methods_of(files)
    twice = methods_of(files[::2])  # the same part by two laboratories
    assert list(twice) == ["navigator, m3depth (a1)", "navigator, m3depth (b1)"]


def test_joined_parts_are_labelled_by_their_number_and_where_that_is_not_enough_by_a_file():
    ours = [part("a1", (0, 2)), part("a2", (1, 3))]
    again = [part("b1", (0, 2), code="bb"), part("b2", (1, 3), code="bb")]
    alone = replace(part("alone", range(4)), part=None)
    assert list(methods_of(ours)) == ["navigator, m3depth"]
    assert list(methods_of([*ours, alone])) == ["navigator, m3depth (2 parts)", "navigator, m3depth (alone)"]
    labels = ["navigator, m3depth (2 parts, with a1)", "navigator, m3depth (2 parts, with b1)"]
    assert list(methods_of([*ours, *again])) == labels
    twins = [replace(alone, path=Path(folder) / "out/results.json") for folder in ("mine", "theirs")]
    assert list(methods_of(twins)) == [f"navigator, m3depth ({twin.path})" for twin in twins]


def test_a_merged_method_has_the_weights_and_the_fullest_record_of_its_program():
    (method,) = methods_of([part("one", (0, 2)), part("two", (1, 3), runtime="openvino 1 cpu bf16")]).values()
    assert method.weights == {"m3depth": "0"} and method.runtime == "openvino 1 cpu bf16"


def test_records_of_one_program_may_lack_words():
    assert fullest_runtime(["openvino 1", None, "openvino 1 cpu bf16", "openvino 1 cpu"]) == "openvino 1 cpu bf16"
    assert fullest_runtime([None]) is fullest_runtime([]) is None
    for other in ("openvino 1 cpu fp32", "openvino 10", "pytorch 1"):
        with pytest.raises(ValueError, match=f"{other} is not openvino 1 cpu bf16"):
            fullest_runtime(["openvino 1 cpu bf16", other])


def test_a_track_holds_what_it_fixes():
    assert in_track("eyes", ("navigator", "sgbm")) and not in_track("eyes", ("straight", "sgbm"))
    assert in_track("drivers", ("straight", "ground_truth")) and not in_track("drivers", ("navigator", "sgbm"))
    assert in_track("both", ("straight", "sgbm"))


def test_files_in_one_folder_are_told_apart_by_their_names():
    one, other = (replace(part("all", range(4), parts=None), path=Path(f"all/{name}.json")) for name in "ab")
    assert list(methods_of((one, other))) == ["navigator, m3depth (a)", "navigator, m3depth (b)"]


def driven(folder, courses, runtime, *perceptions):
    """A file of one part with several perceptions, and the record of all their networks."""
    file = part(folder, courses, runtime=runtime)
    episodes = file.episodes[METHOD]
    return replace(file, episodes={("navigator", perception): episodes for perception in perceptions})


def test_the_runtime_of_a_method_is_that_of_its_own_network():
    """M3Depth beside another network, which PyTorch ran, in one part, and each by itself in the other."""
    rival, both = "m3depth:rival.safetensors", "openvino 1 cpu bf16 + pytorch 2 cpu bf16"
    files = [
        driven("a", (0,), both, "m3depth", rival, "sgbm"), driven("b", (1,), "openvino 1 cpu bf16", "m3depth", "sgbm"),
        driven("c", (1,), "pytorch 2 cpu bf16", rival),
    ]  # fmt: skip
    methods = methods_of(files)
    assert [(m.perception, len(m.episodes), m.runtime) for m in methods.values()] == [
        ("m3depth", 2, "openvino 1 cpu bf16"), (rival, 2, "pytorch 2 cpu bf16"), ("sgbm", 2, None),
    ]  # fmt: skip


def test_methods_without_a_network_do_not_depend_on_what_ran_those_beside_them():
    files = [driven("a", (0,), "openvino 1", "m3depth", "sgbm"), driven("b", (1,), "pytorch 2", "m3depth", "sgbm")]
    methods = methods_of(files)
    assert sorted((m.perception, len(m.episodes)) for m in methods.values()) == [
        ("m3depth", 1), ("m3depth", 1), ("sgbm", 2),
    ]  # fmt: skip
