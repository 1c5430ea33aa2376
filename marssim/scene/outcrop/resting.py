"""Plates at rest on the ground: the planes of their tops, and the part of each of them that shows above the ground."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from marssim.scene.outcrop.polygons import area_and_centroid, clip
from marssim.scene.rocks.mesh import ground_plane
from marssim.scene.rocks.population import CAMERA_EXTENT, LEAST_DISTANCE

Ground = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Rest:
    """How N plates rest on the ground.

    Attributes:
        plane: (N, 3) z0, east, north: the tops have the height z0 + east x + north y [m].
        rise: (N,) height above the ground of the highest edge over that of the middle [m].
        area: (N,) area of the part that shows above the ground [m2].
        middle: (N, 2) centroid of that part [m].
    """

    plane: np.ndarray
    rise: np.ndarray
    area: np.ndarray
    middle: np.ndarray


def rest(
    outline: np.ndarray, at: np.ndarray, diameter: np.ndarray, lean: np.ndarray, edge: np.ndarray, height_at: Ground
) -> Rest:
    """Lay plates so that their highest edges stand at given heights above the ground.

    Args:
        outline: (N, P, 2) outlines of their tops [m].
        at: (N, 2) points in them, around which the ground counts [m].
        diameter: (N,) diameters of the ground that counts [m].
        lean: (N, 2) slopes of their tops to the ground.
        edge: (N,) heights of their highest edges above the ground [m].
        height_at: Function of x, y [m] that returns the height of the ground [m].
    """
    ground = ground_under(at, diameter, height_at)
    plane = ground + np.column_stack([-np.einsum("ni,ni->n", lean, at), lean])
    top = plane[:, :1] + np.einsum("npi,ni->np", outline, plane[:, 1:])
    rise = (top - height_at(outline[..., 0], outline[..., 1])).max(axis=1)
    plane[:, 0] += edge - rise
    return Rest(plane, rise, *shown_part(outline, plane - ground))


def ground_under(at: np.ndarray, diameter: np.ndarray, height_at: Ground) -> np.ndarray:
    """Return the planes (N, 3) of the ground around points, z0 + east x + north y [m]; see `rest` for the arguments."""
    ground, slope = ground_plane(at, diameter, height_at)
    return np.column_stack([ground - np.einsum("ni,ni->n", slope, at), slope])


def shown_part(outline: np.ndarray, above: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the area (N,) [m2] and the centroid (N, 2) [m] of what shows of plates above the ground.

    Args:
        outline: (N, P, 2) outlines of their tops [m].
        above: (N, 3) height of their tops over the planes of the ground, z0 + east x + north y [m].
    """
    count = np.full(len(outline), outline.shape[1])
    return area_and_centroid(*clip(outline, count, -above[:, 1:], above[:, 0]))


def camera_distance(xy: np.ndarray, half: float) -> np.ndarray:
    """Return the least distances [m] of a camera from points (N, 2)."""
    away: np.ndarray = np.abs(xy).max(axis=1, initial=0) - CAMERA_EXTENT * half
    return np.maximum(away, 0) + LEAST_DISTANCE
