"""Replay a recorded drive: depth maps go in, the navigator's commands come out. No simulator, no network.

    python -m marssim.generate --out data/drive --trajectory --pairs 20 --views-per-scene 20
    python -m nav.replay data/drive --goal 20 0
    python -m nav.replay data/drive --goal 20 0 --bag out/replay
    python -m nav.replay data/drive --goal 20 0 --view      and shows it in 3-D, in the browser

The goal is given in the frame of the first image: metres ahead, metres to the left. The navigator gets the dataset's
true depth. --bag also writes what it saw and decided as a ROS 2 bag. From Python, `replay` takes frames from any source
of depth and poses.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from numpy.typing import ArrayLike

from marssim.base.bags.library import check_installed
from marssim.base.bags.messages import SECOND
from marssim.base.bags.stereo_writer import StereoBagWriter
from marssim.base.bags.writer import check_new
from marssim.base.camera import StereoRig
from marssim.base.command.run import run_command
from marssim.base.command.wording import counted
from marssim.base.dataset.dataset import StereoDataset
from marssim.base.files.json_file import DatasetError
from marssim.base.rover_spec import ZHURONG, RoverSpec
from marssim.base.view.show import check_viewer, show
from nav.bag import write_decision
from nav.command import Command
from nav.drive_shots import DriveRecorder
from nav.navigator import Navigator

DRIVE_APART = 4.0  # [m] between two images, beyond which the frames are not a drive


@dataclass(frozen=True)
class Frame:
    """One image of a recorded drive."""

    depth: np.ndarray
    """(H, W) depth [m] along the optical axis."""
    confidence: np.ndarray | None
    """(H, W) confidence in [0, 1], or None."""
    rig: StereoRig
    """The cameras at the size of `depth`."""
    camera_pose: np.ndarray
    """(4, 4) pose of the left camera, camera to world."""
    pan: float = 0.0
    """Pan of the mast [rad], positive to the left."""
    images: tuple[np.ndarray, np.ndarray] | None = None
    """Images of both eyes, (H, W, 3) uint8 RGB, or None. The navigator does not need them."""
    time: float = 0.0
    """When the images were taken [s]. Only a bag needs it."""

    def body(self, spec: RoverSpec = ZHURONG) -> np.ndarray:
        """Return the pose of the rover, (4, 4) body to world, whose mount puts the camera at its pose."""
        return np.asarray(self.camera_pose @ np.linalg.inv(spec.mount.left_eye(self.rig.baseline, self.pan)))


# called with frame, navigator and command after each decision
Watch = Callable[[Frame, Navigator, Command], None]


def replay(
    frames: Iterable[Frame], goal: ArrayLike, spec: RoverSpec = ZHURONG, watch: Watch | None = None
) -> list[Command]:
    """Return the navigator's command for each frame, until the navigator ends the drive.

    The recording is another driver's: each command is what the navigator would do from the place that this driver had
    reached. The rover is assumed to stand where its mount (spec.mount) puts the camera at its recorded pose.

    Args:
        frames: The recorded images, in order.
        goal: (2,) goal in the world [m].
        spec: The rover.
        watch: Is called with frame, navigator and command after each decision.
    """
    navigator, commands = Navigator(spec), []
    for frame in frames:
        body, place = frame.body(spec), np.asarray(goal, float)
        command = navigator.step(frame.depth, frame.confidence, frame.rig, body, place, frame.pan)
        commands.append(command)
        if watch is not None:
            watch(frame, navigator, command)
        if command.over:
            break
    return commands


def recorded(dataset: StereoDataset, scene: int) -> Iterator[Frame]:
    """Yield the frames of one scene of a dataset with their true depth, in the order in which they were taken."""
    for number, entry in enumerate(dataset.index["samples"]):
        if int(entry["name"].split("/")[0]) == scene:
            sample = dataset[number]
            if "pose" not in sample.meta:
                file = dataset.path / "scenes" / entry["name"] / "sample.json"
                raise DatasetError(f"{file}: field 'pose' is missing, so the camera's place is not known")
            yield Frame(
                sample.depth, None, sample.rig, np.array(sample.meta["pose"]), images=(sample.left, sample.right),
                time=float(sample.meta.get("timestamp", sample.meta.get("view", number))),
            )  # fmt: skip


def write_look(bag: StereoBagWriter, frame: Frame, navigator: Navigator, command: Command) -> None:
    """Write a frame and the decision on it to a bag, 1 s later than the time of the frame, as 0 is no time in ROS."""
    stamp, body = round((1 + frame.time) * SECOND), frame.body(navigator.spec)
    if frame.images is not None:
        bag.write_images(stamp, *frame.images, frame.rig)
    bag.write_depth(stamp, frame.depth, frame.rig.camera)
    bag.write_pose(stamp, body, frame.camera_pose, frame.rig.baseline)
    write_decision(bag, stamp, command.status, command.speed, command.yaw_rate, body, navigator)


@dataclass(frozen=True)
class ReplayConfig:
    """Feed a recorded drive to the navigator and print its commands."""

    data: Annotated[Path, tyro.conf.Positional]
    """Dataset of a recorded drive, as `marssim.generate --trajectory` writes it."""
    goal: tuple[float, float] = (20.0, 0.0)
    """Goal in metres ahead and metres to the left of the first image."""
    scene: int = 0
    """Number of the scene in the dataset; each scene is one drive."""
    bag: Path | None = None
    """ROS 2 bag to write, a new folder: images, depth, planned path, command, status and pose of each frame. It needs
    the extra `real`."""
    view: bool = False
    """At the end, show the drive on a page in the browser, until Ctrl-C: for each frame the cloud, also coloured by
    traversability, the navigator's map and the motion that it chose. It needs the extra `view`."""


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return the exit code."""
    return run_command(_work, ReplayConfig, "python -m nav.replay", __doc__, args)


def _work(config: ReplayConfig) -> None:
    if config.view:
        check_viewer()
    if not np.isfinite(config.goal).all():
        raise ValueError(f"--goal must be two finite numbers [m], got {config.goal}")
    if config.bag is not None:
        check_installed(config.bag)
        check_new(config.bag)
    dataset = StereoDataset(config.data)
    frames = list(recorded(dataset, config.scene))
    if not frames:
        raise DatasetError(f"{config.data}: holds no scene {config.scene}")
    settings = dataset.index.get("config")
    if isinstance(settings, dict) and settings.get("trajectory") is False:
        raise DatasetError(
            f"{config.data}: holds no recorded drive, its views are random; generate one with marssim.generate "
            "--trajectory"
        )
    places = np.array([frame.camera_pose[:2, 3] for frame in frames])
    apart = float(np.hypot(*np.diff(places, axis=0).T).max(initial=0))
    if apart > DRIVE_APART:
        print(f"warning: frames lie up to {apart:.1f} m apart; are they the images of one drive?", file=sys.stderr)
    eye = frames[0].camera_pose
    forward = eye[:2, 2] / max(float(np.hypot(*eye[:2, 2])), 1e-9)
    left = np.array([-forward[1], forward[0]])
    goal = eye[:2, 3] + config.goal[0] * forward + config.goal[1] * left
    recorder = DriveRecorder(goal, ZHURONG)
    with ExitStack() as opened:
        watches: list[Watch] = []
        if config.bag is not None:
            watches.append(partial(write_look, opened.enter_context(StereoBagWriter(config.bag))))
        if config.view:
            watches.append(partial(_record, recorder))

        def watch(frame: Frame, navigator: Navigator, command: Command) -> None:
            for each in watches:
                each(frame, navigator, command)

        commands = replay(frames, goal, watch=watch)
    print(f"{'frame':>5}  {'status':8} {'speed':>9} {'yaw rate':>11} {'pan':>8}")
    for number, c in enumerate(commands):
        pan = f"{np.rad2deg(c.pan or 0.0):4.0f} deg"
        print(f"{number:5d}  {c.status:8} {c.speed:5.2f} m/s {c.yaw_rate:5.2f} rad/s {pan}")
    written = "" if config.bag is None else f", in {config.bag}"
    print(f"{counted(len(commands), 'command')} for {counted(len(frames), 'frame')}{written}")
    if config.view:
        show(recorder.shots, f"{config.data.resolve().name}, scene {config.scene}")


def _record(recorder: DriveRecorder, frame: Frame, navigator: Navigator, command: Command) -> None:
    """Keep a frame and the decision on it for the page in the browser."""
    image = None if frame.images is None else frame.images[0]
    recorder.add(navigator, command, frame.rig, frame.camera_pose, frame.depth, frame.confidence, image)


if __name__ == "__main__":
    sys.exit(main())
