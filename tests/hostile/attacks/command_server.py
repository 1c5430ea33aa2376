"""A process that has the commands imported and forks one for each case, since a fresh start takes seconds.

It reads requests from stdin, a line of JSON each, and answers each with a line of JSON. The requests are the calls of
processes.Server.
"""

from __future__ import annotations

import importlib
import json
import os
import resource
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

WRITES = ("open", "os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.truncate")  # events of sys.addaudithook
LONGEST = 300  # [s] then a command counts as hung


def run(request: dict[str, Any]) -> None:
    """Run a command in this process, which was forked for it, and end it."""
    os.setsid()
    os.chdir(request["cwd"])
    for number, file in ((1, request["stdout"]), (2, request["stderr"])):
        opened = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(opened, number)
        os.close(opened)
    if limit := request.get("file_size"):
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
        if request.get("file_size_kills"):
            signal.signal(signal.SIGXFSZ, signal.SIG_DFL)  # Python ignores it, so that a write fails instead
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if user := request.get("user"):
        os.setgroups([])
        os.setgid(user)
        os.setuid(user)
    counted = _count_writes(request["out"], request.get("die_at_write")) if "out" in request else [0]
    module, _, function = request["entry"].partition(":")
    code = getattr(importlib.import_module(module), function or "main")(request["args"])
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    if file := request.get("writes_file"):
        with open(file, "w", encoding="utf-8") as count:
            count.write(str(counted[0]))
    os._exit(code)


def _count_writes(out: str, die_at: int | None) -> list[int]:
    """Count what is written, renamed and deleted in a folder, and die before the n-th time."""
    count = [0]

    def hook(event: str, args: tuple[Any, ...]) -> None:
        if event not in WRITES or not str(args[0]).startswith(out):
            return
        if event == "open" and not args[2] & (os.O_WRONLY | os.O_RDWR):
            return
        count[0] += 1
        if count[0] == die_at:
            os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(hook)
    return count


def answers() -> Iterator[dict[str, Any]]:
    """Do the requests and yield the answers."""
    for line in sys.stdin:
        request = json.loads(line)
        if request["do"] == "start":
            pid = os.fork()
            if not pid:
                try:
                    run(request)
                except BaseException:
                    sys.excepthook(*sys.exc_info())
                    sys.stderr.flush()
                finally:
                    os._exit(1)
            yield {"pid": pid}
        else:
            pid = request["pid"]
            timer = threading.Timer(LONGEST, os.killpg, (pid, signal.SIGABRT))
            timer.start()
            _, status = os.waitpid(pid, 0)
            timer.cancel()
            timer.join()
            yield {"code": os.waitstatus_to_exitcode(status)}


def main() -> None:
    """Import the modules of the command line, then serve."""
    for name in sys.argv[1:]:
        importlib.import_module(name)
    print(json.dumps({"ready": True}), flush=True)
    for answer in answers():
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":  # not in the workers that a command spawns
    main()
