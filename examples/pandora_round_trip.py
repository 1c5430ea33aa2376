"""Send a dataset to CNES's Pandora and score what comes back.

    python -m venv pandora && pandora/bin/pip install pandora
    python -m marssim.generate --out data/small --pairs 12 --views-per-scene 4 --seed 1 --renderer scan
    python examples/pandora_round_trip.py --pandora pandora/bin/pandora

Without --pandora, the program writes Pandora's input, lets OpenCV's SGBM play its part, and scores that: it shows the
files of the round trip.
"""

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import tyro

STEPS = {
    "matching_cost": {"matching_cost_method": "census", "window_size": 5},
    "aggregation": {"aggregation_method": "cbca"},
    "disparity": {"disparity_method": "wta", "invalid_disparity": "NaN"},
    "refinement": {"refinement_method": "vfit"},
    "filter": {"filter_method": "median"},
    "validation": {"validation_method": "cross_checking_accurate"},
}
MOST = 192  # [px] largest disparity that is looked for


def write_input(pair: Path, folder: Path) -> Path:
    """Write grey images and Pandora's config for one pair; return the config's path."""
    folder.mkdir(parents=True, exist_ok=True)
    for eye in ("im0", "im1"):
        cv2.imwrite(str(folder / f"{eye}.tif"), cv2.imread(str(pair / f"{eye}.png"), cv2.IMREAD_GRAYSCALE))
    left, right = ({"img": str(folder / f"{eye}.tif")} for eye in ("im0", "im1"))
    # Pandora counts disparity from left to right, so ours are negative
    config = {"input": {"left": {**left, "disp": [-MOST, 0]}, "right": right}, "pipeline": STEPS}
    (folder / "config.json").write_text(json.dumps(config, indent=1))
    return folder / "config.json"


def stand_in(folder: Path) -> None:
    """Write what Pandora would write, by OpenCV's SGBM: left_disparity.tif, negative, NaN where it is unknown."""
    left, right = (cv2.imread(str(folder / f"{eye}.tif"), cv2.IMREAD_GRAYSCALE) for eye in ("im0", "im1"))
    reach = min(MOST, left.shape[1] // 32 * 16)  # half the width at most, a multiple of 16
    matched = cv2.StereoSGBM.create(0, reach, 5).compute(left, right).astype(np.float32) / 16
    cv2.imwrite(str(folder / "left_disparity.tif"), np.where(matched > 0, -matched, np.nan).astype(np.float32))


def run(*command: str) -> None:
    """Run a command of this project."""
    subprocess.run([sys.executable, *command], check=True)


def main(
    data: Path = Path("data/small"), out: Path = Path("out/pandora"), split: str = "test", pandora: Path | None = None
) -> None:
    """Export a split, match it, and score the disparities.

    Args:
        data: Dataset folder.
        out: Folder for the export, the disparities and the scores.
        split: Part of the dataset: train, val or test.
        pandora: The program `pandora`; without it, SGBM plays its part.
    """
    if not data.is_dir():
        settings = "--pairs 12 --views-per-scene 4 --seed 1 --renderer scan"
        raise SystemExit(f"{data}: no such folder; make it with: python -m marssim.generate --out {data} {settings}")
    run("-m", "marssim.export", str(data), "--format", "eth3d", "--split", split, "--out", str(out / "eth3d"))
    for pair in sorted((out / "eth3d" / split / "two_view_training").iterdir()):
        config = write_input(pair, out / "maps" / pair.name)
        if pandora is None:
            stand_in(config.parent)
        else:
            subprocess.run([str(pandora), str(config), str(config.parent)], check=True)
    maps = f"Pandora={out / 'maps'},scale=-1,fill"
    command = ["-m", "m3depth.evaluate", "--data", str(data), "--split", split, "--out", str(out / "score")]
    run(*command, "--predictions", maps, "--baselines", "none")


if __name__ == "__main__":
    tyro.cli(main)
