"""Makes a blind comparison of real and rendered ground: numbered grey crops, shuffled, and the key to them.

    python docs/blind_comparison.py --images real --out blind/draw1 --key blind/key1.json --seed 1

The folder of real images holds the files that FRAMES names, as the Planetary Data System and the raw image pages of
Curiosity publish them (NASA/JPL-Caltech). A real crop is cut from ground with stones. A rendered crop has the focal
length, the height and direction of view, the light and the place in the image of a real one, and stones too. Both have
the same tone: the square root of light, stretched between the same percentiles, and the same JPEG at the end. Whoever
labels the crops must have seen neither set, and gets the folder without the key.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import tyro

from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.dataset.frame import GROUND, SKY
from marssim.base.files.json_file import write_json
from marssim.inspection.image_statistics import linear
from marssim.render.sensor import Sensor, SensorConfig
from marssim.render.view import SceneRenderer
from marssim.scene.presets import Place, preset
from marssim.scene.scene import build_scene
from marssim.scene.viewpoint import ViewConfig, draw_pose

SIDE = 200  # [px] width and height of a crop
STONES = (0.02, 0.6)  # share of a rendered crop that rocks and slabs cover
STRETCH = (0.5, 99.5)  # [%] percentiles of a crop that become black and white
QUALITY = 90  # of the JPEG that all crops go through
OVERLAP = 0.3  # largest share of a real crop that another one shows, too
TRIES = 300
COLUMNS, ENLARGED = 5, 300  # of the contact sheet, [px]


@dataclass(frozen=True)
class Frame:
    """A real image, and how a rendered image shows ground as it does.

    Attributes:
        file: Name of the file.
        place: Name of the preset of the place where it was taken.
        size: Width and height [px].
        focal: Focal length [px].
        height: Distance of the camera from the plane of the ground [m].
        pitch_deg: Angle between the optical axis and that plane [deg], LOW HIGH.
        sun_elevation_deg: Height of the sun above that plane [deg], LOW HIGH.
        sun_left_deg: Direction of the sun, to the left of the direction of view [deg], LOW HIGH.
        regions: Left, top, right and bottom border [px] of parts that are ground with stones wherever a crop lies.
        psf: Standard deviation of the point spread function [px], LOW HIGH.
        grain: Standard deviation of the grain over the code, LOW HIGH, as smooth parts of the real image have it.
        hot_pixels: Hot pixels in a million, LOW HIGH.
    """

    file: str
    place: Place
    size: tuple[int, int]
    focal: float
    height: float
    pitch_deg: tuple[float, float]
    sun_elevation_deg: tuple[float, float]
    sun_left_deg: tuple[float, float]
    regions: tuple[tuple[int, int, int, int], ...]
    psf: tuple[float, float]
    grain: tuple[float, float]
    hot_pixels: tuple[float, float] = (0.0, 0.0)


FRAMES = (
    # Curiosity, sand between slabs; the sun's height is not known, but by its shadows
    Frame(
        "NLB_517071516EDR_F0541490CCAM15900M1_8bit.png", "gale", (1024, 1024), 1220.0, 1.9, (33.0, 37.0), (35.0, 60.0),
        (50.0, 110.0), ((8, 8, 1016, 260), (8, 350, 230, 910)), (0.5, 0.6), (0.035, 0.05), (200.0, 600.0),
    ),
    # Curiosity, sol 1431: a slope below a cliff, which the camera looks up to
    Frame(
        "NLB_524534514EDR_F0562034NCAM00280M_.jpeg", "gale", (1024, 1024), 1220.0, 4.0, (3.0, 6.0), (30.0, 55.0),
        (50.0, 110.0), ((8, 730, 1016, 1016),), (0.5, 0.6), (0.035, 0.05), (200.0, 600.0),
    ),
    # Perseverance, sol 709: slabs; its label has the sun 80 deg high, and the camera's model and direction
    Frame(
        "NLMV0709_0729882743_168RAD_N0332841TRAV00262_0A02LLJ01.IMG", "jezero", (1280, 960), 740.0, 2.0, (27.0, 30.0),
        (77.0, 83.0), (20.0, 60.0), ((20, 140, 1060, 600), (230, 560, 1180, 790), (1060, 200, 1270, 700)),
        (0.5, 0.6), (0.006, 0.012),
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Options:
    """Writes numbered grey crops of real and of rendered ground, shuffled, and the key to them."""

    images: Path
    """Folder with the real images."""
    out: Path
    """Folder to write the crops to, as 01.png and so on, and the contact sheet beside it, with its name and .png."""
    key: Path
    """JSON file to write what each crop is to; it must lie outside of the folder."""
    seed: int = 1
    """Seed of the draw."""
    crops: int = 20
    """Number of crops, half of them real."""


def main(options: Annotated[Options, tyro.conf.arg(name="")]) -> None:
    if options.out.resolve() in options.key.resolve().parents:
        raise SystemExit(f"--key {options.key} lies in the folder of the crops; give it a place outside of it")
    rng = np.random.default_rng(options.seed)
    half = options.crops // 2
    turn = [FRAMES[n % len(FRAMES)] for n in rng.permutation(half)]
    crops = real_crops(options.images, turn, rng)
    for frame in turn:
        crops.append(rendered_crop(frame, int(rng.integers(2**31))))
    order = rng.permutation(len(crops))
    options.out.mkdir(parents=True, exist_ok=True)
    for number, n in enumerate(order, 1):
        cv2.imwrite(str(options.out / f"{number:02d}.png"), crops[n][0])
    write_json(options.key, {f"{number:02d}": crops[n][1] for number, n in enumerate(order, 1)})
    sheet = contact_sheet([crops[n][0] for n in order])
    cv2.imwrite(str(options.out.with_name(options.out.name + ".png")), sheet)


def real_crops(folder: Path, turn: list[Frame], rng: np.random.Generator) -> list[tuple[np.ndarray, dict]]:
    """Return a crop of each frame and what it is; crops of a frame hardly overlap."""
    out, taken = [], []
    for frame in turn:
        light = real_light(folder / frame.file)
        for _ in range(TRIES):
            x, y = window(frame, rng)
            part = light[y : y + SIDE, x : x + SIDE]
            others = [place for name, *place in taken if name == frame.file]
            if (part > 0).all() and max([overlap((x, y), other) for other in others], default=0) <= OVERLAP:
                break
        else:
            raise SystemExit(f"{frame.file}: has no room for so many crops")
        taken.append((frame.file, x, y))
        out.append((toned(part), {"real": True, "image": frame.file, "x": x, "y": y}))
    return out


def window(frame: Frame, rng: np.random.Generator) -> tuple[int, int]:
    """Return the left and the top border of a crop of a frame; all its places are equally likely."""
    room = np.array([(right - left - SIDE, bottom - top - SIDE) for left, top, right, bottom in frame.regions])
    n = rng.choice(len(room), p=room.prod(axis=1) / room.prod(axis=1).sum())
    x, y = np.array(frame.regions[n][:2]) + rng.integers(room[n] + 1)
    return int(x), int(y)


def overlap(one, other) -> float:
    """Return the share of a crop that another one shows, too; both by left and top border [px]."""
    across, down = (max(SIDE - abs(a - b), 0) for a, b in zip(one, other, strict=True))
    return across * down / SIDE**2


def real_light(path: Path) -> np.ndarray:
    """Return the light of a real image, (H, W) float, up to a factor; 0 has no data.

    Cameras code 12 bits as the square root in 8 bits, which public images stretch. Calibrated products are linear.
    """
    if path.suffix.upper() == ".IMG":
        return pds_image(path)
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise SystemExit(f"{path}: no such image")
    return (np.maximum(image, 0.5) / 255) ** 2


def pds_image(path: Path) -> np.ndarray:
    """Return a PDS3 image of 16 bits with an attached label, (H, W) float, the mean of its bands."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SystemExit(f"{path}: {error.strerror}") from None
    label = data[:100_000].decode("latin-1")
    described = re.search(r"^OBJECT\s*= IMAGE\s*$(.*?)^END_OBJECT\s*= IMAGE\s*$", label, re.DOTALL | re.MULTILINE)
    if described is None:
        raise SystemExit(f"{path}: has no PDS3 label with an IMAGE")

    def number(name: str, text: str) -> int:
        value = re.search(rf"^\s*{re.escape(name)}\s*= (\d+)\s*$", text, re.MULTILINE)
        if value is None:
            raise SystemExit(f"{path}: field {name} is missing in the label")
        return int(value[1])

    shape = tuple(number(name, described[1]) for name in ("BANDS", "LINES", "LINE_SAMPLES"))
    if number("SAMPLE_BITS", described[1]) != 16 or "MSB_INTEGER" not in described[1]:
        raise SystemExit(f"{path}: only MSB_INTEGER of 16 bits can be read")
    start = (number("^IMAGE", label) - 1) * number("RECORD_BYTES", label)
    return np.frombuffer(data, ">i2", int(np.prod(shape)), start).reshape(shape).mean(axis=0)


