"""Evaluation from a dataset on disk to tables and figures, with methods whose errors are known."""

import hashlib
import json
import os
import signal
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from small_rivals import TINY

from m3depth.estimator import CLASSICAL
from m3depth.evaluate import EvaluateOptions, evaluate, main, prepare
from m3depth.evaluation.command.methods import named_estimators
from m3depth.evaluation.cost import Cost, measured
from m3depth.evaluation.report import FIGURES
from m3depth.evaluation.resume import SavedState, SavedStateError
from m3depth.evaluation.scoring import Scoring
from m3depth.kinds.networks import new_network
from m3depth.runtimes.choice import recorded_runtime
from m3depth.stereo.classical import SGBM
from m3depth.stereo.degradation import Degradation
from m3depth.stereo.prediction import Prediction
from m3depth.weights import SHIPPED_WEIGHTS
from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.command.flags import parse
from marssim.base.dataset.dataset import StereoDataset, write_index
from marssim.base.dataset.frame import StereoFrame
from marssim.base.dataset.sample import write_sample
from marssim.base.files.json_file import DatasetError

METHODS = "m3depth.evaluation.command.methods"
H, W = 64, 96
RIG = StereoRig(PinholeCamera.centred(W, H, 120.0), 0.25)


def make_frame(seed: int) -> StereoFrame:
    """Ground 2 to 12 m away under a strip of sky; the left image samples the right one at x - d."""
    rng = np.random.default_rng(seed)
    depth = np.repeat(1 / np.linspace(1 / 12, 1 / 2, H)[:, None], W, axis=1).astype(np.float32)
    disparity = RIG.depth_to_disparity(depth)
    texture = cv2.GaussianBlur(rng.uniform(0, 255, (H, W + 32, 3)).astype(np.float32), (0, 0), 1.0)
    x = np.arange(W, dtype=np.float32)[None] - disparity + 32
    y = np.repeat(np.arange(H, dtype=np.float32)[:, None], W, axis=1)
    left = cv2.remap(texture, x, y, cv2.INTER_LINEAR).astype(np.uint8)
    sky = np.zeros((H, W), bool)
    sky[:6] = True
    surface = np.where(sky, -1, 0).astype(np.int32)
    surface[30:40, 40:60] = 1
    normal = np.broadcast_to(np.float32([0, -0.6, -0.8]), (H, W, 3)).copy()
    normal[sky] = 0
    hidden = np.zeros((H, W), bool)
    hidden[6:, :8] = True
    return StereoFrame(
        left, texture[:, 32:].astype(np.uint8), np.where(sky, np.float32(np.inf), depth),
        np.where(sky, np.float32(0), disparity), normal, surface, hidden, RIG, np.eye(4),
    )  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("set")
    names = [f"00001/0{view}" for view in range(4)]  # scene 1 is in the test split
    for seed, name in enumerate(names):
        write_sample(path / "scenes" / name, make_frame(seed), {})
    write_index(path, {}, names)
    return path


class Scaled:
    """The truth of make_frame, scaled."""

    def __init__(self, factor: float = 1.25) -> None:
        self.factor = factor
        self.images: list[np.ndarray] = []

    def infer(self, left, right, rig):
        frame = make_frame(0)
        self.images.append(left)
        depth = frame.depth * np.float32(self.factor)
        return Prediction(depth, rig.depth_to_disparity(depth), None, np.ones((H, W), np.float32))


class Worse:
    """The truth of make_frame with an error that grows from one pair to the next."""

    def __init__(self) -> None:
        self.times = 0

    def infer(self, left, right, rig):
        self.times += 1
        return Scaled(1 + 0.01 * self.times).infer(left, right, rig)


def test_a_bug_in_scoring_shows_its_traceback(folder, tmp_path, monkeypatch):
    """A ValueError is a mistake of the user while the flags are checked, and none after that."""

    def wrong(*_, **__):
        raise ValueError("operands could not be broadcast together")

    monkeypatch.setattr(f"{METHODS}.load_estimator", _without_network)
    monkeypatch.setattr("m3depth.evaluate.evaluate", wrong)
    with pytest.raises(RuntimeError, match="scoring failed: operands could not be broadcast"):
        main(["--data", str(folder), "--out", str(tmp_path / "out")])


