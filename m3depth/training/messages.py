"""The messages of a training run: what it starts with, how far it is, and what it has written."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Any

from m3depth.datasets.open import open_pairs, reader_config_for
from m3depth.kinds.networks import SHIPPED_KINDS
from m3depth.network.output import padded_size
from m3depth.training.config import TrainConfig
from m3depth.training.curves import CURVES
from m3depth.training.ending import share_done
from m3depth.training.run import Run
from marssim.base.command.wording import counted


def data_names(config: TrainConfig) -> str:
    """Return the dataset folders as they were given."""
    return " ".join(map(str, config.data))


def announce(run: Run, resumed: bool, samples: int, held_out: int) -> None:
    """Print to stderr how many samples train what on which device, and which settings of a resumed run are new.

    Args:
        run: The run.
        resumed: Whether it continues from a checkpoint.
        samples: Number of training samples.
        held_out: Number of pairs of the val split.
    """
    size = sum(p.numel() for p in run.model.parameters())
    start = f"resumed at step {run.step}, {run.seconds / 60:.1f} min" if resumed else "new run"
    validated = f", {held_out} for validation" if held_out else ""
    network = f"{run.model.config.KIND} of {size / 1e6:.2f} M parameters"
    lines = [f"{counted(samples, 'sample')}{validated}, {network}, {run.device}, {start}"]
    height, width = run.config.crop
    rows, columns = padded_size(height, width, run.model.size_multiple)
    if (rows, columns) != (height, width):
        lines.append(
            f"warning: --crop {height} {width}: the network pads these crops to {rows} x {columns} px, and errs at "
            f"that border in images without padding; give multiples of {run.model.size_multiple}"
        )
    if run.changed:
        lines.append(f"goes on with other settings: {', '.join(run.changed)}")
    if run.config.validate_samples and not held_out:
        lines.append(f"{data_names(run.config)}: split val holds no pairs, so nothing is validated")
    print("\n".join(lines), file=sys.stderr, flush=True)


def progress_text(run: Run, values: dict[str, float]) -> str:
    """Return the progress line: step, share of the budget, remaining time, loss and speed.

    Args:
        run: The run after a step.
        values: Loss and its terms at that step.
    """
    done = min(1.0, share_done(run.config, run.step, run.seconds))
    remaining = run.seconds * (1 - done) / done
    speed = run.config.batch * run.world * run.step / max(run.seconds, 1e-9)
    terms = "".join(f"{name[0]} {values[name]:.3f}  " for name in ("disparity", "normal") if name in values)
    return (
        f"step {run.step}  {done:6.1%}  ETA {remaining / 60:.1f} min  loss {values['loss']:.3f}  "
        f"{terms}{speed:.2f} crops/s"
    )


def summary(run: Run, validations: list[dict[str, Any]]) -> str:
    """Return the summary of a finished run: its files, how good the weights are, and how to score them.

    Args:
        run: The run.
        validations: Records of the kind "val" in its log.
    """
    finite = [record for record in validations if record["epe"] is not None]
    quality = "not validated"
    if finite:
        last, best = finite[-1], min(finite, key=lambda record: record["epe"])
        normals = "" if last.get("normal") is None else f", normals {last['normal']:.1f} deg"
        quality = f"EPE {last['epe']:.3f} px, Abs Rel {last['abs_rel']:.4f}{normals} on val"
        if best["epe"] < last["epe"]:
            quality += f" (best EPE {best['epe']:.3f} px at step {best['step']})"
    weights = run.config.out / "weights.safetensors"
    lines = [f"{weights}: averaged weights of step {run.step}, {run.seconds / 60:.1f} min; {quality}"]
    if (run.config.out / CURVES).is_file():
        lines.append(f"{run.config.out / CURVES}: curves of the loss and the validations")
    for number, folder in enumerate(run.config.data, start=1):
        reader = reader_config_for(folder, run.config.data, run.config.reader).flags()
        words = ["--data", folder, *reader, "--split", "test", "--weights", weights]
        if not holds_test_pairs(run.config, folder):
            lines.append(f"{folder}: split test holds no pairs to score them on; more scenes would have some")
            continue
        out = run.config.out / ("score" if number == 1 else f"score-{number}")
        flags = shlex.join(map(str, [*words, "--out", out]))
        if run.model.config.KIND in SHIPPED_KINDS:
            lines.append(f"score them: python -m m3depth.evaluate {flags}")
        else:
            lines.append(f"score them: call m3depth.evaluate.main in a program that adds the network, with {flags}")
    return "\n".join(lines)


def holds_test_pairs(config: TrainConfig, folder: Path) -> bool:
    """Tell whether a folder has pairs in the split test; True where this cannot be found out.

    Args:
        config: The settings of the run, with those of the reader.
        folder: A dataset folder.
    """
    try:
        return len(open_pairs(folder, "test", reader_config_for(folder, config.data, config.reader))) > 0
    except (ValueError, OSError):
        return True
