from .builtin import NavigatorDriver, RandomDriver, StraightDriver
from .by_name import DRIVERS, make_driver
from .corridors import Corridors
from .driver import Driver, Stop
from .image_observation import ImageObservation
from .policy_files import PolicyDriver

__all__ = [
    "DRIVERS",
    "Corridors",
    "Driver",
    "ImageObservation",
    "NavigatorDriver",
    "PolicyDriver",
    "RandomDriver",
    "Stop",
    "StraightDriver",
    "make_driver",
]
