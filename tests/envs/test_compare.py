import hashlib
import json
import math
import shutil
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import envs.compare
from envs.compare import CompareConfig, compare, main
from envs.comparison.suite_results import SuiteResults, _fault_of_looks, _fault_of_steps
from marssim.base.files.json_file import DatasetError
from marssim.base.results import lock

BESIDE_EPISODES = ("config", "driven_with", "results", "differences")  # what may be left out of a file


@pytest.fixture
def edited(suite_run, tmp_path):
    """Returns a copy of the results after a change of their episodes, without what need not stand beside them."""

    def edit(change, name="theirs"):
        content = json.loads((suite_run / "results.json").read_text())
        content = {key: value for key, value in content.items() if key not in BESIDE_EPISODES}
        change(content)
        content["code"] = Counter(episode["code"].partition("\n")[0] for episode in content["episodes"])
        path = tmp_path / name / "results.json"
        path.parent.mkdir()
        path.write_text(json.dumps(content))
        return path

    return edit


def test_results_that_hold_are_described(suite_run, small_suite, capsys):
    assert main([str(suite_run), "--check", "--suite", str(small_suite)]) == 0
    assert (
        ": all 4 episodes of small-v1, dev, by straight, ground_truth; random, ground_truth" in capsys.readouterr().out
    )


def test_every_file_is_checked_and_part_of_a_split_is_called_so(suite_run, small_suite, tmp_path, capsys):
    bad, part = tmp_path / "bad.json", tmp_path / "part.json"
    content = json.loads((suite_run / "results.json").read_text())
    bad.write_text("{}")
    kept = [episode for episode in content["episodes"] if episode["condition"] == "clear"]
    suite = {**content["suite"], "conditions": ["clear"]}
    beside = {"code": {kept[0]["code"]: len(kept)}, "versions": content["versions"]}
    part.write_text(json.dumps({**beside, "episodes": kept, "suite": suite}))
    assert main([*map(str, (bad, part, suite_run)), "--check", "--suite", str(small_suite)]) == 2
    out, error = capsys.readouterr()
    first, second = out.splitlines()
    assert first.startswith(f"{part}: 2 of 4 episodes of small-v1") and ": all 4 episodes of small-v1" in second
    first, last = error.splitlines()
    assert first.startswith(f"error: {bad}: ") and last == "error: 1 of 3 files were refused"
    assert main([str(part), str(suite_run), "--check", "--suite", str(tmp_path / "none.json")]) == 2
    assert capsys.readouterr() == ("", f"error: suite {tmp_path / 'none.json'}: no such file\n")


NO_ERRORS = {"abs_rel": 0.1, "rocks": 0, "rocks_missed": 0, "false_obstacles": 0}


def broken(key, value):
    return lambda content: content["episodes"][0].update({key: value})


def arrived(content):
    """Return an episode that reached the goal."""
    return next(episode for episode in content["episodes"] if episode["success"])


def failed(outcome, cause, driver="navigator", min_clearance=0.0):
    """The first episode failed by its cause, at its end."""
    values = {"outcome": outcome, "cause": cause, "driver": driver, "success": False, "spl": 0.0, "distance": 1.5}
    values["min_clearance"] = min_clearance
    return lambda content: content["episodes"][0].update(values)


