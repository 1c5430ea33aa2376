import json

import numpy as np
import pytest

from envs.suites.making import make_suite, suite_conditions
from envs.suites.suite import _same, build_course, build_sensor, course_values, load_suite
from marssim.base.files.json_file import DatasetError


@pytest.fixture(scope="module")
def suite(small_suite):
    return load_suite(str(small_suite))


def test_a_suite_names_every_episode(suite):
    assert suite.name == "small-v1" and set(suite.conditions) == {"clear", "rare_looks"}
    assert sorted(suite.episodes) == [
        *[("dev", condition, n) for condition in ("clear", "rare_looks") for n in (0, 1)],
        ("test", "clear", 0), ("test", "rare_looks", 0),
    ]  # fmt: skip
    seeds = {key[::2]: episode["seed"] for key, episode in suite.episodes.items()}
    assert len(set(seeds.values())) == 3  # the same under both conditions, and no split shares one
    episode = suite.episodes["dev", "clear", 0]
    assert np.hypot(*np.subtract(episode["goal"], episode["start"][:2])) == pytest.approx(3, abs=0.01)
    assert episode["shortest"] >= 2.99


def check(suite, number=0, condition="clear", seed_of=0, **changes):
    """Compare what the simulator builds from the seed of a dev course, under changed values, with an episode."""
    seed = suite.episodes["dev", condition, seed_of]["seed"]
    values = {**suite.conditions[condition], **changes}
    course, sensor = build_course(values, seed), build_sensor(values, seed)
    suite.check_episode("dev", condition, number, course, sensor)
    return course


def test_the_course_of_an_episode_is_that_of_the_suite(suite):
    course = check(suite, 1, seed_of=1)
    with pytest.raises(
        DatasetError,
        match=r"course 0 of dev, clear, is not .* .another start, goal, shortest, scene, look, sensor.",
    ):
        check(suite, 0, seed_of=1)
    assert course_values(course)["scene"] == suite.episodes["dev", "rare_looks", 1]["scene"]


def test_a_simulator_that_builds_another_scene_is_noticed(suite):
    with pytest.raises(DatasetError, match=r"^suite small-v1: .*another scene.*; drive it with release "):
        check(suite, k=0.05)


def test_a_simulator_that_draws_another_light_is_noticed(suite):
    with pytest.raises(DatasetError, match=r"builds \(another look\); drive it with release "):
        check(suite, optical_depth=2.0)


def test_a_simulator_that_draws_other_lenses_is_noticed(suite):
    with pytest.raises(DatasetError, match=r"builds \(another sensor\); drive it with release "):
        check(suite, lens_dust=0.1)


def test_a_suite_is_made_the_same_again(suite, small_suite):
    splits = {"dev": dict(suite.splits["dev"])}
    content = make_suite(suite.name, splits, {"clear": suite.conditions["clear"]}, suite.drive)
    written = json.loads(small_suite.read_text())["episodes"]
    assert content["episodes"] == [e for e in written if (e["split"], e["condition"]) == ("dev", "clear")]


def test_the_suite_of_the_package_is_that_of_its_conditions_and_builds_its_scenes():
    suite = load_suite("marsnav-v1")
    assert suite.conditions == suite_conditions() and {name: v["courses"] for name, v in suite.splits.items()} == {
        "dev": 20, "test": 20
    }  # fmt: skip
    for condition, course in (("storm", 0), ("ditch", 1), ("into_sun", 0)):
        seed = suite.episodes["dev", condition, course]["seed"]
        values = suite.conditions[condition]
        suite.check_episode("dev", condition, course, build_course(values, seed), build_sensor(values, seed))


