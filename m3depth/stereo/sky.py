"""Where sky can be: above the horizon of the ground, up to the upper border of the image.

A network that has seen few bright, smooth walls or blank dust may take them for sky, and sky is free ground to a
navigator. What it takes for sky is therefore only sky where a sky can be. The other way round, nothing floats in the
sky: a part without contact to the ground, of which the network is not confident, is sky too.
"""

from __future__ import annotations

import cv2
import numpy as np

from marssim.base.camera import PinholeCamera, StereoRig

CONFIDENT = 0.5  # confidence from which a pixel tells where the ground is
# Share of the pixels that must be confident ground. 284 rendered images, half of them with faults, have .47 and more;
# most blank images that the network takes for sky have .03 and less, a dark and noisy one had .22.
FEWEST = 0.05
MOST = 4000  # pixels to which the plane is fitted
ROUNDS = 8  # of the robust fit
UPRIGHT = 0.3  # least cosine between the plane's normal and the image's vertical: a wall has no horizon
TOLERANCE = 0.5  # [px] disparity off the plane at which a pixel weighs half
# [rad] Sky may begin this far below the horizon of the ground before the rover, where the ground falls away behind a
# crest, but not so far that ground of this plane would be nearer than NEAR_GROUND, as it is for a lower camera.
BELOW_HORIZON = float(np.arctan(1.2 / 8))
NEAR_GROUND = 8.0  # [m]


def possible_sky(candidates: np.ndarray, disparity: np.ndarray, confidence: np.ndarray, rig: StereoRig) -> np.ndarray:
    """Return the part of what a network takes for sky that can be sky, with what floats in it.

    It is connected with the upper border of the image, and lies above the horizon of the plane that fits the confident
    disparities best, or below it by at most BELOW_HORIZON, where the plane is farther than NEAR_GROUND. Where that
    plane is seen as a wall, the horizon is not known, and only the border decides. Where fewer pixels than FEWEST are
    confident ground, as before blank ground or where the camera looks up, nothing is sky. A part floats if sky
    separates it from the lower border and none of its pixels is confident. The image must be upright, as a rover's is.

    Args:
        candidates: (H, W) bool, what the network takes for sky.
        disparity: (H, W) [px].
        confidence: (H, W), 0 to 1.
        rig: The cameras of the maps.

    Returns:
        (H, W) bool.
    """
    if not candidates.any():
        return candidates
    ground = np.flatnonzero(~candidates & (confidence >= CONFIDENT) & np.isfinite(disparity) & (disparity > 0))
    if len(ground) < FEWEST * candidates.size:
        return np.zeros_like(candidates)
    plane = ground_plane(ground[:: -(-len(ground) // MOST)], disparity, rig.camera)
    above = candidates if plane is None else candidates & ~_below_horizon(plane, rig)
    border = np.zeros_like(above)
    border[0] = True
    sky = _parts_with(border, above, 4)
    held = confidence >= CONFIDENT
    held[-1] = True
    return ~_parts_with(held, ~sky, 8)


def _parts_with(marked: np.ndarray, mask: np.ndarray, connectivity: int) -> np.ndarray:
    """Return the connected parts of a mask (H, W) that have a marked pixel."""
    count, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=connectivity)
    kept = np.zeros(count, dtype=bool)
    kept[labels[marked & mask]] = True
    return kept[labels]


def ground_plane(pixels: np.ndarray, disparity: np.ndarray, camera: PinholeCamera) -> np.ndarray | None:
    """Fit a plane to disparities by reweighted least squares.

    A plane in space is a plane in disparity too, d = a u + b v + c.

    Args:
        pixels: (N,) flat indices of the pixels that count.
        disparity: (H, W) [px].
        camera: The camera of the disparities.

    Returns:
        (3,) a, b, c; None where the pixels determine no plane, or one that is seen as a wall.
    """
    v, u = np.divmod(pixels, disparity.shape[1])
    columns = np.stack([u, v, np.ones_like(u)], axis=1).astype(float)
    values = disparity.ravel()[pixels].astype(float)
    weight = np.ones(len(pixels))
    for _ in range(ROUNDS):
        try:
            plane = np.linalg.solve(columns.T @ (weight[:, None] * columns), columns.T @ (weight * values))
        except np.linalg.LinAlgError:
            return None
        weight = 1 / (1 + ((columns @ plane - values) / TOLERANCE) ** 2)
    normal = _downward(plane, camera)
    return plane if normal[1] > UPRIGHT * np.linalg.norm(normal) else None


def _downward(plane: np.ndarray, camera: PinholeCamera) -> np.ndarray:
    """Return the downward normal (3,), camera frame, of a plane d = a u + b v + c; d = normal . ray of each pixel."""
    a, b, c = plane
    return np.array([a * camera.fx, b * camera.fy, a * camera.cx + b * camera.cy + c])


def _below_horizon(plane: np.ndarray, rig: StereoRig) -> np.ndarray:
    """Return the pixels (H, W) that look too far below the horizon of a plane, d = a u + b v + c, to see sky."""
    normal, rays = _downward(plane, rig.camera), rig.camera.rays()
    height = rig.fb / np.linalg.norm(normal)  # of the camera over the plane [m]
    limit = min(BELOW_HORIZON, np.arctan(height / NEAR_GROUND))
    x, y = rays[:1, :, 0], rays[:, :1, 1]
    down = x * normal[0] + (y * normal[1] + normal[2])
    return down > np.sin(limit) * np.linalg.norm(normal) * np.sqrt(x * x + (y * y + 1))
