from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from marssim.physics.soil.soils import CRUST, SAND
from marssim.physics.soil.wheel import sinkage_under_load, wheel_forces
from marssim.physics.world import GRAVITY

RADIUS, WIDTH = 0.15, 0.20
# without shear stress, and with the peak of the normal stress at the lowest point, where Bekker's wheel has it
BEKKER = replace(SAND, cohesion_modulus=0.0, friction_angle=0.0, cohesion=0.0, peak=(0.0, 0.0), rebound=0.0)
FRICTION = SAND.density * GRAVITY * WIDTH * SAND.friction_modulus


@pytest.mark.parametrize("sinkage", [0.001, 0.004])
def test_a_shallow_wheel_sinks_as_bekkers_closed_form_says(sinkage):
    """W = b k sqrt(D z) z^n (3 - n) / 3 (Bekker 1956), for z far below D. It is exact there for n = 1."""
    n = 1.0
    soil = replace(BEKKER, exponent=n, slip_exponent=0.0)
    load = wheel_forces(soil, RADIUS, WIDTH, sinkage, 0.0).support
    modulus = FRICTION / WIDTH**n
    closed = WIDTH * modulus * np.sqrt(2 * RADIUS * sinkage) * sinkage**n * (3 - n) / 3
    assert float(load) == pytest.approx(closed, rel=0.02)


@pytest.mark.parametrize("sinkage", [0.002, 0.02, 0.05])
def test_the_load_is_the_integral_of_bekkers_pressure_over_the_wheel(sinkage):
    """W = b times the integral of k (z / b)^n dx, with the depth of the circle below the ground."""
    load = wheel_forces(BEKKER, RADIUS, WIDTH, sinkage, 0.0).support
    half = np.sqrt(RADIUS**2 - (RADIUS - sinkage) ** 2)
    x = half * np.sin(np.linspace(0, np.pi / 2, 20001))
    deep = sinkage - (RADIUS - np.sqrt(RADIUS**2 - x**2))
    pressure = FRICTION * (np.maximum(deep, 0) / WIDTH) ** BEKKER.exponent
    assert float(load) == pytest.approx(WIDTH * np.trapezoid(pressure, x), rel=1e-3)


@pytest.mark.parametrize("sinkage", [0.005, 0.03])
def test_the_resistance_is_the_work_of_making_the_rut(sinkage):
    """R = b times the integral of the pressure from 0 to z (Bekker): a plate pressed down as deep does that work."""
    pull = wheel_forces(BEKKER, RADIUS, WIDTH, sinkage, 0.0).pull
    n = BEKKER.exponent
    assert float(pull) == pytest.approx(-WIDTH * FRICTION * sinkage ** (n + 1) / WIDTH**n / (n + 1), rel=1e-3)


@pytest.mark.parametrize("soil", [SAND, CRUST])
def test_the_soil_carries_the_load_at_the_sinkage_that_is_found(soil):
    load, slip = np.meshgrid([20.0, 150.0, 400.0], [0.0, 0.1, 0.5, 1.0])
    sinkage = sinkage_under_load(soil, RADIUS, WIDTH, load, slip)
    np.testing.assert_allclose(wheel_forces(soil, RADIUS, WIDTH, sinkage, slip).support, load, rtol=1e-6)
    assert (np.diff(sinkage, axis=1) > 0).all()  # heavier wheels sink deeper
    assert (np.diff(sinkage, axis=0) > 0).all()  # and so do those that slip


def test_soil_that_is_only_cohesive_holds_a_spinning_wheel_by_its_cohesion():
    """With its full shear stress at once, T = r^2 b c (theta_f - theta_r)."""
    soil = replace(BEKKER, cohesion=800.0, shear_modulus=1e-6, rebound=0.05)
    sinkage = 0.02
    angle = np.arccos(1 - sinkage / RADIUS) + np.arccos(1 - 0.05 * sinkage / RADIUS)
    torque = wheel_forces(soil, RADIUS, WIDTH, sinkage, 1.0).torque
    assert float(torque) == pytest.approx(RADIUS**2 * WIDTH * 800.0 * angle, rel=0.01)


