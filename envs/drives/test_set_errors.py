"""The test set's depth errors, which the drives' own are compared with: read from the results of m3depth.evaluate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from m3depth.estimator import CLASSICAL, M3DEPTH, EstimatorName
from marssim.base.files.json_file import DatasetError, read_json

# Estimators by their columns, for results of release 0.1.0, which do not list them and score one network.
COLUMNS = {EstimatorName(name).label(): name for name in (M3DEPTH, *CLASSICAL)}


def errors_on_test_set(files: Sequence[Path], perceptions: Mapping[str, str | None]) -> dict[str, float]:
    """Return the Abs Rel (mean over images, all pixels) of each perception that one of the files has scored.

    Args:
        files: results.json of m3depth.evaluate. The pairs of all that score the same perception count alike.
        perceptions: Names as envs.evaluate takes them, each with the SHA-256 of the file that it is read from (None
            without one). A score counts only if it is of the same file.

    Raises:
        DatasetError: A file holds no such results, or scores none of the perceptions.
    """
    scores: dict[str, list[tuple[float, int]]] = {}  # Abs Rel, pairs
    for file in files:
        content = read_json(file)
        try:
            pairs = int(content["pairs"])
            columns = _scored(content)
        except (KeyError, TypeError, AttributeError, ValueError):
            methods = content.get("methods")
            if isinstance(methods, dict) and any(isinstance(m, dict) and "residual" in m for m in methods.values()):
                raise DatasetError(f"{file}: scores pairs without true depth, so it has no error of depth") from None
            raise DatasetError(f"{file}: is no results.json of m3depth.evaluate") from None
        errors = {
            perception: columns[key]
            for perception, digest in perceptions.items()
            if (key := digest or perception) in columns
        }
        if not errors:
            raise DatasetError(f"{file}: scores none of {', '.join(perceptions)} (with the same weights)")
        for perception, error in errors.items():
            scores.setdefault(perception, []).append((error, pairs))
    return {name: sum(e * n for e, n in parts) / sum(n for _, n in parts) for name, parts in scores.items()}


def _scored(content: Mapping[str, Any]) -> dict[str, float]:
    """The Abs Rel of every estimator, by the digest of its file or, without one, by its name."""
    estimators = content.get("estimators")
    if estimators is None:
        weights = content["weights_sha256"]
        estimators = {
            column: {"name": name, "sha256": weights if name == M3DEPTH else None} for column, name in COLUMNS.items()
        }
    errors = {
        method: float(result["depth"]["all"]["per_image"]["abs_rel"]) for method, result in content["methods"].items()
    }
    return {
        str(estimator["sha256"] or estimator["name"]): errors[column]
        for column, estimator in estimators.items()
        if column in errors
    }
