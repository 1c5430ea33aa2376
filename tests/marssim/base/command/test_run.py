import errno
import math
import os
import signal
import subprocess
import sys
from concurrent.futures import BrokenExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import pytest
import tyro

from marssim.base.command.exits import HelpPrinted
from marssim.base.command.flags import parse
from marssim.base.command.run import describe, exit_code, run_command
from marssim.base.command.wording import counted


class OutOfMemoryError(RuntimeError):
    """An error with the name of PyTorch's."""


@dataclass(frozen=True)
class Part:
    angle: tuple[float, float] = (0.0, 1.0)
    """a range"""
    half_width: float = 1.0
    """a size"""

    def __post_init__(self) -> None:
        if self.half_width < 0:
            raise ValueError(f"half_width must not be negative, got {self.half_width}")
        if self.angle[0] > self.angle[1]:
            raise ValueError(
                f"--part.angle must be a range LOW HIGH, and this message is far longer than a terminal is wide so "
                f"that the parser has to wrap it, /a/path/{'long' * 30}, got {self.angle}"
            )


@dataclass(frozen=True)
class Inner:
    depth: int = 1
    """a number"""

    def __post_init__(self) -> None:
        if self.depth > 9:
            raise ValueError(f"depth must be small, got {self.depth}")


@dataclass(frozen=True)
class Flat:
    inner: Inner = field(default_factory=Inner)
    grain: float = 1.0
    """a number"""
    reach: tuple[float, float] = (0.0, math.inf)
    """a range that may be infinite"""

    def __post_init__(self) -> None:
        if self.grain == 0:
            raise ValueError("grain must not be 0")
        if self.grain < 0:
            raise ValueError("no such sand")


@dataclass(frozen=True)
class Settings:
    out: Path
    """a folder"""
    count: int = 1
    """a number; its help is long enough for several lines of a terminal that is not very wide, which is to be seen"""
    kind: Literal["round", "square"] = "round"
    """a choice"""
    size: tuple[int, int] | None = None
    """a pair of numbers that may be left out"""
    files: tuple[Path, Path] | None = None
    """two paths that may be left out"""
    quiet: bool = False
    """a switch"""
    part: Part = field(default_factory=Part)
    flat: Annotated[Flat, tyro.conf.arg(name="")] = field(default_factory=Flat)

    def __post_init__(self) -> None:
        if self.count < 0:
            raise ValueError(f"count must not be negative, got {self.count}")


@dataclass(frozen=True)
class Named:
    name: tyro.conf.Positional[Path]
    """a file"""
    size: int
    """a size"""


def failing(error: BaseException):
    def work(_: Settings) -> None:
        raise error

    return work


def run(capsys, work, *args: str, **more: str) -> tuple[int, str]:
    code = run_command(work, Settings, "python -m settings", "About.", ["--out", "x", *args], **more)
    return code, capsys.readouterr().err


def test_a_good_command_line_reaches_the_work(capsys):
    configs = []
    assert run(capsys, configs.append, "--count", "3", "--part.angle", "2", "4") == (0, "")
    assert configs == [Settings(Path("x"), 3, part=Part((2.0, 4.0)))]


