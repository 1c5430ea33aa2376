"""Statistics of a dataset's samples: depth, disparity, sky, occlusion, texture, rocks and sun.

Definitions. The pixels of the left images of all samples are pooled; a share is one of all of them unless it names
another whole.

within 15 m     Pixels of a depth of 15 m or less. One share is of all pixels, where the sky counts as farther, the
                other of the pixels that are not sky. The paper (Sec. V-B, figure on the dataset) gives about 90 % and
                does not tell which share it means.
valid           Pixels of a depth from 0.5 m to 15 m, on which methods are trained and scored.
occluded        Share of the pixels that are not sky: those hidden from the right eye or outside its image.
rock            Share of the pixels up to 15 m. Rocks are seen from the side, so that it is more than the share of the
                ground that they cover.
cover           Share of the ground under rocks of a diameter and more; see marssim/inspection/visible_rocks.py.
gradient        Mean length of the grey image's Sobel gradient [grey levels / px] where it does not show the sky.
LBP entropy     Shannon entropy [bits] of uniform, rotation-invariant local binary patterns of 8 points on a circle of
                1 px (10 classes, so at most 3.32; Ojala et al. 2002) outside the sky; mean over the samples.
ground          Contrast by octave of wavelength and slope of the spectrum, its direction (of all octaves but the
                longest), peakedness and shade, in windows of the left image that show only ground up to NEAR_GROUND;
                see marssim/inspection/image_statistics.py. Mean over the samples that have such windows.
edge width      Median over the strongest clean edges of a left image, see there; of the samples that have such edges.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from marssim.base.camera import MAX_DEPTH, MIN_DEPTH
from marssim.base.dataset.sample import StereoSample
from marssim.base.images.texture import gradient, lbp_entropy
from marssim.inspection.image_statistics import BAND_EDGES, GroundTexture, edge_widths, ground_texture, linear
from marssim.inspection.visible_rocks import RockCover

DEPTH_STEP, DEPTH_END = 0.25, 100.0  # bin and end of the depth histogram [m]; the last bin has all that is farther
NETWORK_DISPARITY = 192.0  # largest disparity that common networks search [px]
NEAR_GROUND = 8.0  # farthest ground whose texture counts [m]


@dataclass
class SampleStatistics:
    """Sums and lists over samples, from which `report` makes the statistics.

    Attributes:
        samples: Number of samples.
        pixels: Number of pixels of their left images.
        sky: Pixels that show the sky.
        occluded: Pixels, not of sky, that are hidden from the right eye or outside its image.
        valid: Pixels of valid depth.
        within: Pixels up to MAX_DEPTH.
        rock: Pixels of rocks up to MAX_DEPTH.
        beyond_network: Valid pixels of NETWORK_DISPARITY and more.
        depth: Histogram of depth, number of pixels in bins of DEPTH_STEP.
        disparity: Histogram of the disparity of valid pixels, in bins of 1 px.
        disparity_range: Least and largest disparity of valid pixels [px].
        gradients: Mean gradient of each sample that shows more than sky [grey levels / px].
        lbp: LBP entropy of each of those [bits].
        ground: Texture of the ground of each sample that has windows of ground.
        edge_width: Median width of edges of each sample that has any [px].
        sun_elevation_deg: Elevation of the sun in each sample that notes it [deg].
        asked_k: Rock abundance that each scene was asked for, where the sample notes it.
        presets: Number of samples by scene preset.
        cover: Rocks and ground of the samples that note their rock abundance.
    """

    samples: int = 0
    pixels: int = 0
    sky: int = 0
    occluded: int = 0
    valid: int = 0
    within: int = 0
    rock: int = 0
    beyond_network: int = 0
    depth: np.ndarray = field(default_factory=lambda: np.zeros(round(DEPTH_END / DEPTH_STEP), dtype=np.int64))
    disparity: np.ndarray = field(default_factory=lambda: np.zeros(1, dtype=np.int64))
    disparity_range: tuple[float, float] = (np.inf, 0.0)
    gradients: list[float] = field(default_factory=list)
    lbp: list[float] = field(default_factory=list)
    ground: list[GroundTexture] = field(default_factory=list)
    edge_width: list[float] = field(default_factory=list)
    sun_elevation_deg: list[float] = field(default_factory=list)
    asked_k: list[float] = field(default_factory=list)
    presets: dict[str, int] = field(default_factory=dict)
    cover: RockCover = field(default_factory=RockCover)

    def add(self, sample: StereoSample) -> None:
        """Add a sample."""
        sky = ~np.isfinite(sample.depth)
        near = sample.depth <= MAX_DEPTH
        self.samples += 1
        self.pixels += sky.size
        self.sky += int(sky.sum())
        self.occluded += int((sample.occluded & ~sky).sum())
        self.valid += int(sample.valid.sum())
        self.within += int(near.sum())
        self.rock += int((near & (sample.rock > 0)).sum())
        depth = sample.depth[~sky]
        self.depth += np.bincount(
            np.minimum(depth / DEPTH_STEP, len(self.depth) - 1).astype(int), minlength=len(self.depth)
        )
        disparity = sample.disparity[sample.valid]
        if len(disparity):
            counts = np.bincount(np.maximum(disparity, 0).astype(int))
            longer, shorter = (
                (counts, self.disparity) if len(counts) > len(self.disparity) else (self.disparity, counts)
            )
            self.disparity = longer.copy()
            self.disparity[: len(shorter)] += shorter
            low, high = self.disparity_range
            self.disparity_range = min(low, float(disparity.min())), max(high, float(disparity.max()))
            self.beyond_network += int((disparity >= NETWORK_DISPARITY).sum())
        if not sky.all():
            grey = cv2.cvtColor(sample.left, cv2.COLOR_RGB2GRAY)
            self.gradients.append(float(gradient(grey)[~sky].mean()))
            self.lbp.append(lbp_entropy(grey, ~sky))
            luminance = linear(grey)
            with suppress(ValueError):  # no window shows only ground
                self.ground.append(ground_texture(luminance, (sample.rock == 0) & (sample.depth <= NEAR_GROUND)))
            if len(widths := edge_widths(luminance)):
                self.edge_width.append(float(np.median(widths)))
        meta = sample.meta
        if (elevation := noted_number(meta.get("sun_elevation_deg"), -90, 90)) is not None:
            self.sun_elevation_deg.append(elevation)
        if (k := _asked_k(meta)) is not None:
            self.asked_k.append(k)
            self.cover.add(sample, k)
        preset = str(meta.get("preset", "unknown"))
        self.presets[preset] = self.presets.get(preset, 0) + 1

    def share_within(self, distance: np.ndarray) -> np.ndarray:
        """Return the share of pixels up to `distance` [m], multiples of DEPTH_STEP, of all that are not sky."""
        total = np.concatenate([[0], np.cumsum(self.depth)])
        return total[np.round(np.asarray(distance) / DEPTH_STEP).astype(int)] / max(1, int(self.depth.sum()))

    def report(self) -> dict[str, Any]:
        """Return the statistics as plain numbers, for JSON; the module defines them."""
        ground = self.pixels - self.sky
        return {
            "samples": self.samples,
            "within_15m_of_all": _share(self.within, self.pixels),
            "within_15m_of_not_sky": _share(self.within, ground),
            "valid": _share(self.valid, self.pixels),
            "sky": _share(self.sky, self.pixels),
            "occluded": _share(self.occluded, ground),
            "rock": _share(self.rock, self.within),
            "depth_histogram": {"step_m": DEPTH_STEP, "counts": self.depth.tolist()},
            "depth_percentiles_m": _percentiles(self.depth, DEPTH_STEP),
            "disparity_px": {
                "least": self.disparity_range[0] if self.valid else None,
                "most": self.disparity_range[1] if self.valid else None,
                "percentiles": _percentiles(self.disparity, 1.0),
                "share_192_and_more": _share(self.beyond_network, self.valid),
                "counts": self.disparity.tolist(),
            },
            "gradient": _spread(self.gradients),
            "lbp_entropy_bits": _spread(self.lbp),
            "edge_width_px": _spread(self.edge_width),
            "ground": self._ground(),
            "sun_elevation_deg": _spread(self.sun_elevation_deg),
            "asked_k": _spread(self.asked_k),
            "cover": self.cover.report(),
            "presets": dict(sorted(self.presets.items())),
        }

    def _ground(self) -> dict[str, Any]:
        if not self.ground:
            return {}
        wavelength = 1 / np.sqrt(BAND_EDGES[:-1] * BAND_EDGES[1:])
        return {
            "samples": len(self.ground),
            "wavelength_px": [round(float(w), 1) for w in wavelength],
            "contrast": np.mean([look.contrast for look in self.ground], axis=0).tolist(),
            "slope": _spread([look.slope for look in self.ground]),
            "direction": np.mean([look.direction[1:] for look in self.ground], axis=0).tolist(),
            "peakedness": np.mean([look.peakedness for look in self.ground], axis=0).tolist(),
            "shade": np.mean([look.shade for look in self.ground], axis=0).tolist(),
        }


def _asked_k(meta: dict[str, Any]) -> float | None:
    """Return the rock abundance k that the sample's scene was asked for, or None if it is not noted."""
    config = meta.get("scene_config")
    rocks = config.get("rocks") if isinstance(config, dict) else None
    return noted_number(rocks.get("k"), 0, 1) if isinstance(rocks, dict) else None


