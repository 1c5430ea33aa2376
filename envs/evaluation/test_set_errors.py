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
        DatasetError: A file holds no such results, scores none of the perceptions, or was scored on images that were
            degraded otherwise than those of the first file.
    """
    scores: dict[str, list[tuple[float, int]]] = {}  # Abs Rel, pairs
    first: str | None = None
    for file in files:
        content = read_json(file)
        try:
            pairs = int(content["pairs"])
            scored = _scored(content)
        except (KeyError, TypeError, AttributeError, ValueError):
            methods = content.get("methods")
            if isinstance(methods, dict) and any(isinstance(m, dict) and "residual" in m for m in methods.values()):
                raise DatasetError(f"{file}: scores pairs without true depth, so it has no error of depth") from None
            raise DatasetError(f"{file}: is no results.json of m3depth.evaluate") from None
        degraded = f"--degrade {content['degrade']}" if content.get("degrade") else "undegraded images"
        first = first or degraded
        if degraded != first:
            raise DatasetError(f"{file}: was scored with {degraded}, {files[0]} with {first}; give results of one kind")
        errors = {
            perception: error
            for perception, digest in perceptions.items()
            for name, of_file, error in scored
            if digest == of_file and (name == perception or (_is_network(name) and _is_network(perception)))
        }
        if not errors:
            raise DatasetError(f"{file}: scores none of {', '.join(perceptions)} (with the same weights)")
        for perception, error in errors.items():
            scores.setdefault(perception, []).append((error, pairs))
    return {name: sum(e * n for e, n in parts) / sum(n for _, n in parts) for name, parts in scores.items()}


def _is_network(name: str) -> bool:
    """Return whether a name is that of weights, whose file may have another path elsewhere."""
    return name.partition(":")[0] == M3DEPTH


def _scored(content: Mapping[str, Any]) -> list[tuple[str, str | None, float]]:
    """Return the name of every estimator, the digest of its file and its Abs Rel.

    Estimators whose holes were filled or left are left out, since no drive sees their depth.
    """
    estimators = content.get("estimators")
    if estimators is None:
        weights = content["weights_sha256"]
        estimators = {
            column: {"name": name, "sha256": weights if name == M3DEPTH else None} for column, name in COLUMNS.items()
        }
    errors = {
        method: float(result["depth"]["all"]["per_image"]["abs_rel"]) for method, result in content["methods"].items()
    }
    return [
        (str(estimator["name"]), estimator["sha256"], errors[column])
        for column, estimator in estimators.items()
        if column in errors and not str(estimator["name"]).endswith((",fill", ",unfilled"))
    ]