def test_true_depth_has_the_pixels_of_the_eyes():
    conditions = suite_conditions()
    for name, values in conditions.items():
        assert values["ground_truth_pixels"] == values.get("image_pixels", 512), name
    assert conditions["half_pixels"]["image_pixels"] == 256 and len(conditions) >= 12


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.pop("drive"), "the file has no drive"), (lambda c: c.update(more=1), "more is unknown"),
        (lambda c: c.update(format=2), "format must be one of 1, got 2"),
        (lambda c: c.update(suite="../mine"), "suite must be a name of letters, digits, _, . and -, got '../mine'"),
        (lambda c: c["drive"].update(renderer="gl"), "drive.renderer must be one of embree, scan, pybullet, got 'gl'"),
        (lambda c: c["conditions"]["clear"].update(dust=1), "conditions, clear: condition: value 'dust' is unknown"),
        (lambda c: c["conditions"]["clear"].update(scene=3), "conditions, clear: scene must be a preset or .*, got 3"),
        (lambda c: c["conditions"]["clear"].update(scene=["a"]), "conditions, clear: scene must be a preset or .*'a'"),
        (lambda c: c["conditions"]["clear"].update(scene="nowhere"), "conditions, clear: scene nowhere: no preset"),
        (lambda c: c["conditions"]["clear"].update(k="x"), "conditions, clear: k must lie in .*, got 'x'"),
        (lambda c: c["conditions"]["clear"].update(optical_depth="x"), "optical_depth must be a number, got 'x'"),
        (lambda c: c["conditions"]["clear"].update(optical_depth=None), "optical_depth must be a number, got None"),
        (lambda c: c["conditions"]["clear"].update(drifts=[1]), r"clear: drifts must be a number, got \[1\]"),
        (lambda c: c["episodes"].append(c["episodes"][0]), "course 0 of dev, clear, appears twice"),
        (lambda c: c["conditions"].update({"/../x": {}}), "conditions: a key must be a name of .*, got '/../x'"),
        (lambda c: c["conditions"].update(clear="storm"), "conditions.clear must be of type object, got 'storm'"),
        (lambda c: c.update(conditions={}, episodes=[]), "conditions must not be empty"),
        (lambda c: c.update(splits={}, episodes=[]), "splits must not be empty"),
        (lambda c: c["conditions"].update(all={}), "conditions: all is the name of all of them together"),
        (lambda c: c.update(conditions=3), "conditions must be of type object, got 3"),
        (lambda c: c["episodes"].pop(), "course 0 of test, rare_looks, is missing"),
        (lambda c: c["episodes"][3].update(course=9), r"episodes\[3\].course must be below \d, .* of dev, got 9"),
        (lambda c: c["episodes"][3].pop("seed"), r"episodes\[3\] has no seed"),
        (lambda c: c["episodes"][0].update(seed=7), r"episodes\[0\].seed must be \d+, as follows from .* dev, got 7"),
        (lambda c: c["episodes"][1].update(split="a"), r"episodes\[1\] is of a, rare_looks, which the file does not"),
        (lambda c: c["episodes"][2]["look"].pop("texture_seed"), r"episodes\[2\].look has no texture_seed"),
        (lambda c: c["episodes"][1]["sensor"].pop("seed"), r"episodes\[1\].sensor has no seed"),
        (lambda c: c["episodes"][3].update(course=[1]), r"episodes\[3\].course must be of type integer"),
        (lambda c: c["episodes"][3].update(goal=[1]), r"episodes\[3\].goal must have 2 items, got 1"),
        (lambda c: c["splits"].update(dev=3), "splits.dev must be of type object, got 3"),
        (lambda c: c.update(suite={"name": c["suite"]}), "is a file of results, not of a suite"),
    ],
)  # fmt: skip
def test_a_file_that_is_no_suite_is_refused_by_name(small_suite, tmp_path, change, message):
    content = json.loads(small_suite.read_text())
    change(content)
    file = tmp_path / "bad.json"
    file.write_text(json.dumps(content))
    with pytest.raises(DatasetError, match=f"^suite {file}.*{message}"):
        load_suite(str(file))


def test_an_unknown_suite_is_refused(tmp_path):
    with pytest.raises(DatasetError, match=r"^`suite` 'marsnav-v9' is unknown; the package has "):
        load_suite("marsnav-v9")
    with pytest.raises(DatasetError, match="no such file"):
        load_suite(str(tmp_path / "none.json"))


@pytest.mark.parametrize(
    ("name", "off", "same"),
    [
        ("start", 1e-3, True),
        ("start", 5e-3, False),
        ("goal", -5e-3, False),
        ("shortest", 0.01, True),
        ("shortest", -0.03, False),
    ],
)
def test_places_may_differ_by_two_millimetres_and_ways_by_two_centimetres(name, off, same):
    built = {"start": [1.0, 2.0, 0.5], "goal": [4.0, 2.0], "shortest": 3.0}
    episode = {**built, name: (np.array(built[name]) + off).tolist()}
    assert _same(name, built, episode) is same
