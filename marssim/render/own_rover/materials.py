"""The colours of the rover's parts, with the cells of its solar panels and the dust on all that faces up."""

from __future__ import annotations

import numpy as np

from marssim.render.surfaces.albedo import GROUND_COLOUR

DECK, FOIL, PANEL, FRAME, METAL, DARK = range(6)
# albedo in linear RGB: white paint, gold foil, blue-grey cells, aluminium frames, wheels and legs, glass and shade
ALBEDO = np.array([
    (0.56, 0.55, 0.52), (0.50, 0.34, 0.12), (0.038, 0.056, 0.098), (0.42, 0.42, 0.42), (0.30, 0.29, 0.28),
    (0.06, 0.06, 0.065),
])  # fmt: skip
GAP = np.array([0.26, 0.27, 0.29])  # albedo between the cells
CELL = np.array([0.08, 0.04])  # [m] length and width of a cell
GAP_WIDTH = 0.003  # [m]
DUST = 0.15  # share of a level face that dust covers


def albedo(material: np.ndarray, points: np.ndarray, normals: np.ndarray, pixel: np.ndarray) -> np.ndarray:
    """Return the albedo of points of the rover, (N, 3) float32 linear RGB.

    Args:
        material: (N,) int.
        points: (N, 3) body frame [m].
        normals: (N, 3) unit normals, body frame.
        pixel: (N,) width of a pixel at the point [m], over which the cells of the panels are averaged.
    """
    colour = ALBEDO[material]
    cells = np.flatnonzero((material == PANEL) & (normals[:, 2] > 0.5))
    open_share = np.ones(len(cells))
    for axis in (0, 1):
        place = points[cells, axis] / CELL[axis]
        away = np.abs(place - np.rint(place)) * CELL[axis]  # from the middle of a gap
        wide = np.maximum(pixel[cells], 1e-4)
        one = np.clip((GAP_WIDTH / 2 + wide / 2 - away) / wide, 0, np.minimum(1, GAP_WIDTH / wide))
        open_share *= 1 - np.where(wide < CELL[axis], one, GAP_WIDTH / CELL[axis])  # a wide pixel has several gaps
    colour[cells] = open_share[:, None] * colour[cells] + (1 - open_share[:, None]) * GAP
    dust = DUST * np.clip(normals[:, 2:], 0, 1) ** 2
    return (colour + dust * (np.array(GROUND_COLOUR) - colour)).astype(np.float32)
