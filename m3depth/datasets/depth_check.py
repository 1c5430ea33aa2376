"""Checks whether the true depth of pairs fits what matches in their images.

A wrong unit, a calibration of another size, exchanged eyes or distances along the ray give depth that a network learns
without a complaint. Semi-global matching does not know the true depth, so where the two differ alike over the whole
image, the difference tells what is wrong.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from m3depth.stereo.classical import SGBM
from m3depth.stereo.pairs import StereoPairs, in_grey, spread
from marssim.base.camera import StereoRig
from marssim.base.command.wording import counted
from marssim.base.dataset.dataset import StereoDataset
from marssim.base.dataset.sample import StereoSample

CHECKED = 6  # pairs of a dataset that are checked, spread over it
WIDTH = 256  # [px] to which the images are reduced
REACH = 128  # [px] largest disparity of a match in them
FEWEST = 500  # matched pixels of known depth below which nothing is said
EXPLAINED = 0.6  # share of the matches that an explanation must explain, and
BETTER = 0.2  # by how much this share must exceed that of the depth as it is; noise, blur and rows gain up to 0.15
HARDLY_ANY = 0.3  # share of the matches below which depth without such an explanation is not that of the pair
SWAP_SHARE = 0.3  # share of the pixels that match where the eyes are exchanged


@dataclass(frozen=True)
class ReducedPair:
    """A pair of WIDTH columns, and its true disparity.

    Attributes:
        left, right: The grey images (H, W).
        rig: Their cameras.
        true: (H, W) disparity of the true depth [px], 0 where unknown, in the sky and where the right eye sees nothing.
        scale: Width of these images over that of the pair's.
    """

    left: np.ndarray
    right: np.ndarray
    rig: StereoRig
    true: np.ndarray
    scale: float

    def matches(self, exchanged: bool = False) -> np.ndarray:
        """Return the disparities (H, W) that SGBM finds, NaN without a match, as given or with the eyes exchanged."""
        left, right = (self.right, self.left) if exchanged else (self.left, self.right)
        return SGBM(disparities=REACH).match(left, right, self.rig)


@dataclass(frozen=True)
class Matches:
    """Matched pixels of known depth, (N,) each, with disparities in pixels of the reduced images.

    Attributes:
        matched: Disparity that semi-global matching finds.
        true: Disparity of the true depth.
        slant: Distance along the ray over depth, 1 or more.
        scale: Width of the reduced images over that of the images.
    """

    matched: np.ndarray
    true: np.ndarray
    slant: np.ndarray
    scale: np.ndarray

    def agreeing(self, expected: np.ndarray) -> float:
        """Return the share of the matches within half a pixel and 2 % of other disparities (N,)."""
        return float((np.abs(self.matched - expected) <= 0.5 + 0.02 * np.abs(expected)).mean())


def depth_misfit(pairs: StereoPairs) -> str | None:
    """Return how the true depth of pairs differs from what matches in their images, as a sentence for a warning.

    Args:
        pairs: The pairs; a few, spread over them, are matched.

    Returns:
        None where the depth fits, where too little matches to tell, and for datasets of marssim, which are checked when
        they are written.

    Raises:
        DatasetError: As reading a pair does.
    """
    if isinstance(pairs, StereoDataset) or not len(pairs):
        return None
    reduced = [_reduced(pairs[index]) for index in spread(len(pairs), CHECKED)]
    where = f"{pairs.path}: " if hasattr(pairs, "path") else ""
    found = _matches(reduced)
    enough = len(found.matched) >= FEWEST
    if enough and (reason := _difference(found)) is None:
        return None
    reason = _exchanged(reduced) or (reason if enough else None)
    return reason and f"{where}the true depth of {counted(len(reduced), 'pair')} does not fit the images: {reason}"


def _difference(found: Matches) -> str | None:
    """Return the difference between the true depth and the matches by which most of them are explained.

    Returns:
        None if the true depth explains them about as well as anything.
    """
    factor = float(np.median(found.matched / found.true))
    shift = float(np.median((found.matched - found.true) / found.scale))
    reasons = {
        f"the disparities that match are {factor:.3g} times as large as those of the depth; check the unit of the maps "
        "(--unit), and the focal length and baseline of the calibration": factor * found.true,
        f"the disparities that match are {abs(shift):.1f} px {'larger' if shift > 0 else 'smaller'} than those of the "
        "depth; check the principal points (cx) of both cameras": found.true + shift * found.scale,
        "the maps hold the distance along the ray, not the depth along the optical axis; give --depth-along ray": (
            found.slant * found.true
        ),
    }
    shares = {reason: found.agreeing(expected) for reason, expected in reasons.items()}
    best, as_it_is = max(shares, key=shares.__getitem__), found.agreeing(found.true)
    if shares[best] >= max(EXPLAINED, as_it_is + BETTER):
        return best
    if as_it_is < HARDLY_ANY:
        return f"{as_it_is:.0%} of the matches agree with it; check the calibration, and that maps and images are pairs"
    return None


def _exchanged(pairs: list[ReducedPair]) -> str | None:
    """Return that the eyes are exchanged, if far more pixels match that way round."""
    given, swapped = (np.mean([np.isfinite(pair.matches(order)).mean() for pair in pairs]) for order in (False, True))
    if swapped > SWAP_SHARE and swapped > 2 * given:
        return "the eyes match the wrong way round; exchange the left and the right images"
    return None


def _matches(pairs: list[ReducedPair]) -> Matches:
    """Match pairs, and return their pixels of known depth that match."""
    columns = []
    for pair in pairs:
        found = pair.matches()
        seen = np.isfinite(found) & (pair.true > 0)
        slant = np.linalg.norm(pair.rig.camera.rays(), axis=-1)
        columns.append((found[seen], pair.true[seen], slant[seen], np.full(int(seen.sum()), pair.scale)))
    return Matches(*(np.concatenate(values) for values in zip(*columns, strict=True)))


def _reduced(sample: StereoSample) -> ReducedPair:
    """Reduce a pair; a pixel's true disparity is that of one of its pixels, and never a mean over an edge."""
    camera = sample.rig.camera
    scale = min(1.0, WIDTH / camera.width)
    size = round(camera.width * scale), max(1, round(camera.height * scale))
    left, right = (cv2.resize(in_grey(eye), size, interpolation=cv2.INTER_AREA) for eye in (sample.left, sample.right))
    true = np.where(sample.occluded, np.float32(0), sample.disparity)
    true = cv2.resize(true, size, interpolation=cv2.INTER_NEAREST) * np.float32(scale)
    return ReducedPair(left, right, sample.rig.resized(*size), true, scale)
