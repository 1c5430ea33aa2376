"""The soils that wheels drive on, as the numbers of Bekker, Reece, Janosi and Hanamoto describe them.

Normal stress under a plate (Reece 1965): p = (c k_c + rho g b k_phi) (z / b)^n, with the width b of the plate and the
sinkage z. Shear stress (Janosi and Hanamoto 1961): tau = (c + p tan phi) (1 - exp(-j / K)), with the displacement j.

Where the numbers are from:

- The moduli, exponent, density and angles of SAND and CRUST begin with those that a public simulator of rovers on Mars
  quotes as "Mars sand" and "Mars regolith" (github.com/mmbaxter484/Mars-Terrain-Simulator, terramechanics_model.m; it
  does not name their source). They lie in the ranges that rovers' trenches and scuffs gave: friction angles of 30 to 37
  deg and cohesions of up to a few kPa (Sullivan et al. 2011, from memory).
- Chosen here: SAND has the friction angle and the shear modulus of the regolith, as grousers, which the model leaves
  out, help wheels in loose sand, and a slip sinkage below that of either; so it ends at 21 deg, as rovers do in loose
  sand, roughly. CRUST has a cohesion of 3 kPa and four times the regolith's stiffness, for cemented soil and gravel,
  and less of what lets wheels slip: no slip sinkage (the regolith's exponent grows by 0.354), K of 10 instead of 14.6
  mm, and c2 of 0.2 instead of 0.503.
- BEDROCK does not yield. Its friction coefficient is that of this rover's wheels in PyBullet, and its creep is chosen.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

SoilName = Literal["sand", "crust", "bedrock"]
SOIL_NAMES: tuple[SoilName, ...] = get_args(SoilName)


@dataclass(frozen=True)
class Soil:
    """Ground that yields under a wheel."""

    cohesion_modulus: float
    """k_c of Reece's pressure; no unit."""
    friction_modulus: float
    """k_phi of Reece's pressure; no unit."""
    exponent: float
    """n of the pressure for a wheel that does not slip."""
    slip_exponent: float
    """By how much n grows until the slip is 1: a wheel that slips digs itself in (Ding et al. 2010)."""
    cohesion: float
    """c [Pa]."""
    friction_angle: float
    """phi [rad]."""
    density: float
    """rho [kg/m3]."""
    shear_modulus: float
    """K, the displacement over which shear stress builds up [m]."""
    peak: tuple[float, float]
    """c1 and c2: the largest normal stress is at (c1 + c2 slip) of the angle where the wheel enters the soil (Wong and
    Reece 1967)."""
    rebound: float
    """Share of the sinkage by which the soil rises again behind the wheel."""


@dataclass(frozen=True)
class Rock:
    """Ground that does not yield."""

    friction: float
    """Friction coefficient."""
    creep: float
    """Slip over which friction builds up."""


SAND = Soil(
    cohesion_modulus=9.1, friction_modulus=500.8, exponent=1.4, slip_exponent=0.2, cohesion=200.0,
    friction_angle=float(np.deg2rad(35)), density=1650.0, shear_modulus=0.0146, peak=(0.33, 0.11), rebound=0.05,
)  # fmt: skip
CRUST = Soil(
    cohesion_modulus=212.2, friction_modulus=2500.0, exponent=1.4, slip_exponent=0.0, cohesion=3000.0,
    friction_angle=float(np.deg2rad(35)), density=1550.0, shear_modulus=0.01, peak=(0.365, 0.2), rebound=0.07,
)  # fmt: skip
BEDROCK = Rock(friction=0.9, creep=0.04)
SOILS: dict[SoilName, Soil | Rock] = {"sand": SAND, "crust": CRUST, "bedrock": BEDROCK}
