"""Print without risk to the work: whatever becomes of stdout and stderr, a command goes on.

A character that an encoding lacks is printed as an escape, as \\u2192. A stream that was closed before the command
began, as by `>&-`, discards what is printed. So does a stream whose file cannot take more, as on a full disk, and
stderr whose reader is gone. Only a reader of stdout that closes the pipe ends the command: it wants no more results.
"""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from marssim.base.files.atomic import WINDOWS

STANDARD = (0, 1, 2)  # file descriptors of stdin, stdout and stderr


class SafeStream:
    """Writes text to another stream, and survives its errors. Everything but writing is that stream's own.

    Args:
        stream: The stream, or None for one that was closed before Python began.
        pipe_ends: Whether BrokenPipeError is raised, when the stream's reader has closed a pipe.

    Attributes:
        error: The first error of writing; None if there was none. Unless it is raised, what is written after it is
            discarded.
    """

    def __init__(self, stream: Any, pipe_ends: bool = False) -> None:
        self.stream = open(os.devnull, "w", encoding="utf-8") if stream is None else stream  # noqa: SIM115
        self.pipe_ends = pipe_ends
        self.error: OSError | ValueError | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)

    def write(self, text: str) -> int:
        with self._surviving():
            try:
                self.stream.write(text)
            except UnicodeEncodeError:
                encoding = self.stream.encoding
                self.stream.write(text.encode(encoding, "backslashreplace").decode(encoding))
        return len(text)

    def flush(self) -> None:
        with self._surviving():
            self.stream.flush()

    def discard(self) -> None:
        """Let the stream lead nowhere, with what waits in its buffer."""
        with suppress(OSError, ValueError):  # a stream in memory, or one that is closed, has no file
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self.stream.fileno())
            os.close(nowhere)

    def reader_is_gone(self) -> bool:
        """Return whether the reader of the stream has closed the pipe, and if so discard what is left to print."""
        with suppress(BrokenPipeError):
            self.flush()
        gone = isinstance(self.error, BrokenPipeError)
        if gone:
            self.discard()
        return gone

    @contextmanager
    def _surviving(self) -> Iterator[None]:
        try:
            yield
        except (OSError, ValueError) as error:  # ValueError: some code has closed the stream
            if WINDOWS and isinstance(error, OSError) and error.errno == errno.EINVAL:
                error = BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))  # as Windows tells of a closed pipe
            self.error = self.error or error
            if isinstance(error, BrokenPipeError) and self.pipe_ends:
                raise error
            self.discard()


@contextmanager
def safe_streams() -> Iterator[SafeStream]:
    """Replace sys.stdout and sys.stderr by SafeStreams while the block runs.

    Yields:
        The stdout of the block, whose `error` says whether something that was printed is lost.
    """
    _open_standard()
    before = sys.stdout, sys.stderr
    out, err = SafeStream(sys.stdout, pipe_ends=True), SafeStream(sys.stderr)
    sys.stdout, sys.stderr = out, err
    try:
        yield out
    finally:
        out.reader_is_gone()
        err.flush()
        sys.stdout, sys.stderr = before


def keep_streams_safe() -> None:
    """Replace sys.stdout and sys.stderr by SafeStreams for the rest of a worker process."""
    _open_standard()
    sys.stdout, sys.stderr = SafeStream(sys.stdout), SafeStream(sys.stderr)


def _open_standard() -> None:
    """Open closed standard descriptors to nowhere, so that no file of results gets their numbers."""
    for number in STANDARD:
        try:
            os.fstat(number)
        except OSError:
            with suppress(OSError):
                opened = os.open(os.devnull, os.O_RDWR)
                if opened != number:
                    os.dup2(opened, number)
                    os.close(opened)
                os.set_inheritable(number, True)
