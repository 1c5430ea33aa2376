"""Plant a defect of each kind into a copy of the packages, and check that the campaign finds it.

    python tests/hostile/planted.py [NAME ...]

The attacks must pass on the copy before the defect is in it. Prints a line for each defect, and exits with 1 if one is
not found.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("marssim", "m3depth", "nav", "envs")
BASE = "marssim/base/"
CASES = "120"  # of each kind of attack; some defects show in a part of the cases only
NOT_COPIED = shutil.ignore_patterns("__pycache__")


@dataclass(frozen=True)
class Defect:
    """A change of the sources that makes a defect."""

    test: str
    """The tests that must find it: a file, and what follows -k."""
    changes: tuple[tuple[str, str, str], ...]
    """File, text that it holds once, and what stands there instead."""


STREAMS = (BASE + "command/streams.py", "    sys.stdout, sys.stderr = out, err\n", "")
IMPORTS = (BASE + "command/run.py", "MISTAKES = (")
DEFECTS = {
    "an unchecked value": Defect(
        "test_command_lines.py -k predict or evaluate or nav.map",
        ((BASE + "command/flags.py", "        _check_numbers(parsed)\n", ""),),
    ),
    "an eval": Defect(
        "test_file_formats.py -k place", ((BASE + "files/json_file.py", "json.loads(data.", "eval(data."),)
    ),
    "a pickle": Defect(
        "test_file_formats.py -k checkpoint",
        (("m3depth/training/run.py", "cpu\", weights_only=True", "cpu\", weights_only=False"),),
    ),
    "a pickle in a policy": Defect(
        "test_file_formats.py -k policy",
        (("envs/drivers/policy_archive.py", "_location=\"cpu\", weights_only=True",
          "_location=\"cpu\", weights_only=False"),),
    ),
    "a hang": Defect(
        "test_file_formats.py -k poses",
        (("m3depth/prediction/sources/poses.py", "        if len(values) not in (8, 12) or",
          "        while len(values) not in (8, 12):\n            pass\n        if len(values) not in (8, 12) or"),),
    ),
    "a lock through a link": Defect(
        "test_surroundings.py -k links",
        ((BASE + "files/no_link.py", 'getattr(os, "O_NOFOLLOW", 0) | ', ""),),
    ),
    "a prediction that nobody checks": Defect(
        "test_user_classes.py -k nonsense and m3depth.predict",
        (("m3depth/checked_inference.py", '    caller = f"{type(estimator).__name__}.infer"\n    if not',
          '    return result\n    caller = f"{type(estimator).__name__}.infer"\n    if not'),),
    ),
    "a removed lock": Defect(
        "test_two_writers.py",
        ((BASE + "results/claim.py", "with sole_writer(self.path):", "with suppress(ZeroDivisionError):"),),
    ),
    "a write in place": Defect(
        "test_kills.py -k predict",
        ((BASE + "files/atomic.py", "    path.parent.mkdir(parents=True, exist_ok=True)\n",
          "    path.parent.mkdir(parents=True, exist_ok=True)\n    path.write_bytes(data)\n    return\n"),),
    ),
    "half-written files that stay": Defect(
        "test_kills.py -k predict", ((BASE + "results/claim.py", "for pattern in self.partial:", "for pattern in ():"),)
    ),
    "a swallowed error of the disk": Defect(
        "test_surroundings.py -k limit",
        ((BASE + "files/atomic.py", "        error.filename = error.filename or str(path)\n        raise\n",
          "        print(error)\n"),),
    ),
    "an error that does not name --out": Defect(
        "test_surroundings.py -k read_only",
        ((BASE + "command/run.py", 'with writing_to(getattr(parsed, "out", None)):', "with writing_to(None):"),),
    ),
    "output that decides": Defect("test_surroundings.py -k closed", (STREAMS,)),
    "a character that an encoding lacks": Defect(
        "test_surroundings.py -k locale",
        (STREAMS, (BASE + "command/run.py", "        with writing_to(getattr(",
                   "        print('\\u2192')\n        with writing_to(getattr(")),
    ),
    "a home that must be there": Defect(
        "test_surroundings.py -k home", ((*IMPORTS, "os.listdir(os.environ['HOME'])\nMISTAKES = ("),)
    ),
    "a working directory that must be there": Defect(
        "test_surroundings.py -k removed", ((*IMPORTS, "os.getcwd()\nMISTAKES = ("),)
    ),
    "an exit that counts as success": Defect(
        "test_user_classes.py -k exit and predict",
        ((BASE + "command/exits.py", "    except HelpPrinted:\n", "    except SystemExit:\n"),),
    ),
    "images that a class may change": Defect(
        "test_user_classes.py -k input and m3depth.evaluate",
        (("m3depth/checked_inference.py", "infer(left.copy(), right.copy(), rig", "infer(left, right, rig"),),
    ),
}  # fmt: skip


def is_found(defect: Defect, folder: Path) -> tuple[bool, str]:
    """Return whether tests pass on a copy of the packages and fail once the defect is in it, and their last lines."""
    for package in PACKAGES:
        shutil.copytree(ROOT / package, folder / package, ignore=NOT_COPIED)
    code, printed = _tested(defect.test, folder)
    if code != 0:
        return False, f"fails without the defect too:\n{printed}"
    for file, text, instead in defect.changes:
        source = (folder / file).read_text(encoding="utf-8")
        assert source.count(text) == 1, f"{file} holds {text!r} {source.count(text)} times"
        (folder / file).write_text(source.replace(text, instead), encoding="utf-8")
    code, printed = _tested(defect.test, folder)
    return code == 1 and "failed" in printed, printed


def _tested(test: str, folder: Path) -> tuple[int, str]:
    """Run tests on the packages in a folder; return the exit code and the last lines that they printed."""
    test, _, names = test.partition(" -k ")
    command = [sys.executable, "-m", "pytest", str(ROOT / "tests/hostile" / test), "-x", "-p", "no:cacheprovider"]
    variables = {"HOSTILE_CASES": CASES, "OMP_NUM_THREADS": "1", **os.environ}
    variables["PYTHONPATH"] = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [*command, *(["-k", names] if names else [])], capture_output=True, text=True, env=variables, cwd=folder
    )
    return done.returncode, done.stdout[-2000:]


def main(names: Sequence[str]) -> int:
    """Plant the defects and return the exit code."""
    missed = 0
    for name in names or DEFECTS:
        began = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            is_caught, printed = is_found(DEFECTS[name], Path(folder))
        missed += not is_caught
        print(f"{'found ' if is_caught else 'MISSED'}  {name}, {time.monotonic() - began:.0f} s", flush=True)
        if not is_caught:
            print(printed)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
