"""The colours of the codes of a recorded drive's pictures, for its page and for the viewer."""

from __future__ import annotations

from functools import cache

import numpy as np

from marssim.base.dataset.drive_file import FULL_COST, MAP_CODES
from nav.ground.map_files import COSTLY

WORST = 0.1  # share of the depth from which errors have the same colour
NO_ERROR = (70, 70, 70)  # colour of pixels without an error
UNKNOWN = (72, 70, 68)  # colour of unknown ground


@cache
def code_colours() -> dict[str, np.ndarray]:
    """Return the colours of the 256 codes of the layers "confidence", "error" and "map", each (256, 3) uint8 RGB."""
    code = np.arange(256)
    share = (code / 255)[:, None]
    confidence = np.where(share < 0.5, _between((40, 24, 50), (60, 130, 150), share * 2),
                          _between((60, 130, 150), (240, 245, 225), share * 2 - 1))  # fmt: skip
    error = np.clip((np.exp((code - 128) / 100) - 1) / WORST, -1, 1)[:, None]
    white = (246, 244, 240)
    errors = np.where(error < 0, _between(white, (40, 90, 170), -error), _between(white, (180, 50, 40), error))
    errors[0] = NO_ERROR
    free, costly = MAP_CODES["free"], MAP_CODES["costly"]
    share = (code - free) / (costly - free) * FULL_COST / COSTLY
    ground = _between((124, 152, 112), (228, 190, 104), np.clip(share, 0, 1)[:, None])
    ground[MAP_CODES["unknown"]] = UNKNOWN
    ground[MAP_CODES["too_near"] :] = (214, 140, 92)
    ground[MAP_CODES["blocked"] :] = (176, 58, 52)
    return {name: table.astype(np.uint8) for name, table in
            {"confidence": confidence, "error": errors, "map": ground}.items()}  # fmt: skip


def _between(low: tuple[int, int, int], high: tuple[int, int, int], share: np.ndarray) -> np.ndarray:
    """Return colours (n, 3) between two, by shares (n, 1)."""
    return np.array(low) + (np.array(high) - np.array(low)) * share
