"""The page that compares trained networks, from scores and runs that are known."""

import hashlib
import json
import os
import re
import sys
import textwrap
from concurrent.futures import BrokenExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from small_network import SMALL
from small_rivals import TINY

from m3depth.estimator import EstimatorName
from m3depth.evaluation.bootstrap import resampled_means
from m3depth.evaluation.cost import Cost
from m3depth.evaluation.report import DEPTH_COLUMNS, NORMAL_COLUMNS, number
from m3depth.figures import drawing
from m3depth.kinds.networks import new_network
from m3depth.network.model import M3Depth
from m3depth.rivals.config import SOURCES
from m3depth.weights import SHIPPED_WEIGHTS
from m3depth.weights.storage import load_weights, save_weights
from marssim.base.camera import NATECAM
from marssim.base.files.json_file import read_json
from marssim.base.images.figure_pixels import figure_pixels

EDGES = range(16)
ROOT = Path(__file__).parents[2]
WEIGHTS = ROOT / "docs/results/methods/weights"
DIGESTS = "| file | SHA-256 |"  # the head of their table


def result(
    methods: dict[str, tuple[float, float]],
    pixels: int,
    scene: str,
    given: str = "",
    weights: dict[str, str] | None = None,
) -> dict:
    """results.json of a place with one pair, whose methods have an error of an image and one in the depth 2 to 3 m.

    The method `given` got the true depth. SGBM gives no normals, so that planes are fitted to its depth. Methods have
    the digests `weights`, or none.
    """
    normals = {label: "fitted_normal_" if label == "SGBM" else "normal_" for label in methods}
    return {
        "degrade": None,
        "data_sha256": f"pairs of {pixels} px",
        "versions": {"commit": "5c02ed5c02ed"},
        "estimators": {label: {"name": "sgbm", "sha256": (weights or {}).get(label)} for label in methods},
        "per_pair": [
            {"pair": f"{scene}/00", "scene": scene,
             **{label: {**dict.fromkeys(DEPTH_COLUMNS, value), "kinds": {"visible": {"epe": value / 2}},
                        **{f"{normals[label]}{name}": value for name in NORMAL_COLUMNS}}
                for label, (value, _) in methods.items()}}
        ],
        "methods": {
            label: {
                "intervals": [
                    {"from_m": near, "to_m": near + 1, "pixels": pixels if near == 2 else 0,
                     "pooled": dict.fromkeys(("mae", "rmse", "abs_rel", "bad1"), error) if near == 2 else {}}
                    for near in EDGES[:-1]
                ],
                "gets_truth": label == given,
                "normals_are_fitted": False,
            }
            for label, (_, error) in methods.items()
        },
    }  # fmt: skip


def digest_of(run: Path) -> str:
    """SHA-256 of a run's weights."""
    return hashlib.sha256((run / "weights.safetensors").read_bytes()).hexdigest()


