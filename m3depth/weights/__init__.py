"""The weights that come with the package, and their card."""

from pathlib import Path

SHIPPED = "shipped"  # names these weights where a command takes the path of a weights file
SHIPPED_WEIGHTS = Path(__file__).parent / "lite.safetensors"


def weights_file(path: Path) -> Path:
    """Return the file of weights: the package's if the path is the word "shipped", else the path itself."""
    return SHIPPED_WEIGHTS if path == Path(SHIPPED) else path
