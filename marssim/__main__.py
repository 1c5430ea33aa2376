"""Print the commands of marssim: `python -m marssim`."""

from marssim.base.command.listing import command_list


def main() -> int:
    """Print the list and return the exit code."""
    print(command_list("marssim"))
    return 0


if __name__ == "__main__":
    main()
