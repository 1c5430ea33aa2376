"""The log of a training run: its file, TensorBoard, and the progress line."""

from __future__ import annotations

import shlex
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from marssim.base.command.progress import LINE_SECONDS
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import DatasetError, json_text, parse_json
from marssim.base.files.no_link import append_line
from marssim.base.results.code_state import versions

LOG = "log.jsonl"  # name of the log in a run's folder


def records(out: Path, kind: str) -> list[dict[str, Any]]:
    """Read the records of a kind in a run's log, those from before it was resumed included.

    Args:
        out: Folder of the run.
        kind: "start" or "stop", or "train", "val" or "val_raw" as Log.write takes it.

    Raises:
        DatasetError: A line holds no record; the message names the file and the line.
    """
    return [record for _, record in read_log(out / LOG) if record.get("kind") == kind]


def read_log(path: Path) -> list[tuple[bytes, dict[str, Any]]]:
    """Return the lines of a log and their records; a last line that is half written is left out.

    Args:
        path: The file; one that does not exist has no lines.

    Raises:
        DatasetError: A line holds no record.
    """
    lines = path.read_bytes().splitlines(keepends=True) if path.exists() else []
    if lines and not lines[-1].endswith(b"}\n"):
        lines.pop()
    records = [parse_json(line, f"{path}, line {number}") for number, line in enumerate(lines, 1)]
    for number, record in enumerate(records, 1):
        kinds = (int, float, str) if record.get("kind") == "start" else (int, float)
        values = (value for name, value in record.items() if name != "kind")
        if type(record.get("step")) is not int or not all(v is None or type(v) in kinds for v in values):
            raise DatasetError(f"{path}, line {number}: is not a record of a training; delete the line, or the file")
    return list(zip(lines, records, strict=True))


def rounded(values: dict[str, float]) -> dict[str, float]:
    """Return numbers of six significant digits, as learning rates are about 1e-6."""
    return {name: float(f"{value:.6g}") for name, value in values.items()}


class Log:
    """RUN/log.jsonl, TensorBoard where it is installed, and the progress line."""

    def __init__(self, out: Path, start: int) -> None:
        out.mkdir(parents=True, exist_ok=True)
        self.path = out / LOG
        if self.path.exists():  # steps after the checkpoint will be logged again
            write_atomically(
                self.path, b"".join(line for line, record in read_log(self.path) if record["step"] <= start)
            )
        try:
            from torch.utils.tensorboard import SummaryWriter

            self.board: Any = SummaryWriter(str(out / "tensorboard"), purge_step=start + 1)
        except (ImportError, UnicodeError):  # the second: a path that it does not write in this locale
            self.board = None
        self.last_line = 0.0

    def start(self, step: int, seed: int, data: str, processes: int) -> None:
        """Add a record of the kind "start": what the next steps are taken with, and the versions.

        Args:
            step: Steps that the run has taken before.
            seed: Seed of the first weights, and of the order of the pairs.
            data: What identifies the samples (m3depth.datasets.state.state_of_pairs).
            processes: Number of processes that share the batches of a step, which the command does not say.
        """
        command = shlex.join([Path(sys.orig_argv[0]).name, *sys.orig_argv[1:]])
        date = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
        about = {"date": date, "command": command, "processes": processes, "seed": seed, "data": data}
        self._add({"kind": "start", "step": step, **about, **versions()})

    def stop(self, step: int, times: dict[str, float]) -> None:
        """Add a record of the kind "stop", at the end of the steps since the last start.

        Args:
            step: Steps that the run has taken.
            times: "minutes" of the run, and "processor_minutes" since the last start.
        """
        self._add({"kind": "stop", "step": step, **rounded(times)})

    def write(self, kind: str, step: int, values: dict[str, float]) -> None:
        """Add a record.

        Args:
            kind: "train", "val" (averaged weights) or "val_raw" (current weights).
            step: Step of the record.
            values: Numbers by name; those that are not finite become null, as JSON has no NaN for "no such pixels".
        """
        self._add({"kind": kind, "step": step, **rounded(values)})
        if self.board is not None:
            for name, value in values.items():
                self.board.add_scalar(f"{kind}/{name}", value, step)

    def _add(self, record: dict[str, Any]) -> None:
        append_line(self.path, json_text(record))

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
