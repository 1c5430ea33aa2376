"""Measure how little texture an image has: the analysis behind the paper's first inspiration (Sec. III-A).

    python -m m3depth.texture real/NLB*.jpeg --beside data/gale --out out/texture

The paper gives two figures, for one image of Mars and one of Earth: the entropy of local binary patterns, about 3.1 and
3.7 bits, and the share of the Fourier energy above 0.1 f_max, under 5 % and 32 %. It does not define them. Ours are
those of the whole grey image (Rec. 601), sky and frame included, in 8 bits. 16-bit images are scaled as m3depth.predict
scales them, so that one pixel in a thousand is white:

    lbp_riu2    [bits] entropy of the histogram of rotation-invariant uniform patterns of 8 neighbours on a circle of
                radius 1 px, bilinear; a neighbour counts if it is at least as bright as the middle (Ojala et al. 2002):
                10 labels, at most 3.32 bits
    lbp_codes   [bits] the same of the 256 plain codes, at most 8 bits
    high        share of the energy |DFT|^2 at radial frequencies above 0.1 f_max, f_max = 0.5 cycles/px, of the image
                without its mean
    high_dc     the same with the mean, which makes it far smaller
    high_hann   the same without the mean and times a Hann window, which removes the jump from one border to the
                opposite one

Three more say what a stereo method has to work with:

    poor        share of the pixels around which the grey levels vary by less than 2.5 (standard deviation in 9 x 9 px),
                the noise of a camera; m3depth.evaluate scores them apart as texture_poor
    gradient    [grey levels / px] median length of the gradient (Sobel)
    slope       exponent a of the power spectrum f^-a, fitted to its means over rings from 0.02 to 0.35 cycles/px, with
                the Hann window; about 2 in photographs (Field 1987), larger is smoother. None for an image of one tone
                or of less than 50 px

The paper's definition must be another one: 10 labels cannot give 3.7 bits, and 256 codes of 3.1 bits would mean little
more than one tone. The figures compare images with each other; none is a target. All but the entropies change much with
the angle that a pixel covers, and all with how the grey levels were stretched, so compare images that are alike in
both. The command writes texture.json and texture.png.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from m3depth.datasets.image_files import in_eight_bits, read_image
from m3depth.evaluation.metrics import texture_poor
from m3depth.figures.texture import GRADIENTS, TextureExample, gradient_shares, texture_figure
from m3depth.stereo.pairs import in_grey, spread
from marssim.base.command.run import run_command
from marssim.base.command.wording import STARTS_OVER, counted
from marssim.base.dataset.dataset import StereoDataset
from marssim.base.files.json_file import write_json
from marssim.base.images.texture import entropy, gradient, local_binary_patterns, uniform_labels
from marssim.base.results.claim import ResultFolder

HIGH = 0.1  # border of the high frequencies, as a share of F_MAX
F_MAX = 0.5  # [cycles/px] highest frequency along a row or column
PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")  # endings of image files in a folder
MEASURES = ("lbp_riu2", "lbp_codes", "high", "high_dc", "high_hann", "poor", "gradient", "slope")  # as above
FITTED = (0.02, 0.35)  # [cycles/px] frequencies between which the slope is fitted
RINGS = 12  # of frequencies, in equal ratios, whose mean powers are fitted
LEAST_SIDE = round(1 / FITTED[0])  # [px] of an image in which the lowest of these frequencies is one wave
PAPER = "3.1 bits, < 5 % (Mars); 3.7 bits, 32 % (Earth)"  # the paper's figures


@dataclass(frozen=True)
class TextureOptions:
    """Measure the entropy of local binary patterns, the high frequencies and the contrast of images."""

    images: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="IMAGES")]
    """Image files, folders of images, or datasets of marssim.generate, whose left images are measured."""
    out: Path
    """Folder to write texture.json and texture.png to."""
    beside: tuple[Path, ...] = ()
    """Images to compare them with: files, folders or datasets likewise."""
    names: tuple[str, str] = ("images", "beside")
    """Names of the two groups in the table and the figure."""
    limit: int = 50
    """Largest number of images of each folder or dataset, 1 or more, spread evenly over it."""

    def __post_init__(self) -> None:
        if self.limit < 1:
            raise ValueError(f"limit must be at least 1, got {self.limit}")
        if not self.images:
            raise ValueError("IMAGES: name at least one image file, folder or dataset")
        if len(set(self.names)) < len(self.names):
            raise ValueError(f"names must differ, got {self.names[0]!r} twice")


def power_spectrum(grey: np.ndarray, hann: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Return |DFT|^2 of an image without its mean, and the radial frequency of each coefficient.

    Args:
        grey: (H, W) image.
        hann: Whether the image is multiplied by a Hann window first.

    Returns:
        (H, W) power and (H, W) frequency [cycles/px], in the order of np.fft.
    """
    image = grey.astype(np.float64)
    image -= image.mean()
    if hann:
        image *= np.outer(np.hanning(image.shape[0] + 2)[1:-1], np.hanning(image.shape[1] + 2)[1:-1])
    rows, columns = (np.fft.fftfreq(n) for n in image.shape)
    return np.abs(np.fft.fft2(image)) ** 2, np.hypot(rows[:, None], columns[None, :])


