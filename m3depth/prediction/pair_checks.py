"""Checks whether two images are a rectified stereo pair, and whether left and right are exchanged."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from m3depth.stereo.classical import SGBM, grey_pair
from m3depth.stereo.pairs import in_grey
from marssim.base.camera import StereoRig

QUICK_WIDTH = 256  # [px] width to which matched_shares reduces images
SWAP_SHARE = 0.3  # share of the pixels that must match with exchanged eyes
LITTLE, HARDLY_ANY = 0.15, 0.05  # shares of matching pixels under which a pair is doubtful, and meaningless
SMALLEST = 100  # [px] width under which too few matches are not held against a pair
FULL_WIDTH = 1024  # [px] width from which the limits of rows grow with the width
DOUBTFUL_ROWS, WRONG_ROWS = 0.75, 2.5  # [px] distances of rows that give a warning, and make the result meaningless
FEATURE_WIDTH = 1200  # [px] largest width of images in which features are searched
FEATURES = 1200  # most features of an image
RATIO = 0.75  # largest ratio of the distances of a feature to its nearest and second nearest partner (Lowe 2004)
TRIPLES = 300  # planes that the robust fit tries
LEAST_MATCHES = 30  # features that the fit needs


def matched_shares(left: np.ndarray, right: np.ndarray, rig: StereoRig) -> tuple[float, float]:
    """Return the shares of the pixels that match in the given order, and with the eyes exchanged.

    SGBM matches images reduced to 256 columns.

    Args:
        left: (H, W) or (H, W, 3) uint8 left image.
        right: The right image, likewise.
        rig: The cameras of these images.

    Raises:
        ValueError: As SGBM.infer.
    """
    left, right = grey_pair(left, right, rig)
    scale = min(1.0, QUICK_WIDTH / rig.camera.width)
    small = rig.resized(round(rig.camera.width * scale), max(1, round(rig.camera.height * scale)))
    size = (small.camera.width, small.camera.height)
    a, b = (cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in (left, right))
    given, exchanged = (float(np.isfinite(SGBM().match(*eyes, small)).mean()) for eyes in ((a, b), (b, a)))
    return given, exchanged


def exchanged(shares: tuple[float, float]) -> bool:
    """Return whether matched_shares show exchanged eyes: 30 % of the pixels match that way, and twice as many.

    Of clean and degraded simulated pairs at least 0.49 match in the right order and at most 0.17 in the wrong one; of a
    raw pair of Curiosity's Navcams 0.85 and 0.36.
    """
    return shares[1] > SWAP_SHARE and shares[1] > 2 * shares[0]


def check_pair(
    left: np.ndarray, right: np.ndarray, rig: StereoRig, names: tuple[str, str] = ("left", "right")
) -> list[tuple[bool, str]]:
    """Return what speaks against a pair.

    The checks find images of one grey level, eyes that are one image or exchanged, pairs of which little matches, and
    rows that lie apart. M3Depth's error grows by a half where rows lie 1 px apart and threefold at 2 px; at 3 px it
    measures nothing. These limits grow with images wider than 1024 px. A pair in which neither features nor 5 % of the
    pixels match is meaningless: images of different places match in 1 to 8 % of the pixels, simulated pairs with a
    seventh of the contrast, blurred and noisy, in at least 16 %.

    Args:
        left: (H, W) or (H, W, 3) uint8 left image, of the rig's size.
        right: The right image, likewise.
        rig: The cameras of these images.
        names: What the messages call the images.

    Returns:
        Whether each finding makes the result meaningless, and its message.
    """
    for name, image in zip(names, (left, right), strict=True):
        if image.min() == image.max():
            tone = "black" if image.max() == 0 else "of one grey level"
            return [(True, f"{name} is {tone}: there is nothing to match")]
    if np.array_equal(left, right):
        return [(True, f"{names[0]} and {names[1]} are one and the same image")]
    shares = matched_shares(left, right, rig)
    if exchanged(shares):
        return [(True, f"{names[0]} and {names[1]} match the wrong way round: exchange left and right")]
    unit = max(1.0, rig.camera.width / FULL_WIDTH)
    offset = row_offset(left, right)
    if offset is not None and (offset.middle > DOUBTFUL_ROWS * unit or offset.worst > 3 * DOUBTFUL_ROWS * unit):
        fatal = offset.middle > WRONG_ROWS * unit
        return [
            (
                fatal,
                f"the rows of {names[0]} and {names[1]} lie {offset.middle:.1f} px apart (median of {offset.matches} "
                f"features; up to {offset.worst:.1f} px in a corner): the pair is not rectified",
            )
        ]
    if shares[0] < LITTLE:
        nothing = shares[0] < HARDLY_ANY and offset is None and rig.camera.width >= SMALLEST
        return [(nothing, f"only {shares[0]:.0%} of {names[0]} and {names[1]} match: is it a pair?")]
    return []


@dataclass(frozen=True)
class RowOffset:
    """The distance of the rows of two images.

    Attributes:
        middle: Median over the matched features [px].
        worst: Largest distance in a corner of the image [px], by a plane fitted to them.
        matches: Number of features that the plane was fitted to.
    """

    middle: float
    worst: float
    matches: int


def row_offset(left: np.ndarray, right: np.ndarray) -> RowOffset | None:
    """Measure the vertical distance of what the two eyes see, which is 0 in a rectified pair.

    SIFT features that are each other's best partners give v_left - v_right as an affine function of the place (what
    roll, pitch and a difference of focal lengths give, to first order), by the least median of squares, refined.

    Args:
        left: (H, W) or (H, W, 3) uint8 left image.
        right: The right image, of the same size.

    Returns:
        The distance; None if too few features match.
    """
    scale = min(1.0, FEATURE_WIDTH / left.shape[1])
    features = [_features(image, scale) for image in (left, right)]
    if any(len(points) < LEAST_MATCHES for points, _ in features):
        return None
    (in_left, a), (in_right, b) = features
    pairs = _mutual(a, b)
    in_left, in_right = in_left[pairs[:, 0]], in_right[pairs[:, 1]]
    height, width = left.shape[:2]
    # Without this, accidental matches all over the image can outnumber the right ones.
    near = (np.abs(in_left - in_right) < [0.5 * width, 0.15 * height]).all(axis=1)
    in_left, in_right = in_left[near], in_right[near]
    if len(in_left) < LEAST_MATCHES:
        return None
    offset = in_left[:, 1] - in_right[:, 1]
    place = np.column_stack([in_left / width, np.ones(len(in_left))])
    plane, inside = _robust_plane(place, offset)
    if inside.sum() < max(LEAST_MATCHES, 0.4 * len(offset)):
        return None
    corners = np.array([[x, y, 1] for x in (0, 1) for y in (0, height / width)])
    middle = float(np.median(np.abs(place[inside] @ plane)))
    return RowOffset(middle, float(np.abs(corners @ plane).max()), int(inside.sum()))


def _features(image: np.ndarray, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Return places (N, 2) [px] in the full image, and descriptors (N, 128)."""
    grey = in_grey(image)
    if scale < 1:
        grey = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    points, descriptors = cv2.SIFT.create(FEATURES, contrastThreshold=0.01).detectAndCompute(grey, None)
    places = np.array([p.pt for p in points], float).reshape(-1, 2)
    return (places + 0.5) / scale - 0.5, np.zeros((0, 128), np.float32) if descriptors is None else descriptors


