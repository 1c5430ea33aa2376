"""What is to be done about pairs whose true maps give no depth, or no normals, to score or to train."""

from __future__ import annotations

from m3depth.datasets.config import DataConfig
from m3depth.datasets.maps import FAR
from m3depth.datasets.pair_files import FITTED
from m3depth.stereo.pairs import StereoPairs

NO_NORMALS = (
    "--normals depth gives no normals, since it needs maps without gaps: it fits planes in windows of "
    f"{FITTED} x {FITTED} px whose pixels are all known"
)


def advice(pairs: StereoPairs, has_sky: bool) -> str:
    """Return the end of a message on pairs without a usable pixel: what their maps hold, and which flags to check.

    Args:
        pairs: The pairs.
        has_sky: Whether a pixel of them is sky.
    """
    reader = getattr(pairs, "config", None)
    config = reader if isinstance(reader, DataConfig) else None  # as of datasets of marssim, and of users
    if has_sky:
        hint = "; if the maps hold millimetres, give --unit 1000" if config is not None else ""
        return f"what is known is sky, {FAR:g} m and farther{hint}"
    if config is None:
        return "check the maps"
    if config.format == "oaisys":
        return "check the maps and --depth-range"
    negative = " (-1 for negative disparities)" if config.depth is None else ""
    return f"check the maps, --unit{negative} and --depth-range"
