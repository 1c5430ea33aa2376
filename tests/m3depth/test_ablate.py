"""The ablation from the command line to its tables, with a tiny network."""

import json
import os
import shutil
import signal
from dataclasses import fields, replace
from pathlib import Path

import cv2
import pytest
import torch
from small_network import SMALL

from m3depth.ablate import main
from m3depth.ablation import runs as ablation
from m3depth.ablation.config import AblateOptions
from m3depth.ablation.runs import SETTINGS, padded_crops, plan
from m3depth.network import config as network_config
from m3depth.network.model import M3Depth
from m3depth.training import loop as training
from m3depth.training.config import PAPER

pytestmark = pytest.mark.usefixtures("undrawn_figures")

TINY = replace(SMALL, wavelet_levels=(2, 2))  # as many as `lite` has, one of the rows of the study of levels


@pytest.fixture(autouse=True, scope="module")
def small_network():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(network_config.PRESETS, "lite", TINY)
        yield
    torch.set_num_threads(threads)


def flags(data: Path, out: Path, *more: str) -> list[str]:
    return ["--data", str(data), "--out", str(out), "--batch", "2", "--crop", "32", "64", "--device", "cpu", *more]


@pytest.fixture(scope="module")
def ablated(plane_set, tmp_path_factory) -> Path:
    """A finished ablation: components, three steps a run."""
    out = tmp_path_factory.mktemp("done") / "ablation"
    assert main(flags(plane_set, out, "--steps", "3", "--studies", "components")) == 0
    return out


@pytest.fixture
def trained(monkeypatch) -> list[str]:
    """Names of the trained runs, in order."""
    names: list[str] = []

    def noted(config, samples, held_out):
        names.append(config.out.name)
        return training.train(config, samples, held_out)

    monkeypatch.setattr(ablation, "train", noted)
    return names


def rows_of(out: Path) -> list[dict]:
    return json.loads((out / "results.json").read_text())["studies"]["components"]["rows"]


def test_a_study_is_trained_scored_and_reported(ablated) -> None:
    results = json.loads((ablated / "results.json").read_text())
    assert (results["steps"], results["seeds"], results["crop"]) == (3, [0], [32, 64])
    for row, name in zip(rows_of(ablated), ("no-wefe-no-irm", "no-wefe", "no-irm", "base"), strict=True):
        folder = ablated / "runs" / f"{name}-0"
        saved = json.loads((folder / "score.json").read_text())
        pairs = [record["M3Depth"]["abs_rel"] for record in saved["per_pair"]]
        assert len(pairs) == 2 and row["here"]["abs_rel"] == pytest.approx(sum(pairs) / 2)
        assert row["here"]["abs_rel"] == pytest.approx(saved["result"]["depth"]["all"]["per_image"]["abs_rel"])
        assert row["here"]["normal_mean"] == pytest.approx(saved["result"]["normal"]["all"]["per_image"]["mean"])
        assert [run["steps"] for run in row["runs"]] == [3]
        config = M3Depth.from_pretrained(folder / "weights.safetensors").config
        assert config.refine_steps == (0 if "no-irm" in name else 2)
        assert config.wavelet_levels == ((0, 0) if "no-wefe" in name else (2, 2))
    report = (ablated / "results.md").read_text()
    assert "| (b) IRM | 0.115 |" in report and "IRM, without WEFE. Paper: Abs Rel falls by 5.0 %; here it " in report
    assert cv2.imread(str(ablated / "components.png")).shape[1] > 1000
    assert cv2.imread(str(ablated / "components_maps.png")).shape[1] > 1000


