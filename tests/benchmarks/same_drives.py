"""Are drives the same on one worker and on two, on dask, in shards, and killed and continued?

    python tests/benchmarks/same_drives.py --out out/same
    python tests/benchmarks/same_drives.py --out out/same --condition clear storm --perception sgbm m3depth

Drives one course of every condition of marsnav-v1 dev in each of these ways, and compares, but for times, the records
of the drives (each step's place, each mean of the depth's errors) and results.json. Prints a table, and exits with 1 if
anything differs. The same command continues where it was stopped.
"""

import argparse
import json
import subprocess
import sys
from collections.abc import Mapping
from itertools import count
from pathlib import Path
from time import sleep
from typing import Any

from envs.suites.suite import load_suite

SUITE, SPLIT = "marsnav-v1", "dev"
TIMES = ("step_seconds", "perception_seconds")  # fields of a record that differ from run to run
RESULTS = ("results", "differences", "suite", "episodes", "weights", "runtime", "code")  # compared in results.json
WAYS = ("1 worker", "2 workers", "dask", "shards", "killed")
KILL_AFTER = 3  # drives after which an evaluation is killed

Records = Mapping[str, Mapping[str, Any]]


def command(out: Path, asked: argparse.Namespace, *more: str) -> list[str]:
    """Return the evaluation of the courses into a folder."""
    return [
        sys.executable, "-m", "envs.evaluate", "--suite", SUITE, "--split", SPLIT, "--episodes", "1",
        "--condition", *asked.condition, "--perception", *asked.perception, "--no-videos", "--out", str(out), *more,
    ]  # fmt: skip


def drive(way: str, out: Path, asked: argparse.Namespace) -> None:
    """Drive all courses in one of WAYS into a folder."""
    if way == "dask":
        from distributed import LocalCluster

        with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:
            subprocess.run(command(out, asked, "--scheduler", cluster.scheduler_address), check=True)
    elif way == "shards":
        parts = [out.with_name(f"{out.name}-{part}") for part in (1, 2)]
        for n, part in enumerate(parts, start=1):
            subprocess.run(command(part, asked, "--shard", f"{n}/{len(parts)}"), check=True)
        subprocess.run([sys.executable, "-m", "envs.join", *map(str, parts), "--out", str(out)], check=True)
    elif way == "killed":
        drive_and_kill(out, asked)
    else:
        subprocess.run(command(out, asked, "--workers", way.split()[0]), check=True)


def drive_and_kill(out: Path, asked: argparse.Namespace) -> None:
    """Drive all courses, and kill the evaluation in the middle of a drive after each KILL_AFTER of them."""
    for run in count(1):
        before = len(list((out / "episodes").glob("*.json")))
        process = subprocess.Popen(command(out, asked))
        while process.poll() is None:
            sleep(2)
            if len(list((out / "episodes").glob("*.json"))) >= before + KILL_AFTER:
                process.kill()
        if process.returncode >= 0:  # it was not killed
            if process.returncode:
                raise SystemExit(f"envs.evaluate failed in {out}")
            note = out / "kills.txt"
            if run == 1 and not note.is_file():
                raise SystemExit(f"{out}: was finished without a kill; delete it, or ask for more conditions")
            if run > 1:
                note.write_text(f"{run - 1}\n")
            print(f"{out}: killed {note.read_text().strip()} times", file=sys.stderr)
            return


def records_of(out: Path) -> Records:
    """Return the records of a folder by the names of their files, without times."""
    records = {}
    for file in sorted((out / "episodes").glob("*.json")):
        record = json.loads(file.read_text())
        records[file.name] = {name: value for name, value in record.items() if name not in TIMES}
    return records


def results_of(out: Path) -> Mapping[str, Any]:
    """Return what results.json says of the drives of a folder, without times."""
    content = json.loads((out / "results.json").read_text())
    return {name: without_times(content[name]) for name in RESULTS if name in content}


def without_times(value: Any) -> Any:
    """Return a value of JSON without the fields that differ from run to run."""
    if isinstance(value, dict):
        return {key: without_times(each) for key, each in value.items() if key not in TIMES}
    return [without_times(each) for each in value] if isinstance(value, list) else value


def differences(records: Records, expected: Records) -> dict[str, list[str]]:
    """Return the fields in which records differ from those that are expected, by their files."""
    out = {}
    for name in sorted(records.keys() | expected.keys()):
        if name not in records or name not in expected:
            out[name] = ["missing"]
        elif fields := [key for key in expected[name] if records[name].get(key) != expected[name][key]]:
            out[name] = fields
    return out


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--perception", nargs="+", default=["ground_truth", "sgbm"])
    parser.add_argument("--condition", nargs="+", default=list(load_suite(SUITE).conditions))
    asked = parser.parse_args()
    folders = {way: asked.out / way.replace(" ", "-") for way in WAYS}
    for way, folder in folders.items():
        drive(way, folder, asked)
    expected, results = records_of(folders[WAYS[0]]), results_of(folders[WAYS[0]])
    print("| driven by | drives | that differ from those of 1 worker | in | results.json |\n|---|---|---|---|---|")
    different = 0
    for way, folder in folders.items():
        records = records_of(folder)
        apart = differences(records, expected)
        fields = sorted({field for each in apart.values() for field in each})
        same = results_of(folder) == results
        print(
            f"| {way} | {len(records)} | {len(apart)} | {', '.join(fields) or '-'} | {'same' if same else 'differs'} |"
        )
        for name, each in apart.items():
            print(f"{way}: {name}: {', '.join(each)}", file=sys.stderr)
        different += len(apart) + (not same)
    return 1 if different or not expected else 0


if __name__ == "__main__":
    sys.exit(main())
