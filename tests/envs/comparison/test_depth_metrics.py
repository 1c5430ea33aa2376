import numpy as np
import pytest
from scipy.stats import pearsonr, spearmanr
from scipy.stats import t as student

from envs.comparison.depth_metrics import (
    METRICS,
    _pearson,
    condition_dots,
    correlate,
    correlation,
    correlation_table,
    depth_table,
    dots_without_each_course,
    one_sided,
    only_with_intervals,
    ranks_within,
)
from envs.comparison.methods import DrivenMethod
from envs.comparison.plots import plot_depth_metrics

CONDITIONS = ("clear", "dust", "storm", "rocks")


def method(perception, spls, errors, missed=None, driver="navigator", courses=(0, 1)):
    """Courses under each condition, with the same SPL and depth error on all of them."""
    episodes = {
        (condition, course): {
            "success": weighted > 0, "spl": weighted, "abs_rel": error, "looks": 10,
            "rocks": None if missed is None else 4, "rocks_missed": None if missed is None else missed[n],
            "false_obstacles": None, "near_ground": 1000, "near_ground_as_sky": 0,
        }
        for n, (condition, weighted, error) in enumerate(zip(CONDITIONS, spls, errors, strict=True))
        for course in courses
    }  # fmt: skip
    return DrivenMethod(driver, perception, episodes)


TRUTH = method("ground_truth", (1.0, 1.0, 1.0, 0.5), (None,) * 4)
EYES = method("eyes", (1.0, 0.8, 0.6, 0.45), (0.01, 0.1, 0.2, 0.02), (0, 1, 2, 3))


def test_a_dot_has_the_errors_of_its_drives_and_what_they_lose_to_true_depth():
    dots = {(dot["condition"], dot["method"]): dot for dot in condition_dots({"truth": TRUTH, "eyes": EYES})}
    assert len(dots) == 8
    storm = dots["storm", "eyes"]
    assert storm["episodes"] == 2 and storm["spl"] == pytest.approx(0.6) and storm["abs_rel"] == pytest.approx(0.2)
    assert storm["rocks_missed"] == 0.5 and storm["false_obstacles"] is None
    assert storm["spl_less_truth"] == pytest.approx(-0.4) and storm["success_rate_less_truth"] == 0
    assert dots["storm", "truth"]["abs_rel"] is None and dots["storm", "truth"]["spl_less_truth"] == 0
    (alone,) = {dot["spl_less_truth"] for dot in condition_dots({"eyes": EYES})}
    assert alone is None


def test_the_table_of_the_depth_has_a_row_for_each_dot_with_errors():
    worse = method("worse", (1.0, 0.8, 0.6, 0.45), (0.01, 0.1, None, 0.02))
    for course in (0, 1):
        worse.episodes["clear", course]["abs_rel"] = 0.03 + 0.6 * course
        del worse.episodes["storm", course]["near_ground"]
    lines = depth_table(condition_dots({"truth": TRUTH, "worse": worse, "eyes": EYES})).splitlines()
    cells = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines]
    assert cells[0][:5] == ["condition", "method", "drives", "Abs Rel on the way, mean", "median"]
    assert ["clear", "worse", "2", "0.33", "0.33", "-", "-", "0"] in cells
    assert ["rocks", "eyes", "2", "0.02", "0.02", "0.75", "-", "0"] in cells
    assert not any(row[:2] == ["storm", "worse"] for row in cells)
    assert depth_table([]) == ""


def test_errors_are_counted_over_all_drives_of_a_dot_so_that_each_rock_weighs_the_same():
    drives = {
        ("clear", course): {
            "success": True, "spl": 1.0, "rocks": among, "rocks_missed": 1 - course, "looks": among,
            "false_obstacles": 1 - course, "near_ground": among, "near_ground_as_sky": 1 - course,
        }
        for course, among in enumerate((1, 9))
    }  # fmt: skip
    (dot,) = condition_dots({"eyes": DrivenMethod("navigator", "eyes", drives)})
    assert dot["rocks_missed"] == dot["false_obstacles"] == dot["near_ground_as_sky"] == 0.1


def test_true_depth_of_another_driver_is_no_reference():
    other = DrivenMethod("straight", "ground_truth", TRUTH.episodes)
    assert {
        dot["spl_less_truth"] for dot in condition_dots({"other": other, "eyes": EYES}) if dot["method"] == "eyes"
    } == {None}


