"""What every command does with its command line and with mistakes: one line on stderr and an exit code.

0: done. 2: a mistake of the user, or a disk, a package or a worker process that failed. 130: interrupted, by Ctrl-C or
SIGTERM, as a cluster's queue sends it in the end. 141: nobody reads on what is printed, as behind `| head`; said by
nothing else.
Anything else is a bug and shows its traceback.
"""

from __future__ import annotations

import difflib
import errno
import io
import os
import re
import select
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager, redirect_stderr
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

from marssim.base.command.notes import speaking

MISTAKES = (ValueError, OSError, ImportError, FloatingPointError, MemoryError, BrokenExecutor)
GOES_ON = "the same command goes on from here"
KILLED = f"a worker process was killed, perhaps for lack of memory; {GOES_ON}, with fewer --workers it needs less"
_RULE = re.compile(r"[─-]{8,}")
_FIELD = re.compile(r"`([a-z][a-z0-9_]*(?:\.[a-z][a-z0-9_]*)*)`")
_OF_TYPES = re.compile(r"no type matching .*<class '\w+'>: ")  # of a flag that may be left out
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")

Config = TypeVar("Config")


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


def parse(
    config: type[Config],
    prog: str,
    description: str | None,
    args: Sequence[str] | None = None,
    default: Config | None = None,
) -> Config:
    """The dataclass `config` as the command line fills it. Raises ValueError of one line that names the flag.

    default: instance whose values are shown and taken instead of those of the class. What a config says about one of
    its own fields ("angle must be ...") becomes what the user can type ("--part.angle must be ...").
    """
    import tyro

    instead: dict[str, Any] = {} if default is None else {"default": default}

    said = io.StringIO()
    try:
        with redirect_stderr(said):
            return tyro.cli(config, prog=prog, description=description, args=args, **instead)
    except ValueError as error:  # a config's own, which the parser let through
        raise ValueError(_with_flag(str(error), config.__name__, config)) from None
    except SystemExit as end:
        if not end.code:
            raise
        raise ValueError(_parse_error(said.getvalue(), end.__context__, config)) from None


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


def counted(number: int, noun: str) -> str:
    """ "1 pair", "2 pairs"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _fail(line: str, code: int) -> int:
    print(f"error: {line}", file=sys.stderr, flush=True)
    return code


def _parse_error(framed: str, cause: BaseException | None, config: type) -> str:
    """tyro's message, which comes in a frame with help below, as one line.

    cause: what the parser was handling when it gave up; a ValueError there is a config's own, which names its flag.
    """
    parts: list[list[str]] = [[]]
    for line in _COLOUR.sub("", framed).splitlines()[1:]:
        line = line.strip("│|╰╯+ ")
        if _RULE.fullmatch(line):
            parts.append([])
        else:
            parts[-1].append(line)
    parts = [part for part in parts if any(part)] or [[]]
    message = " ".join(filter(None, parts[0]))
    if wrong := re.match(r"Error parsing (\S+): (.*)", message):
        where, why = wrong.groups()
        if where.startswith("--"):
            why = _OF_TYPES.sub("", why)
            usage = parts[1][1] if len(parts) > 1 and len(parts[1]) > 1 else where  # the flag with its kind of value
            return f"{usage}: {why}"
        while cause is not None and not isinstance(cause, ValueError):
            cause = cause.__context__
        return _with_flag(str(cause or why), where, config)
    if message.startswith("Missing from"):
        flags = [line.split()[0] for line in parts[0] if re.match(r"(--|[A-Z]+$)", line)]
        others = [line for part in parts[1:] if part[0].startswith("Unrecognized") for line in part[1:]]
        unknown = _unknown(" ".join(others).split(), flags) if others else ""
        return f"{', '.join(flags) or message} missing{unknown and f'; {unknown}'}; --help tells more"
    if message.startswith("Unrecognized"):
        known = [line.split()[0].rstrip(",") for part in parts[1:] for line in part if line.startswith("--")]
        return _unknown(message.partition(": ")[2].split(", "), known)
    return message[:1].lower() + message[1:]


def _unknown(words: Sequence[str], known: Sequence[str]) -> str:
    """What the parser could not place: options, each with the nearest of the known ones, or values of none."""
    told = []
    for option in (word.partition("=")[0] for word in words if re.match(r"--?[a-zA-Z]", word)):
        near = difflib.get_close_matches(option, known, 1)
        told.append(option + (f" (did you mean {near[0]}?)" if near else ""))
    return f"unknown option {', '.join(told)}" if told else f"{' '.join(words)} belongs to no option"


def _with_flag(message: str, where: str, config: type) -> str:
    """A config's complaint that begins with the name of one of its fields, with the flag instead.

    where: dotted path of the config in the root config, or the root's own name. A part whose flags bear no prefix
    (tyro.conf.arg(name="")) is on the path, but not in the flag.
    """
    holders: list[Any] = [config]
    prefix = ""
    for name in [] if where == config.__name__ else where.replace("-", "_").split("."):
        part, named = _parts(holders[0]).get(name, (None, True))
        if part is None:
            return message
        holders, prefix = [part], prefix + named * f"{name.replace('_', '-')}."
    holders += [part for part, named in _parts(holders[0]).values() if not named]
    word = re.match(r"[a-z]\w*", message)
    if word is None or not any(word[0] in get_type_hints(holder) for holder in holders):
        return message
    return f"--{prefix}{word[0].replace('_', '-')}{message[word.end() :]}"


def _parts(config: type) -> dict[str, tuple[type, bool]]:
    """The fields of a config that are configs themselves, and whether their flags bear their name."""
    parts = {}
    for name, hint in get_type_hints(config, include_extras=True).items():
        part = getattr(hint, "__origin__", hint)
        if is_dataclass(part) and isinstance(part, type):
            parts[name] = part, all(getattr(extra, "name", None) != "" for extra in getattr(hint, "__metadata__", ()))
    return parts