def high_share(power: np.ndarray, frequency: np.ndarray, extra: float = 0.0) -> float:
    """Return the share of the energy above HIGH * F_MAX; 0 for an image of one tone.

    Args:
        power: (H, W) power spectrum.
        frequency: (H, W) radial frequency [cycles/px].
        extra: Energy that is added to the sum of all.
    """
    total = float(power.sum()) + extra
    return float(power[frequency > HIGH * F_MAX].sum()) / total if total > 0 else 0.0


def spectral_slope(power: np.ndarray, frequency: np.ndarray) -> float | None:
    """Return the exponent a of a power spectrum f^-a, by least squares in logarithms over RINGS.

    Args:
        power: (H, W) power spectrum.
        frequency: (H, W) radial frequency [cycles/px].

    Returns:
        The exponent; None where the frequencies of a ring have no power, or a side is shorter than LEAST_SIDE.
        In small images, some rings hold no frequency and are left out.
    """
    if min(power.shape) < LEAST_SIDE:
        return None
    ring = np.digitize(frequency.ravel(), np.geomspace(*FITTED, RINGS + 1))
    inside = (ring > 0) & (ring <= RINGS)
    ring, logarithm = ring[inside] - 1, np.log(frequency.ravel()[inside])
    count = np.bincount(ring, minlength=RINGS)
    total = np.bincount(ring, power.ravel()[inside], RINGS)
    held = count > 0
    if not (total[held] > 0).all():
        return None
    middle = np.bincount(ring, logarithm, RINGS)[held] / count[held]
    return float(-np.polyfit(middle, np.log(total[held] / count[held]), 1)[0])


def measure(grey: np.ndarray) -> dict[str, float | None]:
    """Return the figures of an image, (H, W) uint8, by name.

    Raises:
        ValueError: The image is smaller than 3 x 3 pixels.
    """
    if min(grey.shape) < 3:
        raise ValueError(f"is {grey.shape[1]} x {grey.shape[0]}: at least 3 x 3 pixels are needed")
    codes = local_binary_patterns(grey)
    power, frequency = power_spectrum(grey)
    constant = (grey.astype(np.float64).mean() * grey.size) ** 2
    windowed = power_spectrum(grey, hann=True)
    return {
        "lbp_riu2": entropy(uniform_labels()[codes]),
        "lbp_codes": entropy(codes),
        "high": high_share(power, frequency),
        "high_dc": high_share(power, frequency, constant),
        "high_hann": high_share(*windowed),
        "poor": float(texture_poor(grey).mean()),
        "gradient": float(np.median(gradient(grey))),
        "slope": spectral_slope(*windowed),
    }