@pytest.fixture
def folders(tmp_path) -> tuple[Path, Path]:
    """The scores of two places and the folder of one run, whose network is the better method."""
    run = tmp_path / "runs/mine"
    run.mkdir(parents=True)
    M3Depth(SMALL).save_pretrained(run / "weights.safetensors")
    for place, ours, theirs, pixels in (("gale", 0.02, 0.08, 100), ("utopia", 0.04, 0.08, 300)):
        folder = tmp_path / "scores/depth/512/clean" / place
        folder.mkdir(parents=True)
        methods = {"SGBM": (theirs, 0.5), "mine": (ours, 0.1 if place == "gale" else 0.3)}
        content = result(methods, pixels, "00000", weights={"mine": digest_of(run)})
        (folder / "results.json").write_text(json.dumps(content))
    lines = [
        {
            "kind": "start",
            "step": 0,
            "seed": 3,
            "data": "feedc0de" * 8,
            "commit": "0123456789ab",
            "command": "python -m m3depth.train --seed 3",
        },
        {"kind": "train", "step": 1, "minutes": 0.1, "processor_minutes": 0.2},
        {"kind": "val", "step": 50, "epe": 8.0},
        {"kind": "train", "step": 60, "minutes": 7.0, "processor_minutes": 12.0},
        {
            "kind": "start",
            "step": 60,
            "seed": 3,
            "data": "feedc0de" * 8,
            "commit": "ba9876543210",
            "command": "python -m m3depth.train --again",
        },
        {"kind": "train", "step": 100, "minutes": 12.0, "processor_minutes": 9.0},
        {"kind": "val", "step": 100, "epe": 2.0},
    ]
    (run / "log.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    return tmp_path / "scores", run


@pytest.fixture
def measured(compare_methods, monkeypatch) -> None:
    """Costs are those of one prediction of a small pair, in this process, which has torch already."""
    monkeypatch.setattr(compare_methods, "cost", compare_methods._cost)
    monkeypatch.setattr(
        compare_methods, "untrained_cost",
        lambda name: compare_methods._untrained_cost(name.lower()) if name == "SGBM" else None,
    )  # fmt: skip
    monkeypatch.setattr(compare_methods, "measured", lambda call, *args: (call(*args), Cost(1.0, 300.0, None)))
    monkeypatch.setattr(compare_methods, "REPEATS", 1)
    monkeypatch.setattr(compare_methods, "NATECAM", NATECAM.resized(64, 64))


def test_failed_pairs_are_told_by_their_share_and_the_others_by_the_median(compare_methods):
    figures = {"a": [0.1, 0.2, 0.5], "b": [0.3, 40.0, None]}
    places = {name: {"figures": {"abs_rel": values}, "scenes": ["0", "1", "2"]} for name, values in figures.items()}
    spread = compare_methods.spread({"places": places})
    assert spread == {"median": 0.3, "failed": 0.4, "largest_scene": pytest.approx(40 / 41.1)}


def flags(scores: Path, out: Path, *runs: Path) -> list[str]:
    return ["--scores", str(scores), "--out", str(out), "--runs", *map(str, runs)]


def test_scores_and_runs_become_one_page(compare_methods, folders, measured, tmp_path):
    scores, run = folders
    out = tmp_path / "out"
    assert compare_methods.main(flags(scores, out, run)) == 0
    content = read_json(out / "methods.json")
    mine = content["runs"]["mine"]
    assert mine["parameters"] == sum(p.numel() for p in M3Depth(SMALL).parameters())
    assert (mine["steps"], mine["minutes"], mine["processor_minutes"]) == (100, 12.0, 21.0)
    # step 50 lies between the logged steps 1, at 0.2 min, and 60, at 12 min
    assert [v["processor_minutes"] for v in mine["validations"]] == pytest.approx([0.2 + 49 / 59 * 11.8, 21.0])
    clean = content["sets"]["clean"]
    assert (clean["pairs"], clean["scenes"]) == (2, 2)
    assert clean["metrics"]["mine"]["abs_rel"]["value"] == pytest.approx(0.03)
    assert clean["metrics"]["mine"]["normal_median"]["interval"] is None  # of two scenes
    assert clean["metrics"]["SGBM"]["epe"]["ratio"] == pytest.approx(0.08 / 0.03)  # mine is the reference
    assert clean["metrics"]["SGBM"]["normal_mean"]["ratio"] == pytest.approx(0.08 / 0.03)  # of the fitted planes
    assert clean["metrics"]["mine"]["visible_epe"]["value"] == pytest.approx(0.015)
    assert "ratio" not in clean["metrics"]["mine"]["rmse"]
    assert clean["spread"]["mine"] == {
        "median": pytest.approx(0.03),
        "failed": 0.0,
        "largest_scene": pytest.approx(2 / 3),
    }
    third = clean["intervals"]["mine"]["intervals"][2]
    assert third["pixels"] == 400 and third["pooled"]["mae"] == pytest.approx((0.1 + 3 * 0.3) / 4)
    assert third["pooled"]["rmse"] == pytest.approx(((0.1**2 + 3 * 0.3**2) / 4) ** 0.5)
    assert clean["intervals"]["mine"]["intervals"][0]["pooled"]["mae"] is None
    page = (out / "methods.md").read_text()
    assert mine["memory_mib"] == 300 and mine["seconds"] == 1.0 and "| 1.00 | 300 | 100 | 21 | 12 |" in page
    digest = digest_of(run)[:12]
    command = "`python -m m3depth.train --again`"
    assert f"| mine | 3 | 0123456789ab, ba9876543210 | feedc0defeed | {command} | {digest} |" in page
    assert "Scored with the code of 5c02ed5c02ed (mine, SGBM)." in page
    assert "| SGBM, planes fitted | 0.0800" in page and "mine, planes" not in page
    assert page.index("| mine | 0.0300 |") < page.index("| SGBM | 0.0800")
    assert "| 2-3 m | 0.2500 | 0.5000 |" in page
    assert "Errors over those of mine on the same pairs" in page
    assert "| SGBM | " + " | ".join(["2.667"] * 4) + " |" in page and page.count("| mine | 0.0300 |") == 4
    of_mine = ["0.0300", "0.0150", "0.0300"]
    millions = f"{mine['parameters'] / 1e6:.2f} M"
    summary, _ = page.split("Seconds and memory")
    assert f"| mine | {' | '.join(of_mine)} | 1.00 | {millions} |" in summary
    assert summary.rstrip().endswith(", planes fitted | 1.00 | - |")
    assert content["untrained"] == {"SGBM": {"seconds": 1.0, "memory_mib": 300.0}}
    assert "| SGBM | - | 1.00 | 300 | - | - | - |" in page
    for picture in ("curves.png", "error_by_depth_clean.png"):
        assert cv2.imread(str(out / picture)).std() > 5


def test_errors_by_depth_have_intervals_over_scenes(compare_methods, folders, measured, tmp_path):
    """Where the scores of each pair have its sums; two pairs of a scene count as one."""
    scores, run = folders
    rng, flat = np.random.default_rng(0), []
    for path in sorted(scores.glob("depth/512/clean/*/results.json")):
        content = json.loads(path.read_text())
        (pair,) = content["per_pair"]
        content["per_pair"] = [{**pair, "pair": f"{n:05d}/00", "scene": f"{n // 2:05d}"} for n in range(8)]
        pixels = rng.integers(20, 90, 8)
        for label, result in content["methods"].items():
            errors = rng.uniform(0.1, 0.9, 8) * pixels
            for each, count, error in zip(content["per_pair"], pixels, errors, strict=True):
                by_depth = {"pixels": [0, 0, int(count), *[0] * 12], "absolute_error_m": [0, 0, error, *[0] * 12]}
                each[label] = {**pair[label], "counts": {"intervals": by_depth}}
            result["intervals"][2] |= {"pixels": int(pixels.sum())}
            result["intervals"][2]["pooled"]["mae"] = float(errors.sum() / pixels.sum())
            if label == "mine":
                flat += zip(errors[::2] + errors[1::2], pixels[::2] + pixels[1::2], strict=True)
        path.write_text(json.dumps(content))
    out = tmp_path / "out"
    assert compare_methods.main(flags(scores, out, run)) == 0
    rows = read_json(out / "methods.json")["sets"]["clean"]["intervals"]["mine"]["intervals"]
    low, high = rows[2]["mae_interval"]
    errors, pixels = np.array(flat).T
    mae = errors.sum() / pixels.sum()
    drawn = np.random.default_rng(1).integers(0, 8, (20_000, 8))
    spread = np.std(errors[drawn].sum(axis=1) / pixels[drawn].sum(axis=1)) * (8 / 7) ** 0.5
    assert rows[2]["pooled"]["mae"] == pytest.approx(mae) and low < mae < high
    assert (high - low) / 2 == pytest.approx(2.365 * spread, rel=0.15)  # Student's t with 7 degrees of freedom
    assert rows[3]["mae_interval"] is None
    page = (out / "methods.md").read_text()
    assert "with 95 % intervals over scenes for methods whose scores have them" in page
    assert f"| 2-3 m | {number(mae)} ({number(low)} to {number(high)}) |" in page


def test_the_page_says_how_many_threads_computed(compare_methods, folders, measured, tmp_path, monkeypatch):
    """A process may use fewer threads than the machine has processors."""
    scores, run = folders
    monkeypatch.setattr(compare_methods, "versions", lambda: {"cpus": 64, "torch_threads": 3})
    assert compare_methods.main(flags(scores, tmp_path, run)) == 0
    page = (tmp_path / "methods.md").read_text()
    assert "of a pair of 512 x 512 px; PyTorch computed with 3 threads." in page


def test_the_reference_of_the_ratios_is_any_scored_method(compare_methods, folders, measured, tmp_path):
    scores, run = folders
    out = tmp_path / "out"
    assert compare_methods.main([*flags(scores, out, run), "--reference", "SGBM"]) == 0
    clean = read_json(out / "methods.json")["sets"]["clean"]
    mine = clean["metrics"]["mine"]["abs_rel"]
    assert mine["ratio"] == pytest.approx(3 / 8)
    assert "Errors over those of SGBM on the same pairs" in (out / "methods.md").read_text()


def test_a_method_that_gets_the_true_depth_is_timed_with_it_marked_and_comes_last(
    compare_methods, folders, measured, tmp_path
):
    scores, run = folders
    sizes = {"given": replace(TINY["fusion"], true_depth=True), "fusion": TINY["fusion"]}
    for name, config in sizes.items():
        folder = run.with_name(name)
        folder.mkdir()
        new_network(config).save_pretrained(folder / "weights.safetensors")
        (folder / "log.jsonl").write_text(
            (run / "log.jsonl").read_text().replace('"epe": 8.0', '"epe": 0, "normal": 9')
        )
    for place in ("gale", "utopia"):
        file = scores / "depth/512/clean" / place / "results.json"
        methods = {"mine": (0.02, 0.1), "fusion": (0.03, 0.1), "given": (0.0, 0.0), "SGBM": (0.08, 0.5)}
        digests = {name: digest_of(run.with_name(name)) for name in ("mine", *sizes)}
        file.write_text(json.dumps(result(methods, 100, "00000", "given", digests)))
    out = tmp_path / "out"
    assert compare_methods.main(flags(scores, out, run, *(run.with_name(name) for name in sizes))) == 0
    content = read_json(out / "methods.json")
    assert [content["runs"][name]["on_m3depth"] for name in ("mine", "given", "fusion")] == [False, False, True]
    page = (out / "methods.md").read_text()
    millions = f"{content['runs']['fusion']['parameters'] / 1e6:.2f} M"
    assert f"| fusion, given M3Depth's depth | {millions} + M3Depth | 1.00 |" in page
    assert f"| given, given the true depth | {millions} | 1.00 |" in page
    assert "| depth | mine | fusion, given M3Depth's depth | SGBM | given, given the true depth |" in page
    ranks = {
        "mine": "0200",
        "fusion, given M3Depth's depth": "0300",
        "SGBM": "0800",
        "given, given the true depth": "0000",
    }
    order = [page.index(f"| {name} | 0.{digits}") for name, digits in ranks.items()]
    assert order == sorted(order)
    one, two = (cv2.imread(str(path)) for path in (out / "curves.png", out / "error_by_depth_clean.png"))
    assert one.shape[1] == 2 * 7 * 120 and two.std() > 5  # a panel of the normals beside that of the disparity


def test_records_of_two_calls_become_the_page_of_one(compare_methods, folders, measured, tmp_path):
    scores, run = folders
    assert compare_methods.main(flags(scores, tmp_path / "one", run)) == 0
    records = [str(tmp_path / "one/records" / f"{name}.json") for name in ("mine", "SGBM")]
    assert compare_methods.main(["--records", *records, "--out", str(tmp_path / "again")]) == 0
    pages = [(tmp_path / name / "methods.md").read_text() for name in ("one", "again")]
    assert pages[0] == pages[1]

    # A second training, scored with SGBM too, which counts once.
    other = run.rename(run.with_name("other"))
    for place in ("gale", "utopia"):
        file = scores / "depth/512/clean" / place / "results.json"
        file.write_text(file.read_text().replace('"mine"', '"other"'))
    assert compare_methods.main([*flags(scores, tmp_path / "both", other), "--records", *records]) == 0
    content = read_json(tmp_path / "both/methods.json")
    # A trained method has the same place in all figures, and so the same colour.
    assert [*content["runs"]] == ["other", "mine"]
    assert [*content["sets"]["clean"]["metrics"]] == ["other", "mine", "SGBM"]
    assert content["reference"] == "other"
    both = content["sets"]["clean"]["metrics"]
    assert both["mine"] == {**both["other"]} and cv2.imread(str(tmp_path / "both/curves.png")).std() > 5


def test_the_steps_since_the_last_logged_one_count(compare_methods, folders):
    _, run = folders
    with (run / "log.jsonl").open("a") as log:
        log.write('{"kind": "stop", "step": 107, "minutes": 13.5, "processor_minutes": 10.0}\n')
    training = sys.modules["method_records"].training(run)
    assert (training["steps"], training["minutes"], training["processor_minutes"]) == (107, 13.5, 22.0)


def test_the_processor_time_is_that_of_all_processes(compare_methods, folders, measured, tmp_path):
    """The log counts that of one. A run that an older version began says their number at its later starts only."""
    scores, run = folders
    first, last = '"command": "python -m m3depth.train --seed 3"', '"command": "python -m m3depth.train --again"'
    log = (run / "log.jsonl").read_text()
    (run / "log.jsonl").write_text(log.replace(last, last + ', "processes": 2'))
    assert sys.modules["method_records"].training(run)["processor_minutes"] == 42.0
    out = tmp_path / "out"
    assert compare_methods.main(flags(scores, out, run)) == 0
    assert "| `python -m m3depth.train --again` in 2 processes of torchrun |" in (out / "methods.md").read_text()
    (run / "log.jsonl").write_text(log.replace(first, first + ', "processes": 1'))
    assert sys.modules["method_records"].training(run)["processor_minutes"] == 21.0


def test_a_half_written_last_line_of_a_log_does_not_count(compare_methods, folders):
    _, run = folders
    with (run / "log.jsonl").open("a") as log:
        log.write('{"kind": "train", "step": 110, "minu')
    training = sys.modules["method_records"].training(run)
    assert training["steps"] == 100 and training["processor_minutes"] == 21.0


def test_a_killed_process_of_the_measurement_is_an_error(compare_methods, monkeypatch, capsys):
    monkeypatch.setattr(compare_methods, "_cost", os._exit)
    with pytest.raises(BrokenExecutor):
        compare_methods.cost(1)


def test_a_method_without_training_is_timed(compare_methods, measured):
    assert compare_methods._untrained_cost("sad-sgm") == {"seconds": 1.0, "memory_mib": 300.0}


def test_the_shipped_network_is_timed_without_a_run(compare_methods, monkeypatch):
    monkeypatch.setattr(compare_methods, "cost", lambda sizes: sizes["kind" if "kind" in sizes else "channels"])
    assert compare_methods.untrained_cost("M3Depth") == read_json(SHIPPED_WEIGHTS.with_suffix(".json"))["channels"]
    cost = {"parameters": 780_000, "on_m3depth": False, "seconds": 0.25, "memory_mib": None}
    lines = sys.modules["methods_page"]._cost_table({}, {"M3Depth": cost})
    assert "| M3Depth | 0.78 M | 0.25 | - | - | - | - |" in lines


@pytest.mark.usefixtures("measured", "undrawn_figures")
def test_a_network_of_ones_own_counts_with_its_source(compare_methods, folders, tmp_path, monkeypatch, capsys):
    scores, run = folders
    source = tmp_path / "own.py"
    source.write_text("width = 1\n")
    monkeypatch.setitem(SOURCES, SMALL.KIND, source)
    digest = EstimatorName(f"m3depth:{run / 'weights.safetensors'}").digest()
    for file in scores.glob("depth/512/clean/*/results.json"):
        file.write_text(file.read_text().replace(digest_of(run), digest))
    assert compare_methods.main(flags(scores, tmp_path / "out", run)) == 0
    source.write_text("width = 2\n")
    assert compare_methods.main(flags(scores, tmp_path / "other", run)) == 2
    assert "has other weights, or another source of the network, than those" in capsys.readouterr().err


def test_a_method_that_the_package_does_not_have_is_not_timed(compare_methods):
    assert compare_methods.untrained_cost("SGBM unfilled") is None


def test_a_method_has_one_colour_in_all_figures(compare_methods, folders, measured, tmp_path, monkeypatch):
    """SGBM is read first here, but has no curve of a training."""
    colours, dashed = [], []

    def pixels(figure):
        colours.append({line.get_label(): line.get_color() for line in figure.axes[0].lines})
        marked = [line for line in figure.axes[0].lines if line.get_marker() != "None"]
        dashed.append({line.get_label() for line in marked if line.get_linestyle() == "--"})
        return figure_pixels(figure)

    monkeypatch.setattr(drawing, "figure_pixels", pixels)
    scores, run = folders
    assert compare_methods.main(flags(scores, tmp_path / "one", run)) == 0
    records = [str(tmp_path / "one/records" / f"{name}.json") for name in ("SGBM", "mine")]
    for reference in ("mine", "SGBM"):
        colours.clear()
        dashed.clear()
        out = str(tmp_path / reference)
        assert compare_methods.main(["--records", *records, "--reference", reference, "--out", out]) == 0
        errors, curves = colours
        assert curves["mine"] == errors["mine"] != errors["SGBM"]
        assert dashed == [{"SGBM"}, set()]  # which was not trained


@pytest.mark.parametrize(
    ("case", "message"),
    [
        ("no weights", "weights.json"),
        ("no scores", "holds no scores of 512 px of score_manifest"),
        ("other methods", "clean/utopia has other methods than the rest"),
        ("not scored", "has no scores of other"),
        ("no run", "has no log.jsonl of m3depth.train"),
        ("no step", "its log.jsonl has no step"),
        ("no reference", "--reference theirs: no such method; choose one of mine, SGBM"),
        ("twice", "--runs must have different names"),
        ("trained on", "has other weights, or another source of the network, than those that"),
        ("two weights", "clean/utopia was scored with other weights of mine than the rest"),
        ("old log", "step 60 has no minutes or no processor_minutes"),
        ("damaged log", "log.jsonl, line 4"),
    ],
)
def test_mistakes_are_one_line(compare_methods, folders, tmp_path, capsys, case, message):
    scores, run = folders
    runs = [run]
    if case == "no scores":
        scores = tmp_path / "empty"
    elif case == "other methods":
        file = scores / "depth/512/clean/utopia/results.json"
        file.write_text(json.dumps(result({"SGBM": (0.1, 0.1)}, 5, "00000")))
    elif case == "not scored":
        runs = [run.rename(run.with_name("other"))]
    elif case == "no run":
        (run / "log.jsonl").unlink()
    elif case == "no step":
        (run / "log.jsonl").write_text("")
    elif case == "no weights":
        (run / "weights.json").unlink()
    elif case == "twice":
        runs = [run, tmp_path / "mine"]
    elif case == "trained on":
        M3Depth(SMALL).save_pretrained(run / "weights.safetensors")
    elif case == "two weights":
        file = scores / "depth/512/clean/utopia/results.json"
        file.write_text(file.read_text().replace(digest_of(run), "0" * 64))
    elif case == "old log":
        log = run / "log.jsonl"
        log.write_text(log.read_text().replace(', "processor_minutes": 12.0', ""))
    elif case == "damaged log":
        log = run / "log.jsonl"
        log.write_text(log.read_text().replace('{"kind": "train", "step": 60', '{"kind": "train, "step": 60'))
    reference = ["--reference", "theirs"] if case == "no reference" else []
    assert compare_methods.main([*flags(scores, tmp_path / "out", *runs), *reference]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ") and error.count("\n") == 1 and message in error
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("undrawn_figures")
@pytest.mark.parametrize(
    ("case", "message"),
    [
        ("nothing", "give --scores, --records or both"),
        ("no scores", "--runs needs --scores"),
        ("no record", "is not a record that compare_methods.py wrote"),
        ("taken", "another method is called mine too"),
        ("taken without training", "another method is called mine too"),
        ("other size", "theirs and mine were scored on pairs of 256 and 512 px"),
        ("other sets", "theirs and mine were scored on different sets: sun10; clean"),
        ("own network", "theirs.json: network config: kind 'plain' is not one of m3depth, "),
        ("other pairs", "theirs and mine were scored on different pairs of clean"),
    ],
)
def test_records_that_cannot_be_compared_are_one_line(
    compare_methods, folders, measured, tmp_path, capsys, case, message
):
    scores, run = folders
    assert compare_methods.main(flags(scores, tmp_path / "one", run)) == 0
    mine = tmp_path / "one/records/mine.json"
    record = {**read_json(mine), "name": "theirs"}
    if case == "other size":
        record["size"] = 256
    elif case == "other sets":
        record["sets"] = {"sun10": record["sets"]["clean"]}
    elif case == "other pairs":
        record["sets"]["clean"]["places"]["gale"]["data"] = "others"
    elif case == "taken":
        record["name"] = "mine"
    elif case == "taken without training":
        record |= {"name": "mine", "run": None}
        record["sets"]["clean"]["places"]["gale"]["figures"]["abs_rel"] = [0.03]
        mine.write_text(json.dumps({**read_json(mine), "run": None}))
    elif case == "no record":
        del record["sets"]
    elif case == "own network":
        record["run"]["network"]["kind"] = "plain"
    theirs = tmp_path / "theirs.json"
    theirs.write_text(json.dumps(record))
    arguments = ["--records", str(mine), str(theirs)]
    arguments = {"nothing": [], "no scores": ["--runs", str(run), *arguments]}.get(case, arguments)
    assert compare_methods.main([*arguments, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ") and error.count("\n") == 1
    assert message in error and not (tmp_path / "out").exists()


def tables(page: str) -> list[list[str]]:
    """The rows of each table of a page of docs/results."""
    text = (ROOT / "docs/results" / page).read_text(encoding="utf-8")
    return [table.splitlines() for table in re.findall(r"(?:^\|.*\|\n)+", text, re.M)]


def test_the_table_of_the_results_is_that_of_the_command():
    """The page of results is written by hand, but the rows of its table are not. Other tables have their own tests."""
    others = "goals reached", "steps, one core", "network and pairs"
    own = [table for table in tables("methods.md") if table[0] != DIGESTS]
    scores = (table for table in own if not any(column in table[0] for column in others))
    shown = {row for table in scores for row in table}
    summary, *others = tables("methods/methods.md")
    assert shown and set(summary) <= shown <= {row for table in (summary, *others) for row in table}


def test_the_tables_of_the_scores_of_longer_trainings_are_those_of_their_file(compare_methods):
    """Their records are tested by test_longer_trainings.py."""
    folder = WEIGHTS.parent / "rescored"
    page = read_json(folder / "methods.json")
    assert sys.modules["methods_page"].markdown(page) == (folder / "methods.md").read_text(encoding="utf-8")
    assert {path.stem for path in folder.glob("records/*.json")} == page["sets"]["clean"]["metrics"].keys()
    files = {run.name: run for other in ("longer", "again") for run in (WEIGHTS.parent / other).iterdir()}
    assert {name: digest_of(run) for name, run in files.items()} == {
        name: run["weights_sha256"] for name, run in page["runs"].items()
    }


def flat(content: dict | list, name: str = "") -> dict[str, object]:
    """The values of nested objects and lists by their places, and numbers by nine digits."""
    values: dict[str, object] = {}
    for key, value in content.items() if isinstance(content, dict) else enumerate(content):
        place = f"{name}/{key}"
        if isinstance(value, dict | list):
            values |= flat(value, place)
        else:
            values[place] = f"{value:.9g}" if isinstance(value, float) else value
    return values


@pytest.mark.usefixtures("undrawn_figures")
def test_all_tables_of_the_results_are_those_of_the_records_beside_them(
    compare_methods, manifest_summary, monkeypatch, tmp_path
):
    """As of the last command of the page, but for what it measures, with few draws for the intervals."""
    folder = WEIGHTS.parent
    records, page = sorted(folder.glob("records/*.json")), read_json(folder / "methods.json")
    named = {record["name"]: record for record in map(read_json, records)}
    costs = {json.dumps(named[name]["run"]["network"]): run for name, run in page["runs"].items()}
    keys = ("gets_truth", "on_m3depth", "parameters", "seconds", "memory_mib")
    monkeypatch.setattr(compare_methods, "cost", lambda sizes: {key: costs[json.dumps(sizes)][key] for key in keys})
    monkeypatch.setattr(compare_methods, "untrained_cost", page["untrained"].get)
    monkeypatch.setattr(compare_methods, "versions", lambda: page["versions"])
    with monkeypatch.context() as patch:
        patch.setattr(manifest_summary, "resampled_means", partial(resampled_means, draws=2))
        flags = ["--reference", "lite", "--rendered-elsewhere", "--out", str(tmp_path)]
        assert compare_methods.main(["--records", *map(str, records), *flags]) == 0
    ours, theirs = (
        {place: value for place, value in flat(content).items() if "interval/" not in place}
        for content in (page, read_json(tmp_path / "methods.json"))
    )
    assert theirs == ours
    assert all((tmp_path / "records" / path.name).read_bytes() == path.read_bytes() for path in records)
    assert sys.modules["methods_page"].markdown(page) == (folder / "methods.md").read_text(encoding="utf-8")

    monkeypatch.setattr(compare_methods, "COLUMNS", {"abs_rel": ""})  # intervals of all figures take a quarter minute
    for name, record in named.items():
        (of_clean, reference) = (of["sets"]["clean"] for of in (record, named["lite"]))
        (figure,) = compare_methods.metrics(of_clean, reference).values()
        assert flat(figure) == flat(page["sets"]["clean"]["metrics"][name]["abs_rel"])


def test_what_the_page_says_of_the_depth_corrected_by_normals_is_that_of_its_records(compare_methods, monkeypatch):
    records = [read_json(WEIGHTS.parent / f"corrected/lite{more}.json") for more in ("", ", corrected by its normals")]
    text = " ".join((ROOT / "docs/results/methods.md").read_text(encoding="utf-8").split())
    visible = sys.modules["method_records"].VISIBLE
    monkeypatch.setattr(compare_methods, "COLUMNS", {"abs_rel": "", visible: ""})
    for name, said, within in (
        ("clean", "times as large on clean pairs", "95 % interval "),
        ("degraded", "times on degraded pairs", ""),
        ("sun10", "times at low sun", ""),
    ):
        plain, corrected = (record["sets"][name] for record in records)
        ratios = compare_methods.metrics(corrected, plain)
        low, high = ratios["abs_rel"]["ratio_interval"]
        assert f"{number(ratios['abs_rel']['ratio'])} {said} ({within}{number(low)} to {number(high)})" in text
        if name == "clean":
            epe = number(ratios[visible]["ratio"])
            assert f"non-occluded EPE is {epe} times as large on clean pairs" in text


def test_pairs_of_two_records_meet_in_any_order_of_their_places(compare_methods):
    def of_set(places):
        return {"places": {name: {"figures": {"abs_rel": [value]}, "scenes": ["0"]} for name, value in places}}

    places = [("gale", 0.1), ("utopia", 0.4)]
    assert compare_methods.pairs_of(of_set(places)) == compare_methods.pairs_of(of_set(places[::-1]))


def test_intervals_of_shares_end_at_one(compare_methods):
    delta = [0.9, *[1.0] * 5]
    figures = {"delta1": delta, "normal_within_30": delta, "rmse": delta}
    of_set = {"places": {"gale": {"figures": figures, "scenes": list("012345")}}}
    found = compare_methods.metrics(of_set, of_set)
    ends = {name: found[name]["interval"][1] for name in figures}
    assert ends["delta1"] == ends["normal_within_30"] == 1 < ends["rmse"]


def test_the_page_has_the_digests_of_the_weights_beside_it():
    (table,) = [table for table in tables("methods.md") if table[0] == DIGESTS]
    digests = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in WEIGHTS.glob("*.safetensors")}
    assert digests and sorted(table[2:]) == sorted(f"| `{name}` | `{digest}` |" for name, digest in digests.items())


def test_the_lines_of_the_page_round_weights_to_the_files_beside_it(tmp_path, monkeypatch):
    lines = re.search(r"(?:^    .*\n)*^    save_weights\(.*\n", (WEIGHTS / "../../methods.md").read_text(), re.M)
    config, tensors = load_weights(WEIGHTS / "lite.safetensors")
    (tmp_path / "runs/lite").mkdir(parents=True)
    single = {name: tensor.float() for name, tensor in tensors.items()}
    save_weights(tmp_path / "runs/lite/weights.safetensors", config, single)
    monkeypatch.chdir(tmp_path)
    exec(textwrap.dedent(lines[0]), {})
    for name in ("lite.safetensors", "lite.json"):
        assert (tmp_path / name).read_bytes() == (WEIGHTS / name).read_bytes()


def test_pairs_that_another_processor_rendered_are_named(compare_methods, folders, measured, tmp_path):
    scores, run = folders
    assert compare_methods.main(flags(scores, tmp_path / "one", run)) == 0
    mine = tmp_path / "one/records/mine.json"
    assert "another digest" not in (tmp_path / "one/methods.md").read_text()
    theirs = {**read_json(mine), "name": "theirs"}
    theirs["sets"]["clean"]["places"]["gale"]["data"] = "others"
    (tmp_path / "theirs.json").write_text(json.dumps(theirs))
    arguments = ["--records", str(mine), str(tmp_path / "theirs.json"), "--reference", "mine"]
    arguments += ["--out", str(tmp_path / "both")]
    assert compare_methods.main(arguments) == 2
    assert compare_methods.main([*arguments, "--rendered-elsewhere"]) == 0
    page = (tmp_path / "both/methods.md").read_text()
    assert "another digest than those that mine was scored on" in page and "gale of clean (theirs)" in page
    theirs["sets"]["clean"]["places"]["gale"]["intervals"][1]["pixels"] += 1
    (tmp_path / "theirs.json").write_text(json.dumps(theirs))
    assert compare_methods.main([*arguments, "--rendered-elsewhere"]) == 2
