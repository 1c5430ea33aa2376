"""The page of promises says of every command what an interruption costs."""

import re
from pathlib import Path

from marssim.base.command.listing import COMMANDS

PAGE = Path(__file__).parents[2] / "docs" / "concepts" / "promises.md"
HEAD = "| Command | What an interruption costs |\n"


def test_every_command_has_its_row():
    rows = PAGE.read_text(encoding="utf-8").partition(HEAD)[2].partition("\n\n")[0].splitlines()
    named = {name for row in rows for name in re.findall(r"`(\w+\.\w+)`", row.split("|")[1])}
    assert named == {f"{package}.{command}" for package, commands in COMMANDS.items() for command in commands}
