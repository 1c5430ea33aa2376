"""Surface normals of planes fitted to a disparity map: the baseline of a learned normal."""

from __future__ import annotations

import cv2
import numpy as np

from marssim.base.camera import PinholeCamera

NORMAL_WINDOW = 15  # side of the window in which a plane is fitted [px]
SPREAD = 1e-3  # least ratio of the known pixels' spread across and along; pixels on a line determine no plane


def fitted_normals(disparity: np.ndarray, camera: PinholeCamera, window: int = NORMAL_WINDOW) -> np.ndarray:
    """Compute surface normals of a disparity map: planes fitted to the known pixels of a window.

    A plane in space is a plane in disparity too: n . P = h gives d = a u + b v + c, and n ~ (a fx, b fy, c) if u and v
    are counted from the principal point. So the least-squares slopes of the disparity suffice.

    Args:
        disparity: (H, W) float [px], unknown where it is 0, negative or not finite.
        camera: The camera of the map.
        window: Side of the window [px], odd.

    Returns:
        (H, W, 3) float32, unit length, facing the camera. The normal points straight at the camera where the disparity
        is unknown, where the known pixels of the window lie on one line, and where the plane would be seen from behind.
    """
    with np.errstate(invalid="ignore"):
        valid = np.isfinite(disparity) & (disparity > 0)
    value = np.where(valid, disparity, 0).astype(np.float64)
    weight = valid.astype(np.float32)  # sums of it are whole numbers, exact in 32 bit
    offset = np.arange(window, dtype=np.float64) - window // 2
    powers = np.ones(window), offset, offset**2

    def moment(image: np.ndarray, i: int, j: int) -> np.ndarray:
        """Sum image * x^i * y^j over the window, x and y from its middle; pixels outside the image count as 0."""
        return cv2.sepFilter2D(image, -1, powers[i], powers[j], borderType=cv2.BORDER_CONSTANT)

    d, xd, yd = moment(value, 0, 0), moment(value, 1, 0), moment(value, 0, 1)
    square = window * powers[2].sum()  # second moment of a window without gaps, whose mixed moments vanish
    # Slopes along u and v, and the value in the window's middle, which is f B / h times -n . ray.
    a, b, middle = xd / square, yd / square, d / window**2
    gaps = valid & (moment(weight, 0, 0) < window**2)
    if gaps.any():
        weights = [
            moment(weight, *power)[gaps].astype(np.float64)
            for power in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
        ]
        a[gaps], b[gaps], middle[gaps] = _plane(weights, [values[gaps] for values in (d, xd, yd)])
    rays = camera.rays()
    u, v = rays[:1, :, 0] * camera.fx, rays[:, :1, 1] * camera.fy  # from the principal point
    normal = np.empty((*disparity.shape, 3))
    normal[..., 0] = -camera.fx * a
    normal[..., 1] = -camera.fy * b
    normal[..., 2] = a * u + b * v - middle
    away = ~(valid & (middle > 0))
    normal[away] = -rays[away]
    length = np.sqrt(normal[..., 0] ** 2 + normal[..., 1] ** 2 + normal[..., 2] ** 2)
    return (normal / length[..., None]).astype(np.float32)


def _plane(weights: list[np.ndarray], values: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fit planes d(x, y) by least squares, from sums over the known pixels of N windows.

    Args:
        weights: Sums of 1, x, y, x^2, xy, y^2, each (N,).
        values: Sums of d, x d, y d, each (N,).

    Returns:
        Slopes along x and y and the value at 0, each (N,); NaN where all known pixels lie on one line.
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
