"""One cloud of many pairs: the points of their clouds in the world, averaged in cubes."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from marssim.base.images.pointcloud import encode_ply

BITS = 21  # of a cube's index along each axis


class FusedCloud:
    """Averages points and colours in cubes, as cloud after cloud is added. Memory grows with the ground that is seen.

    Args:
        voxel: Edge of a cube [m].
    """

    def __init__(self, voxel: float) -> None:
        self.voxel = voxel
        self._keys = np.zeros(0, np.int64)
        self._sums = np.zeros((0, 7))  # x, y, z, red, green, blue, number of points
        self._waiting: list[tuple[np.ndarray, np.ndarray]] = []  # keys and sums that are not yet among these
        self._origin: np.ndarray | None = None

    def add(self, points: np.ndarray, colours: np.ndarray) -> None:
        """Add a cloud.

        Args:
            points: (N, 3) [m], world frame. Points farther than 2^20 cubes from the first one are left out.
            colours: (N, 3) uint8.
        """
        if not len(points):
            return
        if self._origin is None:
            self._origin = np.floor(points[0] / self.voxel) * self.voxel
        local = np.asarray(points, float) - self._origin
        index = np.floor(local / self.voxel).astype(np.int64) + (1 << (BITS - 1))
        inside = ((index >= 0) & (index < 1 << BITS)).all(axis=1)
        if not inside.any():
            return
        index, local, colours = index[inside], local[inside], colours[inside]
        keys = (index[:, 0] << 2 * BITS) | (index[:, 1] << BITS) | index[:, 2]
        added = np.column_stack([local, colours.astype(float), np.ones(len(local))])
        self._waiting.append(_summed(keys, added))
        if sum(len(waiting) for waiting, _ in self._waiting) > len(self._keys):
            self._merge()  # as rarely as the cloud doubles, so that many clouds do not take quadratic time

    def _merge(self) -> None:
        """Add what is waiting to the cubes."""
        parts = [(self._keys, self._sums), *self._waiting]
        self._keys, self._sums = _summed(*(np.concatenate(part) for part in zip(*parts, strict=True)))
        self._waiting = []

    def result(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the mean points (M, 3) [m] and colours (M, 3) uint8, one for each cube that holds any."""
        if self._origin is None:
            return np.zeros((0, 3)), np.zeros((0, 3), np.uint8)
        if self._waiting:
            self._merge()
        mean = self._sums[:, :6] / self._sums[:, 6:]
        return mean[:, :3] + self._origin, np.round(mean[:, 3:]).astype(np.uint8)

    def encode(self) -> bytes:
        """Return the cloud as the content of a PLY file."""
        return encode_ply(*self.result())


def fuse(clouds: Iterable[tuple[np.ndarray, np.ndarray]], voxel: float) -> FusedCloud:
    """Fuse clouds of one world.

    Args:
        clouds: Points (N, 3) [m], world frame, and colours (N, 3) uint8 of each.
        voxel: Edge of a cube [m].
    """
    fused = FusedCloud(voxel)
    for points, colours in clouds:
        fused.add(points, colours)
    return fused


def _summed(keys: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the distinct keys in order, and the sums of the rows (N, C) of each."""
    order = np.argsort(keys, kind="stable")
    keys, values = keys[order], values[order]
    first = np.flatnonzero(np.r_[True, keys[1:] != keys[:-1]])
    return keys[first], np.add.reduceat(values, first, axis=0)
