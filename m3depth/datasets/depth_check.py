"""Checks whether the true depth of pairs fits what matches in their images.

A wrong unit, a calibration of another size, exchanged eyes or distances along the ray give depth that a network learns
without a complaint. Semi-global matching does not know the true depth, so where the two differ alike over the whole
image, the difference tells what is wrong. Maps of disparity show no wrong focal length or baseline: both depths have
them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import cv2
import numpy as np

from m3depth.datasets.config import DataConfig
from m3depth.stereo.classical import SGBM
from m3depth.stereo.eye_order import exchanged
from m3depth.stereo.pairs import StereoPairs, in_grey, pair_name, spread
from marssim.base.camera import StereoRig
from marssim.base.command.wording import counted
from marssim.base.dataset.dataset import StereoDataset
from marssim.base.dataset.sample import StereoSample

CHECKED = 6  # pairs of a dataset that are checked, spread over it
WIDTH = 256  # [px] to which the images are reduced
REACH = 128  # [px] largest disparity of a match in them
FEWEST_PAIRS = 2  # of those that are checked, which have a difference of their own where all together have none
FEWEST = 500  # matched pixels of known depth below which nothing is said
EXPLAINED = 0.6  # share of the matches that an explanation must explain, and
BETTER = 0.2  # by how much this share must exceed that of the depth as it is; noise, blur and rows gain up to 0.15
HARDLY_ANY = 0.3  # share of the matches below which depth without such an explanation is not that of the pair
CENTRES = "the principal points (cx) of both cameras"


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
class DepthMatches:
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


def depth_misfit(pairs: StereoPairs, among: Sequence[int] | None = None) -> str | None:
    """Return how the true depth of pairs differs from what matches in their images, as a sentence for a warning.

    Args:
        pairs: The pairs.
        among: Indices of the pairs that may be read; None takes all. A few, spread over them, are matched.

    Returns:
        None where the depth fits, where too little matches to tell, and for datasets of marssim, which are checked when
        they are written.

    Raises:
        DatasetError: As reading a pair does.
    """
    indices = range(len(pairs)) if among is None else among
    if isinstance(pairs, StereoDataset) or not len(indices):
        return None
    checked = [indices[number] for number in spread(len(indices), CHECKED)]
    reduced = [_reduced(pairs[index]) for index in checked]
    matches_by_pair = [_matches(pair) for pair in reduced]
    matches = _joined(matches_by_pair)
    enough = len(matches.matched) >= FEWEST
    reader = getattr(pairs, "config", None)
    config = reader if isinstance(reader, DataConfig) else None
    difference = (_explanation(matches, config) or _disagreement(matches)) if enough else None
    where = f"{pairs.path}: " if hasattr(pairs, "path") else ""
    if enough and difference is None:
        reasons = {
            index: reason
            for index, of_pair in zip(checked, matches_by_pair, strict=True)
            if len(of_pair.matched) >= FEWEST and (reason := _explanation(of_pair, config))
        }
        if len(reasons) < FEWEST_PAIRS:
            return None
        index, reason = next(iter(reasons.items()))
        some = f"{len(reasons)} of {counted(len(checked), 'pair')}, one of them {pair_name(pairs, index)},"
        return f"{where}the true depth of {some} does not fit the images: {reason}"
    misfit = _exchanged(reduced) or difference
    return misfit and f"{where}the true depth of {counted(len(reduced), 'pair')} does not fit the images: {misfit}"


def _explanation(matches: DepthMatches, config: DataConfig | None) -> str | None:
    """Return the difference between the true depth and the matches by which most of them are explained.

    Args:
        matches: The matches.
        config: How the pairs are read, which says what their maps hold; None if that is not known.

    Returns:
        None if there is no such difference, or the true depth explains them about as well as anything.
    """
    factor = float(np.median(matches.matched / matches.true))
    shift = float(np.median((matches.matched - matches.true) / matches.scale))
    disparity_maps = config is not None and config.depth is None and config.format != "oaisys"
    unit = "the unit of the maps" + (" (--unit)" if config is not None and (config.depth or config.disparity) else "")
    reasons = {
        f"the disparities that match are {factor:.3g} times as large as those of the depth; check {unit}"
        + ("" if disparity_maps else ", and the focal length and baseline of the calibration"): factor * matches.true,
        f"the disparities that match are {abs(shift):.1f} px {'larger' if shift > 0 else 'smaller'} than those of the "
        f"depth; check {'that the maps are of these images' if disparity_maps else CENTRES}": (
            matches.true + shift * matches.scale
        ),
    }
    if not disparity_maps:
        if config is not None and config.depth_along == "ray":
            reasons["the maps hold the depth along the optical axis; leave out --depth-along ray"] = (
                matches.true / matches.slant
            )
        else:
            flag = "; give --depth-along ray" if config is not None and config.depth else ""
            reasons[f"the maps hold the distance along the ray, not the depth along the optical axis{flag}"] = (
                matches.slant * matches.true
            )
    shares = {reason: matches.agreeing(expected) for reason, expected in reasons.items()}
    best, as_it_is = max(shares, key=shares.__getitem__), matches.agreeing(matches.true)
    return best if shares[best] >= max(EXPLAINED, as_it_is + BETTER) else None


def _disagreement(matches: DepthMatches) -> str | None:
    """Return that hardly any match agrees with the true depth; None if enough do."""
    share = matches.agreeing(matches.true)
    if share >= HARDLY_ANY:
        return None
    return f"{share:.0%} of the matches agree with it; check the calibration, and that maps and images are pairs"


def _exchanged(pairs: list[ReducedPair]) -> str | None:
    """Return that the eyes are exchanged, if far more pixels match that way round."""
    given, swapped = (
        float(np.mean([np.isfinite(pair.matches(order)).mean() for pair in pairs])) for order in (False, True)
    )
    message = "the eyes match the wrong way round; exchange the left and the right images"
    return message if exchanged((given, swapped)) else None


def _matches(pair: ReducedPair) -> DepthMatches:
    """Match a pair, and return its pixels of known depth that match."""
    disparity = pair.matches()
    usable = np.isfinite(disparity) & (pair.true > 0)
    slant = np.linalg.norm(pair.rig.camera.rays(), axis=-1)
    return DepthMatches(disparity[usable], pair.true[usable], slant[usable], np.full(int(usable.sum()), pair.scale))


def _joined(matches: list[DepthMatches]) -> DepthMatches:
    return DepthMatches(*(np.concatenate([getattr(m, field.name) for m in matches]) for field in fields(DepthMatches)))


def _reduced(sample: StereoSample) -> ReducedPair:
    """Reduce a pair; a pixel's true disparity is that of one of its pixels, and never a mean over an edge."""
    camera = sample.rig.camera
    scale = min(1.0, WIDTH / camera.width)
    size = round(camera.width * scale), max(1, round(camera.height * scale))
    left, right = (
        cv2.resize(in_grey(eye[..., 0] if eye.shape[2:] == (1,) else eye), size, interpolation=cv2.INTER_AREA)
        for eye in (sample.left, sample.right)
    )
    # beyond the left border of the right image, where the reader calls pixels hidden, a disparity may be far too large
    inside = np.arange(camera.width) - sample.disparity >= -0.5
    valid = np.isfinite(sample.disparity) & ~(sample.occluded & inside)
    disparity = np.where(valid, sample.disparity, 0).astype(np.float32)
    block = np.ones((max(1, round(1 / scale)),) * 2)
    true, near = (
        cv2.resize(values, size, interpolation=cv2.INTER_NEAREST) * np.float32(scale)
        for values in (disparity, cv2.dilate(disparity, block))
    )
    return ReducedPair(left, right, sample.rig.resized(*size), np.where(true > 0, true, near), scale)
