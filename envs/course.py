"""Courses of MarsNav-v0 by their documented names; `envs.world.course` holds the code."""

from envs.world.course import EDGE, Course

__all__ = ["EDGE", "Course"]
