"""The test set's depth errors, to hold those on the way against: read from what m3depth.evaluate wrote."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from marssim.base.files.json_file import DatasetError, read_json

METHODS = {"m3depth": "M3Depth", "sgbm": "SGBM"}  # perceptions, and what m3depth.evaluate calls them


def errors_on_test_set(files: Sequence[Path], perceptions: Mapping[str, str | None]) -> dict[str, float]:
    """Abs Rel (mean over images, all pixels) of each perception that one of the files has scored.

    files: results.json of m3depth.evaluate; the pairs of all that score the same count alike. perceptions: names as
    envs.evaluate takes them, and the digests of their weights; a network's score counts only under the same weights.
    Raises DatasetError for a file that is no such results, or that scores none of the perceptions.
    """
    found: dict[str, list[tuple[float, int]]] = {}  # Abs Rel, pairs
    for file in files:
        content = read_json(file)
        try:
            scores = {
                method: float(result["depth"]["all"]["per_image"]["abs_rel"])
                for method, result in content["methods"].items()
            }
            weights, pairs = content["weights_sha256"], int(content["pairs"])
        except (KeyError, TypeError, AttributeError, ValueError):
            raise DatasetError(f"{file}: is no results.json of m3depth.evaluate") from None
        own = {
            perception: scores[method]
            for perception, digest in perceptions.items()
            if (method := METHODS.get(perception.partition(":")[0])) in scores and digest in (None, weights)
        }
        if not own:
            raise DatasetError(f"{file}: scores none of {', '.join(perceptions)} (with the same weights)")
        for perception, error in own.items():
            found.setdefault(perception, []).append((error, pairs))
    return {name: sum(e * n for e, n in parts) / sum(n for _, n in parts) for name, parts in found.items()}