def rendered_crop(frame: Frame, seed: int) -> tuple[np.ndarray, dict]:
    """Return a crop of a frame's place as the frame would show it, and what it is."""
    rng = np.random.default_rng(seed)
    yaw = rng.uniform(0, 360)
    sun = rng.uniform(*frame.sun_elevation_deg), yaw + rng.uniform(*frame.sun_left_deg)
    scene = build_scene(preset(frame.place), rng).with_sun(*sun)
    view = ViewConfig((frame.height, frame.height), frame.pitch_deg, (-3.0, 3.0), (yaw, yaw))
    faults = SensorConfig(psf=frame.psf, hot_pixels=frame.hot_pixels)
    whole = StereoRig(PinholeCamera.centred(*frame.size, frame.focal), 0.42)
    x, y = window(frame, rng)
    with SceneRenderer(scene, rig=whole.cropped(x, y, SIDE, SIDE)) as renderer:
        for _ in range(TRIES):
            pose = draw_pose(scene, view, rng)
            drawn = renderer.render_from(pose, Sensor.draw(faults, rng), rng)
            stones = np.mean((drawn.surface != SKY) & (drawn.surface != GROUND))
            if STONES[0] <= stones <= STONES[1] and not (drawn.surface == SKY).any():
                break
        else:
            raise SystemExit(f"{frame.place}: no view with stones and without sky in {TRIES} tries")
    grey = cv2.cvtColor(drawn.left, cv2.COLOR_RGB2GRAY)
    grain = rng.uniform(*frame.grain) * rng.standard_normal(grey.shape)
    return toned(linear(grey), grain), {
        "real": False,
        "place": frame.place,
        "as": frame.file,
        "seed": seed,
        "x": x,
        "y": y,
    }


