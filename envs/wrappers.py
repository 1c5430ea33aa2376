"""Wrappers of MarsNav-v0 by their documented names; `envs.drivers.image_observation` holds the code."""

from envs.drivers.image_observation import ImageObservation

__all__ = ["ImageObservation"]
