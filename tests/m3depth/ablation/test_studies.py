"""The studies: the trained networks, and the paper's figures."""

from dataclasses import replace

import pytest
import torch

from m3depth.ablation.studies import BASE, STUDIES, distinct, without_repeats
from m3depth.network.config import PLAIN_UPSAMPLING, PRESETS
from m3depth.network.model import M3Depth
from m3depth.training.loss_config import LossConfig


@pytest.mark.parametrize("preset", list(PRESETS))
def test_a_run_that_is_the_same_in_several_tables_is_one(preset: str) -> None:
    runs = distinct(STUDIES.values(), preset)
    different = {run.name: run.resolved(preset) for run in runs.values()}
    rows = [row.variant.name for study in STUDIES.values() for row in study.rows]
    # The preset is in each study, no-irm and the loss without consistency in two; the paper's networks have no lookup
    # and no fine part to leave out, and none of the seven additions to the network.
    shared = {"lite": 8, "paper": 8 + 3 + 7, "paper-thin": 8 + 3 + 7}[preset]
    assert len(different) == len(set(different.values())) == len(rows) - shared
    assert runs.keys() == set(rows)
    network, loss = BASE.resolved(preset)
    assert (network, loss) == (PRESETS[preset], LossConfig()) and BASE in runs.values()


@pytest.mark.parametrize("preset", list(PRESETS))
def test_a_study_changes_only_its_own_fields(preset: str) -> None:
    base = PRESETS[preset]

    def changed(study: str) -> list[dict]:
        networks = [row.variant.resolved(preset)[0] for row in STUDIES[study].rows]
        names = ("wavelet_levels", *PLAIN_UPSAMPLING)
        fixed = [{k: v for k, v in vars(n).items() if k not in names} for n in networks]
        assert all(f == {k: v for k, v in vars(base).items() if k not in names} for f in fixed)
        return [{name: getattr(n, name) for name in names} for n in networks]

    on, off = base.wavelet_levels, (0, 0)
    unchanged = {name: getattr(base, name) for name in PLAIN_UPSAMPLING}
    assert changed("components") == [
        {"wavelet_levels": levels, **rest}
        for levels, rest in ((off, PLAIN_UPSAMPLING), (off, unchanged), (on, PLAIN_UPSAMPLING), (on, unchanged))
    ]
    assert [c["refine_steps"] for c in changed("iterations")] == [1, 2, 3, 4, 5, 6]
    assert [c["wavelet_levels"] for c in changed("levels")] == [(2, 2), (3, 3), (4, 4), (5, 5)]
    losses = [row.variant.resolved(preset)[1] for row in STUDIES["loss"].rows]
    assert [(c.disparity, c.normal, c.consistency) for c in losses] == [
        (2, 1, 3), (2, 1, 0), (1, 2, 3), (3, 2, 1), (1, 3, 2), (2, 0, 0),
    ]  # fmt: skip


def test_rows_without_a_part_that_the_preset_lacks_are_left_out() -> None:
    parts = without_repeats(STUDIES["parts"], "paper-thin")
    assert [row.label for row in parts.rows] == [
        "all parts", "no convex upsampling", "no recurrent steps", "none of these parts",
    ]  # fmt: skip
    assert [(c.before, c.after) for c in parts.comparisons] == [(1, 0), (2, 0), (3, 1), (3, 2)]
    assert parts.reference == 0 and len(distinct([parts], "paper-thin")) == 4
    for study in STUDIES.values():
        same = without_repeats(study, "lite")
        assert [*same.rows] == [*study.rows] and [*same.comparisons] == [*study.comparisons]


def test_each_addition_of_lite_is_one_in_which_the_papers_network_differs() -> None:
    """Taken back together, with the parts, the widths, the levels, the steps and the outputs, they are that network."""
    rows = [row.variant for row in STUDIES["additions"].rows[1:]]
    taken_back = {name: value for variant in rows for name, value in variant.network.items()}
    lite, thin = vars(PRESETS["lite"]), vars(PRESETS["paper-thin"])
    others = {"wavelet_levels", "refine_steps", "lookup_levels", "fine_width"}
    assert {name: thin[name] for name in thin if thin[name] != lite[name] and name not in others} == taken_back
    (loss,) = (variant.resolved("lite")[1] for variant in rows if variant.loss)
    assert (loss.relative, loss.rock, loss.edge, loss.one_eye, loss.rover) == (0, 1, 1, 1, 1)
    by_paper = without_repeats(STUDIES["additions"], "paper-thin", "paper")  # whose recipe has no such weights
    assert [row.label for row in by_paper.rows] == ["all additions"] and not by_paper.comparisons
    study = without_repeats(STUDIES["additions"], "paper-thin")
    assert [row.label for row in study.rows] == ["all additions", "without: weights of pixels in the loss"]


def test_the_networks_of_paper_thin_run() -> None:
    left, right, camera = torch.rand(1, 3, 64, 64), torch.rand(1, 3, 64, 64), torch.tensor([[60.0, 60.0, 31.5, 31.5]])
    for study, row in (("components", 0), ("components", 2), ("iterations", 0)):
        network = M3Depth(STUDIES[study].rows[row].variant.resolved("paper-thin")[0]).eval()
        with torch.inference_mode():
            assert network(left, right, camera).disparity.shape == (1, 1, 64, 64)


def test_the_papers_changes_are_those_of_its_text() -> None:
    """They come from the text, not from the tables, so figures that were copied wrongly would not give them."""
    rows = STUDIES["components"].rows
    assert [rows[i].paper["rmse"] for i in (0, 1, 2)] == [0.562, 0.462, 0.418]
    assert rows[2].paper["normal_mean"] == 25.3 and rows[2].paper["normal_within_11.25"] == 0.361
    assert STUDIES["loss"].rows[1].paper == {"abs_rel": 0.132, "sq_rel": 0.091, "rmse": 0.402, "delta1": 0.863}
    steps = STUDIES["iterations"].rows
    assert steps[4].paper["delta1"] == 0.912 and steps[5].paper == {"delta1": 0.913}
    best = min(STUDIES["levels"].rows, key=lambda row: row.paper["abs_rel"])
    assert best.label == "3" and best.paper["abs_rel"] == steps[4].paper["abs_rel"] == 0.084
    assert steps[2].paper["abs_rel"] == rows[3].paper["abs_rel"] == 0.089


def test_each_part_of_lite_has_a_row_without_it_and_the_recurrent_steps_one_of_their_own() -> None:
    study = STUDIES["parts"]
    base = PRESETS["lite"]
    parts = ("refine_steps", "lookup_levels", "fine_width", "convex_upsampling")
    present = []
    for row in study.rows:
        network = row.variant.resolved("lite")[0]
        assert replace(network, **{name: getattr(base, name) for name in parts}) == base
        present.append("".join(name[0] for name in parts if getattr(network, name)))
        assert not row.paper
    assert present == ["rlfc", "rfc", "rlc", "rlf", "r", "fc", ""]
    gained = {c.change: set(present[c.after]) - set(present[c.before]) for c in study.comparisons}
    assert [*gained.values()] == [{"l"}, {"f"}, {"c"}, {"r", "l"}, {"r"}, {"f", "c"}]
