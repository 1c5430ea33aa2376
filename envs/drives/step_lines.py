"""Progress inside a drive: a plain line now and then where stderr is no terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable
from time import monotonic

import numpy as np
from tqdm import tqdm

from envs.drivers.driver import Driver
from envs.mars_nav import MarsNavEnv

LINE_SECONDS = 30.0  # [s] between two lines; a drive that takes less prints none


class StepLines:
    """Prints the progress of a drive to stderr every LINE_SECONDS, unless stderr is a terminal.

    Give `watch` to envs.drives.episodes.run_episode.
    """

    def __init__(self, name: str, series: Callable[[], str] | None = None) -> None:
        """Start the clock.

        Args:
            name: The drive in words, as each line begins.
            series: Returns the state of the series of drives, as each line ends; None for a single drive.
        """
        self.name, self.series = name, series
        self._start = self._last = monotonic()

    def watch(self, env: MarsNavEnv, driver: Driver, step: int) -> None:
        """Print a line if it is time for one.

        Args:
            env: The environment.
            driver: The driver.
            step: Number of the step.
        """
        now = monotonic()
        if now - self._last < LINE_SECONDS or sys.stderr.isatty():
            return
        self._last = now
        assert env.course is not None and env.vehicle is not None
        left = float(np.hypot(*(env.course.goal - np.array(env.vehicle.state().position[:2]))))
        line = f"{self.name}: step {step} of at most {env.referee.time_limit}, {left:.1f} m to the goal"
        line += f", {tqdm.format_interval(now - self._start)}"
        print(f"{line}; {self.series()}" if self.series else line, file=sys.stderr, flush=True)
