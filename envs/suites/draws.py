"""What a reset of MarsNav-v0 draws: numbers from ranges, the soil and the condition from choices."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from envs.courses.course import LIMITS, CourseConfig, check_rocks
from envs.suites.condition_ranges import ConditionRanges, range_ends
from envs.suites.conditions import Values, under
from envs.world.eyes import EyesConfig
from envs.world.slip import SlipConfig, checked_slip
from marssim.base.files.json_file import json_text
from marssim.physics.soil.soil_map import GroundName
from marssim.scene.scene import SceneConfig

STREAM = 0xD4A35  # tells the random stream of the draws from others of the same seed
Number = float | tuple[float, float] | None  # a fixed number, or the ends of a range
Slip = SlipConfig | GroundName | None
Condition = str | Values


@dataclass(frozen=True)
class EpisodeSettings:
    """The settings of an episode."""

    scene: SceneConfig
    """The place."""
    course: CourseConfig
    """The properties of the course."""
    eyes: EyesConfig
    """The cameras."""
    slip: SlipConfig | None
    """How the wheels slip; None for wheels that do not."""
    condition: Condition
    """The condition; scene, course and eyes are already those under it."""
    drawn: tuple[str, ...] = ()
    """Names of what was drawn."""

    def with_options(self, options: Any) -> EpisodeSettings:
        """Return the settings of an episode with options of its own.

        Args:
            options: As MarsNavEnv.reset takes them.

        Raises:
            ValueError: An option is unknown or out of its range; the message names it.
        """
        return replace(self, course=self.course.with_options(options))

    def info(self) -> dict[str, Any]:
        """Return {"drawn": the values of what was drawn, by name}; an empty dict where nothing was drawn.

        They are the values that the episode has: those of a condition or of options, where these replaced what was
        drawn. None stands for what the scene has of itself. Numbers are floats, and a condition without a name is the
        JSON text of its values: a vector environment of gymnasium converts the values of all environments to the type
        of the first.
        """
        if not self.drawn:
            return {}
        low, high = self.scene.look.sun_elevation_deg
        condition = self.condition
        if not isinstance(condition, str):
            condition = json_text(condition, sort_keys=True, default=str)
        values = {
            **{name: getattr(self.course, name) for name in LIMITS},
            "slip": None if self.slip is None else self.slip.ground,
            "slip_measured": None if self.slip is None else self.slip.measured,
            "condition": condition,
        }
        if values["sun_elevation_deg"] is None and low == high:  # as a condition fixes it
            values["sun_elevation_deg"] = low
        return {"drawn": {name: _typed(values[name]) for name in self.drawn}}


class EpisodeDraws:
    """Draws the settings of episodes."""

    def __init__(
        self,
        scene: SceneConfig,
        eyes: EyesConfig,
        numbers: Mapping[str, Number],
        slip: Slip | tuple[Slip, ...] = None,
        condition: Condition | tuple[Condition, ...] | None = None,
    ) -> None:
        """Check all that may be drawn. In place of a tuple, a list will do.

        Args:
            scene: The place, unless a condition names another.
            eyes: The cameras without a condition.
            numbers: Properties of a course, by their names in LIMITS: each a number, or the two ends of the range from
                which it is drawn evenly.
            slip: How the wheels slip, or several such settings, one of which is drawn.
            condition: The condition, None for none, or several conditions, one of which is drawn. Values of a condition
                may be the two ends of a range, from which they are drawn.

        Raises:
            ValueError: A value is unknown or out of its range, or does not go with one of the conditions. One line that
                names it.
        """
        if not isinstance(eyes, EyesConfig):
            raise ValueError(f"eyes must be an EyesConfig of envs.world.eyes, got {eyes!r:.60}")
        ranges = {name: range_ends(name, value) for name, value in numbers.items() if isinstance(value, tuple | list)}
        self._ranges: dict[str, Any] = ranges
        self._fixed: dict[str, Any] = {name: value for name, value in numbers.items() if name not in ranges}
        self._slips = [checked_slip(each) for each in _choices("slip", slip)]
        self._conditions = [ConditionRanges({} if condition is None else c) for c in _choices("condition", condition)]
        drawn = {
            "slip": isinstance(slip, tuple | list),
            "slip_measured": len({each.measured for each in self._slips if each is not None}) > 1,
            "condition": isinstance(condition, tuple | list) or not all(each.fixed for each in self._conditions),
        }
        self._drawn = (*self._ranges, *(name for name, is_drawn in drawn.items() if is_drawn))
        ends: list[dict[str, Any]] = [{name: each[end] for name, each in ranges.items()} for end in (0, 1)]
        least, most = (CourseConfig(**self._fixed, **end) for end in ends)
        for name, (low, high) in ranges.items():
            if low > high:
                raise ValueError(f"{name} must have the lower end of its range first, got {numbers[name]!r}")
        for each in self._conditions:
            under_most = [under(at_end, scene, course, eyes) for at_end in each.ends for course in (least, most)]
            each.check_order()
            for place, course, _ in under_most:
                check_rocks(place, course)
        self._scene, self._eyes = scene, eyes

    @property
    def may_slip(self) -> bool:
        """Whether the wheels slip in some of the episodes."""
        return any(each is not None for each in self._slips)

    def draw(self, rng: np.random.Generator) -> EpisodeSettings:
        """Return the settings of the next episode. Where nothing is to be drawn, rng is not used."""
        numbers: dict[str, Any] = {name: float(rng.uniform(*ends)) for name, ends in self._ranges.items()}
        slip = self._slips[_number(rng, len(self._slips))]
        condition = self._conditions[_number(rng, len(self._conditions))].draw(rng)
        course = CourseConfig(**self._fixed, **numbers)
        scene, course, eyes = under(condition, self._scene, course, self._eyes)
        return EpisodeSettings(scene, course, eyes, slip, condition, self._drawn)


def stream_of_draws(seed: int) -> np.random.Generator:
    """Return the random stream of the draws of an environment.

    It is apart from the environment's np_random, so that a seed gives the same course whether something is drawn, is an
    option of reset, or neither.

    Args:
        seed: The environment's np_random_seed; below 0 where np_random was set without one.
    """
    return np.random.default_rng((max(seed, 0), STREAM))


def _typed(value: Any) -> Any:
    """Return a whole number as a float, and anything else as it is."""
    return float(value) if isinstance(value, int) else value


def _choices(name: str, value: Any) -> list[Any]:
    """Return what a setting is drawn from."""
    if not isinstance(value, tuple | list):
        return [value]
    if not value:
        raise ValueError(f"{name} must have one choice or more, got {value!r}")
    return list(value)


def _number(rng: np.random.Generator, count: int) -> int:
    """Return the number of a choice, drawn if there are several."""
    return int(rng.integers(count)) if count > 1 else 0
