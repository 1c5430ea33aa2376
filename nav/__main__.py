"""Print the commands of nav: `python -m nav`."""

import sys

from marssim.base.command.listing import print_commands


def main() -> int:
    """Print the list and return the exit code."""
    return print_commands("nav")


if __name__ == "__main__":
    sys.exit(main())