def seen(**values):
    """The first episode is one of another perception, which saw no rocks, with these values."""
    return lambda content: content["episodes"][0].update({"perception": "p", **NO_ERRORS, **values})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (broken("spl", "high"), "episodes[0].spl must be of type number, got 'high'"),
        (broken("spl", 1.5), "episodes[0].spl must be at most 1, got 1.5"),
        (broken("outcome", "won"), "episodes[0].outcome must be one of goal, collision"),
        (broken("cause", "bad luck"), "episodes[0].cause must be one of null, odometry error, known obstacle"),
        (lambda c: arrived(c).update(cause="detour"), "cause must be null for a drive that reached the goal, got det"),
        (failed("collision", "detour"), "cause must not be detour for collision"),
        (failed("no_path", "missed obstacle"), "cause must not be missed obstacle for no_path"),
        (failed("no_path", "detour", "straight"), "cause must be null for the driver straight, got detour"),
        (broken("shortest", 9.0), "clear, course 0: shortest must be "), (broken("course", 7), "has no such episode"),
        (broken("shortest", 2.0), "clear, course 0: shortest must be "), (broken("spl", 0.123), "spl must be "),
        (lambda c: c["episodes"].append(c["episodes"][0]), "clear, course 0: appears twice"),
        (lambda c: c["episodes"][0].update(success=not c["episodes"][0]["success"]), "success must not be "),
        (lambda c: c["episodes"].pop(), "1 episode is missing, such as rare_looks, course 1"),
        (lambda c: c.pop("suite"), "the file has no suite; to compare drives without --suite, name all methods in one"),
        (lambda c: c["episodes"].clear(), "holds no episode"),
        (lambda c: c["suite"].update(sha256="0"), "is of another version of small-v1: its suite has the SHA-256 0, "),
        (lambda c: c["suite"].update(split="x"), "suite.split 'x' is none of dev, test"),
        (lambda c: c["suite"].update(name="../other"), "suite.name must be a name of letters, digits"),
        (lambda c: c["suite"].update(courses=3), "suite.courses must be at most 2, got 3"),
        (lambda c: c["suite"].update(courses=1), "is none of the episodes that the file says were driven"),
        (lambda c: c["suite"].update(shard="2"), "suite.shard must be I/N"),
        (lambda c: c["suite"].update(shard="1/" + "9" * 5000), "suite.shard must be I/N"),
        (lambda c: c["suite"].update(conditions=["clear", "clear"]), "suite.conditions must differ, got clear, clear"),
        (lambda c: c["suite"].update(shard="2/2"), "is none of the episodes that the file says were driven"),
        (broken("start_distance", 4.0), "start_distance must be 3.00 m, got 4"),
        (broken("start_distance", 2.0), "start_distance must be 3.00 m, got 2"),
        (lambda c: c["episodes"][0].update(shortest=c["episodes"][0]["shortest"] + 0.05), "shortest must be "),
        (lambda c: c["episodes"][0].update(looks=c["episodes"][0]["steps"] + 2), "looks must be "),
        (broken("rocks", 0), "rocks must be null for true depth, got 0"),
        (broken("steps", 1000), "steps must be at most 45, got 1000"),
        (broken("steps", 1), "path_length must be at most 0.45 m in 1 steps, got "),
        (broken("looks", 0), "episodes[0].looks must be at least 1, got 0"),
        (broken("looks", 1000), "the first step and one after each, got 1000"),
        (broken("looks", 2), "clear, course 0: looks must be "),
        (broken("blind", 1000), "the number of looks, got 1000"),
        (broken("slip", 0.5), "slip must be null, as the wheels do not slip in small-v1, got 0.5"),
        (broken("energy", 3.0), "energy must be null, as the wheels do not slip in small-v1, got 3.0"),
        (broken("abs_rel", -5), "episodes[0].abs_rel must be at least 0, got -5"),
        (broken("abs_rel", 0.1), "abs_rel must be null for true depth, got 0.1"),
        (broken("rocks", 3), "rocks must be null for true depth, got 3"),
        (seen(rocks=1, rocks_missed=9), "must be at most 1, the number"),
        (seen(rocks_missed=1), "rocks_missed must be at most 0, the"),
        (broken("perception", "p"), "abs_rel must be a number for p; only drives with true depth have null"),
        (seen(rocks=None), "rocks must be a number for p; only drives with true depth have null"),
        (seen(looks=None), "looks must be a number for p; only drives with true depth have null"),
        (seen(blind=None), "blind must be a number for p; only drives with true depth have null"),
        (
            lambda c: (failed("collision", None)(c), c["episodes"][0].pop("min_clearance")),
            "min_clearance must be a number for a collision, got None",
        ),
        (seen(near_ground=10**9), "the pixels of all looks, got 1000000000"),
        (seen(false_obstacles=None), "false_obstacles must be a number for p; only drives with true depth have null"),
        (broken("min_clearance", 4.0), "episodes[0].min_clearance must be at most 3, got 4"),
        (
            seen(near_ground=5, near_ground_as_sky=6),
            "near_ground_as_sky must be at most 5, the pixels of near ground, got 6",
        ),
        (broken("near_ground", 7), "near_ground must be null for true depth, got 7"),
        (lambda c: c.update(weights=[]), "weights must be of type object, got []"),
        (lambda c: c.update(weights={"a": "x"}), "weights.a must be a SHA-256, got 'x'"),
        (lambda c: c.update(runtime=3), "runtime must be of type string or null, got 3"),
        (broken("code", "a\nb"), "episodes[0].code must be a state of the sources"),
        (broken("perception", "a\x1b[2J"), "episodes[0].perception must be a name in one line"),
    ],
)  # fmt: skip
def test_results_that_cannot_be_true_are_refused_in_one_line(edited, small_suite, capsys, change, message):
    path = edited(change)
    assert main([str(path), "--check", "--suite", str(small_suite)]) == 2
    error = capsys.readouterr().err
    assert str(path) in error and message in error and error.count("\n") == 1


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (("goal", 1.0, 0.9, 9), r"path_length must be at least 2.10 m, by the distances of the goal, got 1"),
        (("goal", 1.93, 1.04, 9), r"path_length must be at least 1.95 m for an arrival, got 1.93"),
        (("goal", 3.0, 1.2, 9), r"distance must be at most 1 m for an arrival, got 1.2"),
        (("collision", 0.0, 0.0, 9), r"path_length must be at least 3.00 m, by the distances of the goal, got 0"),
        (("elsewhere", 1.0, 5.0, 9), r"path_length must be at least 2.00 m, by the distances of the goal, got 1"),
        (("no_path", 3.0, 0.5, 9), r"distance must be at least 1 m for no_path, got 0.5"),
        (("time", 3.0, 2.0, 9), r"steps must be at least 45 for time, got 9"),
        (("no_path", 3.0, 2.0, 46), r"steps must be at most 45, got 46"),
        (("goal", 3.0, 0.4, 9), r"distance must be at least 0.55 m after the step that arrives, got 0.4"),
        (("stuck", 0.1, 3.0, 4), r"steps must be at least 5 for stuck, got 4"),
        (("out_of_bounds", 0.0, 3.0, 0), r"steps must be at least 1 for out_of_bounds, got 0"),
    ],
)
def test_the_end_of_a_drive_must_fit_its_way_and_its_steps(edited, small_suite, values, message):
    outcome, way, distance, steps = values

    def change(content):
        success = outcome == "goal"
        content["episodes"][0].update(
            outcome=outcome,
            success=success,
            path_length=way,
            spl=float(success),
            distance=distance,
            steps=steps,
            looks=steps + 1,
        )

    with pytest.raises(DatasetError, match=message):
        compare(CompareConfig((edited(change),), suite=str(small_suite), check=True))