def find_images(paths: Sequence[Path], limit: int) -> Iterator[tuple[str, np.ndarray]]:
    """Yield name and (H, W) uint8 grey image of each image, once; 16-bit images are scaled as by read_pair.

    Args:
        paths: Image files, folders of images, or datasets.
        limit: Largest number of images of a folder or dataset.

    Raises:
        FileNotFoundError: There is no such file or folder.
        ValueError: A file is no image, or a folder holds none; the message names it.
    """
    read: set[Path] = set()
    for path in paths:
        if (path / "dataset.json").is_file():
            dataset = StereoDataset(path)
            for i in spread(len(dataset), limit):
                yield f"{path}/{dataset.names[i]}", in_grey(dataset[i].left)
            continue
        if not path.exists():
            raise FileNotFoundError(f"{path}: no such file or folder")
        files = sorted(p for p in path.iterdir() if p.suffix.lower() in PICTURES) if path.is_dir() else [path]
        if not files:
            raise ValueError(f"{path}: holds no images ({', '.join(PICTURES)}) and no dataset")
        for i in spread(len(files), limit):
            if files[i].resolve() in read:  # given by itself, and with its folder
                continue
            read.add(files[i].resolve())
            (image,) = in_eight_bits(read_image(files[i]))
            yield str(files[i]), in_grey(image)


def analyse(options: TextureOptions) -> dict[str, Any]:
    """Measure both groups, write texture.json and texture.png, and return the content of the first."""
    with ResultFolder(options.out, "comparison").claim():
        return _analyse(options)


def _analyse(options: TextureOptions) -> dict[str, Any]:
    groups: dict[str, Any] = {}
    examples = []
    for name, paths in zip(options.names, (options.images, options.beside), strict=True):
        records: list[dict[str, Any]] = []
        shares = np.zeros(len(GRADIENTS))
        for file, grey in find_images(paths, options.limit):
            try:
                records.append({"image": file, **measure(grey)})
            except ValueError as error:
                raise ValueError(f"{file}: {error}") from None
            shares += gradient_shares(grey)
            if len(records) == 1:
                codes = local_binary_patterns(grey)
                spectrum, frequency = power_spectrum(grey)
                examples.append(TextureExample(name, grey, codes, spectrum, frequency, shares))
        if records:
            shares /= len(records)  # in place: the example holds them
            mean = {key: _mean([record[key] for record in records]) for key in MEASURES}
            groups[name] = {"count": len(records), "mean": mean, "images": records}
    content = {"paper": PAPER, "groups": groups}
    write_json(options.out / "texture.json", content, sort_keys=False)
    texture_figure(examples, groups, HIGH * F_MAX, options.out / "texture.png")
    return content


def _mean(values: Sequence[float | None]) -> float | None:
    """Return the mean of the values that are there; None without any."""
    numbers = [value for value in values if value is not None]
    return float(np.mean(numbers)) if numbers else None


def main(args: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit code: 2 for a mistake of the user."""
    return run_command(_work, TextureOptions, "python -m m3depth.texture", __doc__, args, STARTS_OVER)


def _work(options: TextureOptions) -> None:
    content = analyse(options)
    width = max(len(name) for name in content["groups"])
    for name, group in content["groups"].items():
        m = group["mean"]
        print(
            f"{name:<{width}}  {counted(group['count'], 'image'):>9}  LBP {m['lbp_riu2']:.2f} bits of 10 labels, "
            f"{m['lbp_codes']:.2f} of 256 codes; energy above 0.1 f_max {m['high']:.1%}, with the mean "
            f"{m['high_dc']:.1%}, windowed {m['high_hann']:.1%}; poor in texture {m['poor']:.1%}, gradient "
            f"{m['gradient']:.2f}, slope {'-' if m['slope'] is None else format(m['slope'], '.2f')}"
        )
    print(f"{'paper':<{width}}  {'':>9}  {content['paper']}")
    print(f"definitions: --help; {options.out / 'texture.png'}")


if __name__ == "__main__":
    sys.exit(main())
