"""Run a command: parse its command line, do its work, and turn errors into one line on stderr and an exit code.

0    The command has done its work.
1    The work ended badly: a training diverged, or marssim.verify found something wrong.
2    The user made a mistake, or a disk, a package or a worker process failed. Also if only stdout could not be written,
     to a full disk for one; then the work is done.
130  Ctrl-C, SIGTERM or SIGHUP interrupted the command. A cluster's queue sends SIGTERM when the time is up, and a
     terminal that is closed sends SIGHUP.
141  The reader of stdout closed the pipe, as `| head` does. Nothing is printed then.

Any other exception is a bug and shows its traceback. What is printed never decides over the work: see
marssim.base.command.streams.
"""

from __future__ import annotations

import errno
import math
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager
from pathlib import Path

from marssim.base.command.exits import exits_as_errors
from marssim.base.command.flags import Config, parse
from marssim.base.command.notes import one_note
from marssim.base.command.signals import REPEAT_WITHIN, STOPPING
from marssim.base.command.streams import SafeStream, safe_streams
from marssim.base.command.wording import GOES_ON, KILLED

MISTAKES = (ValueError, OSError, ImportError, MemoryError)
# in errors of PyTorch, of cuBLAS, of cuDNN and of Apple's GPUs; a driver's error says "CUDA error: out of memory"
_NO_MEMORY = r"can't allocate memory|out of memory|_ALLOC_FAILED"
_FIELD = re.compile(r"`([a-z][a-z0-9_]*(?:\.[a-z][a-z0-9_]*)*)`")


def run_command(
    work: Callable[[Config], object],
    config: type[Config],
    prog: str,
    description: str | None,
    args: Sequence[str] | None = None,
    interrupted: str = GOES_ON,
    default: Config | None = None,
) -> int:
    """Parse a command line, do the work, and return the exit code.

    An error is printed to stderr as one line, `error: ...`.

    Args:
        work: Does the work. It takes the config.
        config: A dataclass with the flags of the command. If it has a field `out`, errors of writing there name --out.
        prog: The command, as it is typed.
        description: Text above the flags in --help.
        args: The command line; None: sys.argv without the program.
        interrupted: What Ctrl-C or a worker that is killed leaves, and how to go on; it ends the message on that.
        default: An instance whose values are the defaults, instead of those of the class.

    Returns:
        The exit code; see the module.

    Raises:
        HelpPrinted: --help or --version was asked for, and is printed.
    """

    def parse_and_work() -> None:
        parsed = parse(config, prog, description, args, default)
        with writing_to(getattr(parsed, "out", None)):
            work(parsed)

    return exit_code(parse_and_work, interrupted)


@contextmanager
def writing_to(out: Path | None) -> Iterator[None]:
    """Name the flag --out in an OSError about a file in the folder `out`, or about a folder that must hold it.

    Args:
        out: Folder of the results; None changes no error.

    Raises:
        OSError: The block failed to write. The message begins with "--out" if that is where it failed.
    """
    try:
        yield
    except OSError as error:
        if out is None or error.filename is None or error.strerror is None:
            raise
        folder, file = (Path(os.path.abspath(str(path))) for path in (out, error.filename))
        if file == folder:
            raise OSError(f"--out {out}: {_reason(error)}") from error
        missing_parent = file in folder.parents and not os.path.exists(file)
        # a file in the folder that does not exist was read, not written
        if missing_parent or (folder in file.parents and error.errno != errno.ENOENT):
            raise OSError(f"--out {out}: {describe(error)}") from error
        raise


def exit_code(work: Callable[[], object], interrupted: str = GOES_ON) -> int:
    """Do the work, print an error as run_command does, and return the exit code.

    Args:
        work: Does the work.
        interrupted: What Ctrl-C or a worker that is killed leaves, and how to go on.
    """
    with safe_streams() as out:
        code = _exit_code(work, interrupted, out)
        if code == 0 and out.error is not None:
            return _fail(f"stdout: {describe(out.error)}; the work is done, but not all that it printed is written", 2)
        return code


