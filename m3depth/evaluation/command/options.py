"""The flags of m3depth.evaluate."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from m3depth.datasets.config import DataConfig, Split
from m3depth.estimator import Classical
from m3depth.evaluation.recorded_maps import FORM
from m3depth.evaluation.scoring import check_choice
from m3depth.network.device import DeviceName
from m3depth.runtimes.choice import RuntimeChoice
from m3depth.stereo.pairs import LEAST_PIXELS, MAX_DISPARITY

Baseline = Literal[Classical, "mccnn", "all", "none"]


@dataclass(frozen=True)
class EvaluateOptions:
    """Score M3Depth and other methods on a dataset of marssim.generate, or of other layouts."""

    data: Path
    """Dataset folder, of marssim.generate or of any layout that --format lists."""
    out: Path
    """Folder to write results.json, results.md and the figures to; those of an earlier scoring are replaced."""
    split: Split = "test"
    """Part of the dataset to score: test, which training leaves out, or all, for data that nothing was trained on. Of
    pairs without true depth, all are scored."""
    weights: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="PATH ...")] = ()
    """Weights files (.safetensors) of m3depth.train to score, each in a row named after its file or run folder.
    Without any, the shipped weights are scored, as M3Depth; the word shipped names them beside others."""
    baselines: tuple[Baseline, ...] = ("sgbm",)
    """Classical methods to score on the same pairs: sgbm is OpenCV's semi-global matching along five paths, sgbm-hh
    along eight, which is slower and more accurate on level ground; ssd, sad and ncc take the window with the least
    squared or absolute difference, or the highest correlation; ssd-sgm, sad-sgm and ncc-sgm sum these costs along eight
    paths first. mccnn is CNES's MC-CNN with such paths, whose weights come with the extra `rivals`. all scores every
    classical method except mccnn; none scores no baseline."""
    estimator: Annotated[tuple[str, ...], tyro.conf.arg(metavar="[NAME=]ESTIMATOR[,fill|,unfilled] ...")] = ()
    """Further methods to score: package.module:Class, a class without arguments that has infer(left, right, rig);
    m3depth (the shipped weights), m3depth:PATH (other weights), or a classical method by its name in --baselines.
    NAME= before it names its row. ",fill" after it fills unknown pixels from the background, and ",unfilled" after
    that of a classical method leaves pixels without a match unknown."""
    predictions: Annotated[tuple[str, ...], tyro.conf.arg(metavar=f"{FORM} ...")] = ()
    """Folders of maps that other programs wrote, each scored in a row NAME. The maps hold disparity [px], or depth
    [m] with ",depth". ",scale=S" says that they hold S times that (-1 for RAFT-Stereo and Pandora); without it, S is 1,
    but 256 for disparity and 1000 for depth in PNG files. ",fill" fills unknown pixels from the background.
    Where the principal points of the cameras differ (doffs), that is added to disparities of the images, but not to
    those of m3depth.predict beside a prediction.json.
    m3depth/evaluation/recorded_maps.py lists the names of the files."""
    device: DeviceName = "auto"
    """Device that M3Depth runs on; auto takes a GPU if there is one."""
    runtime: RuntimeChoice = "auto"
    """Program that runs M3Depth: pytorch; openvino, on the CPU, with the extra `fast`; or auto, which is openvino if it
    is installed and the device is the CPU, and else pytorch."""
    max_pixels: int | None = None
    """Largest number of pixels of an image, 2048 or more, that a network works on, for M3Depth and classes whose infer
    takes it; the other methods work on all. The maps have the images' size, and their errors are in its pixels."""
    limit: int | None = None
    """Number of pairs to score, 1 or more, spread evenly over the split. Without it, all are scored."""
    degrade: str | None = None
    """Degradation of the images before they are scored, as contrast=.33,blur=1,noise=2.5: contrast (a factor), blur
    (sigma [px]) and noise (sigma [grey levels]) of both images; vertical (offset downwards [px]) and gain (brightness
    relative to the left) of the right one alone. Maps of --predictions stay as recorded, and their rows say so."""
    seed: int = 0
    """Seed of the noise that --degrade adds."""
    max_disparity: float = MAX_DISPARITY
    """Largest true disparity [px], above 0, of the pixels that are scored; nearer ones are scored apart, as near. For
    images larger than 512 px of the same view, give as many times more."""
    align_rows: bool = False
    """Align the rows of each pair where they lie significantly apart, before the estimators see it, as m3depth.predict
    does. It counts to their time. Maps of --predictions stay as recorded, and their rows say so."""
    reader: Annotated[DataConfig, tyro.conf.arg(name="")] = field(default_factory=DataConfig)
    """How the folder is read."""

    def __post_init__(self) -> None:
        check_choice(self.limit, self.seed)
        if not self.max_disparity > 0:
            raise ValueError(f"max_disparity must be positive, got {self.max_disparity}")
        if self.max_pixels is not None and self.max_pixels < LEAST_PIXELS:
            raise ValueError(f"max_pixels must be at least {LEAST_PIXELS}, got {self.max_pixels}")
