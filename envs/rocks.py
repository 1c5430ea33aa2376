"""Which rocks the navigator's map shows as obstacles, from one frame of predicted depth.

    python -m envs.rocks --data DIR --split test --perception m3depth sgbm ground_truth --out out/rocks

Each pair of a dataset is one look: its depth goes into an empty elevation map as the navigator's does, and the map says
what stands out of the ground. m3depth.evaluate scores rocks on the depth map itself; what the navigator makes of it is
told here, one floor above m3depth and nav, which do not know each other. The rows of ground_truth say what the map can
show at best. Writes results.json, results.md (which says what counts) and rocks.png.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from tqdm import tqdm

from envs.sight import load_perception
from m3depth.degradation import Degradation
from m3depth.figures.rocks import rocks_figure
from m3depth.report import rocks_table, versions, write_json
from m3depth.rocks import RockScene, RockTally, rock_scene
from marssim.camera import StereoRig
from marssim.command import counted, run_command
from marssim.dataset import Split, StereoDataset
from marssim.rover_spec import ZHURONG
from nav import ElevationMap, TraversabilityConfig, assess

BESIDE = 0.3  # [m] of a rock, where what stands out is the rock's
STANDS_OUT = 0.1  # [m] in the map of the true depth: no false obstacle
RULES = """\
Rocks, their height and distance are those of m3depth.rocks, as far as the map reaches (12 m). One is found if a cell on
it, or beside it, stands out by that much; its height is that of the highest such cell. A false obstacle is a connected
patch of such cells, away (0.3 m) from every rock pixel and from all that stands out by 0.1 m in the map of the true
depth. The rows of ground_truth say what the map can show at best."""


@dataclass(frozen=True)
class RocksConfig:
    """Count the rocks that the navigator's map shows, from single frames of a dataset."""

    data: Path
    """dataset folder, as marssim.generate writes it"""
    out: Path
    """folder for results.json, results.md and rocks.png"""
    split: Split = "test"
    """part of the dataset"""
    perception: tuple[str, ...] = ("m3depth", "ground_truth")
    """what turns the images into depth: m3depth (the shipped weights), sgbm, ground_truth (true depth), m3depth:WEIGHTS
    (a .safetensors file) or package.module:Class (with infer(left, right, rig))"""
    step: float = 0.15
    """height above the ground [m] from which a cell is an obstacle; a rock of 0.2 m may be measured 5 cm too low"""
    limit: int | None = None
    """look at so many pairs only, spread evenly"""
    degrade: str | None = None
    """make the images worse first, as in contrast=.33,blur=1,noise=2.5"""
    seed: int = 0
    """seed of the noise that --degrade adds"""

    def __post_init__(self) -> None:
        if not self.step > 0:
            raise ValueError(f"step must be positive, got {self.step}")
        if self.limit is not None and self.limit < 1:
            raise ValueError(f"limit must be at least 1, got {self.limit}")
        if self.seed < 0:
            raise ValueError(f"seed must not be negative, got {self.seed}")
        if not self.perception or len(set(self.perception)) < len(self.perception):
            raise ValueError("perception must name one or more, each once")


@dataclass(frozen=True)
class Look:
    """What one depth map shows. step: (n, n) [m] above the ground, NaN unknown; cells: as ElevationMap.cell_of."""

    elevation: ElevationMap
    step: np.ndarray

    def cells(self, points: np.ndarray) -> np.ndarray:
        """(n, n) bool: cells in which points (N, 3) [m] lie."""
        mask = np.zeros(self.step.shape, bool)
        index = self.elevation.cell_of(points[:, :2])
        index = index[((index >= 0) & (index < self.elevation.n)).all(axis=1)]
        mask[index[:, 1], index[:, 0]] = True
        return mask


def look_at(depth: np.ndarray, confidence: np.ndarray | None, rig: StereoRig, turn: np.ndarray) -> Look:
    """The navigator's map of one depth map. turn: (3, 3) left camera to level axes; the camera stands at (0, 0, 0)."""
    pose = np.eye(4)
    pose[:3, :3] = turn
    elevation = ElevationMap()
    elevation.integrate(depth, confidence, rig, pose)
    return Look(elevation, assess(elevation, ZHURONG, TraversabilityConfig()).step)