def _exit_code(work: Callable[[], object], interrupted: str, out: SafeStream) -> int:
    try:
        with one_note(), _terminated_as_interrupted(), exits_as_errors():
            _check_working_directory()
            work()
        out.flush()
    except BrokenPipeError as error:
        return 141 if out.reader_is_gone() else _fail(describe(error), 2)
    except BrokenExecutor as error:
        return _fail(f"{describe(error)}; {interrupted}", 2)
    except MISTAKES as error:
        return _fail(describe(error), 2)
    except FloatingPointError as error:
        return _fail(describe(error), 1)
    except RuntimeError as error:
        if _is_interruption(error):  # in a file that PyTorch was writing
            return _fail(f"interrupted; {interrupted}", 130)
        if (advice := _advice_for_gpu(error)) is not None:
            return _fail(advice, 2)
        if not is_out_of_memory(error):
            raise
        return _fail(f"out of memory ({str(error).strip().splitlines()[0]})", 2)
    except (KeyboardInterrupt, SystemError) as error:
        if not _is_interruption(error):
            raise
        return _fail(f"interrupted; {interrupted}", 130)
    return 0


def _check_working_directory() -> None:
    """Raise a ValueError where the working directory was removed: relative paths lead nowhere, and MKL ends PyTorch."""
    try:
        os.getcwd()
    except FileNotFoundError:
        raise ValueError("the working directory was removed: change to a folder that exists") from None


@contextmanager
def _terminated_as_interrupted() -> Iterator[None]:
    """Let each of STOPPING raise KeyboardInterrupt in the block, unless it has a handler, or is ignored.

    Outside the main thread, where Python cannot handle signals, nothing changes.
    """
    numbers = [n for n in STOPPING if signal.getsignal(n) is signal.SIG_DFL]
    if threading.current_thread() is not threading.main_thread():
        numbers = []

    first = math.inf  # until the first signal has come

    def end(number: int, frame: object) -> None:
        nonlocal first
        if first == math.inf:
            first = time.monotonic()
            raise KeyboardInterrupt
        # a second signal ends the process at once, but no copy of the first: a shell and its terminal both send SIGHUP
        if time.monotonic() - first > REPEAT_WITHIN:
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)

    for number in numbers:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in numbers:
            signal.signal(number, signal.SIG_DFL)


def _is_interruption(error: BaseException) -> bool:
    """Return whether a signal caused an error. In a call of a compiled function, it is a SystemError."""
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, KeyboardInterrupt):
        cause = cause.__cause__ or cause.__context__
    return cause is not None


def is_out_of_memory(error: BaseException) -> bool:
    """Return whether PyTorch raised the error for lack of memory of a GPU or of the processor.

    PyTorch raises no MemoryError. Its classes are known by name, since it is not imported here.
    """
    return isinstance(error, RuntimeError) and (
        type(error).__name__ == "OutOfMemoryError" or re.search(_NO_MEMORY, str(error)) is not None
    )


def _advice_for_gpu(error: RuntimeError) -> str | None:
    """Return what to do about an error of a GPU that says nothing to its user; None for other errors."""
    if "no kernel image is available" in str(error):
        return (
            "the installed PyTorch has nothing compiled for this GPU: use the CPU, with --device cpu where the command "
            "has it, or else with CUDA_VISIBLE_DEVICES= before the command"
        )
    return None


def describe(error: BaseException) -> str:
    """Return an error as one line for the user: an OSError's file and reason, else the error's message.

    A name in ` ` in the message is a field of a config, as `relief.heightmap_at`, and becomes its flag.
    """
    if isinstance(error, BrokenExecutor) and not str(error):
        return KILLED
    if isinstance(error, MemoryError):
        return f"out of memory{f' ({error})' if str(error) else ''}"
    if isinstance(error, OSError) and error.strerror:
        files = [str(file) for file in (error.filename, error.filename2) if file is not None]
        return ": ".join([" -> ".join(files), _reason(error)] if files else [_reason(error)])
    line = " ".join(line.strip() for line in str(error).splitlines() if line.strip()) or type(error).__name__
    return _FIELD.sub(lambda field: f"--{field[1].replace('_', '-')}", line)


def _reason(error: OSError) -> str:
    reason = error.strerror or str(error)
    return reason[:1].lower() + reason[1:]


def _fail(line: str, code: int) -> int:
    print(f"error: {line}", file=sys.stderr, flush=True)
    return code
