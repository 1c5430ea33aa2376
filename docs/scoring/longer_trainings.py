"""Write the table of longer trainings beside those of one core, for docs/results/methods.md.

    python docs/scoring/longer_trainings.py

It reads each folder of a run in docs/results/methods/longer, NAME-150-min, and the record of NAME in
docs/results/methods/records.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from method_records import training

METHODS = Path(__file__).parents[1] / "results" / "methods"
LONGER, RECORDS, ENDING = METHODS / "longer", METHODS / "records", "-150-min"
CORES = 2  # that the processes of a longer training shared
COLUMNS = (
    "network", "steps", "steps, one core", "EPE [px]", "EPE, one core", "normals [deg]", "normals, one core",
    "time of the cores", "SHA-256 of the weights",
)  # fmt: skip


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
        digest = hashlib.sha256((run / "weights.safetensors").read_bytes()).hexdigest()
        out.append(
            [
                f"`{name}`", str(long["steps"]), str(short["steps"]), f"{last['epe']:.2f}", f"{before['epe']:.2f}",
                _degrees(last), _degrees(before), f"{100 * share:.0f} %", f"`{digest}`",
            ]
        )  # fmt: skip
    return out


def table(longer: Path = LONGER, records: Path = RECORDS) -> str:
    """Return the table in Markdown. Arguments are those of rows."""
    lines = [COLUMNS, ("---", *("---:" for _ in COLUMNS[1:-1]), "---"), *rows(longer, records)]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def _degrees(validation: dict[str, Any]) -> str:
    normal = validation.get("normal")
    return "-" if normal is None else f"{normal:.1f}"


if __name__ == "__main__":
    print(table(), end="")
