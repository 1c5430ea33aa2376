"""Depth in, wheel command out: map, traversability, planner and controller of a rover. numpy, scipy and OpenCV only."""

from nav.command import Command
from nav.config import NavigatorConfig
from nav.controller import WheelCommand, crab, point_turn, steerable, wheel_command
from nav.distance_field import DistanceField
from nav.elevation import ElevationConfig, ElevationMap
from nav.navigator import Navigator
from nav.planner import Motion, Planner, PlannerConfig
from nav.traversability import Traversability, TraversabilityConfig, assess

__all__ = [
    "Command",
    "DistanceField",
    "ElevationConfig",
    "ElevationMap",
    "Motion",
    "Navigator",
    "NavigatorConfig",
    "Planner",
    "PlannerConfig",
    "Traversability",
    "TraversabilityConfig",
    "WheelCommand",
    "assess",
    "crab",
    "point_turn",
    "steerable",
    "wheel_command",
]
