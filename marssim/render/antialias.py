"""Anti-aliasing: finds the pixels on edges and gives them the mean colour of four rays.

Only pixels at a change of surface, depth or light get three rays beside that through their centre. Most of these rays
hit what a neighbouring pixel shows and take its colour.
"""

from __future__ import annotations

import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.base.compute.compiled import compiled, read_only
from marssim.base.dataset.frame import GROUND, SKY
from marssim.render.geometry.gbuffer import GBuffer, Hits

SAME_DEPTH = 0.02  # relative difference of depth up to which two samples of a surface count as one place
SUBPIXELS = ((0.0, -0.375), (-0.33, 0.19), (0.33, 0.19))  # [px] offsets x, y of a pixel's further rays
RAYS = len(SUBPIXELS)
# least change of 1 / Z to the next pixel that is an edge: STEP_SHARE of 1 / Z plus STEP_LEAST [1/m]
STEP_SHARE, STEP_LEAST = 0.06, 1e-3
CONTRAST = 0.04  # least contrast of an edge: half the relative change of brightness
AHEAD = 0.99  # depth before which rays beside a pixel meet no ground, over the least depth around it
BEND_SHARE = 0.1  # the same for the second difference of 1 / Z along a row or column, on ground


def edge_pixels(view: GBuffer, lit: np.ndarray, colour: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Return the pixels where brightness changes at a change of surface or stone, a depth edge or a sharp shadow.

    The border of a shadow is sharp where a pixel that sees the whole sun is beside one that sees nothing of it.
    A depth edge is a jump of 1 / Z. On ground it is a jump of the second difference of 1 / Z, which is 0 on any plane.

    Args:
        view: G-buffer of the camera.
        lit: (H, W) float32 share of the sun that each pixel sees.
        colour: (H * W, 3) colours of the view.

    Returns:
        (E,) int32 indices of pixels, counted row by row, those amid ground first; (E,) float64 depths before which
        rays through these meet no ground [m], 0 beside the sky, where that is not known; and the number of pixels amid
        ground.
    """
    pixels = _edge_pixels(view.depth, view.surface, view.detail, lit, colour)
    begin, amid = _begins(pixels, view.depth, view.surface)
    order = np.argsort(~amid, kind="stable")
    return pixels[order], begin[order], int(amid.sum())


def subpixel_rays(camera: PinholeCamera, pixels: np.ndarray) -> np.ndarray:
    """Return the three further rays of each of the pixels (E,), (3 E, 3) of z = 1, pixel by pixel."""
    return _subpixel_rays(read_only(camera.rays().reshape(-1, 3)), pixels, float(camera.fx), float(camera.fy))


def colours_beside(
    pixels: np.ndarray, hits: Hits, view: GBuffer, lit: np.ndarray, colour: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Interpolate the colours of further rays from the pixels around them, where possible.

    It is possible if some of the 3 x 3 pixels show the same surface and stone at the same depth, and if light and
    shadow do not both fall on those without a soft border between them.

    Args:
        pixels: (E,) indices of `edge_pixels`.
        hits: What the (3 E,) further rays hit.
        view: G-buffer of the camera.
        lit: (H, W) float32 share of the sun that each pixel sees.
        colour: (H * W, 3) colours of the view.

    Returns:
        (3 E, 3) float32 colours, and (3 E,) bool: the ray has a colour.
    """
    return _colours_beside(
        pixels, hits.depth, hits.surface, hits.detail, view.depth, view.surface, view.detail, lit, colour
    )


def average(pixels: np.ndarray, samples: np.ndarray, colour: np.ndarray) -> None:
    """Give the pixels (E,) of colour (H * W, 3) the mean of theirs and of three samples (3 E, 3), in place."""
    _average(pixels, samples, colour)


@compiled
def _edge_pixels(depth, surface, detail, lit, colour):
    height, width = depth.shape
    out = np.empty(height * width, dtype=np.int32)
    count = 0
    bend, contrast = np.float32(BEND_SHARE), np.float32(CONTRAST)
    share, least, one = np.float32(STEP_SHARE), np.float32(STEP_LEAST), np.float32(1)
    for row in range(height):
        up, down = max(row - 1, 0), min(row + 1, height - 1)
        for column in range(width):
            left, right = max(column - 1, 0), min(column + 1, width - 1)
            inside = up < row < down and left < column < right
            centre, z, brightness = surface[row, column], depth[row, column], colour[row * width + column, 0]
            edge = False
            for j, i in ((row, left), (row, right), (up, column), (down, column)):
                beside = colour[j * width + i, 0]
                if edge or not abs(brightness - beside) > contrast * (brightness + beside):
                    continue
                # only where the brightness changes is it worth while to look for what changes
                edge = surface[j, i] != centre or abs(lit[j, i] - lit[row, column]) == one
                if edge or centre == SKY:
                    continue
                near, before = one / z, one / depth[j, i]
                if centre == GROUND:
                    # On slanted ground 1 / Z changes fast but linearly; at a crest before other ground it jumps.
                    opposite = one / depth[2 * row - j, 2 * column - i] if inside else near
                    edge = detail[j, i, 0] != detail[row, column, 0]
                    edge = edge or abs(before + opposite - 2 * near) > bend * near + least
                else:
                    edge = abs(before - near) > share * near + least
            if edge:
                out[count] = row * width + column
                count += 1
    return out[:count]


@compiled
def _subpixel_rays(rays, pixels, fx, fy):
    out = np.ones((RAYS * len(pixels), 3))
    for p in range(len(pixels)):
        u, v = rays[pixels[p], 0], rays[pixels[p], 1]
        for k in range(RAYS):
            du, dv = SUBPIXELS[k]
            out[RAYS * p + k, 0], out[RAYS * p + k, 1] = u + du / fx, v + dv / fy
    return out


@compiled
def _begins(pixels, depth, surface):
    """Return the depths before which rays through pixels (E,) meet no ground, 0 beside the sky, and who is amid it."""
    height, width = depth.shape
    out, amid = np.zeros(len(pixels)), np.zeros(len(pixels), dtype=np.bool_)
    for p in range(len(pixels)):
        row, column = pixels[p] // width, pixels[p] % width
        nearest, alone = np.inf, True
        for j in range(max(row - 1, 0), min(row + 2, height)):
            for i in range(max(column - 1, 0), min(column + 2, width)):
                nearest = min(nearest, 0.0 if surface[j, i] == SKY else float(depth[j, i]))
                alone = alone and surface[j, i] == GROUND
        out[p], amid[p] = AHEAD * nearest, alone
    return out, amid


@compiled
def _colours_beside(pixels, depth, surface, detail, pixel_depth, pixel_surface, pixel_detail, lit, colour):
    height, width = lit.shape
    coloured = np.zeros(len(depth), dtype=np.bool_)
    out = np.empty((len(depth), 3), dtype=np.float32)
    for p in range(len(pixels)):
        row, column = pixels[p] // width, pixels[p] % width
        up, down = max(row - 1, 0), min(row + 1, height - 1)
        left, right = max(column - 1, 0), min(column + 1, width - 1)
        for k in range(RAYS * p, RAYS * p + RAYS):
            du, dv = SUBPIXELS[k - RAYS * p]
            centre, z = surface[k], depth[k]
            near = SAME_DEPTH * z
            total, dark, bright, soft = 0.0, False, False, False
            red, green, blue = 0.0, 0.0, 0.0
            for j in range(up, down + 1):
                # bilinear weights where the ray lies among such pixels; else nearly nothing but the nearest ones counts
                below = max(1 - abs(j - row - dv), 1e-6)
                for i in range(left, right + 1):
                    if pixel_surface[j, i] != centre or (centre != SKY and not abs(pixel_depth[j, i] - z) < near):
                        continue
                    if centre == GROUND and pixel_detail[j, i, 0] != detail[k, 0]:
                        continue
                    bright, dark = bright or lit[j, i] == 1, dark or lit[j, i] == 0
                    soft = soft or 0 < lit[j, i] < 1
                    weight = max(1 - abs(i - column - du), 1e-6) * below
                    total += weight
                    at = j * width + i
                    red += weight * colour[at, 0]
                    green += weight * colour[at, 1]
                    blue += weight * colour[at, 2]
            coloured[k] = soft or bright != dark
            if total > 0:
                out[k, 0], out[k, 1], out[k, 2] = red / total, green / total, blue / total
    return out, coloured


@compiled
def _average(pixels, samples, colour):
    for p in range(len(pixels)):
        for c in range(3):
            total = colour[pixels[p], c]
            for k in range(RAYS * p, RAYS * p + RAYS):
                total += samples[k, c]
            colour[pixels[p], c] = total * np.float32(1 / (1 + RAYS))
