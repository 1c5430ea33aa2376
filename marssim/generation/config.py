"""The configuration of marssim.generate, and the command line that gives it."""

from __future__ import annotations

import hashlib
import math
import re
import sys
from collections.abc import Sequence
from copy import copy
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
import tyro

from marssim.base.calibration.calibration_files import calibration_texts
from marssim.base.calibration.rig_file import RawRig, read_rig_file
from marssim.base.camera import LONGEST_FOCAL, NATECAM, PinholeCamera, StereoRig
from marssim.base.command.flags import parse
from marssim.base.command.limits import check_least
from marssim.base.command.notes import print_note
from marssim.base.dataset.dataset import SPLIT_OF_TEN
from marssim.base.files.json_file import DatasetError
from marssim.base.version import VERSION
from marssim.render.detector.compression import LARGEST_JPEG
from marssim.render.faults import FAULT_SETS, FaultSet, fault_set, fault_view
from marssim.render.renderers.by_name import FALLBACK_NOTE, RendererName, default_renderer
from marssim.render.sensor import LOSSLESS, SensorConfig
from marssim.scene.place_file import PLACE_VALUES, load_place
from marssim.scene.presets import PRESETS, preset
from marssim.scene.scene import SceneConfig
from marssim.scene.trajectory import TrajectoryConfig
from marssim.scene.viewpoint import ViewConfig

MIXED = "mixed"  # name of the place that takes all presets in turn
AUTO: Final = "auto"
TINY: Final = "tiny"
EGL: Final = "egl"
MOST_PAIRS = 10_000_000  # pairs in a dataset; their names alone fill a GB
LONGEST_DRIVE = 10_000  # pairs of a drive, whose path is drawn before the first one and takes seconds then
MOST_PIXELS = 2**30  # pixels of an image that OpenCV still reads from a file
MIXTURE = 0x6D69786564  # separates the draw of the places from all other draws of a seed


@dataclass(frozen=True, kw_only=True)
class RunConfig:
    """Generate stereo pairs of Mars with exact depth, normals and masks."""

    out: Path
    """Folder of the dataset. If it holds a part of the same dataset, the command adds what is missing."""
    pairs: int = 100
    """Number of stereo pairs, 1 to 10,000,000. The command can be repeated with a larger number to add pairs."""
    seed: int = 0
    """Seed of all random draws, 0 or more."""
    workers: int = 1
    """Number of processes that render, 1 or more, each with one thread. It does not change the files."""
    scheduler: str | None = None
    """Address of a dask scheduler, like tcp://host:8786, whose workers render instead of processes of this machine. All
    of them must see the folder --out."""
    renderer: RendererName = field(default_factory=default_renderer)
    """Renderer of the images and of the ground truth: PyBullet's rasteriser (the default where PyBullet is installed),
    Embree's rays, or scan conversion of the triangles, which is as fast as Embree and needs neither library (the
    default elsewhere). They differ in a few pixels on silhouettes."""
    rasterizer: Literal["auto", "tiny", "egl"] = "auto"
    """What draws for the renderer pybullet: tiny, PyBullet's own rasteriser, which draws the same on every machine, or
    egl, the graphics card, on which a few pixels on silhouettes depend. auto takes egl where a graphics card works, and
    else tiny; for an unfinished dataset it takes what the dataset was begun with."""
    views_per_scene: int = 8
    """Number of pairs of each scene, 1 or more. The splits train, val and test share no scene."""
    trajectory: bool = False
    """Take the views of a scene along a drive over it, in order, instead of at random places. The poses are also
    written to trajectory.txt."""
    raw: bool = False
    """Also write each pair as the cameras of --rig-file take it, with their distortion and rotations: raw_left.png and
    raw_right.png beside the rectified pair, and their calibration for OpenCV, ROS, Kalibr and PDS in the folder
    calibration. The rectified pair and the truth have the view that m3depth.rectify --shift 0 gives them."""
    drive: TrajectoryConfig = field(default_factory=TrajectoryConfig)
    view: ViewConfig = field(default_factory=ViewConfig)
    sensor: SensorConfig = field(default_factory=SensorConfig)

    def __post_init__(self) -> None:
        check_least(self, pairs=1, workers=1, views_per_scene=1, seed=0)
        if self.trajectory and self.views_per_scene > LONGEST_DRIVE:
            raise ValueError(f"views_per_scene must be at most {LONGEST_DRIVE} in a drive, got {self.views_per_scene}")
        if self.pairs > MOST_PAIRS:
            raise ValueError(f"pairs must be at most {MOST_PAIRS}, got {self.pairs}")
        if self.rasterizer != AUTO and self.renderer != "pybullet":
            raise ValueError(f"rasterizer {self.rasterizer} needs --renderer pybullet, not {self.renderer}")
        if not self.trajectory and self.drive != TrajectoryConfig():
            changed = [name for name, value in vars(self.drive).items() if value != getattr(TrajectoryConfig(), name)]
            raise ValueError(f"--drive.{changed[0].replace('_', '-')} describes a drive, which needs --trajectory")


