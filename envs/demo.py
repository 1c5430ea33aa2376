"""Show the whole chain in some two minutes: generate, score, drive.

    python -m envs.demo --out out/demo

Renders a small dataset, scores the shipped weights and SGBM on it, drives one MarsNav-v0 episode with M3Depth as the
rover's eyes, and writes a summary page with a contact sheet, a comparison figure and a video. The time is for two free
cores, once everything is installed.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Annotated

import tyro

from envs.courses.clearance import FAR
from envs.courses.course import CourseConfig, check_rocks
from envs.drivers.builtin import NavigatorDriver
from envs.drivers.driver import Driver
from envs.drives.episodes import Cell, EpisodeRecord, run_episode
from envs.drives.film import Film
from envs.drives.step_lines import StepLines
from envs.mars_nav import MarsNavEnv
from envs.world.referee import GOAL_RADIUS
from envs.world.vehicle import checked_dynamics
from m3depth.estimator import Estimator, load_estimator
from m3depth.evaluate import evaluate
from m3depth.evaluation.report import text_table
from marssim.base.command.limits import check_least
from marssim.base.command.notes import print_note
from marssim.base.command.run import run_command
from marssim.base.command.wording import counted
from marssim.base.dataset.dataset import StereoDataset
from marssim.base.files.atomic import write_atomically
from marssim.base.files.png import encode_png
from marssim.base.results.claim import PARTIAL, ResultFolder
from marssim.base.rover_spec import ZHURONG
from marssim.engines.bullet import pybullet_is_installed
from marssim.generate import GenerateConfig, generate_dataset
from marssim.render.renderers.by_name import default_renderer
from marssim.scene.place_file import PLACE_VALUES, load_place
from marssim.scene.presets import PRESETS

MARK = "MADE_BY_DEMO.txt"
ABOUT_MARK = "python -m envs.demo replaces the files beside this one when it starts, and deletes data/.\n"
WITHOUT_PYBULLET = "PyBullet is not installed here, so the renderer scan makes the images, and the drive is kinematic"
SEED = 20_000  # seed of the data; none of the shipped weights' training data has it


@dataclass(frozen=True)
class DemoConfig:
    """Generate, score and drive, once."""

    out: Path = Path("out/demo")
    """Folder to write: a new or an empty one, or that of an earlier demo, which is replaced."""
    pairs: int = 16
    """Number of stereo pairs to generate and score, 1 or more."""
    scene: Annotated[str, tyro.conf.arg(metavar=PLACE_VALUES)] = PRESETS[0]
    """Place of the pairs and of the drive: a preset, or the JSON file of a place (marssim.scene.place_file)."""
    goal_distance: float = 14.0
    """Distance from start to goal of the drive [m], 3 to 100."""
    workers: int = 2
    """Number of processes that generate, 1 or more."""

    def __post_init__(self) -> None:
        check_least(self, pairs=1, workers=1)
        course = CourseConfig(self.goal_distance)  # raises ValueError for a value out of range
        place = load_place(self.scene)  # raises ValueError for an unknown place
        try:
            check_rocks(place, course)
        except ValueError as error:  # it names k, which is the place's
            raise ValueError(
                f"--goal-distance {self.goal_distance:g}: the scene of such a drive may have too many rocks in "
                f"--scene {self.scene}; choose a smaller one"
            ) from error


def demo(config: DemoConfig) -> Path:
    """Run the demo and return the path of its summary.

    Raises:
        DatasetError: If --out is a file, a dataset or a folder with files of another command.
        FolderInUse: If another command writes there.
        FileNotFoundError: If the weights are missing.
    """
    folder = ResultFolder(config.out, "demo", MARK, mark_text=ABOUT_MARK, partial=(PARTIAL, f"data/{PARTIAL}"))
    folder.check()
    started = perf_counter()
    network, sgbm = load_estimator("m3depth"), load_estimator("sgbm")
    with folder.claim():
        return _demo(config, network, sgbm, started)


def _demo(config: DemoConfig, network: Estimator, sgbm: Estimator, started: float) -> Path:
    data = config.out / "data"
    if data.exists():
        shutil.rmtree(data)  # the mark stays, so that a demo that is killed here can start again
    generate_config = GenerateConfig(
        out=data, pairs=config.pairs, seed=SEED, workers=config.workers, scenes=(load_place(config.scene),),
        renderer=default_renderer(),
    )  # fmt: skip
    if not pybullet_is_installed():
        print_note(WITHOUT_PYBULLET)
    print(f"1. {counted(config.pairs, 'stereo pair')} of {config.scene}, rendered by {generate_config.renderer}")
    dataset = generate_dataset(generate_config)
    write_atomically(config.out / "contact_sheet.png", (data / "contact_sheet.png").read_bytes())

    print("2. depth and normals by M3Depth and by SGBM")
    result = evaluate(dataset, {"M3Depth": network, "SGBM": sgbm}, examples=3)
    from m3depth.figures.comparison import comparison_figure  # not at the top, since it loads matplotlib

    comparison_figure(result.examples, config.out / "comparison.png")
    table = text_table(result.results)
    print(table)

    print(f"3. a drive of {config.goal_distance:g} m with M3Depth as the rover's eyes")
    env = MarsNavEnv(network, checked_dynamics(None), "embree", config.scene, config.goal_distance, mast=True)
    try:
        title = f"navigator, m3depth: {Path(config.scene).stem}, {config.goal_distance:g} m"
        with Film(config.out / "drive.mp4", title) as film:
            lines = StepLines("drive")

            def watch(env: MarsNavEnv, driver: Driver, step: int) -> None:
                film.watch(env, driver, step)
                lines.watch(env, driver, step)

            record = run_episode(env, NavigatorDriver(), Cell(), SEED, 0, ("navigator", "m3depth"), watch)
    finally:
        env.close()
    still = film.stills[len(film.stills) // 2]
    write_atomically(config.out / "drive.png", encode_png(still[..., ::-1]))
    summary = config.out / "summary.md"
    seconds = perf_counter() - started
    page = _summary(config, generate_config.renderer, dataset, table, record, seconds)
    write_atomically(summary, page.encode())
    return summary


def _summary(
    config: DemoConfig,
    renderer: str,
    dataset: StereoDataset,
    table: str,
    record: EpisodeRecord,
    seconds: float,
) -> str:
    return f"""# Demo: {config.scene}

