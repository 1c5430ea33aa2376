"""Depth and normals as 16-bit images."""

from __future__ import annotations

import numpy as np

from marssim.base.compute.compiled import compiled

NEAREST, FARTHEST = 0.1, 1000.0  # [m] range of the depth code
SKY_CODE = 65535


def encode_depth(depth: np.ndarray) -> np.ndarray:
    """uint16 code of depth [m], equal steps of its logarithm: 7e-5 relative error at most.

    code = round(65534 ln(Z / 0.1 m) / ln(1000 m / 0.1 m)), clipped; 65535 where depth is not finite (sky).
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
    """float32 depth [m] of encode_depth's code; inf in the sky."""
    table = NEAREST * (FARTHEST / NEAREST) ** (np.arange(SKY_CODE + 1) / (SKY_CODE - 1))
    table[SKY_CODE] = np.inf
    return table.astype(np.float32)[code]


def encode_normal(normal: np.ndarray) -> np.ndarray:
    """uint16 RGB of unit normals (H, W, 3); black where the normal is zero (sky)."""
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
    """(H, W, 3) float32 unit normals of encode_normal's code; 0 in the sky."""
    normal = code.astype(np.float32) * np.float32(2 / 65535) - 1
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-6)
    return np.where((code == 0).all(axis=-1, keepdims=True), np.float32(0), normal)