def test_runs_are_shared_between_studies(tmp_path) -> None:
    options = AblateOptions((tmp_path,), tmp_path, steps=1)
    for name in ("data", "studies", "seeds"):
        with pytest.raises(ValueError, match=f"{name} must name at least one"):
            replace(options, **{name: ()})
    names = [run.folder.name for run in plan(options)]
    assert len(names) == len(set(names)) == 22
    both = replace(options, studies=("components", "loss"), seeds=(0, 1, 0))
    runs = plan(both)
    assert [run.folder.name for run in runs[:2]] == ["base-0", "no-wefe-no-irm-0"] and len(runs) == 2 * (4 + 5)
    equal = {(c.data, c.max_steps, c.max_minutes, c.batch, c.crop, c.lr, c.augment) for c in (r.config for r in runs)}
    assert len(equal) == 1
    assert {run.config.seed for run in runs[:9]} == {0} and {run.config.seed for run in runs[9:]} == {1}
    assert len({run.config.loss for run in runs}) == 6


def test_all_runs_are_trained_by_the_recipe(tmp_path) -> None:
    """Beside its network and what its study changes in the loss, each has PAPER's settings but for the flags."""
    options = AblateOptions((tmp_path,), tmp_path, steps=1, preset="paper-thin", recipe="paper", batch=6)
    runs = {run.variant.name: run.config for run in plan(options)}
    own = {"data", "out", "network", "max_steps", "batch", "crop", "validate_every", "validate_samples"}
    for name, config in runs.items():
        changed = {f.name for f in fields(config) if getattr(config, f.name) != getattr(PAPER, f.name)}
        assert changed == own | ({"loss"} if name.startswith("loss-") else set()) and config.batch == 6
    assert runs["loss-1-2-3"].loss == replace(PAPER.loss, disparity=1, normal=2, consistency=3)
    others = {run.variant.name: run.config for run in plan(replace(options, recipe="own"))}
    assert others.keys() == runs.keys() and not any(config.loss.depth for config in others.values())


def test_an_ablation_by_the_papers_recipe_says_so_and_is_not_continued_by_another(plane_set, tmp_path, capsys) -> None:
    out = tmp_path / "paper_recipe"
    arguments = flags(plane_set, out, "--steps", "1", "--studies", "consistency", "--recipe")
    assert main([*arguments, "paper"]) == 0
    assert "Preset `lite`, recipe `paper`. Every run: 1 steps" in capsys.readouterr().out
    score = json.loads((out / "runs/base-0/score.json").read_text())
    assert score["loss"]["depth"] is True and score["loss"]["rock"] == 1
    assert main([*arguments, "own"]) == 2
    assert "recipe" in capsys.readouterr().err


def test_finished_runs_are_kept_and_seeds_can_be_added(plane_set, ablated, tmp_path, trained, capsys) -> None:
    out = tmp_path / "again"
    shutil.copytree(ablated, out)
    arguments = flags(plane_set, out, "--steps", "3", "--studies", "components")
    assert main(arguments) == 0 and trained == []
    before, weights = rows_of(out), (out / "runs" / "base-0" / "weights.safetensors").read_bytes()
    assert before == rows_of(ablated)
    assert main([*arguments, "--seeds", "0", "1"]) == 0
    assert trained == ["base-1", "no-wefe-no-irm-1", "no-wefe-1", "no-irm-1"]
    assert (out / "runs" / "base-0" / "weights.safetensors").read_bytes() == weights
    for old, new in zip(before, rows_of(out), strict=True):
        one, other = (new["by_seed"][seed]["normal_mean"] for seed in ("0", "1"))
        assert one == old["here"]["normal_mean"] != other
        assert new["here"]["normal_mean"] == pytest.approx((one + other) / 2)
    assert "will lack" not in capsys.readouterr().err
    assert main(flags(plane_set, out, "--steps", "3", "--studies", "components", "--seeds", "1")) == 0
    assert f"warning: {out / 'results.md'} will lack seed 0, which it has now; name all" in capsys.readouterr().err


