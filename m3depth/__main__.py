"""Print the commands of m3depth: `python -m m3depth`."""

from marssim.base.command.listing import command_list


def main() -> int:
    """Print the list and return the exit code."""
    print(command_list("m3depth"))
    return 0


if __name__ == "__main__":
    main()
