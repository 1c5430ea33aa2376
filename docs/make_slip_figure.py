"""Makes the figure of docs/results/slip.md, slip over slope and what a wheel pulls: images/slip.png.

Run it in the folder of the repository:

    python docs/make_slip_figure.py
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from marssim.base.rover_spec import ZHURONG
from marssim.physics.soil.soils import SOIL_NAMES
from marssim.physics.soil.tables import wheel_table
from marssim.physics.soil.traction import Traction
from marssim.physics.support import SupportMap
from marssim.physics.world import GRAVITY
from marssim.scene.presets import preset
from marssim.scene.scene import build_scene

FIGURE = Path(__file__).parent / "images" / "slip.png"
COLOURS = dict(zip(SOIL_NAMES, ("#c08a3e", "#7a5c45", "#5b6770")))
LINES = dict(zip(SOIL_NAMES, ("-", "--", "-.")))
# the order of the slip of the Mars Exploration Rovers in loose sand, from memory: see docs/results/slip.md
ROVERS = ((5, 10, 15, 20), (5, 20, 50, 90))
SPEED = 0.2  # [m/s]


def main() -> None:
    slopes = np.deg2rad(np.arange(0, 30.1, 0.25))
    scene = build_scene(preset("utopia", size=8.0, horizon=10.0), 0)
    support = SupportMap.from_scene(scene, ZHURONG.obstacle_height)
    figure, (up, across, pull) = plt.subplots(1, 3, figsize=(11, 3.4), layout="constrained")
    for soil in SOIL_NAMES:
        weight = ZHURONG.mass * GRAVITY / 6
        table = wheel_table(soil, ZHURONG.wheel_radius, ZHURONG.wheel_width, 6 * weight)
        style = {"color": COLOURS[soil], "ls": LINES[soil], "label": soil}
        up.plot(np.rad2deg(slopes), 100 * table.slip_on_slope(weight, slopes), **style)
        traction = Traction(scene, ZHURONG, support, soil)
        across.plot(np.rad2deg(slopes), [sideslip_deg(traction, slope) for slope in slopes], **style)
        pull.plot(100 * table.slips, table.at(np.array([weight]))[0][0] / weight, **style)
    up.plot(*ROVERS, "o", mfc="none", color="#333333", label="rovers in sand, roughly")
    up.set(xlabel="slope, straight up [deg]", ylabel="slip [%]", ylim=(0, 103), xlim=(0, 30))
    across.set(xlabel="slope, straight across [deg]", ylabel="sideslip angle [deg]", ylim=(0, 45), xlim=(0, 30))
    pull.set(xlabel="slip [%]", ylabel="drawbar pull / load", xlim=(0, 100))
    pull.axhline(0, color="#999999", lw=0.8)
    for axes in (up, across, pull):
        axes.grid(alpha=0.3)
    up.legend(frameon=False, fontsize=8)
    figure.savefig(FIGURE, dpi=110)


def sideslip_deg(traction: Traction, slope: float) -> float:
    """Return the sideslip angle [deg] of a rover that drives across a slope [rad]: of its course below its heading."""
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, np.cos(slope), -np.sin(slope)], [0, np.sin(slope), np.cos(slope)]]
    wheels = ZHURONG.wheel_positions[:, :2]
    motion = traction.balance(
        traction.grip(pose, traction.soils_under(wheels, wheels)), traction.rims(SPEED, 0.0)
    ).motion
    return float(np.rad2deg(np.arctan2(abs(motion[1]), motion[0])))


if __name__ == "__main__":
    if len(sys.argv) > 1:
        raise SystemExit(__doc__)
    main()
