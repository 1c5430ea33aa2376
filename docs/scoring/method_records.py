"""Records of methods for docs/scoring/compare_methods.py: one JSON file a method, with its scores, training and sizes.

A record holds all that the page needs of a method, so that methods can be trained and scored one after the other, on
machines that are gone by the time the page is written. Records of the same pairs can be compared pair by pair.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from m3depth.evaluation.report import DEPTH_COLUMNS, NORMAL_COLUMNS
from m3depth.kinds.config import config_from_dict
from m3depth.training.log import LOG, read_log
from marssim.base.files.json_file import DatasetError, read_json

VISIBLE = "visible_epe"  # the figure of the pixels that both cameras see
POOLED = ("mae", "rmse", "abs_rel", "bad1")  # figures of an interval of depth
DIGITS = 6  # significant digits of the figures of a pair
COLUMNS = {
    **DEPTH_COLUMNS,
    VISIBLE: "EPE, non-occluded [px] ↓",
    **{f"normal_{name}": title for name, title in NORMAL_COLUMNS.items()},
}
"""The figures of a pair, with their headings in tables."""
RATIOS = {
    "abs_rel": "Abs Rel", "epe": "EPE", VISIBLE: "EPE, non-occluded",
    "normal_mean": "mean error of the normals",
}  # fmt: skip
"""The figures that are also given over those of the reference."""
SHARES = {name for name in COLUMNS if name == "bad1" or name.startswith(("delta", "normal_within"))}
FAILED_ABS_REL = 0.5  # a method fails on a pair if its Abs Rel is this or more


def scored_methods(folder: Path, size: int) -> dict[str, dict[str, Any]]:
    """Return the scores of every method in a folder of docs/scoring/score_manifest.py.

    Args:
        folder: The --out of that command.
        size: Width of the pairs [px].

    Returns:
        By method and set of the manifest "degrade", and "places" by their name: "data" (the digest of the pairs),
        "pairs" and "scenes" (their names), "figures" (for each of COLUMNS a list over the pairs; None where a pair has
        none), "intervals" (errors by true depth), "scene_intervals" (by scene and interval, the number of pixels and
        the sum of their absolute errors [m]; {} for scores of earlier versions), "gets_truth", "normals_are_fitted"
        (whether the normals are those of planes that are fitted to the depth), "weights_sha256" (with the source file
        of a network of one's own; None without weights), "runtime" (None for methods that are not named m3depth) and
        "commit" (of the code).

    Raises:
        DatasetError: There are none, the places do not have the same methods, or two have other weights of a method.
    """
    methods: dict[str, dict[str, Any]] = {}
    labels: list[str] = []
    for path in sorted(folder.glob(f"depth/{size}/*/*/results.json")):
        part, name, place = read_json(path), path.parts[-3], path.parts[-2]
        labels = labels or [*part["methods"]]
        if [*part["methods"]] != labels:
            raise DatasetError(f"--scores {folder}: {name}/{place} has other methods than the rest")
        for label in labels:
            sets = methods.setdefault(label, {})
            sets.setdefault(name, {"degrade": part["degrade"], "places": {}})["places"][place] = _of_place(part, label)
            if len(set(of_all_places(sets, "weights_sha256"))) > 1:
                raise DatasetError(
                    f"--scores {folder}: {name}/{place} was scored with other weights of {label} than the rest; "
                    "run score_manifest again"
                )
    if not methods:
        raise DatasetError(f"--scores {folder}: holds no scores of {size} px of score_manifest")
    return methods


def of_all_places(sets: Mapping[str, Any], key: str) -> list[Any]:
    """Return an entry of every place of every set of a record; None where the record is older than the entry."""
    return [place.get(key) for of_set in sets.values() for place in of_set["places"].values()]


def _of_place(part: Mapping[str, Any], label: str) -> dict[str, Any]:
    pairs = part["per_pair"]
    records = [_with_normals(pair[label]) for pair in pairs]
    result = part["methods"][label]
    return {
        "data": part["data_sha256"],
        "weights_sha256": part["estimators"][label]["sha256"],
        "commit": part["versions"]["commit"],
        "runtime": part.get("runtime") if part["estimators"][label]["name"].startswith("m3depth") else None,
        "pairs": [pair["pair"] for pair in pairs],
        "scenes": [pair["scene"] for pair in pairs],
        "figures": {name: [_rounded(record.get(name)) for record in records] for name in COLUMNS},
        "intervals": [
            {
                **{name: row[name] for name in ("from_m", "to_m", "pixels")},
                "pooled": {name: _rounded(row["pooled"].get(name)) for name in POOLED},
            }
            for row in result["intervals"]
        ],
        "scene_intervals": _scene_intervals(pairs, label),
        "gets_truth": bool(result.get("gets_truth")),
        "normals_are_fitted": result["normals_are_fitted"] or not any("normal_mean" in pair[label] for pair in pairs),
    }


def _scene_intervals(pairs: Sequence[Mapping[str, Any]], label: str) -> dict[str, dict[str, list[float]]]:
    """Return the sums of each scene for each interval of true depth; {} if the scores of a pair have none."""
    sums: dict[str, dict[str, Any]] = {}
    for pair in pairs:
        of_pair = pair[label].get("counts", {}).get("intervals")
        if of_pair is None:
            return {}
        of_scene = sums.setdefault(pair["scene"], dict.fromkeys(of_pair, 0))
        for name, values in of_pair.items():
            of_scene[name] = of_scene[name] + np.array(values)
    return {
        scene: {name: [_rounded(value) for value in values.tolist()] for name, values in of_scene.items()}
        for scene, of_scene in sums.items()
    }


def _with_normals(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return the figures of a pair, where the fitted normals stand for those that the method lacks."""
    fitted = {f"normal_{name}": record.get(f"fitted_normal_{name}") for name in NORMAL_COLUMNS}
    return {VISIBLE: record.get("kinds", {}).get("visible", {}).get("epe"), **fitted, **record}


def _rounded(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.{DIGITS}g}")


def record_of_run(run: Path) -> dict[str, Any]:
    """Return what a record holds of a folder of m3depth.train.

    Returns:
        "network", the sizes (m3depth.kinds.config.config_from_dict), "weights_sha256" and "training".

    Raises:
        DatasetError: It is no folder of a run, or holds no step.
        FileNotFoundError: It holds no weights.
    """
    trained = training(run)
    weights = run / "weights.safetensors"
    network = read_json(weights.with_suffix(".json"))
    return {
        "network": network, "weights_sha256": hashlib.sha256(weights.read_bytes()).hexdigest(), "training": trained,
    }  # fmt: skip


def training(run: Path) -> dict[str, Any]:
    """Return the steps, the minutes, the starts and the errors at the validations of a run.

    Where other programs kept the processor busy, the minutes of the processor, which the log counts from each start on,
    compare runs better than those of the clock. The log counts those of the first process; where torchrun started
    several, they are taken that many times, though the others do not validate. A run has as many at each start; older
    logs lack their number.

    Raises:
        DatasetError: It is no folder of a run, or a line of its log is malformed.
    """
    log = run / LOG
    if not log.is_file():
        raise DatasetError(f"--runs {run}: has no {LOG} of m3depth.train")
    lines = [record for _, record in read_log(log)]
    steps = [line for line in lines if line["kind"] in ("train", "stop")]
    if not steps:
        raise DatasetError(f"--runs {run}: its {LOG} has no step")
    for line in steps:
        if "processor_minutes" not in line or "minutes" not in line:
            raise DatasetError(f"{log}: step {line['step']} has no minutes or no processor_minutes")
    starts = [line for line in lines if line["kind"] == "start"]
    processes = max((line.get("processes", 1) for line in starts), default=1)
    processor, before, last = [], 0.0, 0.0
    for line in lines:
        if line["kind"] == "start":
            before, last = before + last, 0.0
        elif line["kind"] in ("train", "stop"):
            last = processes * line["processor_minutes"]
            processor.append(before + last)
    at = [line["step"] for line in steps]
    return {
        "steps": steps[-1]["step"],
        "minutes": steps[-1]["minutes"],
        "processor_minutes": processor[-1],
        "starts": starts,
        "validations": [
            {
                "step": line["step"],
                "processor_minutes": float(np.interp(line["step"], at, processor)),
                "epe": line["epe"],
                "normal": line.get("normal"),
            }
            for line in lines
            if line["kind"] == "val"
        ],
    }


def read_record(path: Path) -> dict[str, Any]:
    """Return a record that docs/scoring/compare_methods.py wrote.

    Raises:
        DatasetError: The file is not such a record, or its network is none that this program knows.
    """
    record: dict[str, Any] = read_json(path)
    if not isinstance(record, dict) or not {"name", "size", "run", "sets"} <= record.keys():
        raise DatasetError(f"--records {path}: is not a record that compare_methods.py wrote")
    if record["run"]:
        try:
            config_from_dict(record["run"]["network"])
        except ValueError as error:
            raise DatasetError(f"--records {path}: {error}") from None
    return record


def check_same_pairs(records: Sequence[Mapping[str, Any]], rendered_elsewhere: bool = False) -> None:
    """Raise DatasetError, one line, unless all records are of the same sets, places, pairs and degradations.

    Args:
        records: The records.
        rendered_elsewhere: Whether pairs of the same names with other digests are the same too, if as many pixels lie
            in each interval of true depth.
    """
    first = records[0]
    for record in records[1:]:
        both = f"{record['name']} and {first['name']}"
        if record["size"] != first["size"]:
            raise DatasetError(f"{both} were scored on pairs of {record['size']} and {first['size']} px")
        if record["sets"].keys() != first["sets"].keys():
            raise DatasetError(
                f"{both} were scored on different sets: {_names(record['sets'])}; {_names(first['sets'])}"
            )
        for name, of_set in record["sets"].items():
            other = first["sets"][name]
            if of_set["degrade"] != other["degrade"] or _pairs(of_set, rendered_elsewhere) != _pairs(
                other, rendered_elsewhere
            ):
                raise DatasetError(f"{both} were scored on different pairs of {name}, or on pairs degraded differently")


def _names(sets: Mapping[str, Any]) -> str:
    return ", ".join(sorted(sets))


def other_renderings(records: Sequence[Mapping[str, Any]], reference: Mapping[str, Any]) -> dict[str, list[str]]:
    """Return the methods whose pairs have another digest than those of the reference, by "place of set".

    A processor of another kind, or another version, renders the same pairs with other last bits.
    """
    others: dict[str, list[str]] = {}
    for record in records:
        for name, of_set in record["sets"].items():
            for place, part in of_set["places"].items():
                if part["data"] != reference["sets"][name]["places"][place]["data"]:
                    others.setdefault(f"{place} of {name}", []).append(record["name"])
    return others


def _pairs(of_set: Mapping[str, Any], rendered_elsewhere: bool) -> dict[str, Any]:
    """Return what tells the pairs of each place: names, pixels in each interval of depth, and the digest, if it may."""
    return {
        place: (
            part["pairs"], [interval["pixels"] for interval in part["intervals"]],
            None if rendered_elsewhere else part["data"],
        )
        for place, part in of_set["places"].items()
    }  # fmt: skip
