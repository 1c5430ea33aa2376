import errno
import io
import os
import subprocess
import sys

import pytest

from marssim.base.command.run import exit_code
from marssim.base.command.streams import SafeStream, safe_streams

ARROW = "worse \u2192 better \udce9\n"  # with a byte of a file name that is not UTF-8
WORK = """
import sys
from marssim.base.command.run import exit_code

def work():
    print("out \u2192")
    print("err \u2192", file=sys.stderr, flush=True)
    with open(sys.argv[1], "w") as results:
        results.write("done")
        print("and on", flush=True)
        print("and on", file=sys.stderr, flush=True)

sys.exit(exit_code(work))
"""


def in_shell(tmp_path, redirection: str, **environment: str) -> tuple[int, bytes, bytes, str]:
    """Run a work that prints and writes a file, and return exit code, stdout, stderr and the file's content."""
    (tmp_path / "work.py").write_text(WORK, encoding="utf-8")
    done = subprocess.run(
        ["bash", "-c", f'"$0" work.py results {redirection}', sys.executable], cwd=tmp_path, capture_output=True,
        env={**os.environ, **environment},
    )  # fmt: skip
    return done.returncode, done.stdout, done.stderr, (tmp_path / "results").read_text()


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_characters_that_an_encoding_lacks_are_escaped(encoding, monkeypatch):
    file = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(file, encoding))
    assert exit_code(lambda: print(ARROW)) == 0
    arrow = "\u2192" if encoding == "utf-8" else "\\u2192"
    assert file.getvalue().decode(encoding) == f"worse {arrow} better \\udce9\n\n"


@pytest.mark.parametrize(
    ("redirection", "encoding", "out", "err"),
    [
        ("", "ascii", b"out \\u2192\nand on\n", b"err \\u2192\nand on\n"),
        (">&-", "utf-8", b"", b"err \xe2\x86\x92\nand on\n"),
        ("2>&-", "utf-8", b"out \xe2\x86\x92\nand on\n", b""),
        ("<&- >&- 2>&-", "utf-8", b"", b""),
        ("2>/dev/full", "utf-8", b"out \xe2\x86\x92\nand on\n", b""),
        ("2> >(true)", "utf-8", b"out \xe2\x86\x92\nand on\n", b""),  # a pipe without a reader
    ],
)
def test_the_work_is_done_whatever_the_streams(tmp_path, redirection, encoding, out, err):
    assert in_shell(tmp_path, redirection, PYTHONIOENCODING=encoding) == (0, out, err, "done")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="this system has no file that is always full")
def test_a_full_stdout_is_reported_once_the_work_is_done(tmp_path):
    code, out, err, results = in_shell(tmp_path, ">/dev/full", PYTHONIOENCODING="utf-8")
    line = "error: stdout: no space left on device; the work is done, but not all that it printed is written\n"
    assert (code, out, results) == (2, b"", "done") and err.decode().splitlines(True) == [
        "err \u2192\n",
        "and on\n",
        line,
    ]


def test_streams_are_put_back_and_keep_what_is_theirs(capsys):
    before = sys.stdout, sys.stderr
    with safe_streams() as out:
        print("inside")
        assert sys.stdout is out and out.encoding == before[0].encoding and not out.isatty()
    assert (sys.stdout, sys.stderr) == before and capsys.readouterr().out == "inside\n"


def test_a_stream_that_some_code_has_closed_discards():
    stream = io.StringIO()
    safe = SafeStream(stream)
    stream.close()
    assert safe.write("more") == 4 and isinstance(safe.error, ValueError)


@pytest.mark.parametrize(("windows", "code"), [(True, 141), (False, 2)])
def test_what_windows_says_of_a_pipe_without_a_reader_ends_the_command(monkeypatch, capsys, windows, code):
    class Pipe(io.StringIO):
        def write(self, text: str) -> int:
            raise OSError(errno.EINVAL, "Invalid argument")

    monkeypatch.setattr("marssim.base.command.streams.WINDOWS", windows)
    monkeypatch.setattr(sys, "stdout", Pipe())
    assert exit_code(lambda: print("out")) == code
    assert bool(capsys.readouterr().err) != windows
