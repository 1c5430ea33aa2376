"""Print the commands of envs: `python -m envs`."""

from marssim.base.command.listing import command_list


def main() -> int:
    """Print the list and return the exit code."""
    print(command_list("envs"))
    return 0


if __name__ == "__main__":
    main()
