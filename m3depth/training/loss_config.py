"""Weights of the loss terms. This file loads no torch, so that the commands print their help at once."""

from __future__ import annotations

from dataclasses import asdict, dataclass

LARGEST_WEIGHT = 1000.0
LARGEST_DECAY = 2.0  # it is raised to the power of the number of steps


@dataclass(frozen=True)
class LossConfig:
    """Weights of the loss terms. A weight of 0 removes its term from the sum.

    Raises:
        ValueError: A weight is out of its range; the message names its flag.
    """

    depth: bool = False
    """Whether error and consistency are those of depth divided by 15 m, for pixels up to 15 m, as in the paper; else
    they are those of disparity, the error with --loss.relative."""
    disparity: float = 2.0
    """Weight of the error of disparity or depth, 0 to 1000, lambda_d of the paper."""
    normal: float = 1.0
    """Weight of the error of the normals, 0 to 1000, lambda_n of the paper."""
    consistency: float = 3.0
    """Weight of the consistency of disparity and normals, 0 to 1000, lambda_c of the paper."""
    consistent_steps: float = 1.0
    """Weight of the consistency of the first maps and of those of each step, 0 to 1000, on top of --loss.initial and
    --loss.decay. The paper applies it to both branches; with 0, it applies to the last maps alone, and SNNet learns
    nothing from it.
    """
    relative: float = 4.0
    """Added weight of small disparities, 0 to 1000, which are far away: an error at a true disparity of d px, at least
    1, counts 1 + this / d times. With 4, an error at 4 px counts twice. With --loss.depth, it has no effect."""
    decay: float = 0.8
    """Weight of the maps of the last refinement step, 0 to 2; the weight of each earlier step is this times that of
    the step after it. With 0.8, the weights are 0.8, 0.64 and so on."""
    initial: float = 1.0
    """Weight of the first maps, 0 to 1000, of soft argmin and SNNet."""
    rock: float = 4.0
    """Weight of pixels on rocks, 0 to 1000, their outlines included."""
    edge: float = 3.0
    """Weight of the other pixels at disparity edges, 0 to 1000."""
    one_eye: float = 0.3
    """Factor, 0 to 1000, of the weight of pixels that only the left eye sees, whose disparity can only be guessed."""
    rover: float = 0.1
    """Factor, 0 to 1000, of the weight of pixels that show the rover itself, which is near, smooth and periodic."""
    sky_disparity: float = 0.02
    """Weight of the disparity of sky pixels, 0 to 1000, whose target is 0. It is small, because --loss.sky trains the
    output that says where sky is. With --loss.depth, it has no effect.
    """
    confidence: float = 0.2
    """Weight, 0 to 1000, of the cross-entropy of the decision "within 1 px"."""
    sky: float = 0.3
    """Weight, 0 to 1000, of the cross-entropy of the decision "sky or too far to measure"."""

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            most = LARGEST_DECAY if name == "decay" else LARGEST_WEIGHT
            if not 0 <= value <= most:
                raise ValueError(f"--loss.{name.replace('_', '-')} must lie in [0, {most:g}], got {value:g}")
