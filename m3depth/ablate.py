"""Run ablation studies under one budget, and put the paper's tables beside ours.

    python -m m3depth.ablate --data data/train --out runs/ablation --minutes 10
    python -m m3depth.ablate --data data/train --test data/unseen --out runs/ablation --steps 2000 --studies components
    python -m m3depth.ablate --data data/train --out runs/thin --preset paper-thin --minutes 10
    python -m m3depth.ablate --data data/train --out runs/paper-recipe --preset paper-thin --recipe paper --minutes 10

The studies are components (WEFE and IRM, on and off), loss (weights, no consistency loss, no normals), iterations (1 to
6), levels (of wavelets, 2 to 5), and parts (lookup, match at half the resolution, convex upsampling and recurrent steps
of lite, on and off; the paper has no such table). Each row of a table is a network that m3depth.train trains from
random weights. All networks see the same data in the same order, with the same seed and the same number of steps or
minutes, and are scored by m3depth.evaluate's rules on the same pairs. A run that several tables share is trained once:
22 runs make these five studies, for each seed. With --preset paper or paper-thin they are 19, since these have no
lookup and no match at half the resolution to leave out. --studies additions takes back all else that lite adds to the
paper's network and loss, one by one, in 8 further runs. --studies components consistency has five runs: WEFE, IRM and
the consistency loss alone, for several --seeds.

The same command continues after it was stopped or killed. It writes results.md and results.json after each run, and two
figures a study at the end: STUDY.png has the errors beside the paper's, STUDY_maps.png the maps of all rows on two test
pairs. runs/NAME-SEED holds the files of training and score.json. Runs that have their score.json and network.json are
not trained again, even without the other files, so that an ablation can go on elsewhere; the maps then lack their rows.
m3depth.train repeats a single run, with runs/NAME-SEED/network.json as --network, the same --recipe, --batch, --crop,
--seed and budget, --validate-every 0 --validate-samples 0, and the --loss weights that score.json lists.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from m3depth.ablation.config import AblateOptions
from marssim.base.command.run import run_command


def main(args: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit code: 2 for a mistake of the user."""
    return run_command(_work, AblateOptions, "python -m m3depth.ablate", __doc__, args)


def _work(options: AblateOptions) -> None:
    from m3depth.ablation.runs import ablate

    results = ablate(options)
    print((options.out / "results.md").read_text(encoding="utf-8"))
    if failed := results["failed"]:
        raise FloatingPointError(f"{options.out}: the tables lack {', '.join(failed)}, whose loss was not finite")


if __name__ == "__main__":
    sys.exit(main())
