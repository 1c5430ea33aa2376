"""The documented names of a course of MarsNav-v0; the code is in envs.world.course."""

from envs.world.course import EDGE, Course

__all__ = ["EDGE", "Course"]
