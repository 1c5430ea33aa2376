"""The stresses under a rigid wheel on yielding soil, and the forces that they add up to.

Wong and Reece (1967, "Prediction of rigid wheel performance based on the analysis of soil-wheel stresses", part I): the
normal stress rises from the angle theta_f where the wheel enters the soil to a peak at theta_m, and falls to the angle
theta_r where it leaves. Angles count from the lowest point of the wheel, positive forwards. The shear stress is that of
Janosi and Hanamoto, with the displacement j = r (theta_f - theta - (1 - s) (sin theta_f - sin theta)) at a slip s. A
wheel that slides sideways displaces the soil across by r (theta_f - theta) v / u too, with v the sideways speed and u
that of the rim (Ishigami et al. 2007, "Terramechanics-based model for steering maneuver of planetary exploration rovers
on loose soil"), and the shear stress lies along both together. Grousers and the soil that the sides of the wheel push
are left out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from marssim.physics.soil.soils import Soil
from marssim.physics.world import GRAVITY

NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)  # of the integral over each side of the peak
DEEPEST = 0.9  # largest sinkage over the wheel's radius
LATEST_PEAK = 0.95  # largest theta_m over theta_f
HALVINGS = 32  # of the interval of the sinkage


class WheelForces(NamedTuple):
    """What the soil does to a wheel; arrays of one shape."""

    support: np.ndarray
    """Force upwards [N]."""
    pull: np.ndarray
    """Drawbar pull: force forwards, thrust less resistance [N]."""
    side: np.ndarray
    """Force against the sideways slide [N]."""
    torque: np.ndarray
    """Torque that the motor needs [N m]."""


def wheel_forces(
    soil: Soil, radius: float, width: float, sinkage: np.ndarray, slip: np.ndarray | float, sideslip: float = 0.0
) -> WheelForces:
    """Integrate the stresses under a wheel.

    Args:
        soil: The soil.
        radius: Radius of the wheel [m].
        width: Width of the wheel [m].
        sinkage: (...) depth of the lowest point of the wheel [m], above 0 and below the radius.
        slip: (...) share of its way that the wheel loses, 0 to 1.
        sideslip: Speed at which it slides sideways, over that of its rim, 0 or more.
    """
    sinkage, slip = np.broadcast_arrays(np.asarray(sinkage, float)[..., None], np.asarray(slip, float)[..., None])
    enters = np.arccos(1 - sinkage / radius)
    leaves = -np.arccos(1 - soil.rebound * sinkage / radius)
    peak = np.minimum(soil.peak[0] + soil.peak[1] * slip, LATEST_PEAK) * enters
    exponent = soil.exponent + soil.slip_exponent * slip
    modulus = soil.cohesion * soil.cohesion_modulus + soil.density * GRAVITY * width * soil.friction_modulus
    stiffness = modulus * (radius / width) ** exponent
    sums = np.zeros((4, *sinkage.shape[:-1]))
    for low, high in ((leaves, peak), (peak, enters)):
        angle = (low + high) / 2 + (high - low) / 2 * NODES
        behind = (angle - leaves) / np.maximum(peak - leaves, 1e-12)
        mirrored = enters - behind * (enters - peak)  # where the front has this stress
        deep = np.cos(angle if high is enters else mirrored) - np.cos(enters)
        normal = stiffness * np.maximum(deep, 0) ** exponent
        moved = np.maximum(radius * (enters - angle - (1 - slip) * (np.sin(enters) - np.sin(angle))), 0)
        across = radius * (enters - angle) * sideslip
        displaced = np.hypot(moved, across)
        built = 1 - np.exp(-displaced / soil.shear_modulus)
        stress = (soil.cohesion + normal * np.tan(soil.friction_angle)) * built / np.maximum(displaced, 1e-12)
        shear = stress * moved
        weights = (high - low) / 2 * WEIGHTS * radius * width
        up, forward = normal * np.cos(angle) + shear * np.sin(angle), shear * np.cos(angle) - normal * np.sin(angle)
        sums += np.stack([(weights * part).sum(axis=-1) for part in (up, forward, stress * across, radius * shear)])
    return WheelForces(*sums)


def sinkage_under_load(
    soil: Soil, radius: float, width: float, load: np.ndarray, slip: np.ndarray | float, sideslip: float = 0.0
) -> np.ndarray:
    """Return the sinkage at which the soil carries a load [m], at most DEEPEST of the radius.

    Args:
        soil: The soil.
        radius: Radius of the wheel [m].
        width: Width of the wheel [m].
        load: (...) load on the wheel [N], above 0.
        slip: (...) share of its way that the wheel loses, 0 to 1.
        sideslip: Speed at which it slides sideways, over that of its rim, 0 or more.
    """
    load, slip = np.broadcast_arrays(np.asarray(load, float), np.asarray(slip, float))
    low, high = np.full(load.shape, 1e-7 * radius), np.full(load.shape, DEEPEST * radius)
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        carried = wheel_forces(soil, radius, width, middle, slip, sideslip).support >= load
        low, high = np.where(carried, low, middle), np.where(carried, middle, high)
    return (low + high) / 2