**Data.** {counted(len(dataset), "stereo pair")}, seed {SEED}, rendered by {renderer}; digest `{dataset.digest[:16]}`.

![contact sheet](contact_sheet.png)

**Depth.** The shipped weights and filled SGBM on the same pairs; no weights were trained on them.

```
{table}
```

![comparison](comparison.png)

**Drive.** {_drive_in_words(record)}
Video: `drive.mp4`.

![drive](drive.png)

The whole demo took {seconds:.0f} s.
"""


def _drive_in_words(record: EpisodeRecord) -> str:
    """Return sentences on the drive that say what each number is compared with."""
    arrived = "reached its goal" if record.outcome == "goal" else f"did not reach its goal ({record.outcome})"
    clearance = f"{record.min_clearance:.2f} m" if record.min_clearance < FAR else f"more than {FAR:g} m"
    return f"""The rover {arrived} and drove {record.path_length:.1f} m. At best, a drive to this goal takes about
{record.shortest - GOAL_RADIUS:.1f} m: the shortest passable path is {record.shortest:.1f} m long, and a drive ends
{GOAL_RADIUS:g} m before the goal.
It took {record.steps} steps of {record.step_seconds:.2f} s, of which perception took {record.perception_seconds:.2f} s.
The smallest clearance on the way was {clearance}, from the rover's footprint to a true obstacle: a rock of
{ZHURONG.obstacle_height:g} m or more in height, a drop or steep ground. The red cells of the map below are something
else: ground that the navigator judges not traversable from the depth that it sees. That includes lower steps and rough
ground, so they may be nearer to the rover.
The tilt was at most {record.max_tilt_deg:.0f} deg."""


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return the exit code."""
    return run_command(
        _work, DemoConfig, "python -m envs.demo", __doc__, args, "the next run starts from the beginning"
    )


def _work(config: DemoConfig) -> None:
    summary = demo(config)
    folder = summary.parent
    print(f"summary      {summary}")
    for name, what in (("contact_sheet.png", "data"), ("comparison.png", "depth"), ("drive.mp4", "drive")):
        print(f"{what:<12} {folder / name}")


if __name__ == "__main__":
    sys.exit(main())
