"""What marssim.generate can be asked for: as a config, and as a command line."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
import tyro

from marssim.base.camera import NATECAM, PinholeCamera, StereoRig
from marssim.base.command.flags import parse
from marssim.base.dataset.dataset import SPLIT_OF_TEN
from marssim.base.files.json_file import DatasetError, read_json
from marssim.base.version import VERSION
from marssim.render.renderers.by_name import RendererName
from marssim.render.sensor import SensorConfig
from marssim.scene.place_file import PLACE_VALUES, load_place
from marssim.scene.scene import PRESETS, SceneConfig, preset
from marssim.scene.trajectory import TrajectoryConfig
from marssim.scene.viewpoint import ViewConfig

MIXED = "mixed"
AUTO: Final = "auto"
TINY: Final = "tiny"
EGL: Final = "egl"
MOST_PAIRS = 10_000_000  # whose names alone fill a GB
MOST_PIXELS = 2**30  # that OpenCV reads from a file
MIXTURE = 0x6D69786564  # parts the draw of the places from all others of a seed


@dataclass(frozen=True, kw_only=True)
class RunConfig:
    """Generate stereo pairs of Mars with exact depth, normals and masks."""

    out: Path
    """folder to write; a folder that holds part of the same dataset is completed"""
    pairs: int = 100
    """number of stereo pairs; a larger number later adds to those that are there"""
    seed: int = 0
    """seed of every random draw, 0 or more"""
    workers: int = 1
    """processes to render in, one thread each; the files do not depend on it"""
    scheduler: str | None = None
    """address of a dask scheduler, tcp://host:8786, whose workers render instead; all must see --out"""
    renderer: RendererName = "pybullet"
    """what makes the G-buffer: PyBullet's rasteriser, Embree's rays, or scan conversion of the triangles in double
    precision (the fastest; needs neither library)"""
    rasterizer: Literal["auto", "tiny", "egl"] = "auto"
    """what draws PyBullet's pictures: its TinyRenderer (the same everywhere), or EGL (a few pixels on silhouettes
    depend on driver and card); auto goes on with what a dataset was begun with, and begins one with EGL where a trial
    in another process shows that it works on a graphics card"""
    views_per_scene: int = 8
    """pairs rendered of one scene; train, val and test share no scene"""
    trajectory: bool = False
    """the views of a scene are a drive over it, in order, instead of places all over it; poses also as
    trajectory.txt"""
    drive: TrajectoryConfig = field(default_factory=TrajectoryConfig)
    view: ViewConfig = field(default_factory=ViewConfig)
    sensor: SensorConfig = field(default_factory=SensorConfig)

    def __post_init__(self) -> None:
        for name, least in (("pairs", 1), ("workers", 1), ("views_per_scene", 1), ("seed", 0)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} must be at least {least}, got {getattr(self, name)}")
        if self.pairs > MOST_PAIRS:
            raise ValueError(f"pairs must be at most {MOST_PAIRS}, got {self.pairs}")
        if self.rasterizer != AUTO and self.renderer != "pybullet":
            raise ValueError(f"rasterizer {self.rasterizer} draws for --renderer pybullet, not for {self.renderer}")
        if not self.trajectory and self.drive != TrajectoryConfig():
            given = [name for name, value in vars(self.drive).items() if value != getattr(TrajectoryConfig(), name)]
            raise ValueError(f"--drive.{given[0].replace('_', '-')} says how a drive goes, which needs --trajectory")


