"""Depth in, wheel command out: map, traversability, planner and controller of a rover. numpy, scipy and OpenCV only."""

from nav.command import Command
from nav.config import NavigatorConfig
from nav.controller import WheelCommand, crab, point_turn, steerable, wheel_command
from nav.ground.elevation import ElevationConfig, ElevationMap
from nav.ground.traversability import Traversability, TraversabilityConfig, assess
from nav.navigator import Navigator
from nav.path.distance_field import DistanceField
from nav.path.planner import Motion, Planner, PlannerConfig

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
