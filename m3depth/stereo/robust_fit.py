"""Linear fits to matched points of which some are wrong."""

from __future__ import annotations

import numpy as np

LEAST_POINTS = 30  # that a fit needs
LEAST_SHARE = 0.5  # of the matches that must agree with one fit, and of these that must be found to sub-pixels
TRIPLES = 200  # fits to three points that the robust fit tries: of half true matches, 200 x 1/8 are all true
LEAST_DETERMINANT = 1e-3  # of three points' scaled terms; under it they lie nearly along a line and fit anything
REFITS = 2  # times that the best fit, to three points, is made again to all that agree with it
BIWEIGHT = 4.0  # standard deviations beyond which a point has no weight; 4.7 is usual, for fewer wrong matches
MAD_TO_DEVIATION = 1.4826  # of a normal distribution: standard deviation over median absolute deviation
LEAST_DEVIATION = 0.01  # [px] smallest standard deviation assumed, so that points of equal rows keep their weight
REWEIGHTINGS = 10  # of the biweight
NEIGHBOURS = 2.0  # factor on the standard error, measured: the errors of points near each other are alike


def consensus_fit(terms: np.ndarray, distance: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the fit (3,) that most of the distances agree with, and which of them do (RANSAC); None if few do.

    Args:
        terms: (N, 3) of each point.
        distance: (N,) of its rows [px].
        tolerance: Error of a distance [px].
    """
    rng = np.random.default_rng(0)
    chosen = rng.integers(len(distance), size=(TRIPLES, 3))
    scaled = terms / np.abs(terms).max(axis=0)
    chosen = chosen[np.abs(np.linalg.det(scaled[chosen])) > LEAST_DETERMINANT]
    if not len(chosen):
        return None
    trials = np.linalg.solve(terms[chosen], distance[chosen][..., None])[..., 0]  # (T, 3)
    agreeing = np.abs(distance - trials @ terms.T) <= tolerance  # (T, N)
    agree = agreeing[agreeing.sum(axis=1).argmax()]
    for _ in range(REFITS):
        if agree.sum() < max(LEAST_POINTS, LEAST_SHARE * len(distance)):
            return None
        fit = np.linalg.lstsq(terms[agree], distance[agree], rcond=None)[0]
        agree = np.abs(distance - terms @ fit) <= tolerance
    return fit, agree


def weighted_fit(terms: np.ndarray, distance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fit distances of rows by iterated weights (Tukey's biweight).

    Args:
        terms: (N, K) of each point.
        distance: (N,) of its rows [px].

    Returns:
        The fit (K,) and its covariance (K, K), with NEIGHBOURS.
    """
    weight = np.ones(len(distance))
    for _ in range(REWEIGHTINGS):
        root = np.sqrt(weight)
        fit = np.linalg.lstsq(terms * root[:, None], distance * root, rcond=None)[0]
        rest = distance - terms @ fit
        deviation = max(MAD_TO_DEVIATION * float(np.median(np.abs(rest))), LEAST_DEVIATION)
        weight = np.clip(1 - (rest / (BIWEIGHT * deviation)) ** 2, 0, None) ** 2
    information = (terms * weight[:, None]).T @ terms
    return fit, (NEIGHBOURS * deviation) ** 2 * np.linalg.pinv(information)
