"""The documented names of wrappers of MarsNav-v0; the code is in envs.drivers.image_observation."""

from envs.drivers.image_observation import ImageObservation

__all__ = ["ImageObservation"]
