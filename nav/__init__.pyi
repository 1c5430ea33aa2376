from .command import Command
from .config import NavigatorConfig
from .controller import WheelCommand, crab, point_turn, steerable, wheel_command
from .ground.elevation import ElevationConfig, ElevationMap
from .ground.read_map import read_map
from .ground.traversability import Traversability, TraversabilityConfig, assess
from .navigator import Navigator
from .path.distance_field import DistanceField
from .path.planner import Motion, Planner
from .path.planner_config import PlannerConfig

__version__: str

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
    "read_map",
    "steerable",
    "wheel_command",
]