@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])  # the parser draws another frame where it cannot draw lines
@pytest.mark.parametrize("columns", ["40", "80", "300"])
@pytest.mark.parametrize(
    ("args", "line"),
    [
        (["--count", "many"], "--count must be a whole number, got 'many'"),
        (["--count"], "--count needs a value"),
        (["--count", "-1"], "--count must not be negative, got -1"),
        (["--part.half-width", "-1"], "--part.half-width must not be negative, got -1.0"),
        (["--inner.depth", "10"], "--inner.depth must be small, got 10"),
        (["--grain", "0"], "--grain must not be 0"),
        (["--grain", "-1"], "no such sand"),
        (["--kind", "oval"], "--kind must be round or square, got 'oval'"),
        (["--kind", "sqare"], "--kind must be round or square, got 'sqare' (did you mean square?)"),
        (["--part.angle", "a", "b"], "--part.angle must be 2 numbers, got 'a b'"),
        (["--size", "640x480"], "--size must be 2 whole numbers, got '640x480'"),
        (["--size", "a", "b"], "--size must be 2 whole numbers, got 'a b'"),
        (["--size"], "--size needs 2 values"),
        (["--files", "a"], "--files must be 2 paths, got 'a'"),
        (["--part.angle", "1"], "--part.angle needs 2 values"),
        (["--part.half-width", "wide"], "--part.half-width must be a number, got 'wide'"),
        (["--cuont", "3"], "unknown option --cuont (did you mean --count?)"),
        (["--part.half-wdith=3"], "unknown option --part.half-wdith (did you mean --part.half-width?)"),
        (["--part.half", "-3"], "unknown option --part.half (did you mean --part.half-width?)"),
        (
            ["--cuont", "3", "--grian", "2", "--zebra"],
            "unknown option --cuont (did you mean --count?), --grian (did you mean --grain?), --zebra",
        ),
        (["--kind", ""], "--kind is empty: give it a value, or leave it out"),
        (["--out="], "--out is empty: give it a value, or leave it out"),
        (["--quiet", "stray", ""], "a value after --quiet is empty: give it a value, or leave it out"),
        (["--grain", "inf"], "--grain must be a finite number, got inf"),
        (["--part.angle", "0", "nan"], "--part.angle must be a finite number, got nan"),
        (["--part.half-width", "1e300"], "--part.half-width must lie within +-1e+12, got 1e+300"),
        (["--count", "9" * 30], "--count must lie within +-1.84e+19, got " + "9" * 30),
        (["--quite"], "unknown option --quite (did you mean --quiet?)"),
        (["--zebra"], "unknown option --zebra"),
        (["stray", "sheep"], "stray sheep belong to no option"),
        (["-inf"], "-inf belongs to no option"),
    ],
)
def test_the_parsers_mistakes_are_one_line(args, line, columns, encoding, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", columns)
    monkeypatch.setattr("tyro._fmtlib._should_use_utf8_drawing_chars", lambda: encoding == "utf-8")
    assert run(capsys, failing(AssertionError()), *args) == (2, f"error: {line}\n")


def test_files_that_a_shell_put_in_place_of_a_pattern_are_a_hint_to_quote_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for number in range(9):
        Path(f"{number}.png").touch()
    code, line = run(capsys, failing(AssertionError()), *sorted(map(str, Path().glob("*.png"))))
    assert (code, line.count("\n")) == (2, 1)
    assert line.startswith(
        "error: 0.png 1.png 2.png and 6 more belong to no option; write a pattern in quotation marks"
    )


def test_a_configs_own_words_are_kept_whatever_their_length(capsys):
    with pytest.raises(ValueError) as own:
        Part((3.0, 1.0))
    assert run(capsys, failing(AssertionError()), "--part.angle", "3", "1") == (2, f"error: {own.value}\n")


@dataclass(frozen=True)
class Optional:
    number: int = 3
    """A number."""
    limit: int | None = None
    """A limit. Left out: none."""
    names: tuple[str, ...] = ()
    """Some names."""


def test_the_help_names_defaults_but_those_that_mean_left_out(capsys):
    with pytest.raises(HelpPrinted):
        parse(Optional, "optional", "Text.", ["--help"])
    help_text = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "A number. (default: 3)" in help_text and help_text.count("(default") == 1
    assert "A limit. Left out: none." in help_text and "Some names." in help_text


@dataclass(frozen=True)
class Refusing:
    out: str = "x"
    """a folder"""

    def __post_init__(self) -> None:
        raise ValueError(self.out)


@pytest.mark.parametrize("message", ["out/mine is given twice", "out.json is damaged", "out-1 is a file"])
def test_a_path_that_begins_like_a_flag_stays_a_path(message):
    with pytest.raises(ValueError) as error:
        parse(Refusing, "refusing", None, ["--out", message])
    assert str(error.value) == message


def test_infinity_is_a_value_where_it_is_one_by_default():
    assert parse(Settings, "settings", None, ["--out", "y", "--reach", "1", "inf"]).flat.reach == (1.0, math.inf)


def test_defaults_of_an_instance_instead_of_the_class():
    given = parse(Settings, "settings", None, ["--out", "y", "--part.half-width", "3"], Settings(Path("x"), 7))
    assert given == Settings(Path("y"), 7, part=Part(half_width=3.0))


def test_all_that_is_missing_is_named():
    with pytest.raises(ValueError, match=r"^--out missing; --help explains the flags$"):
        parse(Settings, "settings", None, [])
    with pytest.raises(ValueError, match=r"^--out missing; unknown option --otu \(did you mean --out\?\); --help"):
        parse(Settings, "settings", None, ["--otu", "x"])
    with pytest.raises(ValueError, match=r"^PATH, --size missing; --help explains the flags$"):
        parse(Named, "named", None, [])


def test_help_goes_to_stdout(capsys):
    with pytest.raises(SystemExit) as end:
        run_command(print, Settings, "settings", "About settings.", ["--help"])
    output = capsys.readouterr()
    assert end.value.code == 0 and "a range" in output.out and "About settings." in output.out and output.err == ""


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (ValueError("--count 3:\n  is too many\n"), "--count 3: is too many"),
        (NotADirectoryError(errno.ENOTDIR, "Not a directory", "a/b"), "a/b: not a directory"),
        (OSError(errno.EXDEV, "Invalid cross-device link", "a", None, "b"), "a -> b: invalid cross-device link"),
        (OSError(errno.ENOSPC, "No space left on device"), "no space left on device"),
        (OSError("x.png: could not be written"), "x.png: could not be written"),
        (ImportError("dask is not installed"), "dask is not installed"),
        (MemoryError(), "out of memory"),
        (
            OutOfMemoryError("CUDA out of memory. Tried 20 GiB.\nSee"),
            "out of memory (CUDA out of memory. Tried 20 GiB.)",
        ),
        (
            RuntimeError("[enforce] can't allocate memory: 9 bytes"),
            "out of memory ([enforce] can't allocate memory: 9 bytes)",
        ),
        (RuntimeError("CUDA error: out of memory\nSearch"), "out of memory (CUDA error: out of memory)"),
        (
            RuntimeError("CUDA error: CUBLAS_STATUS_ALLOC_FAILED when calling `x`"),
            "out of memory (CUDA error: CUBLAS_STATUS_ALLOC_FAILED when calling `x`)",
        ),
        (
            RuntimeError("CUDA error: no kernel image is available for execution on the device\nSearch"),
            "the installed PyTorch has nothing compiled for this GPU: use the CPU, with --device cpu where the command "
            "has it, or else with CUDA_VISIBLE_DEVICES= before the command",
        ),
        (KeyError, KeyError),
        (RuntimeError("a bug"), RuntimeError),
    ],
)
def test_mistakes_are_one_line_and_bugs_show_their_traceback(error, line, capsys):
    if isinstance(line, type):
        with pytest.raises(line):
            run(capsys, failing(error))
    else:
        assert run(capsys, failing(error)) == (2, f"error: {line}\n")


