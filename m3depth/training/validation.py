"""Validation during training: scores of both weights on a few pairs, and a picture of some of them."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence

import torch
from torch import Tensor

from m3depth.estimator import for_pair
from m3depth.evaluation.example import Example
from m3depth.figures.pairs import pairs_figure
from m3depth.network.device import autocast, fast_dtype
from m3depth.network.output import Maps, maps_at_size
from m3depth.network.stereo_network import StereoNetwork
from m3depth.stereo.pairs import StereoPairs, pair_name, spread
from m3depth.training.batch import Batch, Target, disparity_edges, network_inputs, whole_batch
from m3depth.training.curves import save_curves
from m3depth.training.log import Log
from m3depth.training.packing import PackedSample
from m3depth.training.run import Run
from m3depth.training.samples import PackedCache
from marssim.base.compute.free_memory import free_memory

CURVES_SECONDS = 10.0  # least time between two drawings of a run's curves [s]; each takes half a second
PANELS = "panels"  # folder of the image panels, in a run's folder
PANEL_PAIRS = 4  # pairs in an image panel


class Validator:
    """Validates the current and the averaged weights of a run on a few pairs, on rank 0.

    Args:
        run: The run.
        log: Its log; None in processes other than rank 0, which validate nothing.
        held_out: Pairs of the val split; there may be none.
    """

    def __init__(self, run: Run, log: Log | None, held_out: StereoPairs) -> None:
        self.run, self.log, self.held_out = run, log, held_out
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
        packed = (self.cache[i] for i in self.chosen)  # one at a time, as they need not fit into the memory together
        self.step, (current, self.scores) = run.step, validate((run.model, run.averaged), packed, run.device)
        path = run.config.out / PANELS / f"{run.step:07d}.png"
        examples = [self._example(index) for index in self.chosen[:PANEL_PAIRS]]
        log.image("panel", run.step, pairs_figure(examples, path))
        log.write("val_raw", run.step, current)
        log.write("val", run.step, self.scores)  # last, since a run that goes on after a kill does not repeat it
        if time.monotonic() - self.drawn > CURVES_SECONDS:
            save_curves(run.config.out)
            self.drawn = time.monotonic()
        log.say(f"validation, step {run.step}: " + "  ".join(f"{k} {v:.4g}" for k, v in self.scores.items()))
        return self.scores

    def _example(self, index: int) -> Example:
        """Return a pair of the val split, with what the averaged weights predict for it."""
        sample = self.held_out[index]
        prediction = for_pair(self.run.averaged, sample).infer(sample.left, sample.right, sample.rig)
        name = pair_name(self.held_out, index)
        return Example(index, sample.left, sample.right, sample, {"averaged weights": prediction}, name)


def error_sums(output: Maps, target: Target) -> dict[str, tuple[float, float]]:
    """Return sum and count of each error over one batch, for means over several.

    Over labelled pixels: epe [px], abs_rel (of depth: |d / d_predicted - 1|), bad1 (share over 1 px), rock_epe and
    edge_epe [px], normal [deg], false_sky (share taken for sky). Over sky pixels: sky_missed (share not taken for sky).
    A network without normals or a map of the sky has none of these errors.

    Args:
        output: What the network returned for the batch.
        target: The ground truth of the batch.
    """
    label, truth = target.label, target.disparity
    error = (output.disparity - truth).abs()
    relative = (truth / output.disparity.clamp(min=0.1) - 1).abs()
    values: dict[str, tuple[Tensor, Tensor]] = {
        "epe": (error, label),
        "abs_rel": (relative, label),
        "bad1": ((error > 1).float(), label),
        "rock_epe": (error, label & target.rock),
        "edge_epe": (error, label & disparity_edges(truth, target.valid)),
    }
    if output.normal is not None:
        angle = torch.rad2deg((output.normal * target.normal).sum(1, keepdim=True).clamp(-1, 1).acos())
        values["normal"] = angle, label & (target.normal.square().sum(1, keepdim=True) > 0.25)
    if output.sky is not None:
        predicted_sky = (output.sky > 0).float()
        values |= {"sky_missed": (1 - predicted_sky, target.sky), "false_sky": (predicted_sky, label)}
    return {name: (float(x[mask].sum()), float(mask.sum())) for name, (x, mask) in values.items()}


@torch.inference_mode()
def predict_batch(model: StereoNetwork, batch: Batch) -> tuple[Maps, Target]:
    """Run the network on a batch in the device's fast precision, without gradients.

    Args:
        model: The network.
        batch: The images and cameras. With a whole pair in `finer`, networks that take a start go on there, and the
            maps of others are enlarged, as in StereoNetwork.infer.

    Returns:
        The maps at the full size of the pairs, and the ground truth there.
    """
    device = batch.left.device
    with autocast(device, fast_dtype(device)):
        out, target = model(*network_inputs(batch, model.takes_truth)), batch.target
        for band in batch.finer:
            if model.TAKES_START:
                out = model(band.left, band.right, band.target.camera, out.start(*band.size))
            else:
                out = maps_at_size(out, *band.size)
            target = band.target
    return out, target


def validate(
    models: Sequence[StereoNetwork], samples: Iterable[PackedSample], device: torch.device
) -> list[dict[str, float]]:
    """Return the mean errors of networks over all pixels of whole images; NaN where there are no such pixels.

    Args:
        models: The networks.
        samples: The pairs, at full size, read once.
        device: Device of the networks.

    Returns:
        For each network, the errors by the names of error_sums.
    """
    training = [model.training for model in models]
    totals: list[dict[str, list[float]]] = [{} for _ in models]
    for model in models:
        model.eval()
    for sample in samples:
        batch = whole_batch(sample).to(device)
        for model, total in zip(models, totals, strict=True):
            for name, pair in error_sums(*predict_batch(model, batch)).items():
                entry = total.setdefault(name, [0.0, 0.0])
                entry[0] += pair[0]
                entry[1] += pair[1]
        del sample, batch  # before the next pair is read
    for model, before in zip(models, training, strict=True):
        model.train(before)
    return [{name: s / n if n else float("nan") for name, (s, n) in total.items()} for total in totals]
