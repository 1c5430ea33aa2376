"""Commands in processes of their own: forked from a server that has them imported, or in a fresh interpreter."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import command_server

MODULES = (
    "marssim.generate", "marssim.export", "m3depth.train", "m3depth.evaluate", "m3depth.predict", "envs.evaluate",
    "small_commands", "matplotlib.figure", "stable_baselines3",
)  # fmt: skip
ENDS_WITHIN = 60.0  # [s] in which the workers of a killed command must end


@dataclass(frozen=True)
class Ended:
    """How a command ended."""

    code: int
    """Exit code; minus the number of the signal that ended the process."""
    stdout: str
    stderr: str

    def check(self, *names: str) -> None:
        """Check that the work is done, or that one line on stderr says what is wrong and holds one of the names."""
        assert self.code != -signal.SIGABRT, f"not done after {command_server.LONGEST} s, or aborted: {self.stderr}"
        assert self.code in (0, 2), f"exit code {self.code}: {self.stderr}"
        assert "Traceback" not in self.stderr, self.stderr
        if self.code == 2:
            line = self.stderr.strip().splitlines()[-1]
            assert self.stderr.count("error: ") == 1 and line.startswith("error: "), self.stderr
            assert any(name in line for name in names), f"{line}: names none of {names}"


class Server:
    """Starts commands by a fork each.

    Args:
        folder: Takes what the commands print.
        environment: Variables that differ from those of this process.
    """

    def __init__(self, folder: Path, environment: Mapping[str, str] | None = None) -> None:
        self.folder = folder
        here = str(Path(__file__).parent)
        variables = {**os.environ, "OMP_NUM_THREADS": "1", **(environment or {})}
        variables["PYTHONPATH"] = os.pathsep.join(filter(None, (here, variables.get("PYTHONPATH"))))
        self.process = subprocess.Popen(
            [sys.executable, str(Path(command_server.__file__)), *MODULES],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=variables,
        )  # fmt: skip
        self._answer()
        self.number = 0

    def _answer(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line, "the server of the commands has ended"
        return json.loads(line)

    def _ask(self, **request: Any) -> dict[str, Any]:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(request) + "\n")
        self.process.stdin.flush()
        return self._answer()

    def start(self, entry: str, args: Sequence[str], **more: Any) -> tuple[int, Path]:
        """Start a command; return its process and the folder of what it prints.

        Args:
            entry: Module of the command, or module:function.
            args: Its command line.
            more: Keys of a request; see command_server.run.
        """
        self.number += 1
        folder = self.folder / str(self.number)
        folder.mkdir()
        folder.chmod(0o777)
        request = {"stdout": str(folder / "stdout"), "stderr": str(folder / "stderr"), "cwd": str(folder), **more}
        return self._ask(do="start", entry=entry, args=list(args), **request)["pid"], folder

    def wait(self, pid: int, folder: Path) -> Ended:
        """Return how a command has ended, once it has, and all that it started."""
        code = self._ask(do="wait", pid=pid)["code"]
        deadline = time.monotonic() + ENDS_WITHIN
        with suppress(ProcessLookupError):
            while time.monotonic() < deadline:
                os.killpg(pid, 0)
                time.sleep(0.05)
            raise AssertionError(f"processes of {pid} still run {ENDS_WITHIN:g} s after it ended")
        texts = [(folder / name).read_text(errors="replace") if (folder / name).exists() else "" for name in NAMES]
        return Ended(code, *texts)

    def run(self, entry: str, args: Sequence[str], **more: Any) -> Ended:
        """Run a command to its end."""
        return self.wait(*self.start(entry, args, **more))

    def close(self) -> None:
        """End the server."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait(60)


NAMES = ("stdout", "stderr")


def fresh(
    module: str, args: Sequence[str], before: Callable[[], None] | None = None, shell: str | None = None, **more: Any
) -> Ended:
    """Run a command in an interpreter of its own.

    Args:
        module: Its module.
        args: Its command line.
        before: Is called in the new process before the interpreter starts.
        shell: What a shell does with the command, as '"$@" >&-'.
        more: Arguments of subprocess.run.
    """
    command = [sys.executable, "-m", module, *args]
    if shell is not None:
        command = ["sh", "-c", shell, "sh", *command]
    options = {"capture_output": True, "timeout": command_server.LONGEST, "preexec_fn": before, **more}
    done = subprocess.run(command, **options)
    return Ended(done.returncode, *(text.decode(errors="replace") for text in (done.stdout, done.stderr)))