def test_correlations_leave_out_what_was_not_measured_and_what_does_not_vary():
    rows = {(row["score"], row["metric"]): row for row in correlate(condition_dots({"truth": TRUTH, "eyes": EYES}))}
    assert set(rows) == {
        (f"spl{less}", metric) for less in ("", "_less_truth") for metric in ("abs_rel", "rocks_missed")
    }
    less = rows["spl_less_truth", "abs_rel"]  # the hard ground of "rocks" is taken out: the order is that of the errors
    assert less["dots"] == 4 and less["spearman"] == pytest.approx(-1)
    assert less["pearson"] == pytest.approx(pearsonr(np.log([0.01, 0.1, 0.2, 0.02]), [0, -0.2, -0.4, -0.05])[0])
    plain = rows["spl", "abs_rel"]
    assert plain["spearman"] == pytest.approx(spearmanr([0.01, 0.1, 0.2, 0.02], [1.0, 0.8, 0.6, 0.45])[0])
    assert plain["spearman_interval"] is None  # of two courses
    table = correlation_table(list(rows.values()))
    (row,) = [line for line in table.splitlines() if "| SPL less true depth | Abs Rel on the way | 4 | -1.00 |" in line]
    assert row.endswith(" by the logarithm |") and table.count("by the logarithm |") == 2
    assert correlate(condition_dots({"truth": TRUTH})) == []
    assert correlation_table([]).startswith("No correlation of scores with the depth: it takes 3 ")


def test_a_metric_in_which_two_dots_differ_from_the_rest_has_no_correlation():
    for others, rows in ((2, 0), (3, 1)):
        dots = [
            {
                "condition": str(n), "method": "eyes", "success_rate": 1.0, "spl": 0.1 * n,
                "success_rate_less_truth": None, "spl_less_truth": None, "abs_rel": None, "rocks_missed": None,
                "false_obstacles": None, "near_ground_as_sky": 1e-6 * n if n < others else 1e-3,
            }
            for n in range(8)
        ]  # fmt: skip
        assert len(correlate(dots)) == rows


def test_a_single_odd_score_has_no_correlation():
    dots = [
        {
            "condition": str(n), "method": "eyes", "success_rate": 0.5 if n == 13 else 1.0, "spl": 0.9 - 0.01 * n,
            "success_rate_less_truth": None, "spl_less_truth": None, "abs_rel": 0.01 + 0.01 * n, "rocks_missed": None,
            "false_obstacles": None, "near_ground_as_sky": None,
        }
        for n in range(14)
    ]  # fmt: skip
    (row,) = correlate(dots)
    assert row["score"] == "spl" and row["spearman"] == pytest.approx(-1)


def scattered(courses, conditions=8):
    """Two methods whose errors differ from condition to condition, and SPL from course to course too."""
    rng = np.random.default_rng(5)
    methods = {}
    for name, worse in (("good", 0.0), ("bad", 0.3)):
        errors = worse + rng.uniform(0.02, 0.4, conditions)
        methods[name] = DrivenMethod(
            "navigator", name, {
                (str(n), course): {
                    "success": True, "spl": float(np.clip(1 - error + rng.normal(0, 0.1), 0, 1)), "abs_rel": error,
                    "looks": 10, "false_obstacles": int(rng.poisson(20 * error)),
                }
                for n, error in enumerate(errors) for course in range(courses)
            },
        )  # fmt: skip
    return methods


def test_intervals_are_those_of_the_jackknife_over_courses_and_conditions():
    methods = scattered(5)
    row = next(r for r in correlate(condition_dots(methods), dots_without_each_course(methods)) if r["score"] == "spl")
    assert row["metric"] == "abs_rel"

    def z(keep):
        kept = {
            name: DrivenMethod(m.driver, m.perception, {key: e for key, e in m.episodes.items() if keep(key)})
            for name, m in methods.items()
        }
        dots = condition_dots(kept)
        return np.arctanh(spearmanr([dot["abs_rel"] for dot in dots], [dot["spl"] for dot in dots])[0])

    of_courses = [z(lambda key, left=left: key[1] != left) for left in range(5)]
    of_conditions = [z(lambda key, left=left: key[0] != str(left)) for left in range(8)]
    variance = 4 * np.var(of_courses) + 7 * np.var(of_conditions)
    ends = np.tanh(np.arctanh(row["spearman"]) + np.array([-1, 1]) * student.ppf(0.975, 4) * np.sqrt(variance))
    assert row["spearman_interval"] == pytest.approx(ends)
    assert -1 < ends[0] < row["spearman"] < ends[1] < 1
    (other,) = [r for r in correlate(condition_dots(methods), dots_without_each_course(methods)) if r["weaker"]]
    low, high = other["weaker_interval"]
    assert low < other["weaker"] < high and high - other["weaker"] == pytest.approx(other["weaker"] - low)


