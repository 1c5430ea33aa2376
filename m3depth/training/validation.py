"""Validation during training, and its image panels."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from pathlib import Path

import cv2
import numpy as np
import torch
from torch import Tensor

from m3depth.network.device import autocast, fast_dtype
from m3depth.network.model import M3Depth, StereoOutput
from m3depth.stereo.pairs import StereoPairs, spread
from m3depth.training.batch import Batch, whole_batch
from m3depth.training.curves import save_curves
from m3depth.training.log import Log
from m3depth.training.losses import Target, disparity_edges
from m3depth.training.packing import TRAINED, PackedSample
from m3depth.training.run import Run
from m3depth.training.samples import PackedCache, free_memory
from marssim.base.files.atomic import write_atomically
from marssim.base.images.colours import disparity_colours, normal_colours

HEADER = 18  # height of the line of names above a panel [px]
COLUMNS = ("left", "true disparity", "disparity", "error, to 4 px", "true normals", "normals", "confidence")

CURVES_SECONDS = 10.0  # least time between two drawings of a run's curves [s]; each takes half a second
PANEL_ROWS = 4  # samples in an image panel


class Validator:
    """Validates the current and the averaged weights of a run on a few pairs, on rank 0.

    Args:
        run: The run.
        log: Its log; None in processes other than rank 0, which validate nothing.
        held_out: Pairs of the val split; there may be none.
    """

    def __init__(self, run: Run, log: Log | None, held_out: StereoPairs) -> None:
        self.run, self.log = run, log
        self.chosen = spread(len(held_out), run.config.validate_samples) if log else []
        self.cache = PackedCache(held_out, free_memory() // 4 if run.config.cache else 0)
        self.step, self.scores = -1, dict[str, float]()
        self.drawn = time.monotonic()  # time of the last drawing of the curves

    def validate(self) -> dict[str, float]:
        """Log the scores of both weights with an image panel, and draw the curves now and then.

        Returns:
            The scores of the averaged weights; those of before if the run has taken no step since, and none if nothing
            is validated.
        """
        run, log = self.run, self.log
        if not self.chosen or log is None or self.step == run.step:
            return self.scores
        packed = [self.cache[i] for i in self.chosen]
        current = validate(run.model, packed, run.device)
        self.step, self.scores = run.step, validate(run.averaged, packed, run.device)
        log.write("val_raw", run.step, current)
        log.write("val", run.step, self.scores)
        path = run.config.out / "panels" / f"{run.step:07d}.png"
        log.image("panel", run.step, save_panel(path, run.averaged, packed[:PANEL_ROWS], run.device))
        if time.monotonic() - self.drawn > CURVES_SECONDS:
            save_curves(run.config.out)
            self.drawn = time.monotonic()
        log.say(f"validation, step {run.step}: " + "  ".join(f"{k} {v:.4g}" for k, v in self.scores.items()))
        return self.scores


def error_sums(output: StereoOutput, target: Target) -> dict[str, tuple[float, float]]:
    """Return sum and count of each error over one batch, for means over several.

    Over labelled pixels: epe [px], abs_rel (of depth: |d / d_predicted - 1|), bad1 (share over 1 px), rock_epe and
    edge_epe [px], normal [deg], false_sky (share taken for sky). Over sky pixels: sky_missed (share not taken for sky).
    """
    label, truth = target.label, target.disparity
    error = (output.disparity - truth).abs()
    relative = (truth / output.disparity.clamp(min=0.1) - 1).abs()
    angle = torch.rad2deg((output.normal * target.normal).sum(1, keepdim=True).clamp(-1, 1).acos())
    predicted_sky = (output.sky > 0).float()
    values: dict[str, tuple[Tensor, Tensor]] = {
        "epe": (error, label),
        "abs_rel": (relative, label),
        "bad1": ((error > 1).float(), label),
        "rock_epe": (error, label & target.rock),
        "edge_epe": (error, label & disparity_edges(truth, target.known)),
        "normal": (angle, label & (target.normal.square().sum(1, keepdim=True) > 0.25)),
        "sky_missed": (1 - predicted_sky, target.sky),
        "false_sky": (predicted_sky, label),
    }
    return {name: (float(x[mask].sum()), float(mask.sum())) for name, (x, mask) in values.items()}


@torch.inference_mode()
def predict_batch(model: M3Depth, batch: Batch) -> StereoOutput:
    """Run the network on a batch in the device's fast precision, without gradients."""
    device = batch.left.device
    with autocast(device, fast_dtype(device)):
        return model(batch.left, batch.right, batch.target.camera)


