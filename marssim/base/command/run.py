"""What every command does with its command line and with mistakes: one line on stderr and an exit code.

0    Done.
1    The work came to a bad end: a training diverged, or marssim.verify found something wrong.
2    A mistake of the user, or a disk, a package or a worker process that failed.
130  Interrupted by Ctrl-C or SIGTERM, which a cluster's queue sends when the time is up.
141  The reader of stdout closed the pipe, as `| head` does. Nothing is printed then.

Anything else is a bug and shows its traceback.
"""

from __future__ import annotations

import errno
import os
import re
import select
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager
from pathlib import Path

from marssim.base.command.flags import Config, parse
from marssim.base.command.notes import GOES_ON, KILLED, speaking

MISTAKES = (ValueError, OSError, ImportError, MemoryError, BrokenExecutor)
_FIELD = re.compile(r"`([a-z][a-z0-9_]*(?:\.[a-z][a-z0-9_]*)*)`")


def run_command(
    work: Callable[[Config], object],
    config: type[Config],
    prog: str,
    description: str | None,
    args: Sequence[str] | None = None,
    interrupted: str = GOES_ON,
) -> int:
    """Parse the command line into `config`, a dataclass, and call `work` on it. Returns the exit code.

    args: instead of sys.argv. interrupted: what Ctrl-C leaves, and how to go on. A mistake is one line,
    `error: ...`, on stderr; --help raises SystemExit(0). What a command writes goes to its field `out`, if it has one.
    """

    def parsed_and_done() -> None:
        asked = parse(config, prog, description, args)
        with writing_to(getattr(asked, "out", None)):
            work(asked)

    return exit_code(parsed_and_done, interrupted)


@contextmanager
def writing_to(out: Path | None) -> Iterator[None]:
    """What the system does not let be written to `out`, or on the way there, is told with the flag --out before it."""
    try:
        yield
    except OSError as error:
        if out is None or error.filename is None or error.strerror is None:
            raise
        there, file = (Path(os.path.abspath(str(path))) for path in (out, error.filename))
        if file == there:
            raise OSError(f"--out {out}: {_reason(error)}") from error
        to_be_made = file in there.parents and not os.path.exists(file)
        if to_be_made or (there in file.parents and error.errno != errno.ENOENT):  # that was read, not written
            raise OSError(f"--out {out}: {describe(error)}") from error
        raise


def exit_code(work: Callable[[], object], interrupted: str = GOES_ON) -> int:
    """Call `work`, tell its mistakes as run_command does, and return the exit code."""
    try:
        with speaking(), _terminated_as_interrupted():
            work()
        sys.stdout.flush()
    except BrokenPipeError as error:
        return 141 if _unread() else _fail(describe(error), 2)
    except MISTAKES as error:
        return _fail(describe(error), 2)
    except FloatingPointError as error:
        return _fail(describe(error), 1)
    except RuntimeError as error:
        if not _is_out_of_memory(error):
            raise
        return _fail(f"out of memory ({str(error).strip().splitlines()[0]})", 2)
    except KeyboardInterrupt:
        return _fail(f"interrupted; {interrupted}", 130)
    return 0


@contextmanager
def _terminated_as_interrupted() -> Iterator[None]:
    """Meanwhile SIGTERM raises KeyboardInterrupt; not outside the main thread, nor where somebody else handles it."""
    if (
        threading.current_thread() is not threading.main_thread()
        or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
    ):
        yield
        return

    def end(number: int, frame: object) -> None:
        signal.signal(number, signal.SIG_DFL)  # a second one ends at once
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _is_out_of_memory(error: RuntimeError) -> bool:
    """Is it PyTorch's, of a GPU or of the processor? That knows no MemoryError, and is not imported here."""
    return type(error).__name__ == "OutOfMemoryError" or "can't allocate memory" in str(error)


def _unread() -> bool:
    """Has whoever read what is printed gone? What is left to print then goes nowhere. Unix only."""
    if not hasattr(select, "poll"):
        return False
    try:
        out = sys.stdout.fileno()
    except OSError:  # nothing of the system's: text that is kept
        return False
    pipe = select.poll()
    pipe.register(out, 0)
    gone = any(event & select.POLLERR for _, event in pipe.poll(0))
    if gone:
        os.dup2(os.open(os.devnull, os.O_WRONLY), out)
    return gone


def describe(error: BaseException) -> str:
    """One line for the user: an OSError's file and reason, else what the error says.

    What stands in ` ` in a message is a field of a config, `relief.heightmap_at`, and becomes its flag.
    """
    if isinstance(error, BrokenExecutor) and not str(error):
        return KILLED
    if isinstance(error, MemoryError):
        return f"out of memory{f' ({error})' if str(error) else ''}"
    if isinstance(error, OSError) and error.strerror:
        files = [str(file) for file in (error.filename, error.filename2) if file is not None]
        return ": ".join([" -> ".join(files), _reason(error)] if files else [_reason(error)])
    line = " ".join(line.strip() for line in str(error).splitlines() if line.strip()) or type(error).__name__
    return _FIELD.sub(lambda found: f"--{found[1].replace('_', '-')}", line)


def _reason(error: OSError) -> str:
    said = error.strerror or str(error)
    return said[:1].lower() + said[1:]


def _fail(line: str, code: int) -> int:
    print(f"error: {line}", file=sys.stderr, flush=True)
    return code