@pytest.mark.parametrize(("courses", "conditions"), [(3, 8), (8, 3)])
def test_three_courses_or_conditions_are_too_few_for_an_interval(courses, conditions):
    methods = scattered(courses, conditions)
    rows = correlate(condition_dots(methods), dots_without_each_course(methods))
    assert rows and all(row["spearman_interval"] is row["pearson_interval"] is None for row in rows)
    assert f"| SPL | Abs Rel on the way | {2 * conditions} | {rows[0]['spearman']:+.2f} |" in correlation_table(rows)


def test_no_correlation_is_given_without_an_interval(tmp_path, drawn_figures):
    few, enough = (
        only_with_intervals(correlate(condition_dots(methods), dots_without_each_course(methods)))
        for methods in (scattered(2), scattered(5))
    )
    assert few and all(row[kind] is None for row in few for kind in ("spearman", "within", "pearson", "weaker"))
    table = correlation_table(few)
    assert "| SPL | Abs Rel on the way | 16 | - | - | - | - |\n" in table and "+1.00" not in table
    assert "\nNo correlation is given where it would have no interval (-). An interval takes 4 courses and 4 " in table
    assert all(row["spearman"] is not None for row in enough)
    assert "no interval (-)" not in correlation_table(enough)
    plot_depth_metrics(tmp_path / "plot.png", condition_dots(scattered(2)), few)
    titles = {axes.get_title() for axes in drawn_figures[0].axes}
    assert titles == {"no correlation: it would have no interval", "no correlation: fewer than 3 dots that differ"}


def test_the_strongest_metric_is_one_with_an_interval():
    """Errors that have exactly the order of SPL correlate by -1, of which no interval can be given."""
    methods = scattered(5)
    for method in methods.values():
        spls = {key: episode["spl"] for key, episode in method.episodes.items()}
        for (condition, course), episode in method.episodes.items():
            mean = np.mean([spl for (other, _), spl in spls.items() if other == condition])
            episode.update(spl=mean, abs_rel=2 - mean, false_obstacles=round(100 * (1 - mean)) + course * 7 % 5)
            episode["looks"] = 10 + int(condition) % 3
    rows = only_with_intervals(correlate(condition_dots(methods), dots_without_each_course(methods)))
    of_spl = {row["metric"]: row for row in rows if row["score"] == "spl"}
    assert of_spl["abs_rel"]["spearman"] is None
    assert of_spl["false_obstacles"]["spearman"] < -0.5 and of_spl["false_obstacles"]["weaker"] is None


def test_a_metric_that_varies_within_one_method_alone_is_left_out(tmp_path, drawn_figures):
    dots = condition_dots(scattered(5))
    for dot in dots:
        dot["near_ground_as_sky"] = 0.01 * (1 + int(dot["condition"])) if dot["method"] == "good" else 0.0
    assert one_sided(dots) == {"near_ground_as_sky": "good"}
    rows = correlate(dots)
    assert rows and "near_ground_as_sky" not in {row["metric"] for row in rows}
    table = correlation_table(rows, one_sided(dots))
    assert (
        "\nNo correlation with the share of the ground within 8 m taken for sky: within all methods but good, it is the"
        " same under all conditions, so it would only tell this method from the others.\n"
    ) in table
    plot_depth_metrics(tmp_path / "plot.png", dots, rows)
    assert "sky" not in "".join(axes.get_xlabel() for axes in drawn_figures[0].axes)
    bad = next(dot for dot in dots if dot["method"] == "bad")
    bad["near_ground_as_sky"] = 0.3
    assert not one_sided(dots) and "near_ground_as_sky" in {row["metric"] for row in correlate(dots)}


def test_a_metric_of_one_method_or_of_one_condition_is_not_left_out():
    dots = condition_dots(scattered(5))
    assert not one_sided([dot for dot in dots if dot["method"] == "good"])
    assert not one_sided([dot for dot in dots if dot["condition"] == "0"])


def test_an_interval_needs_a_correlation_without_each_condition():
    """Four methods that differ under one condition alone."""
    methods = {
        name: method(name, (0.9 - 0.1 * n, 0.9, 0.9, 0.9), (0.01 * (1 + n),) * 4, courses=range(4))
        for n, name in enumerate("abcd")
    }
    (row,) = correlate(condition_dots(methods), dots_without_each_course(methods))
    assert np.isfinite(row["spearman"]) and row["spearman_interval"] is None and row["pearson_interval"] is None