def _mutual(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return indices (M, 2) of features that are each other's nearest, clearly nearer than the second."""
    matcher = cv2.BFMatcher()
    back = {m.queryIdx: m.trainIdx for m in matcher.match(b, a)}
    forth = [m for m in matcher.knnMatch(a, b, k=2) if len(m) == 2 and m[0].distance < RATIO * m[1].distance]
    kept = [(m.queryIdx, m.trainIdx) for m, _ in forth if back.get(m.trainIdx) == m.queryIdx]
    return np.array(kept, int).reshape(-1, 2)


def _robust_plane(place: np.ndarray, offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a plane (3,), and which offsets (N,) belong to it. place: (N, 3) x, y, 1."""
    rng = np.random.default_rng(0)
    best, plane = np.inf, np.zeros(3)
    for _ in range(TRIPLES):
        chosen = rng.choice(len(offset), 3, replace=False)
        trial = np.linalg.lstsq(place[chosen], offset[chosen], rcond=None)[0]
        spread = float(np.median(np.abs(offset - place @ trial)))
        if spread < best:
            best, plane = spread, trial
    for _ in range(3):
        inside = np.abs(offset - place @ plane) <= 3 * max(1.5 * best, 0.2)
        plane = np.linalg.lstsq(place[inside], offset[inside], rcond=None)[0]
    return plane, inside