def test_forces_of_arrays_are_those_of_their_numbers():
    sinkage, slip = np.array([[0.01], [0.02]]), np.array([0.0, 0.3, 0.8])
    every = wheel_forces(SAND, RADIUS, WIDTH, sinkage, slip)
    assert every.pull.shape == (2, 3)
    np.testing.assert_allclose(every.pull[1, 2], wheel_forces(SAND, RADIUS, WIDTH, 0.02, 0.8).pull, rtol=1e-12)


def test_a_wheel_that_slides_sideways_is_held_by_cohesion_alone_with_all_of_it():
    """With its full shear stress at once, F = r b c (theta_f - theta_r), in the direction of the slide."""
    soil = replace(BEKKER, cohesion=800.0, shear_modulus=1e-6, rebound=0.05)
    sinkage = 0.02
    angle = np.arccos(1 - sinkage / RADIUS) + np.arccos(1 - 0.05 * sinkage / RADIUS)
    fast = wheel_forces(soil, RADIUS, WIDTH, sinkage, 0.0, 100.0)
    assert float(fast.side) == pytest.approx(RADIUS * WIDTH * 800.0 * angle, rel=0.01)
    assert abs(float(fast.torque)) < 0.01 * RADIUS * float(fast.side)
    assert not wheel_forces(soil, RADIUS, WIDTH, sinkage, 0.3).side.any()


@pytest.mark.parametrize("soil", [SAND, CRUST])
def test_a_slide_to_the_side_takes_thrust_from_a_wheel(soil):
    straight, sideways = (wheel_forces(soil, RADIUS, WIDTH, 0.02, 0.2, slide) for slide in (0.0, 0.5))
    assert sideways.pull < straight.pull and sideways.torque < straight.torque
    assert float(sideways.side) > 0


@pytest.mark.parametrize("slip", [0.0, 0.4])
@pytest.mark.parametrize("soil", [SAND, CRUST])
def test_the_forces_are_the_integrals_of_wong_and_reeces_stresses(soil, slip):
    """Their equations again, integrated by SciPy."""
    sinkage = 0.03
    enters, leaves = np.arccos(1 - sinkage / RADIUS), -np.arccos(1 - soil.rebound * sinkage / RADIUS)
    peak = (soil.peak[0] + soil.peak[1] * slip) * enters
    n = soil.exponent + soil.slip_exponent * slip
    k = soil.cohesion * soil.cohesion_modulus + soil.density * GRAVITY * WIDTH * soil.friction_modulus

    def stresses(angle: float) -> tuple[float, float]:
        front = angle if angle > peak else enters - (angle - leaves) / (peak - leaves) * (enters - peak)
        normal = k * (RADIUS / WIDTH * (np.cos(front) - np.cos(enters))) ** n
        moved = RADIUS * (enters - angle - (1 - slip) * (np.sin(enters) - np.sin(angle)))
        return normal, (soil.cohesion + normal * np.tan(soil.friction_angle)) * (
            1 - np.exp(-moved / soil.shear_modulus)
        )

    def integral(part) -> float:
        ends = (leaves, peak, enters)
        halves = [quad(lambda a: part(a, *stresses(a)), *pair)[0] for pair in pairwise(ends)]
        return RADIUS * WIDTH * sum(halves)

    forces = wheel_forces(soil, RADIUS, WIDTH, sinkage, slip)
    assert float(forces.support) == pytest.approx(integral(lambda a, n, t: n * np.cos(a) + t * np.sin(a)), rel=1e-4)
    assert float(forces.torque) == pytest.approx(integral(lambda a, n, t: RADIUS * t), rel=1e-4)
    pull = integral(lambda a, n, t: t * np.cos(a) - n * np.sin(a))
    assert float(forces.pull) == pytest.approx(pull, abs=1e-4 * float(forces.support))
