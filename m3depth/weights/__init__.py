"""The weights that come with the package."""

from pathlib import Path

SHIPPED_WEIGHTS = Path(__file__).parent / "lite.safetensors"
