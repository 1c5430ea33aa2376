"""The weights that come with the package, their card, and the errors of weights files.

storage.py        weights on disk
config_json.py     the config of a network in a weights file
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from marssim.base.command.input_file import check_file

SHIPPED = "shipped"  # names these weights in --init of m3depth.train and in --weights
SHIPPED_WEIGHTS = Path(__file__).parent / "lite.safetensors"
WANTED = "give a weights.safetensors that m3depth.train wrote"  # the advice of errors


def weights_file(path: Path) -> Path:
    """Return the file of weights: the package's if the path is the word "shipped", else the path itself."""
    return SHIPPED_WEIGHTS if path == Path(SHIPPED) else path


def check_weights_file(path: Path) -> None:
    """Raise FileNotFoundError or IsADirectoryError, which names the path and what is wanted, unless it is a file."""
    check_file(path, "weights file", WANTED)


@contextmanager
def named_by(flag: str) -> Iterator[None]:
    """Name the flag that gave a weights file in the errors of reading it, which begin with the file.

    Args:
        flag: The flag, or what the caller calls it.
    """
    try:
        yield
    except (FileNotFoundError, IsADirectoryError) as error:
        raise type(error)(f"{flag} {error}") from None
    except ValueError as error:
        raise ValueError(f"{flag} {error}") from None