def test_known_errors_are_measured(folder):
    done = evaluate(StereoDataset(folder, "test"), {"right": Scaled(1.0), "off": Scaled(1.1)}, examples=2)
    assert done.results["right"]["depth"]["all"]["pooled"]["abs_rel"] < 1e-4  # the disk's rounding
    assert done.results["off"]["depth"]["all"]["per_image"]["abs_rel"] == pytest.approx(0.1, abs=1e-4)
    assert done.results["off"]["median_image"]["abs_rel"] == pytest.approx(0.1, abs=1e-4)
    assert done.results["off"]["depth"]["rock"]["pixels"] == 4 * 200
    assert done.results["off"]["normal"]["all"]["pooled"] == {}
    assert [(record["index"], record["pair"]) for record in done.pairs] == [(i, f"00001/0{i}") for i in range(4)]
    assert {record["scene"] for record in done.pairs} == {"00001"}
    assert [example.index for example in done.examples] == [0, 3]

    assert done.results["off"]["seconds"]["median"] > 0


def test_the_worst_pairs_of_the_first_method_are_kept_in_order(folder):
    done = evaluate(StereoDataset(folder, "test"), {"worse": Worse(), "right": Scaled(1.0)}, worst=2)
    errors = {record["index"]: record["worse"]["epe"] for record in done.pairs}
    assert [example.index for example in done.worst] == sorted(errors, key=lambda index: -errors[index])[:2] == [3, 2]
    assert list(done.worst[0].predictions) == ["worse", "right"]


def test_limit_spreads_over_the_dataset(folder):
    done = evaluate(StereoDataset(folder, "test"), {"m": Scaled()}, limit=2)
    assert [record["index"] for record in done.pairs] == [0, 3]
    with pytest.raises(ValueError, match="limit"):
        evaluate(StereoDataset(folder, "test"), {"m": Scaled()}, limit=0)


def test_degradation_is_what_methods_see_and_depends_on_seed_and_pair_alone(folder):
    degradation, runs = Degradation.parse("contrast=.5,noise=3"), []
    for limit, seed in ((None, 0), (2, 0), (None, 1)):
        method = Scaled()
        evaluate(StereoDataset(folder, "test"), {"m": method}, limit=limit, degradation=degradation, seed=seed)
        runs.append(method.images)
    assert np.array_equal(runs[0][-1], runs[1][-1])
    assert not np.array_equal(runs[0][-1], runs[2][-1])
    clean = StereoDataset(folder, "test")[3].left
    assert runs[0][-1].std() == pytest.approx(np.hypot(0.5 * clean.std(), 3), rel=0.05)


def test_every_pair_has_noise_of_its_own(plane_samples):
    grey = replace(plane_samples[0], left=np.full_like(plane_samples[0].left, 128))
    method = Scaled()
    evaluate([grey, grey], {"m": method}, degradation=Degradation(noise=3.0))
    to_warm_up, first, second = method.images
    assert np.array_equal(to_warm_up, first) and not np.array_equal(first, second)


def test_wrong_size_names_the_method(folder):
    class Wrong(Scaled):
        def infer(self, left, right, rig):
            return replace(super().infer(left, right, rig), depth=np.ones((2, 2), np.float32))

    with pytest.raises(ValueError, match=r"bad, pair 00001/00: Wrong\.infer returned depth of shape \(2, 2\)"):
        evaluate(StereoDataset(folder, "test"), {"bad": Wrong()})


