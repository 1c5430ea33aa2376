"""Train M3Depth, or one of the methods that it is compared with (--preset).

    python -m m3depth.train --data DIR --out RUN --max-minutes 120
    python -m m3depth.train --data DIR --out RUN --init shipped --lr 2e-4 --max-minutes 30  # fine-tuning
    python -m m3depth.train --data KITTI --out RUN --max-steps 20000 --crop 320 960
    python -m m3depth.train --data SimMars6K --format folder --left '*Left.png' --right '*Right.png' \\
        --depth '*Depth.exr' --normal '*Normal.png' --calib natecam --out RUN --max-minutes 120
    python -m m3depth.train --data DIR --out RUN --preset paper --recipe paper --epochs 100 --accumulate 2
    torchrun --nproc-per-node 4 -m m3depth.train --data DIR --out RUN --max-steps 100000

RUN/weights.safetensors holds the averaged weights, RUN/checkpoint.pt the state of the run, RUN/curves.png its loss and
validations. The same command again continues from the checkpoint. It may have a larger budget, another --lr or other
settings, and prints which are new. A different network, batch, crop, seed, --init or number of processes belongs to
another run and is refused.

The files, in the order of the data's way:

    datasets/open.py                 a folder -> pairs of a split, with ground truth
    training/samples.py, batch.py    pairs -> shuffled, augmented crops -> batches; packing.py keeps pairs in memory
    training/loop.py                 batch -> network -> losses.py -> step, until the budget is spent
    training/run.py                  the state of the run, its checkpoint, and what a resumed run must share
    training/validation.py, log.py   scores on the val split, the log and the progress line
"""

from __future__ import annotations

import os
import re
import sys
import traceback
from collections.abc import Sequence

from m3depth.datasets.config import Split
from m3depth.training.config import TrainConfig, recipe_defaults
from marssim.base.command.run import run_command

# in errors of collectives, of a lost process
LOST = "Connection (closed|reset)|Broken pipe|remote process exited|Timed out waiting"
SPLITS: tuple[Split, Split] = ("train", "val")
USAGE = (__doc__ or "").partition("\nThe files, ")[0]  # the description that --help prints


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code: 2 for a mistake in the flags, or a disk that fails."""
    args = sys.argv[1:] if args is None else args
    in_group = "LOCAL_RANK" in os.environ  # one of torchrun's processes
    try:
        code = run_command(_work, TrainConfig, "python -m m3depth.train", USAGE, args, default=recipe_defaults(args))
    except Exception:
        if not in_group:
            raise
        traceback.print_exc()
        code = 1
    if code and in_group:
        # The others wait for this process in a collective, and torchrun ends them once it has ended; at its exit, it
        # would wait for them.
        sys.stderr.flush()
        os._exit(code)
    return code


def _work(config: TrainConfig) -> None:
    """Open the datasets and train."""
    from m3depth.datasets.open import open_folders
    from m3depth.training.loop import train
    from m3depth.training.samples import JoinedPairs

    pairs = (JoinedPairs(open_folders(config.data, split, config.reader)) for split in SPLITS)
    try:
        train(config, *pairs)
    except RuntimeError as error:
        reason = str(error).partition("\n")[0]
        if "LOCAL_RANK" in os.environ and re.search(LOST, reason):
            raise ConnectionError(f"another process of this training has ended, see its own error: {reason}") from None
        raise


if __name__ == "__main__":
    sys.exit(main())
