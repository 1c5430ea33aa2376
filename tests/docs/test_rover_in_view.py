"""Errors without the rover: those of all other scored pixels, for the pairs that show it."""

import json
from types import ModuleType

import numpy as np
import pytest
from small_network import SMALL

from m3depth.evaluation.metrics import pixel_kinds
from m3depth.network.model import M3Depth
from marssim.base.camera import NATECAM
from marssim.base.dataset.dataset import StereoDataset
from marssim.generate import GenerateConfig, generate_dataset
from marssim.scene.presets import preset
from marssim.scene.viewpoint import ViewConfig


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """A dataset whose views look down on the rover's deck, or away from it."""
    out = tmp_path_factory.mktemp("rover") / "data"
    view = ViewConfig(rover=(0.6, 0.6), rover_pan_deg=(120.0, 160.0), pitch_deg=(25.0, 35.0))
    generate_dataset(
        GenerateConfig(
            out=out, pairs=8, views_per_scene=2, renderer="scan", seed=4, rig=NATECAM.resized(64, 64),
            scenes=(preset("gale", size=12.0, horizon=16.0),), view=view,
        )
    )  # fmt: skip
    return out


def test_pairs_that_show_the_rover_are_scored_with_and_without_it(rover_in_view: ModuleType, data, tmp_path) -> None:
    M3Depth(SMALL).save_pretrained(tmp_path / "runs/base-0/weights.safetensors")
    out = tmp_path / "rover.json"
    assert rover_in_view.main(["--data", str(data), "--runs", str(tmp_path / "runs"), "--out", str(out)]) == 0
    (figures,) = json.loads(out.read_text()).values()
    pairs = StereoDataset(data, "test")
    shown = [name for name, sample in zip(pairs.names, pairs, strict=True) if "rover" in sample.meta]
    assert 0 < len(shown) < len(pairs.names) and [*figures] == shown
    assert all(of["rover_pixels"] > 20 and of["rover_abs_rel"] > 0 and of["abs_rel"] > 0 for of in figures.values())


def test_errors_on_the_rover_and_elsewhere_are_kept_apart(rover_in_view: ModuleType, data) -> None:
    sample = next(sample for sample in StereoDataset(data, "test") if "rover" in sample.meta)
    kinds = pixel_kinds(sample)
    rover = kinds["rover"]
    assert 20 < rover.sum() < kinds["all"].sum()
    figures = rover_in_view.errors_of(sample, np.where(rover, 1.5, 1.02) * sample.depth)
    expected = {"abs_rel": 0.02, "rover_abs_rel": 0.5, "rover_pixels": rover.sum()}
    assert figures == pytest.approx(expected, rel=1e-3)


def test_a_folder_without_weights_is_named(rover_in_view: ModuleType, data, tmp_path, capsys) -> None:
    flags = ["--data", str(data), "--runs", str(tmp_path), "--out", str(tmp_path / "rover.json")]
    assert rover_in_view.main(flags) == 2
    assert f"--runs {tmp_path}: holds no run with weights.safetensors" in capsys.readouterr().err
