"""Tables that are written by hand have the figures of the files beside them."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from envs.comparison.conduct import conduct_of, conduct_table
from envs.comparison.depth_metrics import (
    condition_dots,
    correlate,
    dots_without_each_course,
    one_sided,
    only_with_intervals,
)
from envs.comparison.methods import methods_of
from envs.comparison.suite_results import read_results
from envs.drives.episodes import is_near_miss
from envs.drives.metrics import paired_scores
from envs.suites.suite import load_suite
from m3depth.evaluation.bootstrap import interval, resampled_means

ROOT = Path(__file__).parents[2] / "docs/results"
REAL_PAIRS = ("perseverance", "perseverance_560", "curiosity")


def rows(page: str, heading: str) -> list[list[str]]:
    """The cells of the first table under a heading of a page, without its two head lines."""
    _, section = (ROOT / page).read_text().split(heading, 1)
    table = re.search(r"(?:^\|.*\n)+", section, re.MULTILINE)
    assert table is not None
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table[0].splitlines()[2:]]


def test_the_receptive_field_is_that_of_its_file() -> None:
    networks = json.loads((ROOT / "ablation/receptive_field.json").read_text())["networks"]
    table_rows = rows("ablation.md", "### The effective receptive field\n")
    assert [row[0] for row in table_rows] == [*networks["base-0"]]
    for part, *cells in table_rows:
        radii = [networks[name][part][f"radius_{share}_px"] for name in ("base-0", "no-wefe-0") for share in (50, 90)]
        assert cells == [f"{radius:.0f} px" for radius in radii]


def test_the_errors_of_the_refinement_steps_are_those_of_their_file() -> None:
    networks = json.loads((ROOT / "texture-and-steps/steps.json").read_text())["networks"]
    words = {"the first map, by soft argmin": "first map", "the correction at 1/2": "result"}
    table_rows = rows("texture-and-steps.md", "## Refinement steps\n")
    assert {row[0] for row in table_rows} == set(networks)
    for network, after, *cells in table_rows:
        of_step = networks[network][words.get(after) or after.split(",")[0]]
        errors = [of_step[kind] for kind in ("non-occluded", "occluded")]
        texts = "{:.3f} ({:.3f} to {:.3f})", "{:.2f} ({:.2f} to {:.2f})"
        assert cells == [text.format(e["epe_px"], *e["interval"]) for text, e in zip(texts, errors, strict=True)]


def test_the_drives_of_the_policy_are_those_of_their_files() -> None:
    table_rows = rows("policy.md", "the\nsame for all drivers.")
    results = {}
    for goal in (10, 20):
        for row in json.loads((ROOT / f"policy/goals-{goal}.json").read_text())["results"]:
            driver = "policy" if row["driver"].endswith(".zip") else row["driver"]
            results[f"{goal} m, {row['cell']['k']:.2f}".replace("0.", "."), driver] = row
    assert {(row[0], row[1]) for row in table_rows} == set(results) and len(table_rows) == 12
    for cell, driver, goals, spl, others, _ in table_rows:
        row = results[cell, driver]
        outcomes = {name: number for name, number in row["outcomes"].items() if name != "goal"}
        assert goals == f"{row['outcomes']['goal']} of {row['episodes']}"
        assert spl == f"{row['spl']:.2f}".lstrip("0")
        words = [f"{number} {name.replace('_', ' ')}" for name, number in outcomes.items()]
        assert sorted(others.split(", ")) == sorted(words or ["-"])


def test_the_scores_of_real_pairs_are_those_of_their_files() -> None:
    labels = {"**M3Depth**": "M3Depth", "M3Depth, weights of 0.1.0": "0.1.0"}
    table_rows = rows("depth.md", "## Real pairs\n")
    assert len(table_rows) == 4 * len(REAL_PAIRS)
    for number, (_, method, *cells) in enumerate(table_rows):
        of_pair = json.loads((ROOT / f"depth/real/{REAL_PAIRS[number // 4]}.json").read_text())["methods"]
        scores = of_pair[labels.get(method, method)]
        agree, common, sky, unknown = (
            f"{100 * scores[name]:.1f} %" for name in ("agreement", "common_agreement", "sky", "unknown")
        )
        assert cells == [agree, common, f"{scores['residual_ratio']:.3f}", sky, unknown]


def test_the_residuals_are_those_of_their_file() -> None:
    datasets = json.loads((ROOT / "depth/photometric_residual.json").read_text())["datasets"]
    table_rows = rows("depth.md", "## The photometric residual of the truth\n")
    assert [row[0] for row in table_rows] == [Path(row["data"]).name for row in datasets]
    for (_, *cells), row in zip(table_rows, datasets, strict=True):
        numbers = [(of_method["ratio"], *of_method["interval"]) for of_method in row["methods"].values()]
        assert cells == ["{:.3f} ({:.3f} to {:.3f})".format(*values) for values in numbers]


def test_the_drives_with_slip_are_those_of_their_files() -> None:
    table_rows = rows("slip.md", "## In drives\n")
    for (_, *cells), name in zip(table_rows, ("none", "measured", "unmeasured"), strict=True):
        of_slopes = json.loads((ROOT / f"slip/{name}.json").read_text())["results"]
        for cell, row, slope in zip(cells, of_slopes, (0, 10), strict=True):
            assert row["cell"] == {"k": 0.07, "slope_deg": slope}
            goals, *others = re.findall(r"(\d) (of 6|collision|elsewhere)", cell)
            outcomes = {"goal": int(goals[0])} | {outcome: int(count) for count, outcome in others}
            assert {name: number for name, number in outcomes.items() if number} == row["outcomes"]
            assert f"{row['spl']:.2f}".lstrip("0") in cell


@pytest.mark.parametrize(("courses", "share", "plain"), [(4, 0.91, 0.77), (8, 0.92, 0.88), (20, 0.95, 0.93)])
def test_intervals_hold_the_true_mean_as_often_as_the_page_says(courses: int, share: float, plain: float) -> None:
    """As docs/concepts/scoring-rules.md says of the differences of SPL on dev."""
    spl: dict[tuple[str, int], dict[str, float]] = {}
    for drive in json.loads((ROOT / "marsnav-v1/dev-ground_truth-sgbm.json").read_text())["episodes"]:
        spl.setdefault((drive["condition"], drive["course"]), {})[drive["perception"]] = drive["spl"]
    differences = np.array([of_course["sgbm"] - of_course["ground_truth"] for of_course in spl.values()])
    assert len(differences) == 56
    samples = np.random.default_rng(0).choice(differences, (courses, 400))
    means = resampled_means(samples, draws=1000)
    ends = [interval(of_sample, mean, courses) for of_sample, mean in zip(means.T, samples.mean(0), strict=True)]
    held = [low <= differences.mean() <= high for low, high in filter(None, ends)]
    assert len(held) == 400 and abs(np.mean(held) - share) < 3 * np.sqrt(share * (1 - share) / len(held))
    low, high = np.quantile(means, [0.025, 0.975], axis=0)
    held = (low <= differences.mean()) & (differences.mean() <= high)
    assert abs(np.mean(held) - plain) < 3 * np.sqrt(plain * (1 - plain) / len(held))


def held(sums: np.ndarray, share: float) -> bool:
    """Whether intervals of quotients of sums (scenes, 2), in samples of the scenes, hold that of all so often."""
    rng, quotient, scenes = np.random.default_rng(0), lambda total: total[..., 0] / total[..., 1], len(sums)
    found = []
    for picks in rng.integers(0, scenes, (200, scenes)):
        sample = sums[picks]
        resampled = quotient(sample[rng.integers(0, scenes, (500, scenes))].sum(axis=1))
        low, high = interval(resampled, quotient(sample.sum(axis=0)), scenes)
        found.append(low <= quotient(sums.sum(axis=0)) <= high)
    return abs(np.mean(found) - share) < 3 * np.sqrt(share * (1 - share) / len(found))


@pytest.mark.parametrize(
    ("method", "pairs", "share"),
    [("lite", "clean", 0.94), ("SGBM", "clean", 0.94), ("SGBM", "degraded", 0.89), ("SSD-SGM", "clean", 0.65)],
)
def test_intervals_of_mean_abs_rel_hold_as_often_as_the_page_says(method: str, pairs: str, share: float) -> None:
    """As docs/concepts/scoring-rules.md says of the methods compared: rarely where few scenes decide the mean."""
    sums: dict[tuple[str, str], np.ndarray] = {}
    record = json.loads((ROOT / f"methods/records/{method}.json").read_text())
    for place, part in record["sets"][pairs]["places"].items():
        for scene, error in zip(part["scenes"], part["figures"]["abs_rel"], strict=True):
            sums[place, scene] = sums.get((place, scene), np.zeros(2)) + np.array([error, 1])
    assert len(sums) == 102 and held(np.stack([*sums.values()]), share)


def test_intervals_of_changes_in_the_ablation_hold_as_often_as_the_page_says() -> None:
    """As the same page says: that of the geometric mean of the same two rows more often than that of the mean."""
    errors: dict[str, dict[str, list[float]]] = {}
    for row in ("base", "loss-1-2-3"):
        for pair in json.loads((ROOT / f"ablation/runs/{row}-0/score.json").read_text())["per_pair"]:
            errors.setdefault(pair["scene"], {}).setdefault(row, []).append(pair["M3Depth"]["abs_rel"])
    before, after = (
        np.array([np.sum(of_scene[row]) for of_scene in errors.values()]) for row in ("base", "loss-1-2-3")
    )
    logs = [np.log(np.divide(of_scene["loss-1-2-3"], of_scene["base"])) for of_scene in errors.values()]
    assert len(errors) == 24 and held(np.column_stack([after, before]), 0.70)
    assert held(np.array([[ratios.sum(), len(ratios)] for ratios in logs]), 0.89)


@pytest.mark.parametrize("method", ["m3depth", "sgbm", "sad-sgm"])
def test_success_over_conditions_with_the_same_courses_has_intervals_that_hold_it(method: str) -> None:
    """As docs/concepts/scoring-rules.md says of samples of the courses of these five conditions."""
    conditions = ("smooth_dust", "storm", "dusty_lens", "warm_rig", "compressed")
    driven: dict[str, dict[tuple[str, int], tuple[float, float]]] = {"ground_truth": {}, method: {}}
    for file in (ROOT / "marsnav-v1").glob("test-*-of-140.json"):
        for drive in json.loads(file.read_text())["episodes"]:
            if drive["perception"] in driven and drive["condition"] in conditions:
                driven[drive["perception"]][drive["condition"], drive["course"]] = (drive["success"], drive["spl"])
    truth, others = driven.values()
    difference = np.mean([others[key][0] for key in truth]) - np.mean([truth[key][0] for key in truth])
    picks, held = np.random.default_rng(0).integers(0, 20, (150, 20)), 0
    for drawn in picks:
        both = [
            {(name, n): scores[name, course] for n, course in enumerate(drawn) for name in conditions}
            for scores in (others, truth)
        ]
        low, high = paired_scores(*both)["interval"]
        held += low <= difference <= high
    assert held / len(picks) > 0.9


def test_the_texture_of_images_is_that_of_its_file() -> None:
    groups = json.loads((ROOT / "texture-and-steps/texture.json").read_text())["groups"]
    mars, earth = groups["Mars"], groups["Earth"]
    given = dict(zip(("Curiosity, Navcam", "Perseverance, Navcam", "Perseverance, Mastcam-Z"), mars["images"]))
    given["mean of these three"] = mars["mean"]
    given |= {f"`{name}`": group["mean"] for name, group in groups.items() if name not in ("Mars", "Earth")}
    formats = {"lbp_riu2": "{:.2f}", "high": "{:.1%}", "poor": "{:.1%}", "gradient": "{:.2f}", "slope": "{:.2f}"}
    table_rows = {row[0]: row[1:] for row in rows("texture-and-steps.md", "## Texture\n")}
    assert set(table_rows) - set(given) == {
        "eight photographs from Earth",
        "the paper: one image of Mars, one of Earth",
    }
    for name, figures in given.items():
        expected = [text.format(figures[key]).replace("%", " %") for key, text in formats.items()]
        assert table_rows[name] == expected, name
    spreads = []
    for key, text in formats.items():
        values = [image[key] for image in earth["images"]]
        mean, low, high = (
            text.format(value).replace("%", " %") for value in (earth["mean"][key], min(values), max(values))
        )
        spreads.append(f"{mean} ({low.removesuffix(' %')} to {high.removesuffix(' %')})")
    assert table_rows["eight photographs from Earth"] == spreads


def test_the_drives_on_test_are_those_of_their_files() -> None:
    methods = ("ground_truth", "m3depth", "sgbm", "sad-sgm")
    drives: dict[tuple[str, str], list[dict]] = {}
    for file in (ROOT / "marsnav-v1").glob("test-*-of-140.json"):
        for drive in json.loads(file.read_text())["episodes"]:
            for condition in (drive["condition"], "all"):
                drives.setdefault((condition, drive["perception"]), []).append(drive)
    table_rows = rows("marsnav-v1.md", "## On test")
    assert [row[0] for row in table_rows] == [*load_suite("marsnav-v1").conditions, "all"]
    for condition, courses, *cells in table_rows:
        for method, cell in zip(methods, cells, strict=True):
            driven = drives[condition, method]
            goals, spl = sum(drive["success"] for drive in driven), np.mean([drive["spl"] for drive in driven])
            assert cell == f"{goals} of {len(driven)}, {spl:.2f}".replace(" 0.", " ."), (condition, method)
        if condition != "all":
            numbers = sorted(drive["course"] for drive in drives[condition, "ground_truth"])
            assert courses == ("all 20" if numbers == [*range(20)] else ", ".join(map(str, numbers)))


def test_what_the_page_counts_on_test_is_in_the_files() -> None:
    files = sorted((ROOT / "marsnav-v1").glob("test-*-of-140.json"))
    drives = [drive for file in files for drive in json.loads(file.read_text())["episodes"]]
    text = " ".join((ROOT / "marsnav-v1.md").read_text().split())
    hours = sum(drive["steps"] * drive["step_seconds"] for drive in drives) / 3600
    assert f"took {hours:.0f} hours of a core" in text and f"over all {len(drives) // 4} drives" in text
    failed = [drive for drive in drives if not drive["success"]]
    gave_up = [drive["perception"] for drive in failed if drive["outcome"] == "no_path"]
    assert (
        f"Of the {len(failed)} drives that failed, {len(gave_up)} ended because the navigator found no path and gave "
        f"up: {gave_up.count('sgbm')} by SGBM, {gave_up.count('sad-sgm')} by semi-global SAD"
    ) in text


def test_time_and_safety_on_test_are_those_of_the_files() -> None:
    methods = methods_of([read_results(file) for file in sorted((ROOT / "marsnav-v1").glob("test-*-of-140.json"))])
    conduct = conduct_of(methods)
    table, _, _ = conduct_table(conduct).partition("\n\n")
    page = (ROOT / "marsnav-v1.md").read_text()
    assert f"### Time and safety\n\n{table}\n\n" in page
    missed = [
        {key: (float(is_near_miss(e["outcome"], e["min_clearance"])), 0.0) for key, e in method.episodes.items()}
        for method in methods.values()
    ]
    less = paired_scores(missed[1], missed[0])
    near = [row["near_misses"] for row in conduct]
    assert max(near) == near[1] and near[1] - near[0] == 9
    low, high = less["interval"]
    points = f"{100 * less['difference']:+.0f} percentage points, 95 % interval {100 * low:+.0f} to {100 * high:+.0f}"
    assert f"in {near[1]} of 280 drives, nine more than with true depth ({points})" in " ".join(page.split())


def test_the_correlations_of_the_depth_with_spl_are_those_of_the_files() -> None:
    methods = methods_of([read_results(file) for file in sorted((ROOT / "marsnav-v1").glob("test-*-of-140.json"))])
    dots = condition_dots(methods)
    assert one_sided(dots) == {"near_ground_as_sky": "navigator, m3depth"}
    rows = only_with_intervals(correlate(dots, dots_without_each_course(methods)))
    of_spl = {row["metric"]: row for row in rows if row["score"] == "spl"}
    words = {
        name: {
            kind: f"{row[kind]:+.2f}, {row[f'{kind}_interval'][0]:+.2f} to {row[f'{kind}_interval'][1]:+.2f}".replace(
                "0.", "."
            )
            for kind in ("spearman", "within")
        }
        for name, row in of_spl.items()
    }
    text = " ".join((ROOT / "marsnav-v1.md").read_text().split())
    obstacles, errors, missed = (words[name] for name in ("false_obstacles", "abs_rel", "rocks_missed"))
    assert f"correlation {obstacles['spearman'].replace(', ', ', 95 % interval ')}), with Abs Rel on the way" in text
    assert f"with Abs Rel on the way ({errors['spearman']}), and with the share of rocks missed" in text
    assert f"with the share of rocks missed ({missed['spearman']})" in text
    within = [each["within"].replace(", ", " (") + ")" for each in (obstacles, errors, missed)]
    assert f"within the methods they are {within[0]}, {within[1]} and {within[2]}." in text


def test_where_the_lead_over_sgbm_comes_from_is_in_the_files() -> None:
    files = sorted((ROOT / "marsnav-v1").glob("test-*-of-140.json"))
    drives = [drive for file in files for drive in json.loads(file.read_text())["episodes"]]
    four = {"smooth_dust", "dusty_lens", "warm_rig", "compressed"}
    everything = {drive["condition"] for drive in drives}
    parts = (everything, four, everything - four, {"clear"})
    table = rows("marsnav-v1.md", "### Where M3Depth's lead over SGBM comes from\n")
    for conditions, (_, goals, success, spl) in zip(parts, table, strict=True):
        ours, sgbm = (
            {
                (drive["condition"], drive["course"]): (float(drive["success"]), drive["spl"])
                for drive in drives
                if drive["perception"] == method and drive["condition"] in conditions
            }
            for method in ("m3depth", "sgbm")
        )
        reached = [int(sum(arrived for arrived, _ in method.values())) for method in (ours, sgbm)]
        assert goals == f"{reached[0]} and {reached[1]} of {len(ours)}"
        less = paired_scores(ours, sgbm)
        low, high = (100 * bound for bound in less["interval"])
        assert success.removeprefix("+") == f"{100 * less['difference']:.0f} ({low:+.0f} to {high:+.0f})"
        low, high = less["spl_interval"]
        assert spl == f"{less['spl_difference']:+.2f} ({low:+.2f} to {high:+.2f})".replace("0.", ".")
    lead = [drive["success"] * (1 if drive["perception"] == "m3depth" else -1) for drive in drives
            if drive["perception"] in ("m3depth", "sgbm") and drive["condition"] in four]  # fmt: skip
    assert sum(lead) == 40
    outside = [drive for drive in drives if drive["condition"] in ("into_sun", "compressed", "half_pixels")]
    names = ("m3depth", "ground_truth", "sgbm")
    reached = [sum(drive["success"] for drive in outside if drive["perception"] == name) for name in names]
    text = " ".join((ROOT / "marsnav-v1.md").read_text().split())
    assert "M3Depth reaches {} of 60 goals, true depth {} and SGBM {}".format(*reached) in text


def test_the_drives_of_learned_networks_over_smooth_dust_are_those_of_their_files() -> None:
    names = {"ground_truth": "true depth", "m3depth": "M3Depth", "sgbm": "SGBM"}
    table_rows = rows("marsnav-v1.md", "### Learned networks over smooth dust\n")
    drives: dict[str, list[dict]] = {row[0]: [] for row in table_rows}
    files = [*(ROOT / "marsnav-v1").glob("rival-*.json"), *(ROOT / "marsnav-v1").glob("test-*-of-140.json")]
    for drive in (drive for file in files for drive in json.loads(file.read_text())["episodes"]):
        name = names.get(drive["perception"], Path(drive["perception"]).stem)
        if name in drives and drive["condition"] == "smooth_dust":
            drives[name].append(drive)
    for name, count, goals, others in table_rows:
        of_method = drives[name]
        reached, spl = sum(drive["success"] for drive in of_method), np.mean([drive["spl"] for drive in of_method])
        assert count == str(len(of_method)) and len({drive["course"] for drive in of_method}) == len(of_method)
        assert goals == f"{reached} of {len(of_method)}, {spl:.2f}".replace(" 0.", " .")
        ended = [drive["outcome"].replace("_", " ") for drive in of_method if not drive["success"]]
        assert others == (", ".join(f"{ended.count(name)} {name}" for name in sorted(set(ended))) or "-")


def test_the_scores_on_unseen_scenes_are_those_of_their_files() -> None:
    labels = {"M3Depth": "M3Depth", "M3Depth, weights of 0.1.0": "release_0.1", "SGBM, filled": "SGBM"}
    labels["SGBM-HH, filled"] = "SGBM-HH"
    sets = {"clean": "clean", "degraded": "degraded", "sun at 10 deg": "sun10", "smooth dust": "dust"}
    names = ("maps", "all_512", "all_1024", "all_2048", "dust", "clean")
    files = [json.loads((ROOT / f"depth/{name}.json").read_text()) for name in names]
    checked = 0
    for pairs, label, *cells in rows("depth.md", "## On unseen scenes\n"):
        size, name = pairs.split(" px, ")
        of_pairs = [file["parts"].get(size, {}).get(sets[name], {}).get("depth", {}) for file in files]
        scores = next(part[method] for part in of_pairs if (method := labels[label.strip("*")]) in part)
        value = {key: scores[key]["value"] for key in ("abs_rel", "epe_visible", "bad1")}
        angles = [f"{scores[key]['value']:.1f} deg" for key in ("normal", "normal_rock", "normal_slab")]
        errors = [f"{value['abs_rel']:.4f}", f"{value['epe_visible']:.3f}", f"{100 * value['bad1']:.1f} %"]
        assert cells == [*errors, *angles]
        checked += 1
    assert checked == 4 + 4 + 3 + 3 + 3 * 3 + 3 * 3


def test_the_rocks_in_the_navigators_map_are_those_of_their_files() -> None:
    labels = {"M3Depth": "M3Depth", "M3Depth, weights of 0.1.0": "release_0.1"}
    labels |= {"SGBM": "SGBM", "true depth": "ground_truth"}
    parts = [json.loads((ROOT / f"depth/{name}.json").read_text())["parts"]["512"] for name in ("maps", "all_512")]
    sets = parts[0]["clean"], parts[1]["degraded"], parts[0]["sun10"]
    table_rows = rows("depth.md", "In the navigator's map of a single image")
    assert len(table_rows) == 4
    for label, *cells in table_rows:
        scores = [part["map"][labels[label.strip("*")]] for part in sets]
        for score, cell in zip(scores, cells, strict=True):
            false = score["false"]["value"]
            assert cell == f"{100 * score['found_both']['value']:.1f} %, {false:.{0 if false > 100 else 1}f}"


def test_the_scores_in_the_world_of_the_first_release_are_those_of_their_file() -> None:
    sizes = json.loads((ROOT / "depth/old_world.json").read_text())["sizes"]
    labels = {"M3Depth": "M3Depth", "M3Depth, weights of 0.1.0": "0.1.0", "SGBM, filled": "SGBM"}
    table_rows = rows("depth.md", "### Both weights in the world of 0.1.0\n")
    assert len(table_rows) == 9
    for pairs, label, *cells in table_rows:
        part = sizes[pairs.split()[2]]
        value = {name: score["value"] for name, score in part["methods"][labels[label]].items()}
        assert pairs.startswith(f"{part['pairs']} of ")
        errors = [f"{value['abs_rel']:.4f}", f"{value['epe_visible']:.3f}", f"{100 * value['bad1']:.1f} %"]
        assert cells == [*errors, f"{value['normal']:.1f} deg"]


def test_the_scores_with_fewer_pixels_are_those_of_their_files() -> None:
    for name, (_, *cells) in zip(("clean", "quarter"), rows("depth.md", "## With fewer pixels\n"), strict=True):
        content = json.loads((ROOT / f"depth/{name}.json").read_text())
        assert content.get("max_pixels") == {"clean": None, "quarter": 65536}[name]
        scores = content["parts"]["512"]["clean"]["depth"]["M3Depth"]
        value = {key: score["value"] for key, score in scores.items() if isinstance(score, dict) and "value" in score}
        errors = [f"{value['abs_rel']:.4f}"[1:], f"{value['epe_visible']:.3f}"[1:], f"{100 * value['bad1']:.1f} %"]
        errors += [f"{value['normal']:.1f} deg", f"{100 * value['found_both']:.1f} %"]
        assert cells == [*errors, f"{100 * value['missed_sky']:.2f}"[1:] + " %"]


def test_the_errors_of_rows_that_lie_apart_are_those_of_their_file() -> None:
    scores = json.loads((ROOT / "depth/rows.json").read_text())
    kinds = {"clean": "clean", "sun at 10 deg": "sun", "image faults": "faults"}
    turns = {
        "0.2 px and 0.02 deg": "small",
        "0.7 px and 0.07 deg": "mid",
        "1 px": "one",
        "up to 1 px and 0.1 deg": "upto",
    }
    table_rows = rows("depth.md", "## Rows that lie apart\n")
    assert len(table_rows) == 9
    for kind, turn, method, *cells in table_rows:
        name = f"{kinds[kind]}-{turns[turn]}"
        mean = "median" if kind == "image faults" else "mean"
        together, *others = (
            [scores[part]["methods"][method][mean][error] for error in ("abs_rel", "epe")]
            for part in (f"{kinds[kind]}-together", name, f"{name}-aligned")
        )
        texts = [f"{together[0]:.4f} / {together[1]:.3f}"]
        for abs_rel, epe in others:
            more = f"{100 * (abs_rel / together[0] - 1):+.0f} %, {100 * (epe / together[1] - 1):+.0f} %"
            texts.append(f"{abs_rel:.4f} / {epe:.3f} ({more})")
        assert cells == texts


@pytest.mark.parametrize("name", ["smooth_dust", "gale"])
def test_the_drives_with_both_weights_are_those_of_their_file(method_drives, name: str) -> None:
    drives = method_drives.read_drives(ROOT / "drives" / f"{name}.jsonl")
    assert method_drives.drives_table(drives, ("m3depth", "release_0.1", "sgbm")) in (ROOT / "drives.md").read_text()


def test_the_drives_of_the_methods_are_those_of_their_file(method_drives) -> None:
    drives = method_drives.read_drives(ROOT / "methods" / "gale.jsonl")
    table = method_drives.drives_table(drives, method_drives.Options(Path("gale.jsonl")).order)
    assert table in (ROOT / "methods.md").read_text()


def test_the_figures_of_the_first_page_are_those_of_the_results() -> None:
    page = " ".join((ROOT.parent / "index.md").read_text().split())
    errors = {(row[0], row[1].strip("*")): row[2] for row in rows("depth.md", "## On unseen scenes\n")}
    ours, classical = (errors["512 px, clean", method] for method in ("M3Depth", "SGBM-HH, filled"))
    assert f"is {ours} with M3Depth and {classical} with OpenCV's semi-global matching" in page
    truth, m3depth, sgbm, _ = (cell.partition(",")[0] for cell in rows("marsnav-v1.md", "## On test")[-1][2:])
    others = f"{sgbm.partition(' ')[0]} with OpenCV's SGBM and {truth.partition(' ')[0]} with the true depth"
    assert f"reaches {m3depth.replace(' of 280', ' of 280 goals')} with M3Depth, {others}" in page
