import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from marssim.base.command.listing import COMMANDS, command_list, summary

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
