"""Maps of disparity and depth in the file types of datasets."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from m3depth.datasets.maps import read_map
from marssim.base.files.pfm import encode_pfm

DEPTH = np.linspace(2, 9, 24, dtype=np.float32).reshape(4, 6)


def put(path: Path, values: np.ndarray) -> None:
    """Write numbers as a file of the type that its name ends in."""
    if path.suffix == ".npy":
        np.save(path, values)
    elif path.suffix == ".pfm":
        path.write_bytes(encode_pfm(values))
    else:
        assert cv2.imwrite(str(path), values)


@pytest.mark.parametrize(("ending", "expected"), [("npy", np.inf), ("tiff", np.inf), ("pfm", np.nan)])
def test_an_infinite_depth_is_sky_but_unknown_in_a_pfm(tmp_path, ending, expected) -> None:
    path = tmp_path / f"depth.{ending}"
    stored = DEPTH.copy()
    stored[0, :2] = np.inf, 1e10  # renderers write the second where there is no surface
    put(path, stored)
    depth = read_map(path, "depth")
    np.testing.assert_array_equal(depth[0, :3], np.float32([expected, np.inf, DEPTH[0, 2]]))