def test_an_arrival_through_what_the_shortest_path_goes_around_counts(edited, small_suite, tmp_path):
    """As a rover does that gets through a ditch: its way is shorter than the shortest path, and its SPL is 1."""
    suite = tmp_path / "small-v1.json"
    content = json.loads(small_suite.read_text())
    (course,) = (e for e in content["episodes"] if (e["split"], e["condition"], e["course"]) == ("dev", "clear", 0))
    course["shortest"] = 5.0
    suite.write_text(json.dumps(content))

    def through(results):
        results["suite"]["sha256"] = hashlib.sha256(suite.read_bytes()).hexdigest()
        for each in results["episodes"]:
            if (each["condition"], each["course"]) == ("clear", 0):
                each.update(
                    outcome="goal",
                    success=True,
                    shortest=5.0,
                    path_length=2.5,
                    distance=0.9,
                    spl=1.0,
                    steps=9,
                    looks=10,
                )

    assert main([str(edited(through)), "--check", "--suite", str(suite)]) == 0


def test_a_shard_must_hold_the_whole_of_its_part(edited, small_suite, capsys):
    def second_half(content):
        content["suite"]["shard"] = "2/2"
        content["episodes"] = [each for each in content["episodes"] if each["condition"] == "rare_looks"]

    path = edited(second_half)
    assert main([str(path), "--check", "--suite", str(small_suite)]) == 0
    content = json.loads(path.read_text())
    content["episodes"] = content["episodes"][:-1]
    path.write_text(json.dumps(content))
    assert main([str(path), "--check", "--suite", str(small_suite)]) == 2
    assert "1 episode is missing, such as rare_looks, course 1" in capsys.readouterr().err


def drawn_bars(axes):
    """The number of error bars."""
    ends = [end for bars in axes.containers for end in bars.lines[2][0].get_segments()]
    return sum(len(end) == 2 and bool(np.isfinite(end).all()) for end in ends)


