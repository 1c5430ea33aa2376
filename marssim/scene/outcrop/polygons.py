"""Operations on many convex polygons at once.

Polygons are an array (N, M, 2) of corners, counter-clockwise, and an array (N,) of how many corners each of them has;
what follows in its row is arbitrary.
"""

from __future__ import annotations

import numpy as np

Polygons = tuple[np.ndarray, np.ndarray]  # corners (N, M, 2) and their numbers (N,)


def following(corners: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Return the next corner (N, M, 2) of each corner; each of the arbitrary rest gets a corner of its polygon."""
    index = np.arange(corners.shape[1])
    after = np.where(index + 1 < count[:, None], index + 1, 0)
    return np.take_along_axis(corners, after[..., None], axis=1)


def clip(corners: np.ndarray, count: np.ndarray, normal: np.ndarray, offset: np.ndarray) -> Polygons:
    """Cut each polygon along a line, and return the part where p . normal <= offset.

    Args:
        corners: (N, M, 2) corners.
        count: (N,) numbers of corners.
        normal: (N, 2) normals of the lines.
        offset: (N,) offsets of the lines.

    Returns:
        (N, L, 2) corners and (N,) numbers of corners, 0 where nothing is left.
    """
    valid = np.arange(corners.shape[1]) < count[:, None]
    beyond = np.einsum("nmi,ni->nm", corners, normal) - offset[:, None]
    onward = following(corners, count)
    after = np.einsum("nmi,ni->nm", onward, normal) - offset[:, None]
    inside = valid & (beyond <= 0)
    crossing = valid & ((beyond <= 0) != (after <= 0))
    share = beyond / np.where(crossing, beyond - after, 1)
    meeting = corners + share[..., None] * (onward - corners)
    width = 2 * corners.shape[1]
    keep = np.stack([inside, crossing], axis=2).reshape(-1, width)
    both = np.stack([corners, meeting], axis=2).reshape(-1, width, 2)
    number = keep.sum(axis=1)
    order = np.argsort(~keep, axis=1, kind="stable")[:, : max(int(number.max(initial=0)), 3)]
    return np.take_along_axis(both, order[..., None], axis=1), number


def clip_some(
    corners: np.ndarray, count: np.ndarray, rows: np.ndarray, normal: np.ndarray, offset: np.ndarray
) -> Polygons:
    """Cut some of the polygons; see `clip`.

    Args:
        corners: (N, M, 2) corners.
        count: (N,) numbers of corners.
        rows: (N,) bool, the K polygons to cut.
        normal: (K, 2) normals of the lines.
        offset: (K,) offsets of the lines.
    """
    part, number = clip(corners[rows], count[rows], normal, offset)
    out = np.zeros((len(corners), max(corners.shape[1], part.shape[1]), 2))
    out[:, : corners.shape[1]] = corners
    out[rows, : part.shape[1]] = part
    count = count.copy()
    count[rows] = number
    return out, count


def area_and_centroid(corners: np.ndarray, count: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the areas (N,) and centroids (N, 2) of polygons; the centroid of an empty one is arbitrary."""
    valid = np.arange(corners.shape[1]) < count[:, None]
    origin = corners[:, :1]
    a, b = corners - origin, following(corners, count) - origin
    cross = np.where(valid, a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], 0.0)
    area = cross.sum(axis=1) / 2
    moment = np.einsum("nm,nmi->ni", cross, np.where(valid[..., None], a + b, 0.0)) / 6
    return area, origin[:, 0] + moment / np.maximum(area, 1e-12)[:, None]


def disc_diameter(area: np.ndarray) -> np.ndarray:
    """Return the diameters (N,) of discs of areas (N,); areas below 0 count as 0."""
    return np.asarray(np.sqrt(4 / np.pi * np.maximum(area, 0)))


def perimeter(corners: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Return the lengths (N,) of the outlines of polygons."""
    side = following(corners, count) - corners
    valid = np.arange(corners.shape[1]) < count[:, None]
    return np.asarray(np.where(valid, np.hypot(side[..., 0], side[..., 1]), 0.0).sum(axis=1))


def inset(corners: np.ndarray, count: np.ndarray, gap: np.ndarray) -> Polygons:
    """Move each side of each polygon inward.

    Args:
        corners: (N, M, 2) corners.
        count: (N,) numbers of corners.
        gap: (N, M) how far the side that begins at each corner moves.

    Returns:
        (N, L, 2) corners and (N,) numbers of corners, 0 where nothing is left.
    """
    side = following(corners, count) - corners
    length = np.maximum(np.hypot(side[..., 0], side[..., 1]), 1e-12)
    outward = np.stack([side[..., 1], -side[..., 0]], axis=-1) / length[..., None]
    offset = np.einsum("nmi,nmi->nm", outward, corners) - gap
    out, number = corners, count
    for k in range(corners.shape[1]):
        rows = k < count
        out, number = clip_some(out, number, rows, outward[rows, k], offset[rows, k])
    return out, number


def outline(corners: np.ndarray, count: np.ndarray, points: int) -> np.ndarray:
    """Return outlines of equally many points: the corners, and points at even distances between them.

    Args:
        corners: (N, M, 2) corners.
        count: (N,) numbers of corners, at least 3. Of more corners than `points`, some are left out.
        points: Number of points P.

    Returns:
        (N, P, 2), counter-clockwise.
    """
    valid = np.arange(corners.shape[1]) < count[:, None]
    side = following(corners, count) - corners
    length = np.where(valid, np.hypot(side[..., 0], side[..., 1]), 0.0)
    end = np.cumsum(length, axis=1)
    start = end - length
    total = end[:, -1:]
    at = np.arange(points) / points * total  # (N, P) positions along the outline
    nearest = np.rint(start / total * points).astype(int) % points
    rows = np.broadcast_to(np.arange(len(corners))[:, None], start.shape)
    at[rows[valid], nearest[valid]] = np.where(nearest == 0, 0.0, start)[valid]
    at = np.sort(at, axis=1)
    which = (at[:, :, None] >= end[:, None, :]).sum(axis=2)
    which = np.minimum(which, count[:, None] - 1)
    share = (at - np.take_along_axis(start, which, axis=1)) / np.maximum(
        np.take_along_axis(length, which, axis=1), 1e-12
    )
    begin = np.take_along_axis(corners, which[..., None], axis=1)
    return np.asarray(begin + share[..., None] * np.take_along_axis(side, which[..., None], axis=1))


def stacked(parts: list[Polygons]) -> Polygons:
    """Return the polygons of all parts, in their order."""
    width = max(corners.shape[1] for corners, _ in parts)
    padded = [np.pad(corners, ((0, 0), (0, width - corners.shape[1]), (0, 0))) for corners, _ in parts]
    return np.concatenate(padded), np.concatenate([count for _, count in parts])
