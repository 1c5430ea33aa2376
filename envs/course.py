"""The documented names of a course of MarsNav-v0; the code is in envs.courses.course."""

from envs.courses.course import EDGE, Course

__all__ = ["EDGE", "Course"]