def count_rocks(tally: RockTally, look: Look, true: Look, scene: RockScene, on_rock: np.ndarray, least: float) -> None:
    """Add what one look shows to the tally. true: the look of the true depth; on_rock: (H, W) bool."""
    tally.images += 1
    config = look.elevation.config
    rays, depth = scene.rays.reshape(-1, 3), scene.true_depth.ravel()
    with np.errstate(invalid="ignore"):
        stands = look.step >= least
    for rock in scene.rocks:
        if np.median(depth[rock.pixels]) >= config.max_range - 0.5:
            continue
        cells = _wider(look.cells(rays[rock.pixels] * depth[rock.pixels][:, None]), 1)
        found = bool((stands & cells).any())
        height = float(np.nanmax(look.step[cells])) if found else np.nan
        tally.rocks.append((rock.height, rock.away, found, height - rock.height))
    everywhere = np.flatnonzero(on_rock.ravel() & np.isfinite(depth))
    known = look.cells(rays[everywhere] * depth[everywhere][:, None])
    with np.errstate(invalid="ignore"):
        known |= true.step >= STANDS_OUT
    false = stands & ~_wider(known, round(BESIDE / config.cell))
    count, label = cv2.connectedComponents(false.astype(np.uint8), connectivity=8)
    x, y = look.elevation.centres()
    away = np.hypot(x[None, :], y[:, None])
    for number in range(1, count):
        patch = label == number
        tally.false.append((float(look.step[patch].max()), float(np.median(away[patch]))))


def _wider(mask: np.ndarray, cells: int) -> np.ndarray:
    return cv2.dilate(mask.astype(np.uint8), np.ones((2 * cells + 1,) * 2, np.uint8)) > 0


def rocks_seen(config: RocksConfig) -> dict[str, Any]:
    """Count, write the report, and return the content of results.json.

    Raises DatasetError or ValueError if the dataset cannot be read or tells no pose, or a perception is unknown.
    """
    dataset = StereoDataset(config.data, config.split)
    if not len(dataset):
        raise ValueError(f"{config.data}: split {config.split} holds no pairs; choose another --split")
    methods = {name: load_perception(name) for name in config.perception}
    worse = None if config.degrade is None else Degradation.parse(config.degrade)
    tallies = {name: RockTally() for name in methods}
    count = len(dataset) if config.limit is None else min(config.limit, len(dataset))
    config.out.mkdir(parents=True, exist_ok=True)
    chosen = np.unique(np.linspace(0, len(dataset) - 1, count).round().astype(int))
    for index in tqdm(chosen, desc="rocks", unit="pair", disable=None):
        sample = dataset[int(index)]
        scene = rock_scene(sample)
        if scene is None:
            continue
        left, right = sample.left, sample.right
        if worse is not None:
            rng = np.random.default_rng((config.seed, int(index)))
            left, right = worse.apply(left, rng), worse.apply(right, rng)
        turn = np.asarray(sample.meta["pose"], float)[:3, :3]
        true = look_at(sample.depth, None, sample.rig, turn)
        for name, method in methods.items():
            if method is None:
                look = true
            else:
                seen = method.infer(left, right, sample.rig)
                look = look_at(seen.depth, seen.confidence, sample.rig, turn)
            count_rocks(tallies[name], look, true, scene, sample.rock > 0, config.step)
    return _report(config, {name: tally.result() for name, tally in tallies.items()})


def _report(config: RocksConfig, results: dict[str, dict[str, Any]]) -> dict[str, Any]:
    images = max((found["images"] for found in results.values() if found), default=0)
    if not images:
        raise ValueError(f"{config.data}: no pair of split {config.split} shows ground and says where its camera stood")
    about = {
        "data": str(config.data), "split": config.split, "images": images, "step_m": config.step,
        "degrade": config.degrade, "seed": config.seed, "versions": versions(),
    }  # fmt: skip
    content = {**about, "methods": results}
    write_json(config.out / "results.json", content)
    rocks_figure(results, config.out / "rocks.png")
    worse = f", degraded by `{config.degrade}`" if config.degrade else ""
    lines = [
        "# Rocks in the navigator's map",
        "",
        f"{counted(images, 'frame')} of `{config.data}`, split {config.split}{worse}; each alone in an empty map. "
        f"Obstacles are cells that stand out of the ground by {config.step:g} m and more.",
        "",
        RULES,
        "",
        *rocks_table(results, config.step),
        "",
        "![rocks](rocks.png)",
        "",
    ]
    (config.out / "results.md").write_text("\n".join(lines))
    return content


def main(args: Sequence[str] | None = None) -> int:
    """The command. Returns the exit code."""
    return run_command(_work, RocksConfig, "python -m envs.rocks", __doc__, args, "nothing was written")


def _work(config: RocksConfig) -> None:
    content = rocks_seen(config)
    for name, found in content["methods"].items():
        key = found["standing_0.2_m_within_8_m"]
        share = "-" if key["found_share"] is None else f"{100 * key['found_share']:.1f} %"
        error = "-" if key["height_error_m"] is None else f"{100 * key['height_error_m']:.1f} cm"
        print(
            f"{name}: of {counted(key['rocks'], 'rock')} of 0.2 m and more within 8 m {share} found, height error "
            f"{error} (median); {found['false']} false obstacles in {counted(found['images'], 'frame')}"
        )
    print(f"by height and range: {config.out / 'results.md'}")


if __name__ == "__main__":
    sys.exit(main())
