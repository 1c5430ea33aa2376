"""sensor_msgs/PointCloud2: coloured points, as RViz and PCL read them."""

from __future__ import annotations

from typing import Any

import numpy as np

from marssim.base.bags.library import new_message
from marssim.base.bags.messages import header

FLOAT32 = 7  # sensor_msgs/PointField
POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<u4")])  # rgb: 0x00RRGGBB in the bits of a float


def cloud_message(stamp: int, frame: str, points: np.ndarray, colours: np.ndarray) -> Any:
    """Return a sensor_msgs/PointCloud2 of one row.

    Args:
        stamp: Time [ns].
        frame: Frame of the points.
        points: (N, 3) [m].
        colours: (N, 3) uint8 RGB.
    """
    rows = np.zeros(len(points), POINT)
    rows["x"], rows["y"], rows["z"] = np.asarray(points, np.float32).reshape(-1, 3).T
    red, green, blue = colours.reshape(-1, 3).astype(np.uint32).T
    rows["rgb"] = red << 16 | green << 8 | blue
    fields = [
        new_message("sensor_msgs/PointField", name=name, offset=4 * i, datatype=FLOAT32, count=1)
        for i, name in enumerate(POINT.names or ())
    ]
    return new_message(
        "sensor_msgs/PointCloud2", header=header(stamp, frame), height=1, width=len(rows), fields=fields,
        is_bigendian=False, point_step=POINT.itemsize, row_step=rows.nbytes, data=rows.view(np.uint8), is_dense=True,
    )  # fmt: skip
