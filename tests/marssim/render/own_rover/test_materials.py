"""The colours of the rover's parts."""

import numpy as np
import pytest

from marssim.render.own_rover.materials import CELL, DARK, DECK, GAP_WIDTH, PANEL, albedo

UP = np.array([0.0, 0.0, 1.0])


def colours(material: int, points: np.ndarray, normal: np.ndarray, pixel: float) -> np.ndarray:
    n = len(points)
    return albedo(np.full(n, material), points, np.tile(normal, (n, 1)), np.full(n, pixel))


def test_from_afar_cells_and_gaps_have_their_mean_colour():
    at = np.random.default_rng(0).uniform(-1, 1, (200_000, 3))
    fine, coarse = (colours(PANEL, at, UP, pixel) for pixel in (1e-4, 0.5))
    assert fine.std(axis=0).min() > 0.02
    assert np.ptp(coarse, axis=0).max() < 1e-6
    assert coarse.mean(axis=0) == pytest.approx(fine.mean(axis=0), rel=0.02)


def test_gaps_lie_between_the_cells():
    middle, gap = (np.array([[CELL[0] * (k + 0.5), CELL[1] * (k + part), 0] for k in range(5)]) for part in (0.5, 0.0))
    assert (colours(PANEL, middle, UP, GAP_WIDTH / 3) < 0.6 * colours(PANEL, gap, UP, GAP_WIDTH / 3)).all()


def test_panels_are_bluish_and_dust_lies_on_what_faces_up():
    at = np.array([[0.5 * CELL[0], 0.5 * CELL[1], 0.0]])
    below = colours(PANEL, at, -UP, 1e-3)[0]
    assert below[2] > below[1] > below[0]
    for material in (DARK, DECK):
        up, side = colours(material, at, UP, 1e-3)[0], colours(material, at, np.array([1.0, 0, 0]), 1e-3)[0]
        assert up[0] - up[2] > side[0] - side[2] + 0.02