def test_scored_runs_go_on_elsewhere_without_their_weights(plane_set, ablated, tmp_path, trained) -> None:
    out = tmp_path / "elsewhere"
    kept = [*ablated.glob("runs/*-0/score.json"), *ablated.glob("runs/*-0/network.json"), ablated / SETTINGS]
    for file in kept:
        copy = out / file.relative_to(ablated)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(file, copy)
    assert len(kept) == 9
    moved = shutil.copytree(plane_set, tmp_path / "moved")
    assert main(flags(moved, out, "--steps", "3", "--studies", "components")) == 0 and trained == []
    assert rows_of(out) == rows_of(ablated) and not (out / "components_maps.png").exists()
    assert f"`{moved}`" in (out / "results.md").read_text()


def test_a_killed_ablation_ends_in_the_same_figures(plane_set, ablated, tmp_path, trained, monkeypatch, capsys) -> None:
    """SIGTERM comes in the second run; the same command then gives the report of one that was not stopped."""
    step, calls = training.backward, []

    def killed(*args):
        calls.append(1)
        if len(calls) == 5:  # the second step of the second run
            os.kill(os.getpid(), signal.SIGTERM)
        return step(*args)

    out = tmp_path / "stopped"
    arguments = flags(plane_set, out, "--steps", "3", "--studies", "components")
    with monkeypatch.context() as patch:
        patch.setattr(training, "backward", killed)
        assert main(arguments) == 130
    assert "the same command goes on from here" in capsys.readouterr().err
    assert trained == ["base-0", "no-wefe-no-irm-0"] and not (out / "runs" / trained[-1] / "score.json").exists()
    assert [row["here"]["abs_rel"] is None for row in rows_of(out)] == [True, True, True, False]  # base is done
    trained.clear()
    assert main(arguments) == 0
    assert trained == ["no-wefe-no-irm-0", "no-wefe-0", "no-irm-0"]
    assert [row["here"] for row in rows_of(out)] == [row["here"] for row in rows_of(ablated)]


def test_a_run_without_a_finite_loss_does_not_stop_the_others(plane_set, tmp_path, monkeypatch, capsys) -> None:
    step = training.backward

    def broken(network, batch, config, dtype):
        loss, terms = step(network, batch, config, dtype)
        return loss * (float("nan") if config.out.name == "no-wefe-0" else 1), terms

    monkeypatch.setattr(training, "backward", broken)
    out = tmp_path / "ablation"
    assert main(flags(plane_set, out, "--steps", "1", "--studies", "components")) == 1
    error = capsys.readouterr().err
    assert "no-wefe-0: training has diverged: loss is not finite at step 0" in error
    assert "--lr" not in error  # which this command lacks
    assert error.endswith(f"error: {out}: the tables lack no-wefe-0, whose loss was not finite\n")
    assert "**Left out, since their loss was not finite: no-wefe-0.**" in (out / "results.md").read_text()
    assert [row["here"]["abs_rel"] is None for row in rows_of(out)] == [False, True, False, False]

    monkeypatch.setattr(training, "backward", step)
    failed = out / "runs/no-wefe-0/failed.json"
    for times in range(2):  # first as it was, then after the file is deleted
        assert main(flags(plane_set, out, "--steps", "1", "--studies", "components")) == (1 if times == 0 else 0)
        assert (f"delete {failed} to try it again" in capsys.readouterr().err) == (times == 0)
        assert [row["here"]["abs_rel"] is None for row in rows_of(out)] == [False, times == 0, False, False]
        failed.unlink(missing_ok=True)