def noted_number(value: Any, least: float, most: float) -> float | None:
    """Return a value of a sample's JSON as a number.

    Other programs may write datasets without this value, or with something else in its place.

    Args:
        value: The value; None if there is none.
        least: Least plausible number.
        most: Largest plausible number.

    Returns:
        None if the value is no number within these bounds.
    """
    return float(value) if isinstance(value, int | float) and least <= value <= most else None


def _share(part: int, whole: int) -> float:
    return part / whole if whole else 0.0


def _percentiles(counts: np.ndarray, step: float) -> dict[str, float]:
    """Return the 1st, 50th and 99th percentile, taking the values of a bin as spread evenly over it."""
    below = np.concatenate([[0], np.cumsum(counts)])
    if not below[-1]:
        return {}
    quantiles = {}
    for percent in (1, 50, 99):
        rank = percent / 100 * below[-1]
        k = int(np.searchsorted(below, rank, side="left")) - 1
        quantiles[str(percent)] = float((k + (rank - below[k]) / counts[k]) * step)
    return quantiles


def _spread(values: list[float]) -> dict[str, float]:
    if not values:
        return {}
    return {"least": min(values), "mean": float(np.mean(values)), "most": max(values)}


def table(statistics: dict[str, SampleStatistics], pairs: dict[str, int]) -> str:
    """Return the statistics as lines of text.

    Args:
        statistics: By split, "all" among them.
        pairs: Number of pairs in the dataset, by split.
    """
    rows: list[tuple[str, list[str]]] = [("pairs", [str(pairs[name]) for name in statistics])]
    reports = {name: part.report() for name, part in statistics.items()}

    def add(label: str, text: Any) -> None:
        """Add a row with the text of each report, "-" where it has no samples."""
        rows.append((label, [text(report) if report["samples"] else "-" for report in reports.values()]))

    add("pairs in these statistics", lambda r: f"{r['samples']}")
    add(f"within {MAX_DEPTH:g} m, of all pixels", lambda r: f"{r['within_15m_of_all']:.1%}")
    add(f"within {MAX_DEPTH:g} m, of pixels not sky", lambda r: f"{r['within_15m_of_not_sky']:.1%}")
    add(f"valid ({MIN_DEPTH:g} m to {MAX_DEPTH:g} m)", lambda r: f"{r['valid']:.1%}")
    add("sky", lambda r: f"{r['sky']:.1%}")
    add("occluded, of pixels not sky", lambda r: f"{r['occluded']:.1%}")
    add("rock, of pixels within 15 m", lambda r: f"{r['rock']:.1%}")
    add("median depth [m]", lambda r: f"{r['depth_percentiles_m'].get('50', np.nan):.2f}")
    add("disparity of valid pixels [px]", lambda r: _range(r["disparity_px"], ".1f"))
    add(f"  {NETWORK_DISPARITY:g} px and more", lambda r: f"{r['disparity_px']['share_192_and_more']:.2%}")
    add("gradient [grey levels / px]", lambda r: _mean(r["gradient"], ".2f"))
    add("LBP entropy [bits]", lambda r: _mean(r["lbp_entropy_bits"], ".3f"))
    add("contrast of ground, 45 to 2.8 px wavelength", lambda r: _row(r["ground"].get("contrast", []), ".2f"))
    add("slope of the ground's spectrum", lambda r: _mean(r["ground"].get("slope", {}), ".2f"))
    add("peakedness of ground at 1, 2 and 4 px", lambda r: _row(r["ground"].get("peakedness", []), ".1f"))
    add("width of edges [px]", lambda r: _mean(r["edge_width_px"], ".2f"))
    add("sun elevation [deg]", lambda r: _range(r["sun_elevation_deg"], ".0f"))
    add("rock abundance k asked for", lambda r: _range(r["asked_k"], ".3f"))
    label = max(len(row[0]) for row in rows)
    width = max(len(cell) for row in rows for cell in (*row[1], "train")) + 2
    lines = [" " * label + "".join(f"{name:>{width}}" for name in statistics)]
    lines += [f"{name:<{label}}" + "".join(f"{cell:>{width}}" for cell in cells) for name, cells in rows]
    return "\n".join(lines)


def _range(values: dict[str, Any], form: str) -> str:
    if values.get("least") is None:
        return "-"
    return f"{values['least']:{form}} to {values['most']:{form}}"


def _mean(values: dict[str, float], form: str) -> str:
    return f"{values['mean']:{form}}" if values else "-"


def _row(values: list[float], form: str) -> str:
    return " ".join(f"{value:{form}}" for value in values) or "-"