def test_values_that_differ_by_rounding_alone_are_equal():
    """As with one drive of twenty lost under each condition."""
    dots = [
        {
            "condition": str(n), "method": "eyes", "success_rate": n / 20, "spl": 0.5,
            "success_rate_less_truth": n / 20 - (n + 1) / 20, "spl_less_truth": None,
            "abs_rel": 0.01 * n, "rocks_missed": None, "false_obstacles": None, "near_ground_as_sky": None,
        }
        for n in range(12, 19)
    ]  # fmt: skip
    assert len({dot["success_rate_less_truth"] for dot in dots}) > 1
    (row,) = correlate(dots)
    assert row["score"] == "success_rate" and row["spearman"] == pytest.approx(1)
    dots[0]["success_rate_less_truth"] = -0.2  # against six equal ones
    assert [row["score"] for row in correlate(dots)] == ["success_rate"]
    dots[1]["success_rate_less_truth"] = dots[2]["success_rate_less_truth"] = -0.1
    spearman = {row["score"]: row["spearman"] for row in correlate(dots)}["success_rate_less_truth"]
    assert spearman == pytest.approx(spearmanr(range(7), [0, 1, 1, 2, 2, 2, 2])[0])


def test_pearsons_correlation_is_with_the_metric_itself_where_a_dot_has_no_error():
    (row,) = correlate(condition_dots({"eyes": method("eyes", (1.0, 0.8, 0.6, 0.45), (0.0, 0.1, 0.2, 0.02))}))
    assert row["metric"] == "abs_rel" and not row["logarithmic"]
    assert row["pearson"] == pytest.approx(pearsonr([0.0, 0.1, 0.2, 0.02], [1.0, 0.8, 0.6, 0.45])[0])
    assert "by the logarithm |" not in correlation_table([row])


def test_without_a_course_a_dot_without_error_has_no_logarithm(recwarn):
    errors = (0.0, 0.1, 0.2, 0.02)
    dots = condition_dots({"eyes": method("eyes", (1.0, 0.8, 0.6, 0.45), errors)})
    assert np.isnan(_pearson("abs_rel", "success_rate", True, dots)) and not recwarn.list


def test_dots_of_one_condition_have_correlations_without_intervals():
    """Without it, no dot is left."""
    errors, successes = (0.3, 0.1, 0.2, 0.02), (0.2, 0.8, 0.6, 0.9)
    methods = {name: method(name, (s,) * 4, (e,) * 4) for name, s, e in zip("abcd", successes, errors)}
    dots = [dot for dot in condition_dots(methods) if dot["condition"] == CONDITIONS[0]]
    rows = [row for row in correlate(dots) if row["metric"] == "abs_rel" and row["score"] == "spl"]
    assert len(dots) == 4 and len(rows) == 1
    for row in rows:
        assert row["logarithmic"] and row["spearman"] == pytest.approx(-1.0)
        assert row["pearson"] == pytest.approx(pearsonr(np.log(errors), successes)[0])
        assert row["spearman_interval"] is None and row["pearson_interval"] is None


def test_a_single_value_has_no_correlation():
    y = np.random.default_rng(3).normal(size=12)
    assert np.isnan(correlation(np.ones(12), y)) and np.isnan(correlation(y, np.ones(12)))
    assert np.isnan(correlation(np.zeros(0), np.zeros(0)))
    assert correlation(1e-8 * np.arange(12), y) == pytest.approx(pearsonr(np.arange(12), y)[0])


