import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest, chi2, multinomial, norm
from scipy.stats import t as student

from envs.drives.episodes import EpisodeRecord
from envs.drives.metrics import (
    best_and_worst,
    effective_drives,
    newcombe_interval,
    paired_difference,
    poisson_interval,
    soft_spl,
    spl,
    summarise,
    wilson_interval,
)
from m3depth.evaluation.bootstrap import interval, resampled_means


def record(outcome="goal", **changes):
    values = {
        "driver": "d", "perception": "p", "cell": "c", "episode": 0, "outcome": outcome, "steps": 10, "distance": 0.5,
        "start_distance": 10.0, "shortest": 10.0, "path_length": 12.5, "min_clearance": 1.0, "max_tilt_deg": 5.0,
        "reward": 1.0, "step_seconds": 0.1, "perception_seconds": 0.05, "redraws": 1, "goal": [0.0, 0.0],
        **changes,
    }  # fmt: skip
    return EpisodeRecord(**values)


def test_spl_is_the_share_of_the_optimum():
    assert spl(True, 10.0, 12.5) == pytest.approx(0.8)
    assert spl(True, 10.0, 9.5) == 1.0  # the goal's radius makes ways a little shorter than the optimum
    assert spl(False, 10.0, 10.0) == 0.0


def test_soft_spl_counts_how_far_it_came():
    assert soft_spl(10.0, 4.0, 10.0, 8.0) == pytest.approx(0.6)
    assert soft_spl(10.0, 4.0, 10.0, 20.0) == pytest.approx(0.6 * 0.5)
    assert soft_spl(10.0, 13.0, 10.0, 5.0) == 0.0  # it ended farther away than it began


@given(trials=st.integers(1, 400), share=st.floats(0, 1))
def test_wilson_interval_is_scipys(trials, share):
    successes = round(share * trials)
    expected = binomtest(successes, trials).proportion_ci(0.95, method="wilson")
    np.testing.assert_allclose(wilson_interval(successes, trials), expected, atol=1e-4)


def test_no_trials_are_refused():
    with pytest.raises(ValueError, match="trial"):
        wilson_interval(0, 0)
    with pytest.raises(ValueError, match="episode"):
        summarise([])


@pytest.mark.parametrize("count", [0, 1, 5, 40])
def test_the_interval_of_a_poisson_count_is_that_of_chi_squared(count):
    low, high = poisson_interval(count)
    assert low == pytest.approx(chi2.ppf(0.025, 2 * count) / 2 if count else 0.0)
    assert high == pytest.approx(chi2.ppf(0.975, 2 * count + 2) / 2)


@pytest.mark.parametrize(
    ("counts", "bounds"),
    [
        ((36, 12, 2, 0), (0.0569, 0.3404)),  # Newcombe 1998
        ((1, 1, 7, 12), (-0.507, -0.026)), ((59, 6, 16, 80), (-0.1186, -0.0046)),  # Fagerland, Lydersen, Laake 2017
    ],
)  # fmt: skip
def test_the_interval_of_paired_success_rates_is_the_published_one(counts, bounds):
    digits = max(len(str(value).partition(".")[2]) for value in bounds)
    assert [round(value, digits) for value in newcombe_interval(*counts, z=1.959964)] == list(bounds)
    both, first, second, neither = counts
    low, high = newcombe_interval(both, second, first, neither)  # of the other difference
    assert (-high, -low) == pytest.approx(bounds, abs=6e-4)


def test_without_courses_that_differ_the_interval_shrinks_with_their_number():
    for n in (1, 20, 2000):
        low, high = newcombe_interval(n, 0, 0, 0)
        assert high == pytest.approx(-low) == pytest.approx(1.96**2 / (n + 1.96**2))
    assert newcombe_interval(0, 0, 0, 20) == pytest.approx(newcombe_interval(20, 0, 0, 0))
    with pytest.raises(ValueError, match="trial"):
        newcombe_interval(0, 0, 0, 0)


