"""Encode depth and normals as 16-bit images, and decode them."""

from __future__ import annotations

import numpy as np

from marssim.base.compute.compiled import compiled

NEAREST, FARTHEST = 0.1, 1000.0  # [m] range of depth that the code covers
SKY_CODE = 65535  # code of depth in the sky


def encode_depth(depth: np.ndarray) -> np.ndarray:
    """Encode depth in equal steps of its logarithm, with a relative error of 7e-5 at most.

    code = round(65534 ln(Z / 0.1 m) / ln(1000 m / 0.1 m)), clipped.

    Args:
        depth: (...) [m].

    Returns:
        (...) uint16; 65535 where depth is not finite, as in the sky.
    """
    return _depth_code(np.ascontiguousarray(depth).ravel()).reshape(depth.shape)


@compiled
def _depth_code(depth):
    out = np.full(len(depth), SKY_CODE, dtype=np.uint16)
    scale = (SKY_CODE - 1) / np.log(FARTHEST / NEAREST)
    for k in range(len(depth)):
        if np.isfinite(depth[k]):
            z = min(max(float(depth[k]), NEAREST), FARTHEST)
            out[k] = np.uint16(min(np.rint(scale * np.log(z / NEAREST)), SKY_CODE - 1.0))
    return out


def decode_depth(code: np.ndarray) -> np.ndarray:
    """Decode the depth that encode_depth encoded.

    Args:
        code: (...) uint16.

    Returns:
        (...) float32 [m]; inf in the sky.
    """
    table = NEAREST * (FARTHEST / NEAREST) ** (np.arange(SKY_CODE + 1) / (SKY_CODE - 1))
    table[SKY_CODE] = np.inf
    return table.astype(np.float32)[code]


def encode_normal(normal: np.ndarray) -> np.ndarray:
    """Encode unit normals as colours, (n + 1) / 2 scaled to 65535.

    Args:
        normal: (H, W, 3) unit vectors; 0 in the sky.

    Returns:
        (H, W, 3) uint16 RGB; black in the sky.
    """
    return _normal_code(np.ascontiguousarray(normal).reshape(-1, 3)).reshape(normal.shape)


@compiled
def _normal_code(normal):
    out = np.zeros(normal.shape, dtype=np.uint16)
    for k in range(len(normal)):
        if normal[k, 0] != 0 or normal[k, 1] != 0 or normal[k, 2] != 0:
            for c in range(3):
                out[k, c] = np.uint16(min(max(np.rint((float(normal[k, c]) + 1) * (65535 / 2)), 0.0), 65535.0))
    return out


def decode_normal(code: np.ndarray) -> np.ndarray:
    """Decode the normals that encode_normal encoded.

    Args:
        code: (H, W, 3) uint16 RGB.

    Returns:
        (H, W, 3) float32 unit normals; 0 in the sky.
    """
    normal = code.astype(np.float32) * np.float32(2 / 65535) - 1
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-6)
    return np.where((code == 0).all(axis=-1, keepdims=True), np.float32(0), normal)
