"""The log of a training run: its file, TensorBoard, and the progress line."""

from __future__ import annotations

import json
import shlex
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from marssim.base.command.progress import LINE_SECONDS
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import json_text
from marssim.base.results.code_state import versions

LOG = "log.jsonl"  # name of the log in a run's folder


def records(out: Path, kind: str) -> list[dict[str, Any]]:
    """Read the records of a kind in a run's log, those from before it was resumed included.

    Args:
        out: Folder of the run.
        kind: "start", or "train", "val" or "val_raw" as Log.write takes it.
    """
    path = out / LOG
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True) if path.exists() else []
    complete = (json.loads(line) for line in lines if line.endswith("}\n"))  # the last one may be half written
    return [record for record in complete if record["kind"] == kind]


class Log:
    """RUN/log.jsonl, TensorBoard where it is installed, and the progress line."""

    def __init__(self, out: Path, start: int) -> None:
        out.mkdir(parents=True, exist_ok=True)
        self.path = out / LOG
        if self.path.exists():  # steps after the checkpoint will be logged again
            lines = self.path.read_text(encoding="utf-8").splitlines(keepends=True)
            kept = [line for line in lines if line.endswith("}\n") and json.loads(line)["step"] <= start]
            write_atomically(self.path, "".join(kept).encode())
        try:
            from torch.utils.tensorboard import SummaryWriter

            self.board: Any = SummaryWriter(str(out / "tensorboard"), purge_step=start + 1)
        except ImportError:
            self.board = None
        self.last_line = 0.0

    def start(self, step: int, seed: int) -> None:
        """Add a record of the kind "start": the command, the seed and the versions that the next steps come from.

        Args:
            step: Steps that the run has taken before.
            seed: Seed of the first weights, and of the order of the pairs.
        """
        command = shlex.join([Path(sys.orig_argv[0]).name, *sys.orig_argv[1:]])
        date = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
        self._add({"kind": "start", "step": step, "date": date, "command": command, "seed": seed, **versions()})

    def write(self, kind: str, step: int, values: dict[str, float]) -> None:
        """Add a record.

        Args:
            kind: "train", "val" (averaged weights) or "val_raw" (current weights).
            step: Step of the record.
            values: Numbers by name; those that are not finite become null.
        """
        # Six significant digits: learning rates are about 1e-6. JSON has no NaN, which means "no such pixels".
        self._add({"kind": kind, "step": step, **{k: float(f"{v:.6g}") for k, v in values.items()}})
        if self.board is not None:
            for name, value in values.items():
                self.board.add_scalar(f"{kind}/{name}", value, step)

    def _add(self, record: dict[str, Any]) -> None:
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json_text(record) + "\n")

    def image(self, name: str, step: int, pixels: np.ndarray) -> None:
        """Show an image in TensorBoard.

        Args:
            name: Name of the image.
            step: Step of the run.
            pixels: (H, W, 3) uint8 RGB.
        """
        if self.board is not None:
            self.board.add_image(name, pixels, step, dataformats="HWC")

    def close(self) -> None:
        """Finish the TensorBoard files."""
        if self.board is not None:
            self.board.close()

    def progress(self, text: str) -> None:
        """Show the progress line: rewritten in place on a terminal, printed now and then elsewhere."""
        if sys.stderr.isatty():
            print(f"\r{text}\x1b[K", end="", file=sys.stderr, flush=True)
        elif time.monotonic() - self.last_line > LINE_SECONDS:
            self.last_line = time.monotonic()
            print(text, file=sys.stderr, flush=True)

    def say(self, text: str) -> None:
        """Print a line that stays, below the progress line."""
        end = "\n" if sys.stderr.isatty() else ""
        print(f"{end}{text}", file=sys.stderr, flush=True)
