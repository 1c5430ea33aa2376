"""What a training run is made of: its state and checkpoint, its log, and the signals that end it."""

from __future__ import annotations

import copy
import io
import json
import math
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch

from m3depth.network.config import M3DepthConfig, read_config
from m3depth.network.model import M3Depth
from m3depth.train_config import TrainConfig
from marssim.atomic import write_atomically

CHECKPOINT = "checkpoint.pt"
WORLD = "number of processes"  # part of a run's identity
PROGRESS_SECONDS = 20.0  # between progress lines where the output is no terminal


def new_network(config: TrainConfig) -> M3Depth:
    """The network that a run starts from. Raises FileNotFoundError or ValueError that names a file."""
    if config.init:
        return M3Depth.from_pretrained(config.init)
    return M3Depth(read_config(config.network)) if config.network else M3Depth.from_preset(config.preset)


def saved_progress(out: Path) -> tuple[int, float]:
    """Steps and seconds of the checkpoint in a run folder; zeros without one. Raises ValueError if it is damaged."""
    path = out / CHECKPOINT
    if not path.is_file():
        return 0, 0.0
    state = read_checkpoint(path, torch.device("cpu"))
    return state["step"], state["seconds"]


def read_checkpoint(path: Path, device: torch.device) -> dict[str, Any]:
    """What Run.save wrote; nothing in the file is executed. Raises ValueError that names it if it is damaged."""
    try:
        state = torch.load(path, map_location=device, weights_only=True)
        # Older ones do not say how many processes, and know fewer fields of the network.
        network = M3DepthConfig.from_dict(state["identity"]["network"])
        state["identity"] = {WORLD: 1, **state["identity"], "network": plain(network)}
    except Exception as error:  # torch raises whatever its unpickler stumbles over
        raise ValueError(f"{path}: not a readable checkpoint ({type(error).__name__})") from None
    return state


def plain(network: M3DepthConfig) -> dict[str, Any]:
    """As JSON gives it back."""
    return json.loads(json.dumps(asdict(network)))


class Run:
    """State of a training run: network, averaged copy, optimizer, step, seconds spent.

    world: number of processes that share the batches of a step.
    """

    def __init__(self, config: TrainConfig, device: torch.device, world: int = 1) -> None:
        torch.manual_seed(config.seed)
        self.config, self.device, self.world = config, device, world
        self.model = new_network(config).to(device).train()
        self.averaged = copy.deepcopy(self.model).eval().requires_grad_(False)
        self.optimizer = torch.optim.AdamW(self.model.parameters(), config.lr, weight_decay=config.weight_decay)
        self.step = 0
        self.seconds = 0.0

    @property
    def checkpoint(self) -> Path:
        """RUN/checkpoint.pt: everything that a resumed run needs; weights.safetensors beside it is for users."""
        return self.config.out / CHECKPOINT

    def average(self) -> None:
        """Move the averaged weights towards the current ones; faster at the start, when these still change a lot."""
        decay = min(self.config.ema, (1 + self.step) / (10 + self.step))
        with torch.no_grad():
            torch._foreach_lerp_(list(self.averaged.parameters()), list(self.model.parameters()), 1 - decay)

    def identity(self) -> dict[str, Any]:
        """The settings that a resumed run must share with the one that it continues."""
        c = self.config
        # Which samples a step sees depends on the number of processes too.
        return {
            "network": plain(self.model.config), "batch": c.batch, "crop": list(c.crop), "seed": c.seed,
            WORLD: self.world,
        }  # fmt: skip

    def save(self) -> None:
        """Write the checkpoint, and the averaged weights with their config, atomically."""
        state = {
            "identity": self.identity(),
            "model": self.model.state_dict(),
            "averaged": self.averaged.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "step": self.step,
            "seconds": self.seconds,
            "rng": torch.get_rng_state(),
        }
        buffer = io.BytesIO()
        torch.save(state, buffer)
        write_atomically(self.checkpoint, buffer.getvalue())
        self.averaged.save_pretrained(self.config.out / "weights.safetensors")

    def resume(self) -> bool:
        """Continue from RUN/checkpoint.pt, if there is one. Raises ValueError if it is damaged or of another run."""
        if not self.checkpoint.is_file():
            return False
        state = read_checkpoint(self.checkpoint, self.device)
        for name, value in self.identity().items():
            if state["identity"].get(name) != value:
                raise ValueError(f"{self.checkpoint}: belongs to a run with another {name}; choose another --out")
        self.model.load_state_dict(state["model"])
        self.averaged.load_state_dict(state["averaged"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.step, self.seconds = state["step"], state["seconds"]
        torch.set_rng_state(state["rng"].cpu())
        return True


class Log:
    """RUN/log.jsonl, TensorBoard where it is installed, and the progress line."""

    def __init__(self, out: Path, start: int) -> None:
        out.mkdir(parents=True, exist_ok=True)
        self.path = out / "log.jsonl"
        if self.path.exists():  # what was logged after the checkpoint will be logged again
            lines = self.path.read_text().splitlines(keepends=True)
            kept = [line for line in lines if line.endswith("}\n") and json.loads(line)["step"] <= start]
            write_atomically(self.path, "".join(kept).encode())
        try:
            from torch.utils.tensorboard import SummaryWriter

            self.board: Any = SummaryWriter(str(out / "tensorboard"), purge_step=start + 1)
        except ImportError:
            self.board = None
        self.last_line = 0.0

    def write(self, kind: str, step: int, values: dict[str, float]) -> None:
        """Add a record. kind: "train", "val" (averaged weights) or "val_raw" (the others)."""
        # JSON knows no NaN, which stands for "no such pixels".
        plain = {k: round(v, 6) if math.isfinite(v) else None for k, v in values.items()}
        record = {"kind": kind, "step": step, **plain}
        with self.path.open("a") as file:
            file.write(json.dumps(record) + "\n")
        if self.board is not None:
            for name, value in values.items():
                self.board.add_scalar(f"{kind}/{name}", value, step)

    def image(self, name: str, step: int, pixels: np.ndarray) -> None:
        """Show an image, (H, W, 3) uint8 RGB, in TensorBoard."""
        if self.board is not None:
            self.board.add_image(name, pixels, step, dataformats="HWC")

    def records(self, kind: str) -> list[dict[str, Any]]:
        """What was written under a kind so far, earlier parts of a resumed run included."""
        lines = self.path.read_text().splitlines() if self.path.exists() else []
        return [record for record in map(json.loads, lines) if record["kind"] == kind]

    def close(self) -> None:
        """Finish the TensorBoard files."""
        if self.board is not None:
            self.board.close()

    def progress(self, text: str) -> None:
        """One line, rewritten on a terminal, printed now and then elsewhere."""
        if sys.stderr.isatty():
            print(f"\r{text}\x1b[K", end="", file=sys.stderr, flush=True)
        elif time.monotonic() - self.last_line > PROGRESS_SECONDS:
            self.last_line = time.monotonic()
            print(text, file=sys.stderr, flush=True)

    def say(self, text: str) -> None:
        """A line that stays, below the progress line."""
        end = "\n" if sys.stderr.isatty() else ""
        print(f"{end}{text}", file=sys.stderr, flush=True)


@contextmanager
def stop_on_signal() -> Iterator[list[int]]:
    """The list that is handed out holds the signal's number once SIGTERM or SIGINT has come; a second one ends."""
    received: list[int] = []

    def remember(number: int, frame: Any) -> None:
        received.append(number)
        signal.signal(number, before[number])

    before: dict[int, Any] = {n: signal.signal(n, remember) for n in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