def test_within_methods_a_method_that_is_worse_throughout_does_not_count():
    """Two methods: the worse one has the larger errors, and within each, larger errors go with better drives."""
    dots = [
        {
            "condition": str(n), "method": name, "success_rate": 1.0, "spl": spl + 0.02 * n,
            "success_rate_less_truth": None, "spl_less_truth": None, "abs_rel": error + 0.001 * n,
            "rocks_missed": error + 0.03 * (n == 2), "false_obstacles": None, "near_ground_as_sky": None,
        }
        for n in range(6) for name, spl, error in (("good", 0.8, 0.01), ("bad", 0.2, 0.05))
    ]  # fmt: skip
    rows = {row["metric"]: row for row in correlate(dots)}
    of_error, of_rocks = rows["abs_rel"], rows["rocks_missed"]
    assert of_error["spearman"] < -0.4 and of_error["within"] == pytest.approx(1)
    strongest, other = sorted((of_error, of_rocks), key=lambda row: -abs(row["spearman"]))
    assert (strongest["weaker"], strongest["weaker_interval"]) == (None, None)
    assert other["weaker"] == pytest.approx(abs(strongest["spearman"]) - abs(other["spearman"]))
    alone = correlate([dot for dot in dots if dot["method"] == "good"])
    assert all(row["within"] == pytest.approx(row["spearman"]) for row in alone)
    for dot in dots:  # a third method, with one error throughout, has no part in it
        dot["near_ground_as_sky"] = dot["abs_rel"]
    constant = [{**dot, "method": "same", "near_ground_as_sky": 0.0} for dot in dots if dot["method"] == "good"]
    rows = {row["metric"]: row for row in correlate([*dots, *constant])}
    assert rows["near_ground_as_sky"]["within"] == pytest.approx(1)


def test_within_methods_a_method_with_more_dots_does_not_have_the_larger_ranks():
    x, y = np.array([0, 1, 2, *range(10, 18)], float), np.array([0, 1, 2, 1, 0, 3, 2, 5, 4, 7, 6], float)
    centred = [-1, 0, 1, *np.arange(8) - 3.5], [-1, 0, 1, -2.5, -3.5, -0.5, -1.5, 1.5, 0.5, 3.5, 2.5]
    within = correlation(*ranks_within(x, y, ["few"] * 3 + ["many"] * 8))
    assert within == pytest.approx(pearsonr(*centred)[0])


def test_metrics_of_different_dots_are_not_compared():
    """As where one laboratory recorded the one and another the other."""
    dots = [
        {
            "condition": str(n), "method": name, "success_rate": 1.0, "spl": 0.9 - 0.1 * n,
            "success_rate_less_truth": None, "spl_less_truth": None, "abs_rel": 0.01 * (1 + n) if mine else None,
            "rocks_missed": None if mine else 0.1 + 0.01 * n * n, "false_obstacles": None, "near_ground_as_sky": None,
        }
        for n in range(5) for name, mine in (("mine", True), ("theirs", False))
    ]  # fmt: skip
    rows = correlate(dots)
    assert [row["metric"] for row in rows] == ["abs_rel", "rocks_missed"]
    assert all(row["weaker"] is row["weaker_interval"] is None for row in rows)


def test_the_plot_takes_metrics_that_only_some_methods_have(tmp_path, drawn_figures):
    dots = condition_dots({"truth": TRUTH, "eyes": EYES, "more": method("more", (1, 1, 0, 1), (0.0, 0.2, 0.3, 0.1))})
    plot_depth_metrics(tmp_path / "plot.png", dots, correlate(dots))
    panels = {(ax.get_subplotspec().rowspan.start, ax.get_xlabel()): ax for ax in drawn_figures[0].axes}
    spl = panels[1, METRICS["abs_rel"].words]
    lines = {line.get_label(): sorted(zip(*line.get_data())) for line in spl.lines}
    assert np.allclose(lines["eyes"], [(0.01, 1.0), (0.02, 0.45), (0.1, 0.8), (0.2, 0.6)])
    assert set(lines) == {"eyes", "more"}  # the true depth has no error
    missed = panels[1, METRICS["rocks_missed"].words]
    assert [line.get_label() for line in missed.lines] == ["eyes"]
    assert {label for _, label in panels if label} == {METRICS[name].words for name in ("abs_rel", "rocks_missed")}


def test_labels_have_the_colour_of_their_dots_and_cover_nothing(tmp_path, drawn_figures):
    dots = condition_dots({"truth": TRUTH, "eyes": EYES, "more": method("more", (1, 1, 0, 1), (0.0, 0.2, 0.3, 0.1))})
    plot_depth_metrics(tmp_path / "plot.png", dots, correlate(dots))
    axes = next(ax for ax in drawn_figures[0].axes if ax.get_subplotspec().rowspan.start == 1)
    assert {text.get_text() for text in axes.texts} == set(CONDITIONS)
    colours = {line.get_label(): line.get_color() for line in axes.lines}
    assert {text.get_color() for text in axes.texts} == set(colours.values())
    boxes = [text.get_window_extent() for text in axes.texts]
    assert not any(one.overlaps(other) for n, one in enumerate(boxes) for other in boxes[:n])
    places = axes.transData.transform([xy for line in axes.lines for xy in zip(*line.get_data())])
    assert not any(box.contains(*place) for box in boxes for place in places)
