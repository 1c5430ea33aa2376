"""The settings of an ablation."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from m3depth.ablation.studies import STUDIES, Study, Variant, distinct, without_repeats
from m3depth.datasets.config import DataConfig
from m3depth.network.device import DeviceName
from m3depth.training.config import LIMITS, Recipe


def budget_text(steps: int | None, minutes: float | None) -> str:
    """Return the budget of each run in words; one of the two is None.

    Args:
        steps: Budget in optimizer steps, or None.
        minutes: Budget in minutes, or None.
    """
    return f"{steps} steps" if steps is not None else f"{minutes:g} minutes"


@dataclass(frozen=True)
class AblateOptions:
    """Run ablation studies. Give --steps or --minutes."""

    data: tuple[Path, ...]
    """Dataset folders to train on, together: of marssim.generate or of any layout that --format lists.
    Where other layouts are among them, the flags of the reader, --format to --depth-range, are for those, and datasets
    of marssim are read without them.
    """
    out: Path
    """Folder to write the runs, the tables and the figures to."""
    test: Path | None = None
    """Dataset folder whose test split is scored. Without it, the first folder of --data."""
    studies: tuple[Literal["components", "loss", "consistency", "iterations", "levels", "parts", "additions"], ...] = (
        "components",
        "loss",
        "iterations",
        "levels",
        "parts",
    )
    """Tables to make: those of the paper; consistency, the rows of loss with and without the consistency loss alone;
    parts, of what stands beside the recurrent steps of lite; and additions, of all else that lite adds to the paper's
    network and loss. The report has those that are named, so name them all when you add some in the same --out: runs
    that are scored are not repeated.
    """
    steps: int | None = None
    """Budget of each run in optimizer steps, above 0 and at most 1e9, so that every network is trained on the same
    crops."""
    minutes: float | None = None
    """Budget of each run in minutes of training, above 0 and up to 1e7, so that cheaper networks make more steps."""
    preset: Literal["lite", "paper", "paper-thin"] = "lite"
    """Network that the studies change: lite, which ships; paper, the paper's full size; or paper-thin, the paper's
    parts at the widths of lite. Rows without a part that the preset lacks are left out.
    """
    recipe: Recipe = "own"
    """Recipe by which all runs are trained: own is that of the defaults of m3depth.train, paper that of its --recipe
    paper, but with the --batch and --crop given here.
    """
    seeds: tuple[int, ...] = (0,)
    """Seeds that every run is repeated with, 0 to 2^63 - 1. Tables show means over them. To add seeds later in the same
    --out, name them all."""
    limit: int | None = None
    """Number of test pairs to score, 2 or more, spread evenly over the split. Without it, all are scored."""
    batch: int = 4
    """Number of crops in a training step, 1 to 4096."""
    crop: tuple[int, int] = (256, 512)
    """Height and width of the crops [px]; both must be multiples of 8. A network pads crops that are no multiples of
    its own, and learns the padding; four and five levels of the wavelet transform need multiples of 128 and 256."""
    recompute: bool = False
    """Compute activations twice instead of storing them, which takes less memory and more time."""
    device: DeviceName = "auto"
    """Device to train and score on; auto takes a GPU if there is one."""
    reader: Annotated[DataConfig, tyro.conf.arg(name="")] = field(default_factory=DataConfig)
    """How the folders of --data and --test are read."""

    def __post_init__(self) -> None:
        if (self.steps is None) == (self.minutes is None):
            raise ValueError("give either --steps or --minutes: one budget for all runs")
        for name in ("steps", "minutes"):
            value, most = getattr(self, name), LIMITS[f"max_{name}"][1]
            if value is not None and not 0 < value <= most:
                raise ValueError(f"{name} must be above 0 and at most {most:g}, got {value}")
        for seed in self.seeds:
            if not 0 <= seed < 1 << 63:
                raise ValueError(f"seeds must be 0 to 2^63 - 1, got {seed}")
        for name in ("data", "studies", "seeds"):
            if not getattr(self, name):
                raise ValueError(f"{name} must name at least one")
        if self.limit is not None and self.limit < 2:
            raise ValueError(f"limit must be at least 2, got {self.limit}")

    @property
    def budget(self) -> str:
        """The budget of each run in words."""
        return budget_text(self.steps, self.minutes)

    def chosen(self) -> dict[str, Study]:
        """Return the chosen studies, in the order of the paper."""
        chosen = {name: study for name, study in STUDIES.items() if name in self.studies}
        return {name: without_repeats(study, self.preset, self.recipe) for name, study in chosen.items()}

    def trained_variants(self) -> dict[str, Variant]:
        """Return the run that gives the figures of each variant of the chosen studies, by the variant's name."""
        return distinct(self.chosen().values(), self.preset, self.recipe)
