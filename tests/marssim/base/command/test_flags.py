"""The command line as a dataclass: repeated flags and the version."""

import re
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import pytest
import tyro

from marssim.base.command.flags import joined, parse
from marssim.base.command.listing import COMMANDS
from marssim.base.version import VERSION

ROOT = Path(__file__).parents[4]


@dataclass(frozen=True)
class Part:
    colours: tuple[Literal["red", "blue"], ...] = ()
    """Colours."""


@dataclass(frozen=True)
class Settings:
    driver_name: tuple[str, ...] = ("navigator",)
    """Drivers."""
    files: list[Path] | None = None
    """Files."""
    named: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME ...")] = ()
    """Names."""
    pair: tuple[float, float] = (0.0, 1.0)
    """A range."""
    count: int = 1
    """A number."""
    part: Part = field(default_factory=Part)
    flat: Annotated[Part, tyro.conf.arg(name="")] = field(default_factory=Part)


def parsed(*args: str) -> Settings:
    return parse(Settings, "settings", None, args)


@pytest.mark.parametrize(
    "args",
    [
        ("--driver-name", "a", "b", "--count", "3"),
        ("--driver-name", "a", "--count", "3", "--driver-name", "b"),
        ("--driver_name", "a", "--driver-name", "b", "--count=3"),
        ("--driver-name=a", "--driver-name=b", "--count", "3"),
    ],
)
def test_a_list_flag_that_is_repeated_keeps_all_of_its_values(args):
    assert parsed(*args) == Settings(driver_name=("a", "b"), count=3)


@pytest.mark.parametrize("args", [("--driver-name",), ("--driver_name", "--count", "3"), ("--count", "3", "--files")])
def test_a_list_flag_without_a_value_is_refused(args):
    with pytest.raises(ValueError, match=r"^--(driver.name|files) needs a value$"):
        parsed(*args)


def test_every_kind_of_list_flag_is_joined():
    asked = ("--files", "x", "--named", "m", "--part.colours", "red", "--colours", "blue")
    again = ("--colours", "red", "--part.colours", "blue", "--named", "n", "--files", "y", "z")
    assert parsed(*asked, *again) == Settings(
        files=[Path("x"), Path("y"), Path("z")], named=("m", "n"),
        part=Part(("red", "blue")), flat=Part(("blue", "red")),
    )  # fmt: skip


def test_the_last_value_of_any_other_flag_counts():
    assert parsed("--pair", "1", "2", "--count", "3", "--count", "4", "--pair", "-3", "-2") == Settings(
        pair=(-3.0, -2.0), count=4
    )


def test_words_that_are_no_flags_stay_where_they_are():
    args = ["data", "--k", "-1", ".5", "--out", "a=b", "-x", "--k", "2", "--", "--k"]
    assert joined(args, {"--k"}) == ["data", "--k", "-1", ".5", "2", "--out", "a=b", "-x", "--", "--k"]
    assert joined(args, set()) == args


def test_an_unknown_flag_that_is_repeated_is_named():
    with pytest.raises(ValueError, match=r"unknown option --driver \(did you mean --driver-name\?\)"):
        parsed("--driver", "a", "--driver", "b")


@dataclass(frozen=True)
class Long:
    turns: int = 1
    """How often
    it turns, in
    all."""
    flat: Annotated[int, tyro.conf.arg(name="even")] = 2
    """A first
    paragraph.

    A second."""


@dataclass(frozen=True)
class Longer(Long):
    last: int = 3
    part: Long = Long()


def test_help_does_not_break_lines_where_the_source_does(capsys):
    with pytest.raises(SystemExit):
        parse(Longer, "some command", "It does.", ["--help"])
    shown = " ".join(capsys.readouterr().out.translate(str.maketrans("│", " ")).splitlines())
    shown = re.sub("  +", "  ", shown)
    for flag in ("--turns INT", "--part.turns INT"):
        assert f" {flag}  How often it turns, in all. (default: 1) " in shown
    for flag in ("--even INT", "--part.even INT"):
        assert f" {flag}  A first paragraph.  A second. (default: 2) " in shown
    assert " --last INT  (default: 3) " in shown


@pytest.mark.parametrize("module", [*COMMANDS, "marssim.generate", "marssim.abundance", "m3depth.train", "nav.replay"])
def test_every_command_prints_its_version(module):
    done = subprocess.run([sys.executable, "-m", module, "--version"], capture_output=True, text=True, cwd=ROOT)
    assert (done.returncode, done.stdout, done.stderr) == (0, f"mars-m3depth {VERSION}\n", "")
