"""The estimators that the flags of m3depth.evaluate name, and what its results record of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from m3depth.estimator import (
    CLASSICAL,
    M3DEPTH,
    Estimator,
    EstimatorName,
    distinct_labels,
    load_estimator,
    name_with_weights,
)
from m3depth.evaluation.command.options import EvaluateOptions
from m3depth.evaluation.scoring import RESERVED
from m3depth.network.device import chosen_device
from m3depth.runtimes.choice import recorded_runtime
from m3depth.wrapped_estimators import FilledEstimator, ReducedEstimator, UnfilledEstimator, takes_setting


@dataclass(frozen=True)
class ScoredEstimators:
    """The estimators of an evaluation, and what its results record of them."""

    columns: dict[str, tuple[str, EstimatorName]]
    """Their names, each with the flag that gives it, by the name of the column, as `named_estimators` returns them."""
    records: dict[str, dict[str, Any]]
    """Name and SHA-256 of each, by the name of its column."""
    runtime: str | None
    """What runs the networks, as recorded_runtime returns it."""
    device: str
    """The kind of device that M3Depth runs on, cpu or cuda."""

    def by_flag(self) -> dict[str, list[Any]]:
        """Return label and record of each, by the flag that names it; those of weights are alike whatever their path.

        So an evaluation continues with the same weights in another place.
        """
        groups: dict[str, list[Any]] = {"--weights": [], "--estimator": []}
        for label, (flag_name, name) in self.columns.items():
            record = self.records[label]
            groups.setdefault(flag_name, []).append(
                [label, record if name.weights is None else {**record, "name": name.holes}]
            )
        return groups


def scored_estimators(options: EvaluateOptions) -> ScoredEstimators:
    """Return the estimators that the flags name, with what the results record of them.

    Raises:
        ValueError: A name is unknown or taken.
        OSError: A file of weights is missing or cannot be read.
    """
    columns = named_estimators(options)
    records = {label: {"name": name.form, "sha256": name.digest()} for label, (_, name) in columns.items()}
    runtime = recorded_runtime([name.name for _, name in columns.values()], options.runtime, options.device)
    on_cpu = (runtime or "").startswith("openvino")
    return ScoredEstimators(columns, records, runtime, "cpu" if on_cpu else chosen_device(options.device).type)


def named_estimators(options: EvaluateOptions) -> dict[str, tuple[str, EstimatorName]]:
    """Return the estimators that the flags name, each with its flag, by the name of its column.

    An estimator that is named twice in the same way has one column.

    Raises:
        ValueError: A name is unknown or taken.
    """
    if "none" in options.baselines and len(options.baselines) > 1:
        raise ValueError("--baselines none excludes other names: give none, or the names")
    classical = CLASSICAL if "all" in options.baselines else options.baselines
    texts = [
        *(("--weights", name_with_weights(path)) for path in options.weights),
        *([] if options.weights else [("--weights", M3DEPTH)]),
        *(("--baselines", name) for name in classical if name != "none"),
    ]
    flags = {EstimatorName(text): flag_name for flag_name, text in reversed(texts)}
    names = list(dict.fromkeys(EstimatorName(text) for _, text in texts))
    for text in options.estimator:
        name = EstimatorName.parse(text, "--estimator", labelled=True, fillable=True)
        if name not in flags:
            flags[name] = "--estimator"
            names.append(name)
    columns: dict[str, tuple[str, EstimatorName]] = {}
    for label, name in zip(distinct_labels(names), names, strict=True):
        if label in columns or label in RESERVED:
            hint = "" if name.given_label else f"; write --estimator NAME={name.form}"
            raise ValueError(f"{flags[name]} {name.form}: the name {label!r} is taken, choose another{hint}")
        columns[label] = flags[name], name
    return columns


def loaded(columns: Mapping[str, tuple[str, EstimatorName]], options: EvaluateOptions) -> dict[str, Estimator]:
    """Load the estimators, by the name of their column.

    They fill unknown pixels, or leave them unknown, where their names say so. Those that take max_pixels work on as
    many as --max-pixels says.

    Args:
        columns: Their names, each with its flag, of named_estimators.
        options: Hold the device, the runtime and max_pixels.

    Raises:
        ValueError: An estimator cannot be used, or none takes max_pixels though it is given.
        OSError: A file is missing or cannot be read.
    """
    estimators = {label: _loaded(name, flag_name, options) for label, (flag_name, name) in columns.items()}
    if options.max_pixels is not None and not any(takes_setting(e, "max_pixels") for e in estimators.values()):
        raise ValueError("--max-pixels: no method that is scored takes such a setting; leave it out")
    return estimators


def _loaded(name: EstimatorName, flag_name: str, options: EvaluateOptions) -> Estimator:
    estimator = load_estimator(name.name, flag_name, device=options.device, runtime=options.runtime)
    if options.max_pixels is not None and takes_setting(estimator, "max_pixels"):
        estimator = ReducedEstimator(estimator, options.max_pixels)
    if name.holes == "unfilled":
        return UnfilledEstimator(estimator)
    return FilledEstimator(estimator) if name.holes == "fill" else estimator
