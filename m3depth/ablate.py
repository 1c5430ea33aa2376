"""Run the paper's ablation studies under one budget, and put the paper's tables beside ours.

    python -m m3depth.ablate --data data/train --out runs/ablation --minutes 10
    python -m m3depth.ablate --data data/train --test data/unseen --out runs/ablation --steps 2000 --studies components

Studies: components (WEFE and IRM, on and off), loss (weights, no consistency loss, no normals), iterations (1 to 6),
levels (of wavelets, 2 to 5). Each row of a table is a network trained from nothing by m3depth.train: the same data in
the same order, the same seed, as many steps or minutes as any other, and scored by m3depth.evaluate's rules on the same
pairs. Rows that are the same run in several tables are trained once: 17 runs make all four studies, for each seed.

The same command goes on where it was stopped or killed. Writes results.md and results.json after each run, and a plot a
study at the end; in runs/NAME-SEED is everything that training writes, and score.json. m3depth.train makes a single
run, with runs/NAME-SEED/network.json as --network and the --loss weights that score.json lists.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from m3depth.ablation.config import AblateOptions
from marssim.base.command.run import run_command


def main(args: Sequence[str] | None = None) -> int:
    """The command. Returns the exit code: 2 for a mistake in what was asked for."""
    return run_command(_work, AblateOptions, "python -m m3depth.ablate", __doc__, args)


def _work(options: AblateOptions) -> None:
    from m3depth.ablation.runs import ablate

    ablate(options)
    print((options.out / "results.md").read_text(encoding="utf-8"))


if __name__ == "__main__":
    sys.exit(main())