def test_methods_of_several_files_are_compared_by_course(
    suite_run, edited, small_suite, tmp_path, capsys, drawn_figures
):
    def arrive(content):
        for episode in content["episodes"]:
            way = max(episode["path_length"], episode["shortest"])
            episode.update(outcome="goal", success=True, distance=0.7, path_length=way, spl=episode["shortest"] / way)
            steps = max(math.ceil(way / 0.4), episode["steps"])
            looks = steps + 1 if episode["condition"] == "clear" else math.ceil(way / 1.4)  # as for a look every metre
            episode.update(steps=steps, looks=looks)
            episode.update(perception="theirs", **NO_ERRORS)

    theirs = edited(arrive)
    out = tmp_path / "out"
    config = CompareConfig((suite_run, theirs), out=out, suite=str(small_suite))
    rows = compare(config)["rows"]
    assert [row["condition"] for row in rows] == [name for name in ("clear", "rare_looks", "all") for _ in range(4)]
    overall = {row["method"]: row for row in rows if row["condition"] == "all"}
    assert list(overall) == ["straight, ground_truth", "random, ground_truth", "straight, theirs", "random, theirs"]
    first, best = overall["straight, ground_truth"], overall["straight, theirs"]
    assert first["less"] is None and best["success_rate"] == 1.0 and best["episodes"] == 4
    assert best["less"]["difference"] == pytest.approx(1 - first["success_rate"])
    assert {file.name for file in out.iterdir()} == {"comparison.json", "comparison.md", "comparison.png"}
    success, spl, less_success, less_spl = drawn_figures[0].axes
    assert drawn_figures[0].legends[0].get_title().get_text() == (
        "bars are 95 % intervals; none of SPL over fewer than 4 courses"
    )
    assert drawn_bars(success) == 3 * len(overall) and drawn_bars(spl) == 0  # Wilson's
    shown = {bars.get_label(): bars.lines[0].get_xdata() for bars in success.containers}
    for method in overall:
        of_method = [row for row in rows if row["method"] == method]
        assert shown[method] == pytest.approx([100 * row["success_rate"] for row in of_method])
    assert len(spl.containers) == 4 and len(less_success.containers) == len(less_spl.containers) == 3
    differences = less_spl.containers[-1].lines[0].get_xdata()
    assert differences == pytest.approx(
        [row["less"]["spl_difference"] for row in rows if row["method"] == "random, theirs"]
    )
    page = (out / "comparison.md").read_text()
    assert (
        "| all | random, theirs | 4 on 2 courses | 100 % (34 to 100) |" in page
        and "Suite small-v1, split dev, track both" in page
    )
    assert page.index("| collisions a km (95 %) |") < page.index("| method | outcome | cause | failures |")
    conduct = json.loads((out / "comparison.json").read_text())["conduct"]
    assert [(row["method"], row["episodes"]) for row in conduct] == [(method, 4) for method in overall]
    methods = {
        row["method"]
        for row in compare(CompareConfig((theirs, suite_run), None, "drivers", suite=str(small_suite)))["rows"]
    }
    assert methods == {"straight, ground_truth", "random, ground_truth"}
    assert main([str(suite_run), "--track", "eyes", "--suite", str(small_suite)]) == 2
    assert "no method of these files is on the track eyes" in capsys.readouterr().err


def test_methods_are_compared_to_any_of_them_under_some_conditions(suite_run, small_suite, capsys):
    whole = compare(CompareConfig((suite_run,), suite=str(small_suite)))["rows"]
    assert whole[0]["method"] == "straight, ground_truth" and {row["condition"] for row in whole} > {"rare_looks"}
    config = CompareConfig((suite_run,), None, "both", ("rare_looks",), "random,ground_truth", str(small_suite))
    first, second = compare(config)["rows"]
    assert (first["method"], first["less"]) == ("random, ground_truth", None)
    other = next(row for row in whole if row["condition"] == "rare_looks" and row["less"] is not None)
    assert second["less"]["difference"] == pytest.approx(-other["less"]["difference"])
    assert (first["spl"], second["episodes"]) == (other["spl"], other["episodes"])
    given = [str(suite_run), "--suite", str(small_suite)]
    for flags, message in (
        (["--condition", "storm"], "--condition storm: no method drove it; they drove clear, rare_looks"),
        (
            ["--reference", "navigator, sgbm"],
            "--reference navigator, sgbm: is no method of these files; choose from str",
        ),
    ):
        assert main([*given, *flags]) == 2
        assert capsys.readouterr().err.startswith(f"error: {message}")


def test_one_method_in_two_files_keeps_apart(suite_run, small_suite, tmp_path):
    twin = shutil.copytree(suite_run, tmp_path / "twin")
    rows = compare(CompareConfig((suite_run, twin), suite=str(small_suite)))["rows"]
    assert [row["method"] for row in rows[:4]] == [
        f"{driver}, ground_truth ({folder.name})" for folder in (suite_run, twin) for driver in ("straight", "random")
    ]
    assert rows[2]["less"]["difference"] == 0


