"""Surface normals by planes that are fitted to a disparity map: the baseline that a learned normal has to beat."""

from __future__ import annotations

import cv2
import numpy as np

from marssim.base.camera import PinholeCamera

NORMAL_WINDOW = 15  # [px] side of the window that a normal is fitted in
SPREAD = 1e-3  # least ratio of the known pixels' spread across and along: what lies on one line fixes no plane


def fitted_normals(disparity: np.ndarray, camera: PinholeCamera, window: int = NORMAL_WINDOW) -> np.ndarray:
    """Surface normals of a disparity map: the plane that fits the known pixels of a window best.

    A plane in space is a plane in disparity too: n . P = h gives d = a u + b v + c, and n ~ (a fx, b fy, c) if u and v
    are counted from the principal point. So the least-squares slopes of the disparity are all that is needed.
    disparity: (H, W) float [px], unknown where it is 0, negative or not finite. window: odd [px].
    Returns (H, W, 3) float32, unit length, facing the camera. Straight towards the camera where the disparity is
    unknown, where the known pixels of the window lie on one line, and in place of a plane that would be seen from
    behind.
    """
    with np.errstate(invalid="ignore"):
        known = np.isfinite(disparity) & (disparity > 0)
    value = np.where(known, disparity, 0).astype(np.float64)
    weight = known.astype(np.float32)  # its moments are whole numbers, exact in 32 bit
    offset = np.arange(window, dtype=np.float64) - window // 2
    powers = np.ones(window), offset, offset**2

    def moment(image: np.ndarray, x: int, y: int) -> np.ndarray:
        """Sum over the window of the image times x and y to these powers, from its middle; nothing lies outside."""
        return cv2.sepFilter2D(image, -1, powers[x], powers[y], borderType=cv2.BORDER_CONSTANT)

    d, xd, yd = moment(value, 0, 0), moment(value, 1, 0), moment(value, 0, 1)
    square = window * powers[2].sum()  # of a window without gaps, whose other moments vanish
    a, b, here = xd / square, yd / square, d / window**2  # here: in the window's middle, f B / h times -n . ray
    gaps = known & (moment(weight, 0, 0) < window**2)
    if gaps.any():
        weights = [
            moment(weight, *power)[gaps].astype(np.float64)
            for power in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
        ]
        a[gaps], b[gaps], here[gaps] = _plane(weights, [values[gaps] for values in (d, xd, yd)])
    rays = camera.rays()
    u, v = rays[:1, :, 0] * camera.fx, rays[:, :1, 1] * camera.fy  # from the principal point
    normal = np.empty((*disparity.shape, 3))
    normal[..., 0] = -camera.fx * a
    normal[..., 1] = -camera.fy * b
    normal[..., 2] = a * u + b * v - here
    away = ~(known & (here > 0))
    normal[away] = -rays[away]
    length = np.sqrt(normal[..., 0] ** 2 + normal[..., 1] ** 2 + normal[..., 2] ** 2)
    return (normal / length[..., None]).astype(np.float32)


def _plane(weights: list[np.ndarray], values: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Least-squares slopes along x and y and value at 0 of d(x, y), from the sums over the known pixels of windows.

    weights: sums of 1, x, y, x^2, xy, y^2; values: of d, x d, y d; each (N,). The value is NaN where all known pixels
    lie on one line.
    """
    count, x, y, xx, xy, yy = weights
    x, y, d = x / count, y / count, values[0] / count
    xx, xy, yy = xx / count - x * x, xy / count - x * y, yy / count - y * y
    xd, yd = values[1] / count - x * d, values[2] / count - y * d
    determinant = xx * yy - xy * xy
    on_a_line = determinant <= SPREAD * (xx + yy) ** 2
    determinant[on_a_line] = np.nan
    a, b = (yy * xd - xy * yd) / determinant, (xx * yd - xy * xd) / determinant
    return a, b, d - a * x - b * y
