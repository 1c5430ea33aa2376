from .courses.course import Course, CourseConfig
from .drivers.builtin import NavigatorDriver, RandomDriver, StraightDriver
from .drivers.by_name import make_driver
from .drivers.corridors import Corridors
from .drivers.driver import Driver, Stop
from .drivers.image_observation import ImageObservation
from .drives.episodes import Cell, EpisodeRecord, run_episode
from .drives.film import Film
from .drives.metrics import soft_spl, spl, wilson_interval
from .mars_nav import MarsNavEnv
from .world.action import ActionError
from .world.perception import Sight
from .world.user_code import UserCodeError

__version__: str

__all__ = [
    "ActionError",
    "Cell",
    "Corridors",
    "Course",
    "CourseConfig",
    "Driver",
    "EpisodeRecord",
    "Film",
    "ImageObservation",
    "MarsNavEnv",
    "NavigatorDriver",
    "RandomDriver",
    "Sight",
    "Stop",
    "StraightDriver",
    "UserCodeError",
    "make_driver",
    "run_episode",
    "soft_spl",
    "spl",
    "wilson_interval",
]
