import pytest

from envs.comparison.conduct import conduct_of, conduct_table
from envs.comparison.methods import DrivenMethod
from envs.drives.episodes import NEAR_MISS

GOAL = {
    "outcome": "goal", "success": True, "steps": 50, "looks": 51, "perception_seconds": 0.2, "min_clearance": 0.5,
    "path_length": 24.0, "shortest": 20.0,
}  # fmt: skip
CRASH = {**GOAL, "outcome": "collision", "success": False, "steps": 10, "looks": 11, "path_length": 4.0}


def driven(*drives):
    return DrivenMethod("navigator", "eyes", {("clear", course): drive for course, drive in enumerate(drives)})


def test_a_row_has_means_and_counts_over_the_compared_drives():
    detour = {**GOAL, "path_length": 32.0, "steps": 90, "looks": 91, "min_clearance": NEAR_MISS - 0.01}
    near = {**CRASH, "min_clearance": 0.0, "perception_seconds": 0.8}
    part = {label: driven(GOAL, detour, near, *more) for label, more in (("ours", ()), ("theirs", (GOAL,)))}
    ours, theirs = conduct_of(part)
    assert {**theirs, "method": "ours"} == ours  # the fourth drive of theirs is not compared
    assert (ours["episodes"], ours["steps"], ours["looks"]) == (3, 50, 51)
    assert ours["perception_seconds"] == pytest.approx((50 * 0.2 + 90 * 0.2 + 10 * 0.8) / 150)
    assert (ours["near_misses"], ours["collisions"]) == (1, 1)  # the collision is no near miss
    assert ours["kilometres"] == pytest.approx(0.06) and ours["collisions_per_km"] == pytest.approx(1 / 0.06)
    low, high = ours["collisions_per_km_interval"]
    assert (0.06 * low, 0.06 * high) == pytest.approx((0.0253, 5.572), abs=1e-3)  # tables of Garwood's interval
    assert ours["path_inefficiency"] == pytest.approx((1.2 + 1.6) / 2)


def test_the_time_of_a_look_counts_looks_and_not_steps():
    """Of 40 steps, 10 brought a look: the mean over the steps is a quarter of the time of a look."""
    rare = {**GOAL, "steps": 40, "looks": 11, "perception_seconds": 0.05}
    assert conduct_of({"ours": driven(rare)})[0]["perception_seconds"] == pytest.approx(0.2)


def test_what_was_not_recorded_is_left_out():
    lacking = {key: value for key, value in CRASH.items() if key not in ("min_clearance", "looks")}
    (row,) = conduct_of({"a|b": driven(lacking)})
    assert row["looks"] is row["perception_seconds"] is row["near_misses"] is row["path_inefficiency"] is None
    assert "| a\\|b | 1 | 10 | - | - | - | 1 | 250.00 (6.33 to 1392.91) | - |" in conduct_table([row])
    (still,) = conduct_of({"ours": driven({**lacking, "outcome": "no_path", "path_length": 0.0})})
    assert still["collisions_per_km"] is still["collisions_per_km_interval"] is None
    assert "| ours | 1 | 10 | - | - | - | 0 | - | - |" in conduct_table([still])


def test_the_table_explains_its_columns():
    table = conduct_table(conduct_of({"ours": driven(GOAL, CRASH)}))
    first, _, row, *_ = table.splitlines()
    assert first.count("|") == row.count("|")
    assert row.startswith("| ours | 2 | 30 | 31 | 0.20 | 0 | 1 | 35.71 (0.90 to ")
    assert "A near miss is a drive that came nearer than 0.10 m to an obstacle without a collision." in table