def toned(light: np.ndarray, grain: np.ndarray | float = 0.0) -> np.ndarray:
    """Return light as an 8-bit image: its square root, stretched, with grain as a share of the code, after JPEG."""
    root = np.sqrt(light)
    low, high = np.percentile(root, STRETCH)
    codes = np.clip(255 * (root - low) / max(high - low, 1e-9) * (1 + grain), 0, 255).round().astype(np.uint8)
    coded = cv2.imencode(".jpg", codes, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1]
    return cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE)


def contact_sheet(crops: list[np.ndarray]) -> np.ndarray:
    """Return all crops, enlarged, with their numbers."""
    tiles = []
    for number, crop in enumerate(crops, 1):
        tile = cv2.resize(crop, (ENLARGED, ENLARGED), interpolation=cv2.INTER_CUBIC)
        cv2.rectangle(tile, (0, 0), (34, 22), 0, -1)
        cv2.putText(tile, str(number), (4, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.6, 255, 1, cv2.LINE_AA)
        tiles.append(cv2.copyMakeBorder(tile, 2, 2, 2, 2, cv2.BORDER_CONSTANT, value=255))
    tiles += [np.full_like(tiles[0], 255)] * (-len(tiles) % COLUMNS)
    return np.vstack([np.hstack(tiles[n : n + COLUMNS]) for n in range(0, len(tiles), COLUMNS)])


if __name__ == "__main__":
    main(tyro.cli(Options))
