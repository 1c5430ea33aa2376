"""Measure how steep and how rough the ground of scenes is, and compare it with what was asked for.

    python -m marssim.slopes --scene gale --scenes 16 --seed 1
    python -m marssim.slopes --scene gale --hurst 0.6 --rms-slope-deg 8 --bare

The terrains are those of marssim.generate with the same seed. The RMS slope over a lag r is that of profiles,
sqrt(E[(h(x + r) - h(x))^2]) / r along x and y, over all scenes, as an angle. Up to 5 m it comes from the finely gridded
square, without the border that blends into its surroundings, and beyond from the coarse grid. The slope asked for is
that of self-affine relief, tan(slope) = tan(RMS slope over 1 m) r^(H - 1). Craters, ditches and ripples add to it,
unless --bare leaves them out. Relief from a heightmap has no slope that was asked for, so that column shows -. Lags
that are too long for a small place are left out. The Hurst exponent is 1 plus the slope of log tan(slope) over log r,
by least squares from 0.5 m to 4 m.

A scene is a small piece of relief, so that scenes differ much over the longest lags. "error" is the standard error of
the measured slope that follows from their scatter, 0 for a single scene.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
import tyro

from marssim.base.command.limits import check_least
from marssim.base.command.run import run_command
from marssim.base.command.wording import counted
from marssim.scene.place_file import PLACE_VALUES, load_place
from marssim.scene.presets import PRESETS
from marssim.scene.scene import SceneConfig
from marssim.scene.terrain import BLEND, HeightGrid, Terrain, build_terrain

LAGS = (0.5, 1.0, 2.0, 4.0, 10.0, 30.0, 100.0)  # distances over which slopes are measured [m]
FITTED = 4  # number of lags, from the first on, that give the Hurst exponent
FINE_UP_TO = 5.0  # longest lag on the fine grid [m]; the coarse one lacks a fortieth of the slope over 10 m
LANDFORMS = ("crater_density", "fresh_crater_density", "ditch_density", "ripple_amplitude")  # which --bare sets to 0
GENTLE = 8.0  # slope that 98 % of the planes at Zhurong's site do not reach [deg]


@dataclass(frozen=True)
class SlopesConfig:
    """Measure the slopes of terrains."""

    scene: Annotated[str, tyro.conf.arg(metavar=PLACE_VALUES)] = PRESETS[0]
    """Place that the terrains are drawn from: a preset, or a JSON file of your own place."""
    hurst: float | None = None
    """Hurst exponent of the relief, above 0 and below 1, instead of that of the place."""
    rms_slope_deg: float | None = None
    """RMS slope over 1 m [deg], at least 0 and below 45, instead of that of the place."""
    bare: bool = False
    """Leave out craters, ditches and ripples, which the slope asked for does not include."""
    scenes: int = 16
    """Number of terrains, 1 or more, that are measured together."""
    seed: int = 1
    """Seed of the terrains, 0 or more."""

    def __post_init__(self) -> None:
        check_least(self, scenes=1, seed=0)
        if self.scene_config().relief.heightmap is not None and self.rms_slope_deg is not None:
            raise ValueError(
                f"--rms-slope-deg is for drawn relief; {self.scene} has a heightmap, which has its own slopes"
            )

    def scene_config(self) -> SceneConfig:
        """Return the place that the terrains are drawn from. Raises ValueError that names the field."""
        config = load_place(self.scene)
        changes: dict[str, Any] = dict.fromkeys(LANDFORMS, 0.0) if self.bare else {}
        for name in ("hurst", "rms_slope_deg"):
            if getattr(self, name) is not None:
                changes[name] = getattr(self, name)
        return replace(config, relief=replace(config.relief, **changes))


@dataclass(frozen=True)
class Slopes:
    """Slopes of terrains.

    Attributes:
        asked: (L,) RMS slope over each of LAGS that was asked for [deg]; NaN for heightmaps.
        measured: (L,) RMS slope that was measured [deg]; NaN where the terrains are too small for the lag.
        error: (L,) standard error of the measured slope, by the scatter of the terrains [deg].
        hurst: Hurst exponent that was measured; NaN on level ground and on places too small for it.
        gentle: Share of the planes of 1 m x 1 m that are less than GENTLE steep; NaN on places too small for it.
    """

    asked: np.ndarray
    measured: np.ndarray
    error: np.ndarray
    hurst: float
    gentle: float


def rms_difference(grid: HeightGrid, lag: float, margin: float = 0.0) -> float:
    """Return the root mean square difference in height of points at a distance, along x and along y.

    A lag between two multiples of the cell is interpolated in the logarithms.

    Args:
        grid: The heights.
        lag: Distance of the points [m].
        margin: Width of the border that is left out [m].

    Returns:
        The difference [m].

    Raises:
        ValueError: The grid is too small for the lag.
    """
    rim = int(np.ceil(margin / grid.cell))
    h = grid.heights[rim : grid.heights.shape[0] - rim, rim : grid.heights.shape[1] - rim]
    steps = np.unique([int(np.floor(lag / grid.cell + 1e-6)), int(np.ceil(lag / grid.cell - 1e-6))])
    if steps[0] < 1 or steps[-1] >= min(h.shape):
        raise ValueError(f"a lag of {lag:g} m does not fit a grid of {grid.cell:g} m, {h.shape[1]} x {h.shape[0]} wide")
    differences = []
    for n in steps:
        east, north = h[:, n:] - h[:, :-n], h[n:] - h[:-n]
        differences.append(np.sqrt((np.mean(east**2) + np.mean(north**2)) / 2))
    if len(differences) == 1 or not min(differences) > 0:
        return float(differences[0])
    return float(np.exp(np.interp(np.log(lag), np.log(steps * grid.cell), np.log(differences))))


def gentle_share(grid: HeightGrid, margin: float = 0.0) -> float:
    """Return the share of planes of 1 m x 1 m that are less than GENTLE steep.

    Args:
        grid: The heights.
        margin: Width of the border that is left out [m].

    Returns:
        The share; NaN if the grid is too small for such a plane.
    """
    rim, n = int(np.ceil(margin / grid.cell)), round(1 / grid.cell)
    h = grid.heights[rim : grid.heights.shape[0] - rim, rim : grid.heights.shape[1] - rim]
    east, north = h[:, n:] - h[:, :-n], h[n:] - h[:-n]
    steep = np.hypot(east[n:] + east[:-n], north[:, n:] + north[:, :-n]) / (2 * n * grid.cell)
    return float(np.mean(np.rad2deg(np.arctan(steep)) < GENTLE)) if steep.size else np.nan


def measure(terrains: Iterable[Terrain], hurst: float, rms_slope_deg: float | None) -> Slopes:
    """Measure the slopes over terrains.

    Args:
        terrains: The terrains.
        hurst: Hurst exponent that they were asked for.
        rms_slope_deg: RMS slope over 1 m that they were asked for [deg]; None for heightmaps.
    """
    differences, gentle = [], []
    for terrain in terrains:
        differences.append([_difference_over(terrain, lag) for lag in LAGS])
        gentle.append(gentle_share(terrain.fine, BLEND))
    lags, squares = np.array(LAGS), np.square(differences)
    tangent = np.sqrt(squares.mean(axis=0)) / lags
    # the relative error of a root is half that of the mean under it; a single terrain has no scatter
    scatter = squares.std(axis=0, ddof=1) if len(squares) > 1 else np.zeros(len(lags))
    relative = scatter / np.sqrt(len(squares)) / np.maximum(2 * squares.mean(axis=0), 1e-30)
    due = np.tan(np.deg2rad(np.nan if rms_slope_deg is None else rms_slope_deg)) * lags ** (hurst - 1)
    first = slice(None, FITTED)
    level = not (tangent[first] > 0).all()
    return Slopes(
        asked=np.rad2deg(np.arctan(due)),
        measured=np.rad2deg(np.arctan(tangent)),
        error=np.rad2deg(relative * tangent / (1 + tangent**2)),
        hurst=np.nan if level else float(1 + np.polyfit(np.log(lags[first]), np.log(tangent[first]), 1)[0]),
        gentle=float(np.mean(gentle)),
    )


def _difference_over(terrain: Terrain, lag: float) -> float:
    """Return rms_difference of a terrain on the grid for the lag; NaN where it is too small."""
    grid, margin = (terrain.fine, BLEND) if lag <= FINE_UP_TO else (terrain.coarse, 0.0)
    try:
        return rms_difference(grid, lag, margin)
    except ValueError:
        return np.nan


def slopes(config: SlopesConfig) -> Slopes:
    """Build the terrains of a config, those that build_scene makes from the same seeds, and measure them."""
    scene = config.scene_config()
    terrains = (
        build_terrain(
            scene.relief, scene.size, scene.cell, scene.horizon, np.random.default_rng((config.seed, n)).spawn(1)[0]
        )
        for n in range(config.scenes)
    )
    drawn = scene.relief.heightmap is None
    return measure(terrains, scene.relief.hurst, scene.relief.rms_slope_deg if drawn else None)


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command(_work, SlopesConfig, "python -m marssim.slopes", __doc__, args, "nothing was written")


def _work(config: SlopesConfig) -> None:
    relief, result = config.scene_config().relief, slopes(config)
    bare = ", without craters, ditches and ripples" if config.bare else ""
    print(f"{counted(config.scenes, 'terrain')} of {config.scene}{bare}; slopes of profiles [deg]")
    print("over [m]  asked  measured  error")
    for lag, asked, measured, error in zip(LAGS, result.asked, result.measured, result.error):
        if not np.isnan(measured):
            print(f"{lag:8g} {_shown(asked, '.2f'):>6} {measured:9.2f} {error:6.2f}")
    fitted = f"{LAGS[0]:g} m to {LAGS[FITTED - 1]:g} m"
    due = f"asked {relief.hurst:.2f}, " if relief.heightmap is None else ""
    print(f"Hurst exponent, {fitted}: {due}measured {_shown(result.hurst, '.2f')}")
    print(f"planes of 1 m x 1 m under {GENTLE:g} deg: {_shown(result.gentle, '.1%')}")


def _shown(value: float, form: str) -> str:
    return "-" if np.isnan(value) else format(value, form)


if __name__ == "__main__":
    sys.exit(main())
