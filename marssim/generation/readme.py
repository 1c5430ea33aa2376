"""README.md of a dataset: what it holds, the command that makes it, and how its files are read."""

from __future__ import annotations

from collections import Counter

from marssim.base.command.wording import counted
from marssim.base.dataset.dataset import SPLITS, StereoDataset
from marssim.base.version import VERSION
from marssim.generation.command_line import command_flags
from marssim.generation.config import GenerateConfig
from marssim.inspection.integrity import CALIBRATION
from marssim.scene.trajectory import TRAJECTORY


def dataset_readme(config: GenerateConfig, dataset: StereoDataset) -> str:
    """Return the page in Markdown.

    Args:
        config: The settings of the dataset.
        dataset: The dataset, whole.
    """
    drive = f"\nThe views of a scene follow a drive. Its poses are also in `scenes/<scene>/{TRAJECTORY}` (TUM format)."
    drive = drive if config.trajectory else ""
    datum = """\nHeights are metres above
the ground in the middle of each scene. In `sample.json`, `heightmap` has the place of this middle in the heightmap
(`at`: metres east and north of the heightmap's middle) and its height there (`datum` in metres: the height of a point
in the file is its height in the scene plus `datum`, minus the height that the tilt of `regional_slope_deg` adds
there)."""
    datum = datum if any(scene.relief.heightmap for scene in config.scenes) else ""
    raw = f"""\n
`raw_left.png` and `raw_right.png` are the pair before rectification, and `{CALIBRATION}` has its calibration in every
form that holds these lenses. `m3depth.rectify --shift 0` makes of it the view of `left.png` and of the truth."""
    raw = raw if config.raw else ""
    flags = command_flags(config, elsewhere=True)
    command = f"\nMade by\n\n    python -m marssim.generate --out DIR {flags}\n" if flags is not None else ""
    return f"""# Mars stereo dataset

{counted(len(dataset), "stereo pair")} ({pairs_by_split(dataset)}; split by
scene), scene `{config.place}`, seed {config.seed}, rendered with {config.renderer}.
{command}
![contact sheet](contact_sheet.png)

Read it in Python with

    from marssim.dataset import StereoDataset
    sample = StereoDataset("DIR", split="train")[0]
    sample.left, sample.right, sample.depth, sample.disparity, sample.normal

Each sample has a folder `scenes/<scene>/<view>/` with these files. Maps are those of the left eye.

| File | Content |
|---|---|
| `left.png`, `right.png` | 8-bit RGB images |
| `depth.png` | 16-bit depth along the optical axis: Z = 0.1 m * 10000^(code / 65534); 65535 is the sky |
| `normal.png` | 16-bit RGB, unit normal n = 2 code / 65535 - 1; camera frame: x right, y down, z forward |
| `surface.png` | 16-bit: 0 is the sky, 1 the ground, from 2 on what stands out of it, rocks first; 65535 is the rover |
| `occluded.png` | 8-bit: 255 where the point is hidden from the right eye or outside its image |
| `sample.json` | cameras, pose, parameters and draws of the scene, its sensors, SHA-256 of each image |

`sample.disparity` is what the images show. It is computed from the depth and from `right_rotation` in `sample.json`,
the small rotation of the right camera that `--sensor.vertical-offset`, `--sensor.horizontal-offset` and
`--sensor.rotation-deg` drew.
{drive}{datum}{raw}
The images are rendered by mars-m3depth {VERSION}, not taken on Mars; its data card says what they are not fit for. Its
licence puts no condition on them.

`dataset.json` lists all samples with the SHA-256 of their `sample.json`; `python -m marssim.verify DIR` checks them.

Digest of all samples: `{dataset.digest}`
"""


def pairs_by_split(dataset: StereoDataset) -> str:
    """Return how many pairs each split holds, in words."""
    counts = Counter(sample["split"] for sample in dataset.index["samples"])
    return ", ".join(f"{name} {counts[name]}" for name in SPLITS)