def test_drives_that_two_files_hold_are_compared_one_by_one(suite_run, edited, small_suite, tmp_path, capsys):
    def again(content):
        for episode in content["episodes"]:
            episode.update(step_seconds=9.0, perception_seconds=8.0, code="later")
        content["episodes"][-1]["min_clearance"] = 1.25

    theirs, out = edited(again), tmp_path / "out"
    last = json.loads(theirs.read_text())["episodes"][-1]
    assert main([str(suite_run), str(theirs), "--suite", str(small_suite), "--out", str(out)]) == 0
    page = capsys.readouterr().out
    for driver, ending in (("straight", "4 of 4"), ("random", "3 of 4")):
        start = f"- {driver}, ground_truth ({suite_run.name}), and {driver}, ground_truth (theirs): {ending}"
        assert f"\n{start} shared episodes are equal but for times" in page
    assert f" but for times; differing: {last['condition']} {last['course']}.\n" in page
    assert page == (out / "comparison.md").read_text()
    first, second = json.loads((out / "comparison.json").read_text())["repeats"]
    assert (first["equal"], first["differing"], second["equal"]) == (4, [], 3)
    assert not compare(CompareConfig((suite_run,), suite=str(small_suite)))["repeats"]


def test_the_chassis_may_touch_a_rock_that_is_no_obstacle(edited, small_suite, capsys):
    """On uneven ground, one of less than 0.3 m, which the clearance does not count."""
    path = edited(lambda content: failed("collision", None, content["episodes"][0]["driver"], 1.7)(content))
    assert main(["--check", str(path), "--suite", str(small_suite)]) == 0
    assert "all 4 episodes of small-v1, dev, by " in capsys.readouterr().out


def test_failures_are_counted_by_method_end_and_cause(edited, small_suite, capsys):
    def fail(content):
        failed = [episode for episode in content["episodes"] if not episode["success"]]
        driver = failed[0]["driver"]
        for episode in content["episodes"]:
            if episode["driver"] == driver:
                episode["driver"] = "mine:Driver"  # of the built-in ones, only the navigator has causes
        content["weights"] = {"mine:Driver": "0" * 64}
        failed[0].update(outcome="collision", cause="missed obstacle", min_clearance=0.01)

    path = edited(fail)
    rows = compare(CompareConfig((path,), suite=str(small_suite)))["failures"]
    failures = sum(not episode["success"] for episode in json.loads(path.read_text())["episodes"])
    assert sum(row["failures"] for row in rows) == failures > 1
    assert [row["failures"] for row in rows if row["cause"] == "missed obstacle"] == [1]
    assert main([str(path), "--suite", str(small_suite)]) == 0
    page = capsys.readouterr().out
    assert "| method | outcome | cause | failures |" in page and "| missed obstacle | 1 |" in page
    assert "| unknown |" in page


def test_shards_of_one_evaluation_are_one_method(suite_run, edited, small_suite, capsys):
    def shard(number):
        def take(content):
            content["suite"]["shard"] = f"{number}/2"
            conditions = content["suite"]["conditions"]
            content["episodes"] = [e for e in content["episodes"] if e["condition"] == conditions[number - 1]]

        return take

    parts = [edited(shard(number), f"part{number}") for number in (1, 2)]
    assert main([str(parts[0]), "--check", "--suite", str(small_suite)]) == 0
    assert f"{parts[0]}: one of 2 parts, with 2 of 4 episodes of small-v1, dev, by " in capsys.readouterr().out
    whole, joined = (compare(CompareConfig(files, suite=str(small_suite))) for files in ((suite_run,), tuple(parts)))
    assert joined["rows"] == whole["rows"] and joined["dots"] == whole["dots"]

    files = (*parts, suite_run)  # which has all episodes of each method
    labels = {row["method"] for row in compare(CompareConfig(files, suite=str(small_suite)))["rows"]}
    names = ("2 parts", suite_run.name)
    assert labels == {f"{driver}, ground_truth ({name})" for driver in ("random", "straight") for name in names}
    for number, path in enumerate(parts):  # another network by the same name is another method
        content = json.loads(path.read_text())
        content["weights"] = {"ground_truth": str(number) * 64}
        path.write_text(json.dumps(content))
    with pytest.raises(ValueError, match="no episode in common"):
        compare(CompareConfig(tuple(parts), suite=str(small_suite)))


