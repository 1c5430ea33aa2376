"""Print the commands of m3depth: `python -m m3depth`."""

import sys

from marssim.base.command.listing import print_commands


def main() -> int:
    """Print the list and return the exit code."""
    return print_commands("m3depth")


if __name__ == "__main__":
    sys.exit(main())
