"""Train M3Depth.

    python -m m3depth.train --data DIR --out RUN --max-minutes 120
    torchrun --nproc-per-node 4 -m m3depth.train --data DIR --out RUN --max-steps 100000

The same command again goes on where RUN/checkpoint.pt stands. RUN/weights.safetensors holds the averaged weights.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

from m3depth.train_config import TrainConfig


def main(args: Sequence[str] | None = None) -> int:
    """The command. Returns the exit code: 2 for a mistake in what was asked for, or a disk that fails."""
    import tyro

    config = tyro.cli(TrainConfig, prog="python -m m3depth.train", args=args, description=__doc__)
    from m3depth.training import train
    from marssim.dataset import StereoDataset

    try:
        samples = StereoDataset(config.data, split="train")
        held_out = StereoDataset(config.data, split="val")
        train(config, samples, held_out)
    except (ValueError, OSError, FloatingPointError) as error:
        print(f"m3depth.train: {error}", file=sys.stderr, flush=True)
        if "LOCAL_RANK" in os.environ:
            # A process of torchrun that waits for the others in a collective must not outlive a failed one.
            os._exit(2)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
