"""Settings of an ablation, and the check of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from m3depth.ablation.studies import STUDIES, Study


def said_budget(steps: int | None, minutes: float | None) -> str:
    """The budget of each run, in words; one of the two is None."""
    return f"{steps} steps" if steps is not None else f"{minutes:g} minutes"


@dataclass(frozen=True)
class AblateOptions:
    """Run the paper's ablation studies. Give --steps or --minutes."""

    data: tuple[Path, ...]
    """Dataset folders, of marssim.generate or of any layout that m3depth.train reads by itself; trained on as one."""
    out: Path
    """Folder for the runs, the tables and the plots."""
    test: Path | None = None
    """Dataset folder whose test split is scored; default: the first of --data."""
    studies: tuple[Literal["components", "loss", "iterations", "levels"], ...] = (
        "components", "loss", "iterations", "levels",
    )  # fmt: skip
    """Which of the paper's tables. More can be asked for later, in the same --out."""
    steps: int | None = None
    """Budget of each run, in optimizer steps: the same crops for every network."""
    minutes: float | None = None
    """Budget of each run, in minutes of training: more steps for cheaper networks."""
    preset: Literal["lite", "paper"] = "lite"
    """The network that is changed."""
    seeds: tuple[int, ...] = (0,)
    """Every run is made with each of them. Figures are means over them; more can be asked for later."""
    limit: int | None = None
    """Score only so many pairs, spread evenly over the test split."""
    batch: int = 4
    """Crops in a step."""
    crop: tuple[int, int] = (256, 448)
    """Height and width of the crops [px], multiples of 8."""
    recompute: bool = False
    """Keep few activations for the way back, as m3depth.train does: less memory, slower."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """auto: a GPU if there is one."""

    def __post_init__(self) -> None:
        if (self.steps is None) == (self.minutes is None):
            raise ValueError("give either --steps or --minutes: one budget for all runs")
        for name in ("steps", "minutes"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ValueError(f"{name} must be positive, got {value}")
        for name in ("data", "studies", "seeds"):
            if not getattr(self, name):
                raise ValueError(f"{name} must name at least one")
        if self.limit is not None and self.limit < 2:
            raise ValueError(f"limit must be at least 2, got {self.limit}")

    @property
    def budget(self) -> str:
        """As the tables state it."""
        return said_budget(self.steps, self.minutes)

    def chosen(self) -> dict[str, Study]:
        """The studies asked for, in the order of the paper."""
        return {name: study for name, study in STUDIES.items() if name in self.studies}