def test_command_writes_tables_and_figures(folder, tmp_path, capsys):
    torch = pytest.importorskip("torch")
    from m3depth.network.model import M3Depth, M3DepthConfig

    torch.manual_seed(0)
    weights = tmp_path / "w.safetensors"
    M3Depth(M3DepthConfig(channels=(8, 8, 16), match_channels=16, hypotheses=8, refine_steps=1)).save_pretrained(
        weights
    )
    out = tmp_path / "out"
    args = ["--data", str(folder), "--out", str(out), "--weights", str(weights), "--limit", "2"]
    assert main([*args, "--degrade", "blur=0.5"]) == 0
    assert "Abs Rel" in capsys.readouterr().out
    results = json.loads((out / "results.json").read_text())
    assert list(results["methods"]) == ["w", "SGBM"]
    digest = hashlib.sha256(weights.read_bytes()).hexdigest()
    assert results["weights_sha256"] == digest and results["weights"] == str(weights)
    assert results["runtime"] == recorded_runtime(["m3depth"], device=results["device"])
    assert results["estimators"] == {
        "w": {"name": f"m3depth:{weights}", "sha256": digest},
        "SGBM": {"name": "sgbm", "sha256": None},
    }
    page = (Path(__file__).parents[2] / "docs/concepts/result-files.md").read_text(encoding="utf-8")
    assert [key for key in (*results, *results["methods"]["w"]) if f"`{key}`" not in page] == []
    assert results["pairs"] == 2 and results["degrade"] == "blur=0.5"
    assert results["methods"]["SGBM"]["depth"]["visible"]["pooled"]["epe"] < 1
    report = (out / "results.md").read_text()
    assert "| SGBM |" in report and "14-15 m" in report and "nan" not in report
    for name in (f"{figure}.png" for figure in FIGURES):
        picture = cv2.imread(str(out / name))
        assert picture.shape[0] > 300 and picture.std() > 10


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"--data": "nowhere"}, "nowhere: no such folder"),
        ({"--split": "val"}, "split val holds no pairs"),
        ({"--weights": "none.safetensors"}, "--weights none.safetensors: no such weights file; give a weights"),
        ({"--limit": "0"}, "--limit must be at least 1"),
        ({"--seed": "-1", "--degrade": "noise=2"}, "--seed must not be negative, got -1"),
        ({"--degrade": "fog=1"}, "error: --degrade: unknown field 'fog'"),
        ({"--degrade": "blur=x"}, "blur must be a number, got 'x'"),
        ({"--max-pixels": "2047"}, "--max-pixels must be at least 2048, got 2047"),
        ({"--max-pixels": "4096"}, "--max-pixels: no method that is scored takes such a setting; leave it out"),
        ({"--estimator": "raft"}, "--estimator 'raft' is unknown; choose from m3depth, sgbm, m3depth:WEIGHTS"),
        ({"--estimator": "m3depth:none.safetensors"}, "--estimator none.safetensors: no such weights file; give a"),
        ({"--estimator": "m3depth.stereo.classical:Nothing"}, "has no class 'Nothing'"),
        ({"--predictions": "raft"}, "--predictions raft: expected NAME=DIR[,depth][,scale=S][,fill]"),
        ({"--predictions": "A=nowhere"}, "nowhere: no such folder"),
        ({"--predictions": "A=.,scale=0"}, "scale must be a number other than 0"),
        ({"--predictions": "SGBM=."}, "the name 'SGBM' is taken"),
        ({"--predictions": "pair=."}, "the name 'pair' is taken"),
        ({"--estimator": "SGBM=m3depth.stereo.classical:BlockMatching"}, "the name 'SGBM' is taken"),
        ({"--estimator": "M3Depth=m3depth.stereo.classical:SGBM"}, "the name 'M3Depth' is taken"),
        ({"--estimator": "index=m3depth.stereo.classical:SGBM"}, "the name 'index' is taken"),
    ],
)
def test_mistakes_exit_with_2_and_one_line(folder, tmp_path, capsys, monkeypatch, change, message):
    monkeypatch.setattr(f"{METHODS}.load_estimator", _without_network)
    options = {"--data": str(folder), "--out": str(tmp_path / "out"), **change}
    assert main([word for pair in options.items() for word in pair]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_name_given_twice_is_refused(folder, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(f"{METHODS}.load_estimator", _without_network)
    twice = ["A=m3depth.stereo.classical:SGBM", "A=m3depth.stereo.classical:BlockMatching"]
    assert main(["--data", str(folder), "--out", str(tmp_path / "out"), "--estimator", *twice]) == 2
    assert "the name 'A' is taken" in capsys.readouterr().err


def test_every_classical_method_and_saved_predictions_in_one_run(folder, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("m3depth.figures.evaluation.draw_evaluation", lambda *_: None)
    monkeypatch.setattr(f"{METHODS}.load_estimator", _without_network)
    saved = tmp_path / "saved"
    saved.mkdir()
    for i, sample in enumerate(StereoDataset(folder, "test")):
        np.save(saved / f"00001_0{i}.npy", -2 * sample.disparity)
    out = tmp_path / "out"
    args = ["--data", str(folder), "--out", str(out), "--limit", "2", "--baselines", "all"]
    assert main([*args, "--predictions", f"Saved={saved},scale=-2"]) == 0
    methods = json.loads((out / "results.json").read_text())["methods"]
    names = ["M3Depth", "SGBM", "SGBM-HH", "SSD", "SAD", "NCC", "SSD-SGM", "SAD-SGM", "NCC-SGM", "Saved"]
    assert list(methods) == names
    assert methods["Saved"]["depth"]["all"]["pooled"]["abs_rel"] < 1e-3
    assert all(methods[name]["depth"]["visible"]["pooled"]["epe"] < 1.5 for name in names)
    assert all(methods[name]["seconds"]["median"] > 0 for name in names[:-1]) and methods["Saved"]["seconds"] is None
    printed = [line.split() for line in capsys.readouterr().out.splitlines()[1 : 1 + len(names)]]
    assert [row[0] for row in printed] == names
    decimals = [
        {len(cell.partition(".")[2]) for cell in column if cell != "-"} for column in zip(*printed, strict=True)
    ]
    assert decimals[1:] == [{4}, {4}, {3}, {4}, {4}, {4}, {4}, {3}, {4}, {2}, {2}]  # one number in each column
    report = (out / "results.md").read_text()
    assert "| Saved, fitted to its depth |" in report and "| fitted to the true depth |" in report


def test_a_saved_prediction_that_is_missing_or_broken_is_named(folder, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(f"{METHODS}.load_estimator", _without_network)
    np.save(tmp_path / "00001_00.npy", np.zeros((2, 2)))
    args = ["--data", str(folder), "--out", str(tmp_path / "out"), "--predictions", f"Saved={tmp_path}"]
    assert main(args) == 2
    assert "no disparity of pair 00001/01" in capsys.readouterr().err
    assert main([*args, "--limit", "1"]) == 2
    error = capsys.readouterr().err
    assert "00001_00.npy: is of shape (2, 2)" in error and error.count("\n") == 1


def test_the_first_call_is_not_timed(folder, monkeypatch):
    timed = []

    def watched(call, *args):
        timed.append(args)
        return measured(call, *args)

    monkeypatch.setattr("m3depth.evaluation.scoring.measured", watched)
    method = Scaled()
    done = evaluate(StereoDataset(folder, "test"), {"m": method})
    assert (len(timed), len(method.images)) == (4, 5)
    assert np.array_equal(method.images[0], method.images[1])
    assert set(done.results["m"]["memory_mib"]) == {"process", "gpu"}


def test_the_costs_of_the_pairs_before_a_stop_count(folder, tmp_path, monkeypatch):
    costs = iter([Cost(1.0, 90.0, None), Cost(2.0, 20.0, None), Cost(4.0, 30.0, None), Cost(9.0, 40.0, None)])
    monkeypatch.setattr("m3depth.evaluation.scoring.measured", lambda call, *args: (call(*args), next(costs)))
    before, after = (Scoring(StereoDataset(folder, "test"), {"m": Scaled()}, None, 0, 192.0) for _ in range(2))
    saved_state = SavedState(tmp_path, {})
    before.add(0)
    before.add(1)
    saved_state.save(before.state_dict())
    after.load_state_dict(saved_state.load())
    after.add(2)
    after.add(3)
    figures = after.result().results["m"]
    assert figures["seconds"] == {"median": 3.0, "mean": 4.0}
    assert figures["memory_mib"] == {"process": 90.0, "gpu": None}


class Stops(Scaled):
    """The truth with an error that depends on the image; gets a signal, or fails, in a given call."""

    def __init__(self, call: int, signal_number: int | None) -> None:
        super().__init__()
        self.call, self.signal = call, signal_number

    def infer(self, left, right, rig):
        if len(self.images) + 1 == self.call:
            if self.signal is None:
                raise OSError("the camera is gone")
            os.kill(os.getpid(), self.signal)
        self.images.append(left)
        return Scaled(1 + 0.001 * (int(left.sum()) % 100)).infer(left, right, rig)


@pytest.mark.parametrize(
    ("signal_number", "kept"), [(signal.SIGINT, 2), (signal.SIGTERM, 2), (None, 1)], ids=["ctrl-c", "term", "failure"]
)
def test_a_stopped_evaluation_continues_to_the_same_result(folder, tmp_path, capsys, monkeypatch, signal_number, kept):
    """Of four pairs. Without a signal, as by kill -9, only the state after the previous pair is saved."""
    monkeypatch.setattr("m3depth.evaluation.resume.SECONDS", 0.0)
    monkeypatch.setattr("m3depth.figures.evaluation.draw_evaluation", lambda done, out: drawn.append(done))
    drawn: list = []
    method = Stops(0, None)
    monkeypatch.setattr(f"{METHODS}.load_estimator", lambda spec, *_, **__: method)
    arguments = ["--data", str(folder), "--baselines", "none", "--degrade", "noise=2"]
    assert main([*arguments, "--out", str(tmp_path / "whole")]) == 0
    method = Stops(3, signal_number)  # in the second pair: methods receive the first one twice
    stopped = [*arguments, "--out", str(tmp_path / "stopped")]
    assert main(stopped) == (2 if signal_number is None else 130)
    assert ("the camera is gone" if signal_number is None else "the same command goes on") in capsys.readouterr().err
    assert not (tmp_path / "stopped/results.json").exists() and (tmp_path / "stopped/unfinished.npz").exists()

    assert main([*stopped, "--seed", "1"]) == 2
    assert "unfinished.npz: belongs to an unfinished evaluation with another --seed; choose" in capsys.readouterr().err
    method = Stops(0, None)
    assert main(stopped) == 0
    assert f"{kept} of 4 pairs are scored already" in capsys.readouterr().err
    whole, again = (_without_costs(tmp_path / name / "results.json") for name in ("whole", "stopped"))
    assert again == whole
    first, second = drawn
    assert [e.index for e in first.examples] == [e.index for e in second.examples] == [0, 2, 3]
    assert [e.index for e in first.worst] == [e.index for e in second.worst]
    for one, other in zip([*first.examples, *first.worst], [*second.examples, *second.worst], strict=True):
        assert np.array_equal(one.left, other.left)
        assert np.array_equal(one.predictions["M3Depth"].depth, other.predictions["M3Depth"].depth)
    assert sorted(file.name for file in (tmp_path / "stopped").iterdir()) == ["results.json", "results.md"]


@pytest.mark.parametrize(
    "change", ["--predictions", "their normals", "--estimator", "--device", "--runtime", "weights of an estimator"]
)
def test_a_stopped_evaluation_does_not_continue_with_other_inputs(folder, tmp_path, capsys, monkeypatch, change):
    """The command is the same; the content of its files, the device or the runtime has changed."""
    monkeypatch.setattr("m3depth.evaluation.resume.SECONDS", 0.0)
    monkeypatch.setattr("m3depth.figures.evaluation.draw_evaluation", lambda *_: None)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    module, weights, maps = tmp_path / "my_class_of_today.py", tmp_path / "w.safetensors", tmp_path / "maps"
    module.write_text("class Mine:\n    pass\n")
    monkeypatch.delitem(sys.modules, module.stem, raising=False)  # that of another case
    weights.write_bytes(b"weights")
    maps.mkdir()
    pairs = StereoDataset(folder, "test")
    for name, sample in zip(pairs.names, pairs, strict=True):
        np.save(maps / f"{name.replace('/', '_')}.npy", sample.disparity)
    method = Stops(3, signal.SIGINT)
    monkeypatch.setattr(f"{METHODS}.load_estimator", lambda spec, *_, **__: method)
    arguments = ["--data", str(folder), "--out", "out", "--baselines", "none", "--predictions", "Read=maps"]
    arguments += ["--estimator", "Mine=my_class_of_today:Mine", "Old=m3depth:w.safetensors"]
    assert main(arguments) == 130
    changed = change
    if change == "--predictions":
        os.utime(maps / f"{pairs.names[0].replace('/', '_')}.npy", (1, 1))
    elif change == "their normals":
        np.save(maps / f"{pairs.names[-1].replace('/', '_')}_normal.npy", pairs[len(pairs) - 1].normal)
        changed = "--predictions"
    elif change == "--estimator":
        module.write_text("class Mine:\n    better = True\n")
    elif change == "--device":
        for caller in ("evaluation.command.methods", "runtimes.choice"):
            monkeypatch.setattr(f"m3depth.{caller}.chosen_device", lambda wanted: torch.device("meta"))
        changed = "--device, another --runtime"  # whose record names the device
    elif change == "--runtime":
        monkeypatch.setattr(f"{METHODS}.recorded_runtime", lambda *_: "openvino 1.0")
    else:
        weights.write_bytes(b"others")
        changed = "--estimator"
    capsys.readouterr()
    assert main(arguments) == 2
    assert f"belongs to an unfinished evaluation with another {changed}; choose" in capsys.readouterr().err


def test_a_stopped_evaluation_continues_with_the_same_weights_by_another_path(folder, tmp_path, monkeypatch):
    monkeypatch.setattr("m3depth.evaluation.resume.SECONDS", 0.0)
    monkeypatch.setattr("m3depth.figures.evaluation.draw_evaluation", lambda *_: None)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "w.safetensors").write_bytes(b"weights")
    (tmp_path / "elsewhere").mkdir()
    method = Stops(3, signal.SIGINT)
    monkeypatch.setattr(f"{METHODS}.load_estimator", lambda spec, *_, **__: method)
    arguments = ["--data", str(folder), "--out", str(tmp_path / "out"), "--baselines", "none", "--weights"]
    assert main([*arguments, "w.safetensors"]) == 130
    monkeypatch.chdir("elsewhere")
    assert main([*arguments, "../w.safetensors"]) == 0


def test_a_stopped_evaluation_of_another_network_does_not_continue_in_another_precision(
    folder, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr("m3depth.evaluation.resume.SECONDS", 0.0)
    monkeypatch.setattr("m3depth.figures.evaluation.draw_evaluation", lambda *_: None)
    weights = tmp_path / "raft.safetensors"
    new_network(TINY["raft-stereo"]).save_pretrained(weights)
    out = tmp_path / "out"
    arguments = ["--data", str(folder), "--out", str(out), "--baselines", "none", "--weights", str(weights)]
    method = Stops(3, signal.SIGINT)
    monkeypatch.setattr(f"{METHODS}.load_estimator", lambda spec, *_, **__: method)
    monkeypatch.setattr("m3depth.runtimes.choice.fast_dtype", lambda device: torch.bfloat16)
    assert main(arguments) == 130
    monkeypatch.setattr("m3depth.runtimes.choice.fast_dtype", lambda device: None)
    capsys.readouterr()
    assert main(arguments) == 2
    assert "belongs to an unfinished evaluation with another --runtime; choose" in capsys.readouterr().err
    monkeypatch.setattr("m3depth.runtimes.choice.fast_dtype", lambda device: torch.bfloat16)
    method = Stops(0, None)
    assert main(arguments) == 0
    results = json.loads((out / "results.json").read_text())
    assert results["runtime"] == recorded_runtime([f"m3depth:{weights}"], device=results["device"])
    assert results["runtime"].startswith("pytorch ") and results["runtime"].endswith(" bf16")


def test_a_state_that_lacks_something_is_damaged(folder, tmp_path):
    saved_state = SavedState(tmp_path, {})
    saved_state.save({"pairs": [], "scores": {}})
    with pytest.raises(SavedStateError, match="not a readable state"):
        evaluate(StereoDataset(folder, "test"), {"m": Scaled()}, saved_state=saved_state)


@pytest.mark.parametrize("names", [list(CLASSICAL), ["all"]])
def test_baselines_takes_every_classical_method_that_is_registered(names):
    options = parse(EvaluateOptions, "evaluate", None, ["--data", "data", "--out", "out", "--baselines", *names])
    assert [name.name for _, name in named_estimators(options).values()] == ["m3depth", *CLASSICAL]


def test_the_largest_scored_disparity_is_a_flag(folder, tmp_path, capsys, monkeypatch):
    """make_frame shows up to 15 px."""
    monkeypatch.setattr("m3depth.figures.evaluation.draw_evaluation", lambda *_: None)
    monkeypatch.setattr(f"{METHODS}.load_estimator", _without_network)
    for limit, has_near in (("192", False), ("8", True)):
        out = tmp_path / limit
        arguments = ["--data", str(folder), "--out", str(out), "--baselines", "none", "--max-disparity", limit]
        assert main([*arguments, "--estimator", "sgbm", "--limit", "1", "--device", "cpu"]) == 0
        assert ("have a disparity above --max-disparity (8 px); this table" in capsys.readouterr().err) == has_near
        content = json.loads((out / "results.json").read_text())
        depth = content["methods"]["SGBM"]["depth"]
        assert content["max_disparity_px"] == float(limit) and (depth["near"]["pixels"] > 0) == has_near
    assert main([*arguments, "--max-disparity", "0"]) == 2
    assert "--max-disparity must be positive, got 0" in capsys.readouterr().err


def test_the_word_shipped_names_the_shipped_weights_beside_others(tmp_path):
    weights = Path("shipped"), tmp_path / "mine.safetensors"
    options = EvaluateOptions(tmp_path, tmp_path, weights=weights, baselines=())
    names = named_estimators(options)
    assert list(names) == ["M3Depth", "mine"] and names["M3Depth"][1].weights == SHIPPED_WEIGHTS


def test_networks_work_on_fewer_pixels_and_the_results_say_so(folder, tmp_path, monkeypatch, capsys) -> None:
    taken = []

    class Takes(Scaled):
        def infer(self, left, right, rig, max_pixels=None):
            taken.append(max_pixels)
            return super().infer(left, right, rig)

    given = {"m3depth": Takes(1.0), "sgbm": Scaled(1.1)}
    monkeypatch.setattr(f"{METHODS}.load_estimator", lambda name, *_, **__: given[name])
    monkeypatch.setattr("m3depth.figures.evaluation.draw_evaluation", lambda *_: None)
    out = tmp_path / "out"
    assert main(["--data", str(folder), "--out", str(out), "--limit", "1", "--max-pixels", "4096"]) == 0
    assert taken == [4096, 4096]  # the first call of a method is made twice
    results = json.loads((out / "results.json").read_text())
    assert results["max_pixels"] == 4096 and list(results["methods"]) == ["M3Depth", "SGBM"]
    assert "1 pair, split test" in (report := (out / "results.md").read_text())
    assert ", by networks on at most 4096 pixels of an image. Weights: shipped." in report


def test_none_and_a_classical_method_exclude_each_other(folder, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(f"{METHODS}.load_estimator", _without_network)
    assert main(["--data", str(folder), "--out", str(tmp_path / "out"), "--baselines", "none", "sgbm"]) == 2
    assert capsys.readouterr().err == "error: --baselines none excludes other names: give none, or the names\n"


def _without_costs(file: Path) -> dict:
    content = json.loads(file.read_text())
    for result in content["methods"].values():
        del result["seconds"], result["memory_mib"]
    for record in content["per_pair"]:
        assert record["M3Depth"].pop("seconds") > 0
    return content


def test_bad_names_and_seeds_are_refused_by_the_function_too(folder):
    with pytest.raises(ValueError, match="'index'"):
        evaluate(StereoDataset(folder, "test"), {"index": Scaled()})
    with pytest.raises(ValueError, match="seed must not be negative"):
        evaluate(StereoDataset(folder, "test"), {"m": Scaled()}, seed=-1)


def test_several_weights_are_scored_in_one_table_under_names_of_their_own(folder, tmp_path, monkeypatch):
    """Also by --estimator; what is named twice has one column."""
    loaded = []

    def load(name, role, **where):
        loaded.append(name)
        return Scaled(1 + 0.1 * len(loaded))

    monkeypatch.setattr(f"{METHODS}.load_estimator", load)
    monkeypatch.setattr("m3depth.figures.evaluation.draw_evaluation", lambda *_: None)
    files = [tmp_path / name / "weights.safetensors" for name in ("first/run", "second/run", "third")]
    for file in files:
        file.parent.mkdir(parents=True)
        file.write_bytes(str(file).encode())
    named = [f"Mine=m3depth:{files[2]}", f"m3depth:{files[2]}", "m3depth", "sgbm", "ncc"]
    args = ["--data", str(folder), "--out", str(tmp_path / "out"), "--limit", "1"]
    assert main([*args, "--weights", str(files[0]), str(files[1]), "--estimator", *named]) == 0
    results = json.loads((tmp_path / "out/results.json").read_text())
    columns = ["first/run", "second/run", "SGBM", "Mine", "third", "M3Depth", "NCC"]
    assert list(results["methods"]) == list(results["estimators"]) == columns
    assert loaded == [results["estimators"][column]["name"] for column in columns]
    assert results["weights_sha256"] == hashlib.sha256(files[0].read_bytes()).hexdigest()
    errors = [results["methods"][column]["depth"]["all"]["pooled"]["abs_rel"] for column in columns]
    assert errors == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7], abs=1e-3)
    assert "| first/run |" in (tmp_path / "out/results.md").read_text()


def test_the_drives_read_the_scores_of_each_weights(folder, tmp_path, monkeypatch):
    """results.json as envs.evaluate --scores reads it."""
    test_set_errors = pytest.importorskip("envs.evaluation.test_set_errors")
    scales = {"sgbm": 1.1}
    monkeypatch.setattr(f"{METHODS}.load_estimator", lambda name, *_, **__: Scaled(scales.get(name, 1.2)))
    monkeypatch.setattr("m3depth.figures.evaluation.draw_evaluation", lambda *_: None)
    weights = tmp_path / "w.safetensors"
    weights.write_bytes(b"weights")
    args = ["--data", str(folder), "--out", str(tmp_path / "out"), "--limit", "1", "--weights", str(weights)]
    assert main(args) == 0
    arguments = {"m3depth:w": hashlib.sha256(b"weights").hexdigest(), "sgbm": None}
    errors = test_set_errors.errors_on_test_set([tmp_path / "out/results.json"], arguments)
    assert errors == {"m3depth:w": pytest.approx(0.2, abs=1e-3), "sgbm": pytest.approx(0.1, abs=1e-3)}


def test_progress_is_printed_where_there_is_no_terminal(folder, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(f"{METHODS}.load_estimator", _without_network)
    monkeypatch.setattr("m3depth.figures.evaluation.draw_evaluation", lambda *_: None)
    monkeypatch.setattr("marssim.base.command.progress.LINE_SECONDS", 0.0)
    assert main(["--data", str(folder), "--out", str(tmp_path / "out"), "--baselines", "none"]) == 0
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("evaluate: ")]
    assert [line.partition(" pairs")[0] for line in lines] == [f"evaluate: {done}/4" for done in (1, 2, 3, 4)]


def test_results_record_which_shipped_weights_were_scored(folder, tmp_path, monkeypatch):
    shipped = tmp_path / "lite.safetensors"
    shipped.write_bytes(b"some weights")
    monkeypatch.setattr("m3depth.estimator.SHIPPED_WEIGHTS", shipped)
    monkeypatch.setattr("m3depth.figures.evaluation.draw_evaluation", lambda *_: None)
    monkeypatch.setattr(f"{METHODS}.load_estimator", _without_network)
    out = tmp_path / "out"
    assert main(["--data", str(folder), "--out", str(out), "--baselines", "none", "--limit", "1"]) == 0
    results = json.loads((out / "results.json").read_text())
    assert results["weights"] == "shipped"
    assert results["weights_sha256"] == hashlib.sha256(b"some weights").hexdigest()


def _without_network(spec, *role, **where):
    from m3depth.estimator import load_estimator

    return SGBM() if spec == "m3depth" else load_estimator(spec, *role)


def test_broken_sample_is_named(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(f"{METHODS}.load_estimator", _without_network)
    write_sample(tmp_path / "scenes" / "00001/00", make_frame(0), {})
    write_index(tmp_path, {}, ["00001/00"])
    (tmp_path / "scenes/00001/00/depth.png").write_bytes(b"")
    assert main(["--data", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert "depth.png" in error and error.strip().count("\n") == 0


def test_split_all_scores_every_split(tmp_path) -> None:
    names = ["00000/00", "00001/00", "00002/00"]  # one scene of each split
    for name in names:
        write_sample(tmp_path / "scenes" / name, make_frame(0), {})
    write_index(tmp_path, {}, names)
    for split, count in (("test", 1), ("all", 3)):
        dataset, _ = prepare(EvaluateOptions(tmp_path, tmp_path / "out", split=split, baselines=("none",)))
        assert len(dataset) == count


def test_a_class_that_returns_no_prediction_is_reported_in_one_line(folder, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(f"{METHODS}.load_estimator", _without_network)
    code = "class Tup:\n    def infer(self, left, right, rig):\n        return left[..., 0]\n"
    (tmp_path / "tup_stereo.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    arguments = ["--baselines", "none", "--limit", "1", "--estimator", "tup_stereo:Tup", "--out", str(tmp_path / "out")]
    assert main(["--data", str(folder), *arguments]) == 2
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert error.startswith(
        f"error: Tup, pair 00001/00: Tup.infer returned an array of shape ({H}, {W}): it must be a Prediction"
    )


def test_results_of_another_command_are_not_replaced(folder, tmp_path, capsys):
    """Results of drives stay; those of an earlier scoring are replaced."""
    results = tmp_path / "results.json"
    results.write_text('{"differences": []}')
    with pytest.raises(DatasetError, match=r"results\.json is of another command"):
        prepare(EvaluateOptions(folder, tmp_path, baselines=("none",)))
    results.write_text('{"per_pair": []}')
    prepare(EvaluateOptions(folder, tmp_path, baselines=("none",)))
