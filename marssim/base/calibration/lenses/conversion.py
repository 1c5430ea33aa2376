"""Lenses of OpenCV that are CAHVORE models too.

CAHVORE with O = A, E = 0 and R0 = 0 takes x = chi (1 + R1 chi^2 + R2 chi^4). For L = 1, chi is the tangent of the angle
to the axis, and this is OpenCV's radial distortion with k1 = R1 and k2 = R2. For L = 0, chi is the angle, and this is
the fisheye with k1 = R1 and k2 = R2.
"""

from __future__ import annotations

from marssim.base.calibration.lenses.cahvore import Cahvore
from marssim.base.calibration.lenses.fisheye import Fisheye
from marssim.base.calibration.lenses.lens import Lens
from marssim.base.calibration.lenses.radial_tangential import RadialTangential


def cahvore_of(lens: Lens) -> Cahvore:
    """Return the CAHVORE model that is the same lens.

    Raises:
        ValueError: The lens has tangential or higher terms, or skew, which CAHVORE lacks.
    """
    if isinstance(lens, Cahvore):
        return lens
    if not isinstance(lens, RadialTangential | Fisheye):
        raise ValueError(f"a lens of kind {type(lens).__name__} is no CAHVORE model")
    k1, k2 = (*lens.coefficients, 0.0, 0.0)[:2]
    if any(lens.coefficients[2:]) or (isinstance(lens, Fisheye) and lens.skew):
        raise ValueError("CAHVORE models have two terms of radial distortion, and no tangential one")
    axis = (0.0, 0.0, 1.0)
    linearity = 0.0 if isinstance(lens, Fisheye) else 1.0
    return Cahvore(
        axis, (lens.fx, 0.0, lens.cx), (0.0, lens.fy, lens.cy), axis, (0.0, k1, k2), (0.0, 0.0, 0.0), linearity
    )