def refusing(number: int, path: Path):
    def work(_: object) -> None:
        raise OSError(number, os.strerror(number), str(path))

    return work


@pytest.mark.parametrize(
    ("number", "at", "message"),
    [
        (errno.EACCES, "made/x", "--out made/x: permission denied"),
        (errno.EROFS, "made/x/a.png", "--out made/x: {}/made/x/a.png: read-only file system"),
        (errno.ENOTDIR, "made", "--out made/x: {}/made: not a directory"),  # a folder on the way, not there yet
        (errno.EACCES, "data", "{}/data: permission denied"),
        (errno.EACCES, ".", "{}: permission denied"),  # a folder that is there: it was read
        (errno.ENOENT, "made/x/a.png", "{}/made/x/a.png: no such file or directory"),
    ],
)
def test_an_error_of_writing_names_the_flag(number, at, message, tmp_path, monkeypatch, capsys):
    """Whether the flag was given as a relative path or not."""
    monkeypatch.chdir(tmp_path)
    work = refusing(number, tmp_path / at)
    line = f"error: {message.format(tmp_path)}\n"
    assert run(capsys, work, "--out", "made/x") == (2, line)
    whole = line.replace("--out made/x", f"--out {tmp_path}/made/x")
    assert run(capsys, work, "--out", str(tmp_path / "made/x")) == (2, whole)


def test_a_command_without_an_output_folder_names_the_file(capsys):
    code = run_command(refusing(errno.EACCES, Path("a")), Named, "named", None, ["b", "--size", "1"])
    assert (code, capsys.readouterr().err) == (2, "error: a: permission denied\n")


