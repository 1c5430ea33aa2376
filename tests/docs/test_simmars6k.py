"""Every command of the guide to SimMars6K runs, on a folder whose files are named as the paper's figures name them."""

import json
import re
import shlex
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
from small_network import SMALL

from m3depth import ablate, evaluate, train
from m3depth.network import config as network_config
from m3depth.network.model import M3Depth

GUIDE = Path(__file__).parents[2] / "docs/guides/simmars6k.md"
COMMANDS = {"train": train.main, "evaluate": evaluate.main, "ablate": ablate.main}
TINY = replace(SMALL, wavelet_levels=(2, 2))
SIZE = 64  # [px]
SHORT = {  # flags of the guide, and what the test gives instead
    "--max-minutes": ["--max-steps", "1", "--batch", "1", "--crop", "32", "64", "--validate-samples", "1"],
    "--epochs": ["--max-steps", "1", "--batch", "1", "--crop", "32", "64", "--validate-samples", "1"],
    "--accumulate": [],
    "--minutes": ["--steps", "1", "--batch", "1", "--crop", "32", "64"],
    "--baselines": ["--baselines", "sgbm-hh"],
}


@pytest.fixture(scope="module")
def simmars(tmp_path_factory) -> Path:
    """Twenty pairs of a wall 2 m away, with depth as EXR and normals as PNG."""
    root = tmp_path_factory.mktemp("data") / "SimMars6K"
    root.mkdir()
    shift = round(595.9 * SIZE / 512 * 0.27 / 2)  # [px]
    rng = np.random.default_rng(0)
    for number in range(20):
        wall = rng.integers(0, 256, (SIZE, SIZE + shift, 3), np.uint8)
        cv2.imwrite(str(root / f"{number:05d}Left.png"), wall[:, :SIZE])
        cv2.imwrite(str(root / f"{number:05d}Right.png"), wall[:, shift:])
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        depth = np.full((SIZE, SIZE), 595.9 * SIZE / 512 * 0.27 / shift, np.float32)
        OpenEXR.File(header, dict.fromkeys("RGB", depth)).write(str(root / f"{number:05d}Depth.exr"))
        facing = np.full((SIZE, SIZE, 3), (0, 128, 128), np.uint8)  # BGR of z = -1
        cv2.imwrite(str(root / f"{number:05d}Normal.png"), facing)
    return root


def commands() -> list[list[str]]:
    """The words of each command of the guide."""
    text = GUIDE.read_text(encoding="utf-8").replace("\\\n", " ")
    files = re.search(r"^ {4}FILES=\(([^)]*)\)$", text, re.MULTILINE)
    assert files is not None
    lines = re.findall(r"^    (python -m m3depth\..*)$", text, re.MULTILINE)
    return [shlex.split(line.replace('"${FILES[@]}"', files[1].replace("\n", " "))) for line in lines]


@pytest.mark.usefixtures("undrawn_figures")
def test_every_command_of_the_guide_runs(simmars, tmp_path, monkeypatch) -> None:
    for preset in ("lite", "paper"):
        monkeypatch.setitem(network_config.PRESETS, preset, TINY)
    M3Depth(TINY).save_pretrained(tmp_path / "tiny.safetensors")
    found = commands()
    names = [words[2].removeprefix("m3depth.") for words in found]
    assert names == ["evaluate", "train", "train", "evaluate", "train", "ablate"]
    for name, (_, _, _, *words) in zip(names, found, strict=True):
        flags: list[str] = []
        while words:
            word = words.pop(0)
            if word in SHORT:
                words.pop(0)
                flags += SHORT[word]
            elif word.startswith(("out/", "runs/")):
                flags.append(str(tmp_path / word))
            else:
                flags.append({"SimMars6K": str(simmars), "shipped": str(tmp_path / "tiny.safetensors")}.get(word, word))
        assert COMMANDS[name]([*flags, "--device", "cpu"]) == 0
    scored = json.loads((tmp_path / "out/simmars-runs/results.json").read_text())["methods"]
    assert scored["simmars"]["normal"]["all"]["pooled"]["mean"] > 0 and "simmars-fine" in scored
    studies = json.loads((tmp_path / "runs/simmars-ablation/results.json").read_text())["studies"]
    assert set(studies) == {"components"}
