"""The cloud of a pair's maps, and its colours: by image, normals, depth and confidence."""

from __future__ import annotations

import math

import numpy as np

from marssim.base.camera import MAX_DEPTH, StereoRig
from marssim.base.images.colours import (
    CONFIDENCE_TITLE,
    NEAR,
    NORMAL_TITLE,
    confidence_colours,
    depth_colours,
    normal_colours,
)
from marssim.base.view.scene import Layer, View

MOST = 800_000  # points of a cloud; 15 bytes each go to the browser
FARTHEST = 30.0  # [m] depth of the points of a cloud


def shown_pixels(depth: np.ndarray, farthest: float = FARTHEST, most: int = MOST) -> np.ndarray:
    """Return the pixels that become points, evenly thinned where there are too many.

    Args:
        depth: (H, W) [m]; pixels that are not finite or not positive are left out.
        farthest: Depth beyond which pixels are left out [m].
        most: Largest number of points.

    Returns:
        (H, W) bool.
    """
    with np.errstate(invalid="ignore"):
        valid = np.isfinite(depth) & (depth > 0) & (depth <= farthest)
    count = int(valid.sum())
    if count <= most:
        return valid
    # every n-th row and column; rows and columns may happen to hold more than their share of points
    step = math.ceil(math.sqrt(count / most))
    while True:
        thinned = np.zeros_like(valid)
        thinned[::step, ::step] = valid[::step, ::step]
        if thinned.sum() <= most:
            return thinned
        step += 1


def view_of_maps(
    rig: StereoRig,
    depth: np.ndarray,
    image: np.ndarray | None = None,
    normal: np.ndarray | None = None,
    confidence: np.ndarray | None = None,
    scale: tuple[float, float] = (NEAR, MAX_DEPTH),
    farthest: float = FARTHEST,
) -> tuple[View, np.ndarray]:
    """Return the view of a pair, with colours by all of its maps.

    Args:
        rig: The cameras.
        depth: (H, W) [m]; pixels that are not finite or not positive become no points.
        image: (H, W, 3) uint8 RGB left image.
        normal: (H, W, 3) unit vectors, camera frame; 0 where unknown.
        confidence: (H, W), 0 to 1.
        scale: Nearest and farthest depth [m] of the colours of depth.
        farthest: Depth beyond which pixels become no points [m].

    Returns:
        The view, and the pixels of its points, (H, W) bool.
    """
    pixels = shown_pixels(depth, farthest)
    points = (rig.camera.rays()[pixels] * depth[pixels, None]).astype(np.float32)
    layers = {}
    if image is not None:
        layers["image"] = Layer(image[pixels], "the left image")
    near, far = scale
    layers["depth"] = Layer(
        depth_colours(depth, near, far)[pixels], f"depth: {near:g} m yellow to {far:g} m violet, grey beyond"
    )
    if normal is not None:
        layers["normals"] = Layer(normal_colours(normal)[pixels], f"{NORMAL_TITLE}; black where unknown")
    if confidence is not None:
        layers["confidence"] = Layer(confidence_colours(confidence)[pixels], CONFIDENCE_TITLE)
    return View(rig, image, points, layers), pixels