@dataclass(frozen=True, kw_only=True)
class GenerateConfig(RunConfig):
    """What a dataset is made of.

    scenes: the scenes of the dataset are drawn from these by turns. rig: the cameras. The rest is RunConfig's.
    """

    scenes: tuple[SceneConfig, ...] = (preset(PRESETS[0]),)
    rig: StereoRig = NATECAM

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.scenes:
            raise ValueError("scenes must hold one config or more")
        camera = self.rig.camera
        if (focal := min(camera.fx, camera.fy)) < 1:
            raise ValueError(f"`rig.focal`, or fx and fy of a rig file, must be at least 1 px, got {focal}; in metres?")
        if camera.width * camera.height > MOST_PIXELS:
            raise ValueError(
                f"`rig.width` times `rig.height`, or those of a rig file, must be at most {MOST_PIXELS} px, "
                f"got {camera.width} x {camera.height}"
            )

    @property
    def place(self) -> str:
        """The preset that the scenes are after, or "mixed"."""
        names = {scene.preset for scene in self.scenes}
        return names.pop() if len(names) == 1 else MIXED

    def content(self) -> dict[str, Any]:
        """What decides the content of each sample: all but the folder, the number of pairs and who renders them.

        A heightmap counts by its SHA-256, wherever it lies; the version of marssim counts too.
        """
        left_out = ("out", "pairs", "workers", "scheduler", "rig", "scenes")
        content = {name: value for name, value in asdict(self).items() if name not in left_out}
        if not self.trajectory:
            del content["drive"]
        if self.rasterizer != EGL:  # TinyRenderer draws alike everywhere
            del content["rasterizer"]
        scenes = [asdict(scene) for scene in self.scenes]  # in the order that they are drawn from
        for scene in scenes:
            del scene["relief"]["heightmap"]
        return {"marssim": VERSION, **content, "scene": self.place, "scenes": scenes, "rig": self.rig.to_dict()}

    def scene_config(self, scene: int) -> SceneConfig:
        """The config that a scene of the dataset is drawn from; it follows from the seed and the scene alone.

        Of n configs, each block of n scenes has every one once, in an order that the seed decides. From block to block
        each takes the place of the next, so that within n lcm(n, 10) scenes (50 of five) every one of the ten places
        that decide the split (dataset.split_of) has each config equally often: so have train, val and test.
        """
        n = len(self.scenes)
        cycle, within = divmod(scene, n * math.lcm(n, len(SPLIT_OF_TEN)))
        rng = np.random.default_rng((self.seed, MIXTURE, cycle))
        order, start = rng.permutation(n), rng.permutation(n)
        return self.scenes[order[(start[within % n] + within // n) % n]]


@dataclass(frozen=True)
class RigOptions:
    """Two equal cameras, side by side; NaTeCam's values by default."""

    width: int = NATECAM.camera.width
    """width of each image [px]"""
    height: int = NATECAM.camera.height
    """height of each image [px]"""
    focal: float = NATECAM.camera.fx
    """focal length [px]"""
    focal_y: float | None = None
    """vertical focal length [px] of pixels that are not square; default: as --rig.focal"""
    baseline: float = NATECAM.baseline
    """distance of the two eyes [m]"""
    cx: float | None = None
    """principal point, column [px], 0 is the middle of the first pixel; default: the image's middle"""
    cy: float | None = None
    """principal point, row [px]; default: the image's middle"""

    def __post_init__(self) -> None:
        self.rig()  # says what is out of range

    def rig(self) -> StereoRig:
        """As a StereoRig. Raises ValueError that names the field."""
        for name in ("width", "height", "focal", "focal_y", "baseline"):
            value = getattr(self, name)
            if value is not None and not 0 < value < float("inf"):
                raise ValueError(f"{name} must be positive, got {value}")
        focal_y = self.focal if self.focal_y is None else self.focal_y
        cx = (self.width - 1) / 2 if self.cx is None else self.cx
        cy = (self.height - 1) / 2 if self.cy is None else self.cy
        return StereoRig(PinholeCamera(self.width, self.height, self.focal, focal_y, cx, cy), self.baseline)


@dataclass(frozen=True)
class SceneOptions(SceneConfig):
    """The scene's knobs as flags; which preset they start from is said by --scene."""

    preset: tyro.conf.Suppress[str] = PRESETS[0]


@dataclass(frozen=True, kw_only=True)
class GenerateOptions(RunConfig):
    """Generate stereo pairs of Mars with exact depth, normals and masks."""

    scene: Annotated[str, tyro.conf.arg(metavar=f"{PLACE_VALUES}|{MIXED}")] = PRESETS[0]
    """Place on Mars that the terrain is modelled on: a preset (listed from few rocks to many), a JSON file of your own
    place, or mixed, which takes the presets in turn so that train, val and test hold each equally often. `--scene NAME
    --help` shows the values of that place as the defaults of --rocks, --relief and --look (those of utopia for mixed).
    Values that you give replace those of the place, or of each place of mixed."""
    knobs: Annotated[SceneOptions, tyro.conf.arg(name="")] = field(default_factory=SceneOptions)
    rig: RigOptions = field(default_factory=RigOptions)
    rig_file: Path | None = None
    """JSON file of the cameras instead of --rig: width, height, fx, fy, cx, cy [px], baseline [m]"""


def parse_generate(prog: str, description: str | None, args: Sequence[str] | None = None) -> GenerateConfig:
    """The config that a command line asks for. Raises ValueError of one line that names the flag, OSError."""
    args = sys.argv[1:] if args is None else args
    asked = named_scene(args)
    places = tuple(map(preset, PRESETS)) if asked == MIXED else (load_place(asked),)
    defaults = [GenerateOptions(out=tyro.MISSING, scene=asked, knobs=_options(place)) for place in places]
    options = [parse(GenerateOptions, prog, description, args, default) for default in defaults]
    first = options[0]
    scenes = tuple(SceneConfig(**{f.name: getattr(o.knobs, f.name) for f in fields(SceneConfig)}) for o in options)
    rig = first.rig.rig()
    if first.rig_file is not None:
        if rig != NATECAM:
            raise ValueError(f"--rig-file {first.rig_file}: not together with --rig.*")
        rig = read_rig(first.rig_file)
    run = {f.name: getattr(first, f.name) for f in fields(RunConfig)}
    return GenerateConfig(**run, scenes=scenes, rig=rig)


def read_rig(path: Path) -> StereoRig:
    """Read StereoRig.to_dict's form. Raises DatasetError, one line, that names the file, and the field."""
    try:
        content = read_json(path)
        if unknown := sorted(set(content) - set(NATECAM.to_dict())):
            raise DatasetError(f"{path}: unknown field {', '.join(unknown)}; a rig has {', '.join(NATECAM.to_dict())}")
        return StereoRig.from_dict(content)
    except DatasetError as error:
        raise DatasetError(f"--rig-file {error}") from None
    except ValueError as error:
        raise DatasetError(f"--rig-file {path}: {error}") from None


def named_scene(args: Sequence[str]) -> str:
    """Return the last value of --scene on a command line; that of the default place if there is none."""
    values = re.findall(r"(?:^|\0)--scene[=\0](?!-)([^\0]*)", "\0".join(args))
    return values[-1] if values else PRESETS[0]


def _options(place: SceneConfig) -> SceneOptions:
    return SceneOptions(**{f.name: getattr(place, f.name) for f in fields(SceneConfig)})
