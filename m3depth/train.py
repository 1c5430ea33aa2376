"""Train M3Depth.

    python -m m3depth.train --data DIR --out RUN --max-minutes 120
    python -m m3depth.train --data KITTI --out RUN --max-steps 20000 --crop 320 960
    python -m m3depth.train --data SimMars6K --left 'left/*.png' --right 'right/*.png' --depth 'depth/*.exr' \
        --calib natecam --normals depth --out RUN --max-minutes 120
    torchrun --nproc-per-node 4 -m m3depth.train --data DIR --out RUN --max-steps 100000

The same command again goes on where RUN/checkpoint.pt stands; with a larger budget, --lr or other settings it goes on
with those, and says which are new. Another network, batch, crop, seed, --init or number of processes is another run,
and refused.
RUN/weights.safetensors holds the averaged weights.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

from m3depth.datasets.config import Part
from m3depth.training.config import TrainConfig
from marssim.base.command.run import run_command

SPLITS: tuple[Part, Part] = ("train", "val")


def main(args: Sequence[str] | None = None) -> int:
    """The command. Returns the exit code: 2 for a mistake in what was asked for, or a disk that fails."""
    code = run_command(_work, TrainConfig, "python -m m3depth.train", __doc__, args)
    if code and "LOCAL_RANK" in os.environ:
        # A process of torchrun that waits for the others in a collective must not outlive a failed one.
        os._exit(code)
    return code


def _work(config: TrainConfig) -> None:
    from m3depth.datasets.open import open_pairs
    from m3depth.training.loop import train
    from m3depth.training.samples import Joined

    train(config, *(Joined([open_pairs(folder, split, config.reader) for folder in config.data]) for split in SPLITS))


if __name__ == "__main__":
    sys.exit(main())