def validate(model: M3Depth, samples: Iterable[PackedSample], device: torch.device) -> dict[str, float]:
    """Return the mean errors (see error_sums) over all pixels of whole images; NaN where there are no such pixels."""
    training = model.training
    model.eval()
    total: dict[str, list[float]] = {}
    for sample in samples:
        batch = whole_batch(sample).to(device)
        for name, pair in error_sums(predict_batch(model, batch), batch.target).items():
            entry = total.setdefault(name, [0.0, 0.0])
            entry[0] += pair[0]
            entry[1] += pair[1]
    model.train(training)
    return {name: s / n if n else float("nan") for name, (s, n) in total.items()}


def save_panel(path: Path, model: M3Depth, samples: Sequence[PackedSample], device: torch.device) -> np.ndarray:
    """Write a PNG with a row for each sample and the columns COLUMNS.

    White is an error of 4 px; confidence is 0 where the network sees sky. Images of other sizes are resized to the
    first one's.

    Returns:
        The picture, (H, W, 3) RGB.
    """
    rows: list[np.ndarray] = []
    for sample in samples:
        batch = whole_batch(sample).to(device)
        out = predict_batch(model, batch)
        truth = batch.target.disparity[0, 0].cpu().numpy()
        estimate = out.disparity[0, 0].float().cpu().numpy()
        top = max(float(truth.max()), 1.0)
        error = np.where(sample.flags & TRAINED, np.abs(estimate - truth), 0)
        confidence = (out.confidence.sigmoid() * (out.sky <= 0))[0, 0].float().cpu().numpy()
        normal_maps = (batch.target.normal, out.normal * (out.sky <= 0))  # sky has no normals
        normals = [normal_colours(x[0].permute(1, 2, 0).float().cpu().numpy())[..., ::-1] for x in normal_maps]
        maps = [disparity_colours(x, top)[..., ::-1] for x in (truth, estimate)]
        maps += [cv2.cvtColor(_byte(error / 4), cv2.COLOR_GRAY2BGR)]
        maps += [*normals, cv2.cvtColor(_byte(confidence), cv2.COLOR_GRAY2BGR)]
        row = np.concatenate([x[::2, ::2] for x in (sample.left[..., ::-1], *maps)], 1)
        rows.append(row if not rows or row.shape == rows[0].shape else cv2.resize(row, rows[0].shape[1::-1]))
    panel = np.concatenate([column_headers(rows[0].shape[1] // len(COLUMNS)), *rows])
    write_atomically(path, cv2.imencode(".png", panel)[1].tobytes())
    return np.ascontiguousarray(panel[..., ::-1])


def column_headers(width: int) -> np.ndarray:
    """Return the names of the columns, each in its own width: (HEADER, len(COLUMNS) width, 3) uint8."""
    names = []
    for name in COLUMNS:
        strip = np.full((HEADER, width, 3), 255, np.uint8)
        (wide, _), _ = cv2.getTextSize(name, cv2.FONT_HERSHEY_SIMPLEX, 1.0, 1)
        scale = min(0.45, (width - 4) / wide)
        cv2.putText(strip, name, (2, HEADER - 6), cv2.FONT_HERSHEY_SIMPLEX, scale, (0, 0, 0), 1, cv2.LINE_AA)
        names.append(strip)
    return np.concatenate(names, 1)


def _byte(x: np.ndarray) -> np.ndarray:
    return (np.nan_to_num(x).clip(0, 1) * 255).astype(np.uint8)
