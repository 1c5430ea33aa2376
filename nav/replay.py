"""Replay a recorded drive: depth maps go in, the navigator's commands come out. No simulator, no network.

    python -m marssim.generate --out data/drive --trajectory --pairs 20 --views-per-scene 20
    python -m nav.replay data/drive --goal 20 0
    python -m nav.replay data/drive --goal 20 0 --bag out/replay
    python -m nav.replay data/drive --goal 20 0 --view      and shows it in 3-D, in the browser
    python -m nav.replay data/drive --goal 20 0 --prior out/map     with a map that nav.map made before

    python -m envs.evaluate --perception sgbm --episodes 1 --record all --out out/eval
    python -m nav.replay out/eval/drives/DRIVE.zip

Of a dataset, the navigator gets the true depth; the goal is given in the frame of the first image: metres ahead, metres
to the left. A drive of marssim.generate says where its cameras are on the rover; for others, --mount does. Of a drive
that envs.evaluate recorded, the navigator gets the depth that the perception measured, the poses of the odometry, the
area of the drive and its own goal. Its commands can differ from those of the drive, since the record rounds the depth
to 0.4 %, and of images of 256 x 256 px or more keeps every n-th pixel. Those of the driver oracle can also differ,
since the record does not hold the true heights. --bag also writes what it saw and
decided as a ROS 2 bag. From Python, `replay` takes frames from any source of depth and poses.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
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
from marssim.base.command.limits import check_least
from marssim.base.command.run import run_command
from marssim.base.command.wording import STARTS_OVER, counted
from marssim.base.dataset.dataset import StereoDataset
from marssim.base.dataset.drive_file import DriveFile, read_drive
from marssim.base.dataset.sample import recorded_mount, recorded_time
from marssim.base.files.json_file import DatasetError
from marssim.base.pose import recorded_pose
from marssim.base.rover_spec import ZHURONG, CameraMount, RoverSpec
from marssim.base.view.show import check_viewer, show
from nav.bag import write_decision
from nav.command import Command
from nav.config import NavigatorConfig
from nav.drive_shots import DriveRecorder
from nav.ground.elevation import ElevationConfig, ElevationMap
from nav.ground.masks import Area
from nav.ground.read_map import is_of_rover, read_map
from nav.navigator import Navigator

DRIVE_APART = 6.0  # [m] between two images, beyond which they are no drive; marssim.generate takes them within 5 m
ALIKE = 0.02  # [m/s], [rad/s] up to which a recorded command is that of the navigator: depth in a record is rounded
AHEAD = (20.0, 0.0)  # [m] goal ahead and to the left of the first image of a dataset
TRAJECTORY = "marssim.generate --trajectory makes one"  # end of the messages about views that are no drive


@dataclass(frozen=True)
class Frame:
    """One image of a recorded drive."""

    depth: np.ndarray | None
    """(H, W) depth [m] along the optical axis; None if the rover took no image here on purpose, between two looks."""
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
    true_body: np.ndarray | None = None
    """(4, 4) true pose of the rover, body to world, if `camera_pose` is that of its odometry. Only a bag needs it."""
    commanded: tuple[float, float] | None = None
    """Speed [m/s] and yaw rate [rad/s] that the rover was commanded at this frame; None if that is not known. Where the
    navigator commands the same and the rover stood still, the rover met something that it did not see."""

    def body(self, spec: RoverSpec = ZHURONG) -> np.ndarray:
        """Return the pose of the rover, (4, 4) body to world, whose mount puts the camera at its pose."""
        return np.asarray(self.camera_pose @ np.linalg.inv(spec.mount.left_eye(self.rig.baseline, self.pan)))


# called with frame, navigator and command after each decision
Watch = Callable[[Frame, Navigator, Command], None]


def replay(
    frames: Iterable[Frame], goal: ArrayLike, spec: RoverSpec = ZHURONG, watch: Watch | None = None,
    area: Area | None = None, prior: ElevationMap | None = None, config: NavigatorConfig | None = None,
) -> list[Command]:  # fmt: skip
    """Return the navigator's command for each frame, until the navigator ends the drive.

    Each command is what the navigator would do from the place that the recording's driver had reached. The rover is
    assumed to stand where its mount (spec.mount) puts the camera at its recorded pose.

    Args:
        frames: The recorded images, in order.
        goal: (2,) goal in the world [m].
        spec: The rover.
        watch: Is called with frame, navigator and command after each decision.
        area: (x0, y0, x1, y1) in the world within which the rover's middle must stay [m]; None for no limit.
        prior: Heights that are known before the drive, in the world of the poses.
        config: The navigator's settings; None for NavigatorConfig.of_rover(spec).

    Raises:
        ValueError: The area is empty, the cells of the prior are not of the navigator's size, or the pose of a frame is
            no rotation and translation, or spec.mount has the rover lie on its side there.
    """
    navigator, commands = Navigator(spec, config, area, prior), []
    obeyed = False  # whether the rover did between two frames what the navigator commanded at the first
    for frame in frames:
        body, place = frame.body(spec), np.asarray(goal, float)
        command = navigator.step(
            frame.depth, frame.confidence, frame.rig, body, place, frame.pan, frame.depth is None, obeyed
        )
        commands.append(command)
        obeyed = frame.commanded is not None and np.allclose(
            (command.speed, command.yaw_rate), frame.commanded, atol=ALIKE
        )
        if watch is not None:
            watch(frame, navigator, command)
        if command.over:
            break
    return commands


def dataset_frames(dataset: StereoDataset, scene: int) -> Iterator[Frame]:
    """Yield the frames of one scene of a dataset with their true depth, in the order in which they were taken."""
    for number, entry in enumerate(dataset.index["samples"]):
        if int(entry["name"].split("/")[0]) == scene:
            sample, file = dataset[number], dataset.path / "scenes" / entry["name"] / "sample.json"
            if "pose" not in sample.meta:
                raise DatasetError(f"{file}: field 'pose' is missing, so the camera's place is not known")
            try:
                pose, mount = recorded_pose(sample.meta["pose"]), recorded_mount(sample.meta)
                time = recorded_time(sample.meta, sample.meta.get("view", number))
                pan = 0.0 if mount is None else CameraMount.of_left_eye(mount, sample.rig.baseline)[1]
            except ValueError as error:
                raise DatasetError(f"{file}: {error}") from None
            depth = np.where(sample.rock < 0, np.float32(np.nan), sample.depth)  # the rover is no ground
            yield Frame(depth, None, sample.rig, pose, pan, (sample.left, sample.right), time)


def write_look(bag: StereoBagWriter, frame: Frame, navigator: Navigator, command: Command) -> None:
    """Write a frame and the decision on it to a bag."""
    stamp, body = _stamp(frame), frame.body(navigator.spec)
    if frame.images is not None:
        bag.write_images(stamp, *frame.images, frame.rig)
    if frame.depth is not None:
        bag.write_depth(stamp, frame.depth, frame.rig.camera)
    true = body if frame.true_body is None else frame.true_body
    eye = true @ navigator.spec.mount.left_eye(frame.rig.baseline, frame.pan)
    bag.write_pose(stamp, true, eye, frame.rig.baseline, believed=body)
    write_decision(bag, stamp, command.status, command.speed, command.yaw_rate, body, navigator)


def _stamp(frame: Frame) -> int:
    """Return the stamp of a frame in a bag [ns], 1 s later than its time, as 0 is no time in ROS."""
    return round((1 + frame.time) * SECOND)


def area_of(drive: DriveFile) -> Area | None:
    """Return the area of a drive that envs.evaluate recorded; None if its file has none, as before 0.2.

    Raises:
        DatasetError: The area is empty.
    """
    if "area" not in drive.content:
        return None
    x0, y0, x1, y1 = map(float, drive.content["area"])
    if not (x0 < x1 and y0 < y1):
        raise DatasetError(f"{drive.path}: area must be x0 < x1 and y0 < y1 [m], got {drive.content['area']}")
    return x0, y0, x1, y1


def drive_frames(drive: DriveFile, spec: RoverSpec = ZHURONG) -> Iterator[Frame]:
    """Yield the frames of a drive that envs.evaluate recorded, at the poses that the odometry gave, without images.

    Raises:
        DatasetError: A picture or a pose of the drive is broken.
    """
    for n, step in enumerate(drive.steps):
        body, true = (_body_pose(drive, n, name) for name in ("believed_pose", "pose"))
        camera_pose = body @ spec.mount.left_eye(drive.rig.baseline, step["pan"])
        depth, confidence = drive.depth(n), drive.confidence(n)
        if step["looked"] and depth is None:
            raise DatasetError(f"{drive.path}: steps[{n}] has no depth, although the rover looked there")
        time = n * drive.content["step_seconds"]
        command = step["command"]
        commanded = None if command is None else (float(command["speed"]), float(command["yaw_rate"]))
        yield Frame(
            depth, confidence, drive.rig, camera_pose, step["pan"], time=time, true_body=true, commanded=commanded
        )


def _body_pose(drive: DriveFile, step: int, name: str) -> np.ndarray:
    """Return a pose of the rover in a step of a drive, (4, 4). Raises DatasetError that names the step."""
    try:
        return recorded_pose([*drive.steps[step][name], [0, 0, 0, 1]])
    except ValueError as error:
        raise DatasetError(f"{drive.path}: steps[{step}].{name}: {error}") from None


@dataclass(frozen=True)
class ReplayConfig:
    """Feed a recorded drive to the navigator and print its commands."""

    data: Annotated[Path, tyro.conf.Positional]
    """Dataset of a recorded drive, as `marssim.generate --trajectory` writes it, or the file of a drive, DRIVE.zip, as
    `envs.evaluate --record` writes it."""
    goal: tuple[float, float] | None = None
    """Goal in metres ahead and metres to the left of the first image. Left out: 20 m ahead, or the goal of the drive in
    a file."""
    number: int = 0
    """Number of the scene in the dataset, 0 or more; each scene is one drive. The file of a drive has no number."""
    mount: tuple[float, float, float] | None = None
    """Place of the cameras of a dataset on the rover: metres ahead of its origin, which is on the ground, -10 to 10,
    metres above the ground, 0.001 to 10, and degrees that they look down, -90 to 90. Left out: that in the dataset, or
    else Zhurong's (0.65 1.2 20), with a warning."""
    prior: Path | None = None
    """Folder of a map of nav.map, in the world of the recorded poses and with cells of 0.1 m: heights that the
    navigator knows before the drive."""
    bag: Path | None = None
    """ROS 2 bag to write, a new folder: images, depth, planned path, command, status and pose of each frame. The images
    of a drive's file are reduced, and are left out. It needs the extra `real`."""
    view: bool = False
    """At the end, show the drive on a page in the browser, until Ctrl-C: for each frame the cloud, also coloured by
    traversability, the navigator's map and the motion that it chose. It needs the extra `view`."""

    def __post_init__(self) -> None:
        check_least(self, number=0)
        if self.goal is not None and not np.isfinite(self.goal).all():
            raise ValueError(f"--goal must be two finite numbers [m], got {self.goal}")
        if self.mount is not None:
            CameraMount.of_flag(self.mount)  # raises ValueError for values that no mast has


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return the exit code."""
    return run_command(_work, ReplayConfig, "python -m nav.replay", __doc__, args, STARTS_OVER)


def _work(config: ReplayConfig) -> None:
    if config.view:
        check_viewer()
    if config.bag is not None:
        check_installed(config.bag)
        check_new(config.bag)
    if config.data.is_file():
        if config.number:
            raise ValueError(f"--number is for a dataset; {config.data} holds one drive")
        if config.mount:
            raise ValueError(f"--mount is for a dataset; the cameras of {config.data} are where Zhurong has them")
        drive, spec = read_drive(config.data), ZHURONG
        frames, title, area = list(drive_frames(drive)), config.data.name, area_of(drive)
        goal = _world(frames[0], config.goal) if config.goal else np.asarray(drive.content["episode"]["goal"], float)
    else:
        frames, title, area = _frames_of_dataset(config), f"{config.data.resolve().name}, scene {config.number}", None
        goal, spec = _world(frames[0], config.goal or AHEAD), replace(ZHURONG, mount=_mount(config))
    prior = None if config.prior is None else _prior(config.prior)
    recorder = DriveRecorder(goal, spec)
    with ExitStack() as opened:
        watches: list[Watch] = []
        if config.bag is not None:
            bag = opened.enter_context(StereoBagWriter(config.bag))
            start = frames[0]
            bag.write_goal(_stamp(start), np.array([*goal, start.body(spec)[2, 3]]))
            watches.append(partial(write_look, bag))
        if config.view:
            watches.append(partial(_record, recorder))

        def watch(frame: Frame, navigator: Navigator, command: Command) -> None:
            for each in watches:
                each(frame, navigator, command)

        commands = replay(frames, goal, spec, watch, area, prior)
    print(f"{'frame':>5}  {'status':8} {'speed':>9} {'yaw rate':>11} {'pan':>8}")
    for number, c in enumerate(commands):
        pan = f"{np.rad2deg(c.pan or 0.0):4.0f} deg"
        print(f"{number:5d}  {c.status:8} {c.speed:5.2f} m/s {c.yaw_rate:5.2f} rad/s {pan}")
    written = "" if config.bag is None else f", in {config.bag}"
    print(f"{counted(len(commands), 'command')} for {counted(len(frames), 'frame')}{written}")
    if config.view:
        show(recorder.shots, title)


def _prior(folder: Path) -> ElevationMap:
    """Return the map of --prior. Raises ValueError, or DatasetError, one line, if the navigator cannot use it."""
    elevation, cell = read_map(folder), ElevationConfig.cell
    if is_of_rover(folder):
        raise ValueError(f"--prior {folder}: lies in the frame of a rover; predict its pair with --poses")
    if elevation.config.cell != cell:
        raise ValueError(f"--prior {folder}: has cells of {elevation.config.cell:g} m; make it with --cell {cell:g}")
    return elevation


def _mount(config: ReplayConfig) -> CameraMount:
    """Return where the cameras of a dataset are on the rover."""
    if config.mount is not None:
        return CameraMount.of_flag(config.mount)
    samples = StereoDataset(config.data)
    sample = samples[next(n for n, name in enumerate(samples.names) if int(name.split("/")[0]) == config.number)]
    recorded = recorded_mount(sample.meta)
    if recorded is None:
        print(
            f"warning: {config.data}: does not say where its cameras are on the rover, so Zhurong's place is assumed; "
            "give --mount",
            file=sys.stderr,
        )
        return ZHURONG.mount
    return CameraMount.of_left_eye(recorded, sample.rig.baseline)[0]


def _record(recorder: DriveRecorder, frame: Frame, navigator: Navigator, command: Command) -> None:
    """Keep a frame and the decision on it for the page in the browser."""
    image = None if frame.images is None else frame.images[0]
    recorder.add(navigator, command, frame.rig, frame.camera_pose, frame.depth, frame.confidence, image)


def _frames_of_dataset(config: ReplayConfig) -> list[Frame]:
    """Return the frames of a scene. Raises DatasetError if they are no drive."""
    if not (config.data / "dataset.json").is_file():
        files = sorted(config.data.glob("*.zip")) or sorted((config.data / "drives").glob("*.zip"))
        if files:
            raise DatasetError(f"{config.data}: holds recorded drives; name one, such as {files[0]}")
        if config.data.is_dir():
            raise DatasetError(
                f"{config.data}: holds neither dataset.json, as a folder of marssim.generate does, nor recorded "
                "drives; recordings of other rovers are replayed in Python, by nav.replay.replay"
            )
    dataset = StereoDataset(config.data)
    frames = list(dataset_frames(dataset, config.number))
    if not frames:
        raise DatasetError(f"{config.data}: holds no scene {config.number}")
    settings = dataset.index.get("config")
    if isinstance(settings, dict) and settings.get("trajectory") is False:
        raise DatasetError(f"{config.data}: holds no recorded drive, its views are random; {TRAJECTORY}")
    places = np.array([frame.camera_pose[:2, 3] for frame in frames])
    apart = float(np.hypot(*np.diff(places, axis=0).T).max(initial=0))
    if apart > DRIVE_APART:
        raise DatasetError(
            f"{config.data}: holds no recorded drive, two of its views in a row lie {apart:.1f} m apart; {TRAJECTORY}"
        )
    return frames


def _world(frame: Frame, goal: tuple[float, float]) -> np.ndarray:
    """Return a goal in the world (2,) [m], given in metres ahead and to the left of a frame."""
    eye = frame.camera_pose
    forward = eye[:2, 2] / max(float(np.hypot(*eye[:2, 2])), 1e-9)
    left = np.array([-forward[1], forward[0]])
    return np.asarray(eye[:2, 3] + goal[0] * forward + goal[1] * left)


if __name__ == "__main__":
    sys.exit(main())
