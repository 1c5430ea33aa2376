import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from marssim.base.command.listing import COMMANDS, command_list, print_commands, summary

ROOT = Path(__file__).parents[4]


def test_every_file_at_a_door_that_is_a_command_is_listed():
    for package, names in COMMANDS.items():
        commands = {f.stem for f in (ROOT / package).glob("*.py") if "\ndef main(args" in f.read_text()}
        assert commands == set(names), package


@pytest.mark.parametrize("package", COMMANDS)
def test_python_m_lists_the_commands(package):
    done = subprocess.run([sys.executable, "-m", package], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    for name in COMMANDS[package]:
        assert f"python -m {package}.{name} " in done.stdout and summary(package, name) in done.stdout


@pytest.mark.parametrize(("given", "tried"), [("generate", "marssim.generate"), ("--pairs", "marssim")])
def test_what_only_lists_the_commands_takes_none(capsys, given, tried):
    assert print_commands("marssim", [given, "1"]) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err == (
        f"error: python -m marssim {given}: this lists the commands and runs none; try python -m {tried}\n"
    )
    assert print_commands("marssim", ["--help"]) == 0 and "marssim.generate" in capsys.readouterr().out


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_a_list_that_cannot_be_printed_ends_as_every_command_does():
    with open("/dev/full", "w") as full:
        done = subprocess.run([sys.executable, "-m", "nav"], stdout=full, stderr=-1, text=True, cwd=ROOT)
    assert done.returncode == 2 and done.stderr.startswith("error: stdout: ") and done.stderr.count("\n") == 1


def test_the_list_imports_none_of_the_commands():
    code = (
        "import sys; from marssim.base.command.listing import command_list; command_list('envs'); print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert not {"envs.evaluate", "torch", "gymnasium"} & set(done.stdout.split())


def test_every_command_is_a_console_script():
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]
    expected = {f"{p}-{n.replace('_', '-')}": f"{p}.{n}:main" for p, names in COMMANDS.items() for n in names}
    assert expected.items() <= scripts.items()


def test_a_summary_is_the_first_line_of_the_docstring():
    assert "stereo pairs" in summary("marssim", "generate") and "\n" not in command_list("nav").splitlines()[0]