@dataclass(frozen=True, kw_only=True)
class GenerateConfig(RunConfig):
    """What a dataset is made of; the fields of RunConfig are flags of marssim.generate."""

    scenes: tuple[SceneConfig, ...] = (preset(PRESETS[0]),)
    """Places from which the scenes are drawn in turn."""
    rig: StereoRig = NATECAM
    """The two cameras, rectified."""
    raw_rig: RawRig | None = None
    """The cameras as they were built, where they differ from `rig`, which is then raw_rig.rig."""
    rig_file: tuple[Path, ...] = ()
    """The files that `raw_rig` is from, for the command that completes a dataset."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.raw and self.raw_rig is None:
            raise ValueError(
                "--raw needs --rig-file with the distortion or the rotation of real cameras: the raw pairs of an ideal "
                "rig are the rectified ones"
            )
        if not self.scenes:
            raise ValueError("scenes must hold one config or more")
        camera = self.rig.camera
        if (focal := min(camera.fx, camera.fy)) < 1:
            raise ValueError(f"`rig.focal`, or fx and fy of a rig file, must be at least 1 px, got {focal}; in metres?")
        if max(camera.width, camera.height) > LARGEST_JPEG and self.sensor.jpeg_quality[0] < LOSSLESS:
            raise ValueError(
                f"`sensor.jpeg_quality` below {LOSSLESS:g}, which --faults may set, needs images of at most "
                f"{LARGEST_JPEG} px a side, got {camera.width} x {camera.height}"
            )
        if camera.width * camera.height > MOST_PIXELS:
            raise ValueError(
                f"`rig.width` times `rig.height`, or those of a rig file, must be at most {MOST_PIXELS} px, "
                f"got {camera.width} x {camera.height}"
            )

    @property
    def place(self) -> str:
        """The preset that all scenes start from, or "mixed"."""
        names = {scene.preset for scene in self.scenes}
        return names.pop() if len(names) == 1 else MIXED

    def content(self) -> dict[str, Any]:
        """Return all settings on which the content of a sample depends, as plain values for JSON.

        The folder, the number of pairs and the workers are not among them. A heightmap counts by its SHA-256 and its
        name, which samples record, and not by its folder. The version of marssim counts too.
        """
        left_out = ("out", "pairs", "workers", "scheduler", "rig", "scenes", "raw", "raw_rig", "rig_file")
        content = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in left_out}
        for part in ("drive", "view", "sensor"):
            content[part] = asdict(content[part])
        if self.raw and self.raw_rig is not None:
            texts = calibration_texts(self.raw_rig)
            digests = {name: hashlib.sha256(text.encode()).hexdigest() for name, text in texts.items()}
            content["raw"] = {**self.raw_rig.to_dict(), "calibration": digests}
        if not self.trajectory:
            del content["drive"]
        if self.rasterizer != EGL:  # TinyRenderer draws the same on every machine
            del content["rasterizer"]
        scenes = [asdict(scene) for scene in self.scenes]  # in the order that they are drawn from
        for scene in scenes:
            if scene["relief"]["heightmap"] is not None:
                scene["relief"]["heightmap"] = Path(scene["relief"]["heightmap"]).name
        return {"marssim": VERSION, **content, "scene": self.place, "scenes": scenes, "rig": self.rig.to_dict()}

    def scene_config(self, scene: int) -> SceneConfig:
        """Return the place that a scene of the dataset is drawn from. It depends on the seed and the scene alone.

        Of n places, each block of n scenes has each once, in an order that follows from the seed. From block to block
        the order is rotated, so that within n lcm(n, 10) scenes (50 for five places) each of the ten positions that
        determine the split (dataset.split_of) has each place equally often, and so do train, val and test.
        """
        n = len(self.scenes)
        cycle, within = divmod(scene, n * math.lcm(n, len(SPLIT_OF_TEN)))
        rng = np.random.default_rng((self.seed, MIXTURE, cycle))
        order, start = rng.permutation(n), rng.permutation(n)
        return self.scenes[order[(start[within % n] + within // n) % n]]


@dataclass(frozen=True)
class RigOptions:
    """The cameras: two equal ones side by side, with the values of NaTeCam by default."""

    width: int = NATECAM.camera.width
    """Width of each image [px], above 0 and up to 65536."""
    height: int = NATECAM.camera.height
    """Height of each image [px], above 0 and up to 65536."""
    focal: float = NATECAM.camera.fx
    """Focal length [px], at least 1 and up to 1e9. It stays the same where only the width is given, so that smaller
    images show a narrower view."""
    focal_y: float | None = None
    """Vertical focal length [px], at least 1 and up to 1e9, for pixels that are not square. By default it equals
    --rig.focal."""
    baseline: float = NATECAM.baseline
    """Distance between the two cameras [m], above 0 and up to 10."""
    cx: float | None = None
    """Column of the principal point [px], -1000000 to 1000000, where 0 is the middle of the first pixel. By default it
    is the middle of the image."""
    cy: float | None = None
    """Row of the principal point [px], -1000000 to 1000000. By default it is the middle of the image."""

    def __post_init__(self) -> None:
        self.rig()  # raises for values out of range

    def rig(self) -> StereoRig:
        """Return the cameras as a StereoRig. Raises ValueError that names the field."""
        for name in ("width", "height", "focal", "focal_y", "baseline"):
            value = getattr(self, name)
            if value is not None and not 0 < value < float("inf"):
                raise ValueError(f"{name} must be positive, got {value}")
            if name.startswith("focal") and value is not None and value > LONGEST_FOCAL:
                raise ValueError(f"{name} must be at most {LONGEST_FOCAL:g} px, got {value:g}")
        focal_y = self.focal if self.focal_y is None else self.focal_y
        cx = (self.width - 1) / 2 if self.cx is None else self.cx
        cy = (self.height - 1) / 2 if self.cy is None else self.cy
        return StereoRig(PinholeCamera(self.width, self.height, self.focal, focal_y, cx, cy), self.baseline)


@dataclass(frozen=True)
class SceneOptions(SceneConfig):
    """The values of a place as flags; --scene names the place that they start from."""

    preset: tyro.conf.Suppress[str] = PRESETS[0]


@dataclass(frozen=True, kw_only=True)
class GenerateOptions(RunConfig):
    """Generate stereo pairs of Mars with exact depth, normals and masks."""

    scene: Annotated[str, tyro.conf.arg(metavar=f"{PLACE_VALUES}|{MIXED}")] = PRESETS[0]
    """Place on Mars that the terrain is modelled on: a preset (listed from few rocks to many), a JSON file of your own
    place, or mixed, which takes the presets in turn so that train, val and test hold each equally often. `--scene NAME
    --help` shows the values of that place as the defaults of --rocks, --outcrop, --relief and --look
    (those of utopia for mixed).
    Values that you give replace those of the place, or of each place of mixed."""
    faults: FaultSet = "none"
    """Image faults of real cameras. random is for training: each pair has each fault with some chance, of dust on the
    windows, motion blur, glare, wrong exposure, bleeding and smear of a CCD, hot pixels, a contrast stretch, JPEG and a
    horizontal offset, and some pairs show the rover itself and its shadow. public gives every pair what rovers' raw
    images on the web have: dust, glare, hot pixels, stretch and JPEG.
    `--faults random --help` shows its values as the defaults of --sensor and --view; values that you give replace
    them."""
    knobs: Annotated[SceneOptions, tyro.conf.arg(name="")] = field(default_factory=SceneOptions)
    rig: RigOptions = field(default_factory=RigOptions)
    rig_file: tuple[Path, ...] = ()
    """The cameras, instead of the flags --rig: a JSON file with width, height, fx, fy, cx, cy [px] and baseline [m],
    to which the distortion of the lenses, vergence and a rotation can be added (see docs/guides/own-camera.md); or a
    calibration of raw cameras, one file or two, as m3depth.rectify takes it. The pairs are then what rectification
    makes of such cameras, and --raw adds what it starts from."""


def parse_generate(prog: str, description: str | None, args: Sequence[str] | None = None) -> GenerateConfig:
    """Return the config that a command line gives.

    Args:
        prog: Name of the command, for the help.
        description: Text of the help.
        args: Words of the command line, instead of sys.argv.

    Raises:
        ValueError: A flag is unknown or has a bad value. One line that names the flag.
        OSError: The file of the rig cannot be read.
    """
    args = sys.argv[1:] if args is None else args
    asked = named_scene(args)
    places = tuple(map(preset, PRESETS)) if asked == MIXED else (load_place(asked),)
    faults = named_faults(args)
    sensor, view = fault_set(faults), fault_view(faults)
    defaults = [
        GenerateOptions(out=tyro.MISSING, scene=asked, knobs=_options(place), faults=faults, sensor=sensor, view=view)
        for place in places
    ]
    options = [parse(GenerateOptions, prog, description, args, default) for default in defaults]
    first = options[0]
    if not any(word.partition("=")[0] == "--renderer" for word in args) and first.renderer != "pybullet":
        print_note(FALLBACK_NOTE)
    scenes = tuple(SceneConfig(**{f.name: getattr(o.knobs, f.name) for f in fields(SceneConfig)}) for o in options)
    rig, raw_rig = first.rig.rig(), None
    if first.rig_file:
        names = " ".join(map(str, first.rig_file))
        if rig != NATECAM:
            raise ValueError(f"--rig-file {names}: cannot be combined with the flags --rig.*")
        if len(first.rig_file) > 2:
            raise ValueError(f"--rig-file {names}: a rig has one file or two, got {len(first.rig_file)}")
        try:
            read = read_rig_file(first.rig_file)
        except DatasetError as error:
            raise DatasetError(f"--rig-file {error}") from None
        rig, raw_rig = (read.rig, read) if isinstance(read, RawRig) else (read, None)
    run = {f.name: getattr(first, f.name) for f in fields(RunConfig)}
    return GenerateConfig(**run, scenes=scenes, rig=rig, raw_rig=raw_rig, rig_file=first.rig_file)


def named_scene(args: Sequence[str]) -> str:
    """Return the last value of --scene on a command line; that of the default place if there is none."""
    values = re.findall(r"(?:^|\0)--scene[=\0](?!-)([^\0]*)", "\0".join(args))
    return values[-1] if values else PRESETS[0]


def named_faults(args: Sequence[str]) -> FaultSet:
    """Return the last value of --faults on a command line; "none" if there is none, or no set of that name."""
    values = re.findall(r"(?:^|\0)--faults[=\0]([^\0]*)", "\0".join(args))
    return next((name for name in FAULT_SETS if values[-1:] == [name]), "none")


def _options(place: SceneConfig) -> SceneOptions:
    """Return a place as flags. The digest of its heightmap is left out, as --relief.heightmap may name another one."""
    options = SceneOptions(**{f.name: getattr(place, f.name) for f in fields(SceneConfig)})
    relief = copy(place.relief)
    object.__setattr__(relief, "heightmap_sha256", None)
    object.__setattr__(options, "relief", relief)
    return options