def test_too_little_memory_names_the_flags_of_this_command(plane_set, tmp_path, monkeypatch, capsys) -> None:
    def full(*_):
        raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 9 GiB.")

    monkeypatch.setattr(training, "backward", full)
    assert main(flags(plane_set, tmp_path / "ablation", "--steps", "1", "--studies", "components")) == 2
    advice = "take fewer or smaller crops with --batch or --crop, or add --recompute; CUDA out of memory"
    assert advice in capsys.readouterr().err
    again = ("--steps", "1", "--studies", "components", "--recompute")
    assert main(flags(plane_set, tmp_path / "again", *again)) == 2
    assert "with --batch or --crop; CUDA out of memory" in capsys.readouterr().err
    monkeypatch.setattr(ablation, "train", lambda *_: (_ for _ in ()).throw(MemoryError()))
    assert main(flags(plane_set, tmp_path / "third", *again)) == 2
    assert capsys.readouterr().err.endswith("error: out of memory\n")


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ([], "either --steps or --minutes"),
        (["--steps", "1", "--minutes", "1"], "either --steps or --minutes"),
        (["--steps", "0"], "--steps must be above 0 and at most 1e+09, got 0"),
        (["--minutes", "1e8"], "--minutes must be above 0 and at most 1e+07"),
        (["--steps", "1", "--limit", "1"], "--limit must be at least 2"),
        (["--steps", "1", "--seeds"], "--seeds"),
        (["--steps", "1", "--seeds", "-1"], "--seeds must be 0 to 2^63 - 1, got -1"),
        (["--steps", "1", "--studies", "levls"], "--studies"),
        (["--steps", "1", "--crop", "36", "64"], "--crop 36 64: both must be multiples of 8"),
        (["--steps", "1", "--test", "nowhere"], "nowhere: no such folder"),
    ],
)
def test_a_wrong_flag_exits_with_2_and_one_line(plane_set, tmp_path, capsys, more, message) -> None:
    out = tmp_path / "ablation"
    assert main(flags(plane_set, out, *more)) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ") and error.count("\n") == 1 and message in error
    assert not out.exists()


def test_another_network_or_state_of_the_code_is_reported(plane_set, ablated, tmp_path, capsys, monkeypatch) -> None:
    out = tmp_path / "again"
    shutil.copytree(ablated, out)
    (out / "runs" / "no-irm-0" / "score.json").unlink()
    monkeypatch.setattr(ablation, "source_digest", lambda packages: "another")
    assert main(flags(plane_set, out, "--steps", "3", "--studies", "components")) == 0
    score = json.loads((out / "runs" / "no-irm-0" / "score.json").read_text())
    before = json.loads((out / "runs" / "base-0" / "score.json").read_text())
    assert score["code"] == f"{before['code']}, another"  # trained by one, scored by the other
    assert "may not compare" in (out / "results.md").read_text()

    monkeypatch.setitem(network_config.PRESETS, "lite", replace(TINY, hidden=16))
    capsys.readouterr()
    assert main(flags(plane_set, out, "--steps", "3", "--studies", "components")) == 2
    assert "network.json: the run is of another network (hidden 8, not 16); choose" in capsys.readouterr().err
    assert json.loads((out / "runs" / "base-0" / "network.json").read_text())["hidden"] == 8


def test_a_folder_holds_one_ablation(plane_set, ablated, tmp_path, capsys) -> None:
    before = (ablated / "results.json").read_bytes()
    for more, other in (
        (["--steps", "2"], "--steps 3, not 2"),
        (["--steps", "3", "--limit", "2"], "--limit none, not 2"),
        (["--minutes", "1"], "--minutes none, not 1.0; --steps 3, not none"),
    ):
        capsys.readouterr()
        assert main(flags(plane_set, ablated, *more)) == 2
        assert f"other settings ({other}" in capsys.readouterr().err
    assert (ablated / "results.json").read_bytes() == before
    (tmp_path / "file").write_text("")
    assert main(flags(plane_set, tmp_path / "file", "--steps", "1")) == 2
    assert f"--out {tmp_path / 'file'}: is not a folder" in capsys.readouterr().err


def test_networks_that_pad_the_crops_are_named(tmp_path) -> None:
    def options(width: int) -> AblateOptions:
        return AblateOptions((tmp_path,), tmp_path / "out", studies=("levels",), steps=1, crop=(256, width))

    assert padded_crops(options(512)) == []
    (one,) = padded_crops(options(384))
    assert one.startswith("crops of 256 x 384 px are padded to 256 x 512 for levels-5, which learn the padding")
    (one,) = padded_crops(options(448))
    assert "256 x 512 for levels-4, levels-5, which" in one
