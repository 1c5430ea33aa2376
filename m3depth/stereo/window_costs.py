"""Matching costs of windows, and the cheapest disparity, pixel by pixel or along paths (SGM).

A cost volume here is (D, H, W) uint16: the cost of disparity d at (y, x) of the left image, 0 to HIGHEST. It is HIGHEST
where x - d lies outside the right image.
"""

from __future__ import annotations

from typing import Literal

import cv2
import numpy as np

from marssim.base.compute.compiled import compiled

Cost = Literal["ssd", "sad", "ncc"]
HIGHEST = 4095  # largest cost: eight paths of it, plus an equal penalty each, still fit 16 bit
# Cost of a difference of 1, so that HIGHEST is reached at 32 grey levels (sad), 32 squared (ssd) and 2 (1 - ncc).
SCALE: dict[str, float] = {"sad": HIGHEST / 32, "ssd": HIGHEST / 32**2, "ncc": HIGHEST / 2}


def window_costs(left: np.ndarray, right: np.ndarray, reach: int, cost: Cost, block: int) -> np.ndarray:
    """Compute the cost volume of windows of `block` x `block` px.

    Args:
        left, right: (H, W) uint8.
        reach: D, the number of disparities, at most W.
        cost: "ssd", "sad" or "ncc".
        block: Side of the window [px], odd.

    Returns:
        (D, H, W) uint16.
    """
    a, b = (image.astype(np.float32) - np.float32(128) for image in (left, right))
    height, width = left.shape

    def mean_of(values: np.ndarray) -> np.ndarray:
        return cv2.boxFilter(values, -1, (block, block), borderType=cv2.BORDER_REPLICATE)

    def variance_of(values: np.ndarray, mean: np.ndarray) -> np.ndarray:
        return np.maximum(mean_of(values * values) - mean * mean, np.float32(1))

    volume = np.full((reach, height, width), HIGHEST, np.uint16)
    for d in range(reach):
        # The windows of a disparity cover the columns that both images share.
        first, second = a[:, d:], b[:, : width - d]
        if cost == "sad":
            mean = mean_of(np.abs(first - second))
        elif cost == "ssd":
            mean = mean_of((first - second) ** 2)
        else:
            m, n = mean_of(first), mean_of(second)
            deviations = np.sqrt(variance_of(first, m) * variance_of(second, n))
            mean = 1 - np.clip((mean_of(first * second) - m * n) / deviations, -1, 1)
        volume[d, :, d:] = np.minimum(mean * np.float32(SCALE[cost]) + np.float32(0.5), HIGHEST)
    return volume


def semi_global(costs: np.ndarray, small: int, large: int) -> np.ndarray:
    """Sum costs along eight paths (Hirschmueller 2008, Eq. 13), up to 65535.

    Args:
        costs: A cost volume, (D, H, W) uint16.
        small: Penalty for a change of the disparity by 1 px.
        large: Penalty for a larger change.

    Returns:
        (D, H, W) uint16.

    Raises:
        ValueError: The penalties are not 0 <= small <= large <= HIGHEST.
    """
    if not 0 <= small <= large <= HIGHEST:
        raise ValueError(f"penalties must be 0 <= small <= large <= {HIGHEST}, got {small} and {large}")
    total = np.zeros_like(costs)
    _down_the_rows(costs, total, small, large, 1)
    _down_the_rows(costs, total, small, large, -1)
    _along_the_rows(costs, total, small, large)
    return total


def winners(costs: np.ndarray) -> np.ndarray:
    """Return the cheapest disparity, refined by a parabola: (H, W) float32 [px]; NaN where the right image disagrees.

    The cheapest disparity of the right image's pixel has to be the same within 1 px.

    Args:
        costs: (D, H, W) uint16.
    """
    return _winners(costs)


@compiled
def _down_the_rows(costs, total, small, large, step):
    """Add three paths that come from the previous row: straight and from both sides. step: 1 down, -1 up."""
    reach, height, width = costs.shape
    previous = np.zeros((3, reach, width), np.int32)
    current = np.zeros((3, reach, width), np.int32)
    least = np.zeros((3, width), np.int32)
    for row in range(height):
        y = row if step > 0 else height - 1 - row
        for path in range(3):
            side = path - 1
            low, high = max(0, -side), min(width, width - side)  # x + side lies in the image
            for d in range(reach):
                for x in range(width):
                    current[path, d, x] = costs[d, y, x]
                if row > 0:
                    up, down = max(d - 1, 0), min(d + 1, reach - 1)
                    for x in range(low, high):
                        best = previous[path, d, x + side]
                        best = min(best, previous[path, up, x + side] + small)
                        best = min(best, previous[path, down, x + side] + small)
                        lowest = least[path, x + side]
                        best = min(best, lowest + large)
                        current[path, d, x] += best - lowest
                for x in range(width):
                    total[d, y, x] += current[path, d, x]
        for path in range(3):
            for x in range(width):
                least[path, x] = current[path, 0, x]
            for d in range(1, reach):
                for x in range(width):
                    least[path, x] = min(least[path, x], current[path, d, x])
        previous, current = current, previous


@compiled
def _along_the_rows(costs, total, small, large):
    """Add the two paths within a row."""
    reach, height, width = costs.shape
    row_costs = np.zeros((width, reach), np.int32)
    added = np.zeros((width, reach), np.int32)
    previous = np.zeros(reach + 2, np.int32)
    current = np.zeros(reach + 2, np.int32)
    for y in range(height):
        for d in range(reach):
            for x in range(width):
                row_costs[x, d] = costs[d, y, x]
        for way in range(2):
            least = 0
            for column in range(width):
                x = column if way == 0 else width - 1 - column
                if column == 0:
                    for d in range(reach):
                        current[d + 1] = row_costs[x, d]
                else:
                    for d in range(reach):
                        best = min(previous[d] + small, previous[d + 2] + small)
                        best = min(best, previous[d + 1])
                        best = min(best, least + large)
                        current[d + 1] = row_costs[x, d] + best - least
                current[0] = current[1]
                current[reach + 1] = current[reach]
                least = current[1]
                for d in range(1, reach + 1):
                    least = min(least, current[d])
                if way == 0:
                    for d in range(reach):
                        added[x, d] = current[d + 1]
                else:
                    for d in range(reach):
                        added[x, d] += current[d + 1]
                previous, current = current, previous
        for d in range(reach):
            for x in range(width):
                total[d, y, x] += added[x, d]


@compiled
def _winners(costs):
    reach, height, width = costs.shape
    out = np.full((height, width), np.nan, np.float32)
    left = np.zeros(width, np.int32)
    right = np.zeros(width, np.int32)
    left_cost = np.zeros(width, np.int32)
    right_cost = np.zeros(width, np.int32)
    for y in range(height):
        left_cost[:] = 1 << 20
        right_cost[:] = 1 << 20
        for d in range(reach):
            for x in range(d, width):
                cost = np.int32(costs[d, y, x])
                if cost < left_cost[x]:
                    left_cost[x] = cost
                    left[x] = d
                if cost < right_cost[x - d]:
                    right_cost[x - d] = cost
                    right[x - d] = d
        for x in range(width):
            d = left[x]
            if abs(right[x - d] - d) > 1:
                continue
            offset = 0.0
            if 0 < d < min(reach - 1, x):
                before, after = np.int32(costs[d - 1, y, x]), np.int32(costs[d + 1, y, x])
                bend = before - 2 * left_cost[x] + after
                if bend > 0:
                    offset = min(max((before - after) / (2 * bend), -0.5), 0.5)
            out[y, x] = d + offset
    return out