@pytest.mark.parametrize("chances", [(0.8, 0.05, 0.1, 0.05), (0.7, 0.02, 0.18, 0.1), (0.9, 0.02, 0.05, 0.03)])
def test_with_twenty_courses_the_interval_covers_the_truth_and_the_bootstrap_does_not(chances):
    """Over all tables that are likely enough to count."""
    n, truth, newcombe, bootstrap = 20, chances[1] - chances[2], 0.0, 0.0
    of_gains = {}
    for first in range(10):
        for second in range(12):
            gains = np.array([1.0] * first + [-1.0] * second + [0.0] * n)[:n]
            of_gains[first, second] = interval(resampled_means(gains, draws=1000), gains.mean(), n)
            for neither in range(n + 1 - first - second):
                counts = (n - first - second - neither, first, second, neither)
                chance = multinomial.pmf(counts, n, chances)
                low, high = newcombe_interval(*counts)
                newcombe += chance * (low <= truth <= high)
                low, high = of_gains[first, second]
                bootstrap += chance * (low - 1e-9 <= truth <= high + 1e-9)
    assert newcombe > 0.93 > 0.91 > bootstrap


@given(st.integers(5, 40), st.integers(2, 6), st.integers(0, 99))
def test_drives_that_repeat_themselves_count_as_their_courses(courses, cells, seed):
    values = (np.random.default_rng(seed).random(courses) < 0.6).astype(float)
    number = [*range(courses)]
    assert effective_drives(np.tile(values, cells), number * cells) == courses
    assert effective_drives(values, number) == courses
    assert effective_drives(np.ones(courses * cells), number * cells) == courses  # nothing says that they differ


def test_drives_that_do_not_depend_on_their_course_count_nearly_all():
    """The variance over the courses, as of a sample of clusters, and t(29) for z."""
    values = (np.random.default_rng(2).random((8, 30)) < 0.5).astype(float)
    sums = values.sum(0) / 240
    variance = 30 * np.var(sums, ddof=1)
    expected = values.var() / variance / (student.ppf(0.975, 29) / norm.ppf(0.975)) ** 2
    assert 30 < expected < 240
    assert effective_drives(values.ravel(), [*range(30)] * 8) == pytest.approx(expected)
    against = np.tile([1.0, 0.0], 30)  # each course succeeds in one cell of two
    assert effective_drives(against, [n for n in range(30) for _ in "ab"]) == 30  # no variance over them to judge by


def test_summary_of_four_drives():
    drives = [
        record(), record(path_length=10.0, min_clearance=0.7),
        record("collision", distance=6.0, path_length=5.0, steps=30, min_clearance=0.4), record("tilt", distance=10.0),
    ]  # fmt: skip
    summary = summarise(drives)
    assert summary["episodes"] == 4
    assert summary["success_rate"] == 0.5 and summary["collision_rate"] == 0.25 and summary["tilt_rate"] == 0.25
    assert summary["spl"] == pytest.approx((0.8 + 1.0) / 4)
    assert summary["soft_spl"] == pytest.approx((0.95 * 0.8 + 0.95 + 0.4 + 0) / 4)
    assert summary["path_inefficiency"] == pytest.approx((1.25 + 1.0) / 2)
    assert summary["outcomes"] == {"collision": 1, "goal": 2, "tilt": 1}
    assert summary["min_clearance"] == 0.4 and summary["steps"] == 15 and summary["redraws"] == 4
    assert summary["step_seconds"] == pytest.approx(0.1) and summary["perception_seconds"] == pytest.approx(0.05)
    low, high = summary["success_interval"]
    assert low < 0.5 < high


def test_a_summary_has_the_largest_tilt_the_mean_slip_and_the_energy_that_was_measured():
    row = summarise([record(max_tilt_deg=3.0, slip=0.1, energy=20.0), record(max_tilt_deg=9.0, slip=0.3, energy=None)])
    assert (row["max_tilt_deg"], row["slip"], row["energy"]) == (9.0, pytest.approx(0.2), 20.0)


def test_the_best_arrived_by_the_shortest_way_and_the_worst_came_least_far():
    near, far = record("time", distance=2.0), record("collision", distance=9.0)
    long, short = record(path_length=20.0), record(path_length=11.0)
    assert best_and_worst([near, long, far, short]) == (3, 2)
    assert best_and_worst([long, short]) == (1, 0) and best_and_worst([long]) == (0, 0)