def test_broken_pools_and_interrupts_say_how_to_go_on(capsys):
    assert describe(BrokenExecutor()).startswith("a worker process was killed, perhaps for lack of memory")
    error = ValueError("`relief.heightmap` /a/b.png: too small; choose a smaller `horizon` and `pip install x`")
    assert describe(error) == "--relief.heightmap /a/b.png: too small; choose a smaller --horizon and `pip install x`"
    assert describe(ValueError("give `relief.heightmap_at`")) == "give --relief.heightmap-at"
    assert describe(BrokenExecutor("--scheduler tcp://a:1: it was lost")) == "--scheduler tcp://a:1: it was lost"
    code, output = run(capsys, failing(KeyboardInterrupt()), interrupted="nothing was written")
    assert (code, output) == (130, "error: interrupted; nothing was written\n")
    code, output = run(capsys, failing(BrokenExecutor("a worker died")), interrupted="the same command starts over")
    assert (code, output) == (2, "error: a worker died; the same command starts over\n")


def test_an_interruption_while_pytorch_writes_a_file_is_one_line(capsys):
    """Its writer then complains of the file's end."""

    def end(_):
        try:
            raise KeyboardInterrupt
        finally:
            raise RuntimeError("[enforce fail at inline_container.cc:672] . unexpected pos 55232 vs 55120")

    assert run(capsys, end) == (130, "error: interrupted; the same command goes on from here\n")


def test_an_interruption_that_a_compiled_function_turned_into_a_system_error_is_one_line(capsys):
    def end(_):
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as signal_handled:
            try:
                raise SystemError("unpickling returned a result with an exception set") from signal_handled
            except SystemError:
                raise SystemError("a kernel returned a result with an exception set")  # noqa: B904, as numba does

    assert run(capsys, end) == (130, "error: interrupted; the same command goes on from here\n")
    with pytest.raises(SystemError, match="bad call"):
        run(capsys, failing(SystemError("bad call")))


def test_a_working_directory_that_was_removed_is_one_line(tmp_path, monkeypatch, capsys):
    folder = tmp_path / "removed"
    folder.mkdir()
    monkeypatch.chdir(folder)
    folder.rmdir()
    code, output = run(capsys, failing(AssertionError("the work began")))
    assert (code, output) == (2, "error: the working directory was removed: change to a folder that exists\n")


def test_work_that_ended_badly_has_another_exit_code_than_a_mistake(capsys):
    code, output = run(capsys, failing(FloatingPointError("training has diverged")))
    assert code == 1 and output == "error: training has diverged\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_from_the_shell(number):
    """A signal is sent to a process. One that was started in the background would inherit that SIGINT is ignored."""
    program = (
        "import signal, sys; from dataclasses import dataclass; from marssim.base.command.run import run_command\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "@dataclass\nclass C: pass\n"
        "def work(_): print('at work', flush=True); sys.stdin.read()\n"
        "sys.exit(run_command(work, C, 'c', None, []))"
    )
    process = subprocess.Popen([sys.executable, "-c", program], stdin=-1, stdout=-1, stderr=-1, text=True)
    assert process.stdout is not None and process.stdout.readline() == "at work\n"
    os.kill(process.pid, number)
    _, output = process.communicate()
    assert (process.returncode, output) == (130, "error: interrupted; the same command goes on from here\n")


def test_sigterm_is_left_as_it_was():
    before = signal.getsignal(signal.SIGTERM)
    for error, code in ((ValueError("no"), 2), (KeyboardInterrupt(), 130)):
        assert exit_code(lambda error=error: failing(error)(None)) == code
        assert signal.getsignal(signal.SIGTERM) is before
    assert exit_code(lambda: None) == 0 and signal.getsignal(signal.SIGTERM) is before


def test_a_reader_that_closes_the_pipe_causes_no_message():
    code = "\n".join([
        "import sys", "from marssim.base.command.run import exit_code",
        "sys.exit(exit_code(lambda: [print('line', i) for i in range(100_000)]))",
    ])  # fmt: skip
    writer = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert writer.stdout.readline() == "line 0\n"
    writer.stdout.close()
    assert writer.stderr.read() == "" and writer.wait() == 141


def test_a_broken_pipe_to_a_worker_is_one_line(capsys):
    def work():
        raise BrokenPipeError(errno.EPIPE, "Broken pipe")

    assert exit_code(work) == 2 and "broken pipe" in capsys.readouterr().err.lower()


def test_counted():
    assert [counted(n, "pair") for n in (0, 1, 2)] == ["0 pairs", "1 pair", "2 pairs"]
