"""Write the tables of longer trainings beside those of one core, for docs/results/methods.md.

    python docs/scoring/longer_trainings.py

It reads each folder of a run in docs/results/methods/longer, NAME-150-min, and the record of NAME in
docs/results/methods/records, for the table of the trainings. For that of the scores it reads the records of both in
docs/results/methods/rescored/records, which are of the same pairs.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from compare_methods import metrics
from method_records import VISIBLE, read_record, training

from m3depth.evaluation.report import number
from m3depth.evaluation.report import table as markdown_table

METHODS = Path(__file__).parents[1] / "results" / "methods"
LONGER, RECORDS, ENDING = METHODS / "longer", METHODS / "records", "-150-min"
RESCORED = METHODS / "rescored" / "records"
DIGEST = 12  # shown characters of a digest
CORES = 2  # that the processes of a longer training shared
COLUMNS = (
    "network", "steps", "steps, one core", "EPE [px]", "EPE, one core", "normals [deg]", "normals, one core",
    "time of the cores", "commit", "SHA-256 of the weights",
)  # fmt: skip
SCORES = {"abs_rel": "Abs Rel", VISIBLE: "EPE, non-occluded [px]", "normal_mean": "normals [deg]"}


def rows(longer: Path = LONGER, records: Path = RECORDS) -> list[list[str]]:
    """Return the cells of each network in the order of COLUMNS.

    Args:
        longer: Folder with a folder for each longer training.
        records: Folder with the records of compare_methods.py.

    Raises:
        DatasetError: A folder is none of a run.
    """
    out = []
    for run in sorted(longer.iterdir()):
        name = run.name.removesuffix(ENDING)
        long = training(run)
        short = json.loads((records / f"{name}.json").read_text(encoding="utf-8"))["run"]["training"]
        last, before = long["validations"][-1], short["validations"][-1]
        share = long["processor_minutes"] / (CORES * long["minutes"])
        digest = hashlib.sha256((run / "weights.safetensors").read_bytes()).hexdigest()[:DIGEST]
        commits = ", ".join(dict.fromkeys(start["commit"] for start in long["starts"]))
        out.append(
            [
                name, str(long["steps"]), str(short["steps"]), f"{last['epe']:.2f}", f"{before['epe']:.2f}",
                _degrees(last), _degrees(before), f"{100 * share:.0f} %", commits, f"`{digest}`",
            ]
        )  # fmt: skip
    return out


def table(longer: Path = LONGER, records: Path = RECORDS) -> str:
    """Return the table in Markdown. Arguments are those of rows."""
    return "\n".join(markdown_table([*COLUMNS], rows(longer, records))) + "\n"


def scores_table(longer: Path = LONGER, rescored: Path = RESCORED) -> str:
    """Return the table of the scores in Markdown: a row for each network and set of pairs.

    Each figure is the mean over the pairs after the longer training, and in brackets its ratio to that after the
    training of one core, with the 95 % interval of the paired bootstrap over scenes.

    Args:
        longer: As for rows.
        rescored: Folder with the records of both trainings of each network.

    Raises:
        DatasetError: A file is no record.
    """
    out = []
    for run in sorted(longer.iterdir()):
        name = run.name.removesuffix(ENDING)
        long, short = (read_record(rescored / f"{label}.json")["sets"] for label in (run.name, name))
        for of_set in long:
            scores = metrics(long[of_set], short[of_set])
            out.append([f"{name}, {of_set}", *(_with_ratio(scores[key]) for key in SCORES)])
    return "\n".join(markdown_table(["network and pairs", *SCORES.values()], out)) + "\n"


def _with_ratio(score: dict[str, Any]) -> str:
    if score["ratio_interval"] is None:  # fewer scenes than an interval needs
        return f"{number(score['value'])} ({score['ratio']:.2f} times)"
    low, high = (f"{limit:.2f}" for limit in score["ratio_interval"])
    return f"{number(score['value'])} ({score['ratio']:.2f} times, {low} to {high})"


def _degrees(validation: dict[str, Any]) -> str:
    normal = validation.get("normal")
    return "-" if normal is None else f"{normal:.1f}"


if __name__ == "__main__":
    print(table())
    print(scores_table(), end="")
