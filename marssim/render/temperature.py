"""A stereo rig that is warmer or colder than when it was calibrated.

Its mast and its cameras bend: the right camera turns against the left one, about its horizontal axis (the rows of the
images lie apart) and about its vertical axis (the eyes converge). The gains of the two detectors drift apart. All three
have one cause and grow with it in proportion. A drive takes minutes, in which the temperature hardly changes, so they
are constant over a drive.

How much a rig bends depends on how it is built. Here 50 K make 0.7 px of rows, 0.5 px of columns and 10 % of brightness
on NaTeCam at 512 x 512 pixels. This is an assumption, not a measurement of any rig.
"""

from __future__ import annotations

from dataclasses import replace

from marssim.base.camera import StereoRig
from marssim.render.sensor import SensorConfig
from marssim.scene.ranges import Range

MOST_KELVIN = 100.0  # largest difference from the temperature of calibration
PITCH_PER_KELVIN = 0.7 / 595.9 / 50  # [rad] by which the right camera turns upward, so that its image lies too low
YAW_PER_KELVIN = 0.5 / 595.9 / 50  # [rad] by which it turns to the left, so that its image lies too far right
GAIN_PER_KELVIN = 0.10 / 50  # share by which it becomes brighter than the left one


def at_temperature(config: SensorConfig, kelvin: float, rig: StereoRig) -> SensorConfig:
    """Return the detectors of a rig that has not its temperature of calibration.

    Args:
        config: The detectors at the temperature of calibration.
        kelvin: How much warmer the rig is [K]; negative values are colder. 0 returns `config`.
        rig: The two cameras. The turns are angles, so that they are fewer pixels in smaller images.

    Raises:
        ValueError: The temperature is more than 100 K off, or moves the right image by more pixels than can be
            simulated, as in images of several thousand pixels; or config.fault_chance would leave its turn out of some
            pairs.
    """
    if not abs(kelvin) <= MOST_KELVIN:
        raise ValueError(f"temperature must lie in [-{MOST_KELVIN:g}, {MOST_KELVIN:g}] K, got {kelvin}")
    if not kelvin:
        return config
    if config.fault_chance != (1.0, 1.0):
        raise ValueError(
            f"a temperature acts on every pair, so fault_chance must be 1 with it, got {config.fault_chance}"
        )
    rows, columns = kelvin * PITCH_PER_KELVIN * rig.camera.fy, kelvin * YAW_PER_KELVIN * rig.camera.fx
    try:
        return replace(
            config,
            vertical_offset=_moved(config.vertical_offset, rows),
            horizontal_offset=_moved(config.horizontal_offset, columns),
            gain_difference=_moved(config.gain_difference, kelvin * GAIN_PER_KELVIN),
        )
    except ValueError as error:
        raise ValueError(
            f"a temperature of {kelvin:g} K moves the right image by {rows:.2f} rows and {columns:.2f} columns: {error}"
        ) from None


def _moved(ends: Range, by: float) -> Range:
    return ends[0] + by, ends[1] + by