def test_no_drive_is_the_best_where_none_arrived():
    near, far = record("time", distance=2.0), record("collision", distance=9.0)
    assert best_and_worst([near, far]) == (None, 1) and best_and_worst([near]) == (None, 0)


def test_no_success_has_no_inefficiency():
    assert summarise([record("time")])["path_inefficiency"] is None


def test_the_paired_difference_is_of_the_same_episodes():
    first = [record("goal" if n < 8 else "collision", episode=n) for n in range(10)]
    second = [record("goal" if n < 5 else "time", episode=n) for n in reversed(range(10))]
    summary = paired_difference(first, second)
    assert summary["difference"] == pytest.approx(0.3) and summary["episodes"] == 10
    low, high = summary["interval"]
    assert [low, high] == list(newcombe_interval(5, 3, 0, 2)) and low < 0.3 < high
    same = paired_difference(first, first)
    assert (same["difference"], same["spl_interval"]) == (0.0, [0.0, 0.0])
    low, high = same["interval"]
    assert low == pytest.approx(-high) and high > 0.1  # that ten courses are alike does not say that all are
    with pytest.raises(ValueError, match="same episodes"):
        paired_difference(first, second[1:])


def test_detours_differ_in_spl_where_success_does_not():
    """Twice as long ways, all of them to the goal: SPL 0.8 and 0.4, or 0.4 and 0.8 on one course of ten."""
    first = [record(episode=n, path_length=25.0 if n == 0 else 12.5) for n in range(10)]
    second = [record(episode=n, path_length=12.5 if n == 0 else 25.0) for n in range(10)]
    summary = paired_difference(first, second)
    assert summary["difference"] == 0 and summary["courses"] == 10
    assert summary["spl_difference"] == pytest.approx(0.4 * 0.8)
    low, high = summary["spl_interval"]
    assert 0 < low < 0.32 < high < 0.45


def test_pairing_is_worth_something():
    """Hard and easy courses differ more than the two drivers do."""
    hard = [record("goal" if n % 2 else "collision", episode=n) for n in range(40)]
    other = [record("goal" if n % 2 or n == 0 else "collision", episode=n) for n in range(40)]
    low, high = paired_difference(other, hard)["interval"]
    assert high - low < 0.2 < np.diff(wilson_interval(20, 40))


def test_courses_of_one_seed_in_several_cells_count_as_one():
    """Drives that repeat themselves on every slope tell no more than those of fewer slopes."""
    first = [record("goal" if n % 3 else "collision", episode=n, cell=c) for n in range(30) for c in "abcd"]
    second = [record("goal" if n % 2 else "collision", episode=n, cell=c) for n in range(30) for c in "abcd"]
    four = paired_difference(first, second)
    two = paired_difference(*[[r for r in records if r.cell in "ab"] for records in (first, second)])
    assert (four["episodes"], two["episodes"], four["courses"], two["courses"]) == (120, 60, 30, 30)
    assert four["difference"] == pytest.approx(two["difference"]) and two["interval"][0] < two["interval"][1]
    np.testing.assert_allclose(four["interval"], two["interval"])
    one = paired_difference(*[[r for r in records if r.cell == "a"] for records in (first, second)])
    np.testing.assert_allclose(one["spl_interval"], two["spl_interval"])
    assert one["interval"] == list(newcombe_interval(10, 10, 5, 5))


def test_failures_are_classed_as_for_enav_and_near_misses_counted():
    records = [
        record(o) for o in ("goal", "no_path", "collision", "tilt", "out_of_bounds", "time", "stuck", "elsewhere")
    ]
    records.append(record("goal", near_miss=True, redraws=2, abs_rel=0.02))
    row = summarise(records)
    assert row["failures"] == {"no feasible path": 1, "safety limit": 3, "time": 2, "elsewhere": 1}
    assert row["near_miss_rate"] == 1 / 9 and row["abs_rel"] == 0.02 and row["unreachable_share"] == 10 / 19


def test_tilts_and_collisions_are_counted_apart():
    row = summarise([record("tilt"), record(), record("collision"), record("tilt")])
    assert (row["tilt_rate"], row["collision_rate"]) == (0.5, 0.25)