def test_a_part_of_other_code_joins_and_is_named(suite_run, edited, small_suite, capsys):
    def shard(number, code):
        def take(content):
            content["suite"]["shard"] = f"{number}/2"
            conditions = content["suite"]["conditions"]
            content["episodes"] = [
                {**e, "code": code} for e in content["episodes"] if e["condition"] == conditions[number - 1]
            ]

        return take

    parts = [str(edited(shard(number, code), code)) for number, code in ((1, "aa"), (2, "bb"))]
    assert main([*parts, "--suite", str(small_suite)]) == 0
    page = capsys.readouterr().out
    assert (
        "\n- Compared on 4 episodes that all methods have driven; others left out: 0.\n"
        "- straight, ground_truth: driven by different states of the code (2 episodes by aa, 2 episodes by bb).\n"
    ) in page
    assert main([parts[0], str(suite_run), "--suite", str(small_suite)]) == 0
    page = capsys.readouterr().out
    assert "others left out: 2 (straight, ground_truth (aa) lacks 2, random, ground_truth (aa) lacks 2)." in page


def test_a_file_that_is_given_twice_is_refused(suite_run, small_suite, capsys):
    for other in (suite_run, suite_run / "results.json"):
        assert main([str(suite_run), str(other), "--suite", str(small_suite)]) == 2
        assert f"{other} is given twice" in capsys.readouterr().err


@pytest.mark.parametrize(
    "flags", [["--out", "comparison"], ["--track", "eyes"], ["--condition", "clear"], ["--reference", "a, b"]]
)
def test_a_check_takes_no_flags_of_a_comparison(suite_run, small_suite, capsys, flags):
    assert main([str(suite_run), "--suite", str(small_suite), "--check", *flags]) == 2
    assert f"error: {flags[0]} is for a comparison" in capsys.readouterr().err


@pytest.mark.skipif(lock.fcntl is None, reason="this system has no flock")
def test_a_second_command_in_the_folder_is_refused(suite_run, small_suite, tmp_path, capsys):
    arguments = [str(suite_run), "--suite", str(small_suite), "--out", str(tmp_path / "out")]
    with lock.sole_writer(tmp_path / "out"):
        assert main(arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"error: {tmp_path / 'out'}: another command (process ") and error.count("\n") == 1
    assert main(arguments) == 0 and not (tmp_path / "out" / ".lock").exists()


def test_files_of_two_splits_are_refused(monkeypatch):
    def read(path, suite):
        return SuiteResults(path, "small-v1", path.stem, {("straight", "ground_truth"): {}}, 4)

    monkeypatch.setattr(envs.compare, "read_results", read)
    with pytest.raises(DatasetError, match=r"is of small-v1, test, and dev of small-v1, dev"):
        compare(CompareConfig((Path("dev"), Path("test"))))


def test_a_rover_that_slides_may_make_more_way_than_its_wheels():
    suite = SimpleNamespace(drive={"dynamics": "kinematic", "slip": "scene"}, conditions={"clear": {}})
    episode = {"steps": 10, "outcome": "no_path", "path_length": 5.0, "condition": "clear"}  # 0.4 m a step without slip
    assert _fault_of_steps(episode, suite) is None


@pytest.mark.parametrize("looks", [10, 11, 15, 16])
def test_looks_that_come_once_in_a_while_follow_from_the_way_and_the_steps(looks):
    """47 m in 121 steps with a look every 4 m: 11 or 12 on the way, and up to 3 where the rover stood."""
    suite = SimpleNamespace(drive={"dynamics": "kinematic", "slip": None}, conditions={"rare": {"look_every": 4.0}})
    episode = {"steps": 121, "path_length": 47.0, "condition": "rare", "looks": looks}
    fault = _fault_of_looks(episode, suite)
    if 11 <= looks <= 15:
        assert fault is None
    else:
        assert fault == f"looks must lie within 11 and 15 for 121 steps, 47 m and a look every 4 m, got {looks}"


def test_a_method_that_saw_nothing_has_an_error():
    suite = SimpleNamespace(conditions={"clear": {}})
    episode = {"steps": 5, "path_length": 1.0, "condition": "clear", "looks": 6, "blind": 6}
    assert _fault_of_looks({**episode, "abs_rel": 4.0}, suite) is None
    assert "abs_rel must be above 0 where all looks are blind" in str(_fault_of_looks({**episode, "abs_rel": 0}, suite))
