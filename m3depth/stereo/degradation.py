"""Degraded images: the effects of dust, bad focus, low light and a maladjusted rig on a pair."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields

import cv2
import numpy as np

MAX_VERTICAL = 16.0  # largest vertical offset of the right image [px]
LARGEST = {"gain": 100.0, "contrast": 100.0, "blur": 100.0, "noise": 255.0}  # blur in px, noise in grey levels


@dataclass(frozen=True)
class Degradation:
    """Changes that are applied in this order: the first two to the right image alone, the others to both.

    Raises:
        ValueError: A value out of range; the message names the field.
    """

    vertical: float = 0.0
    """Rows by which the right image is too low [px], interpolated by Lanczos."""
    gain: float = 1.0
    """Brightness of the right image relative to the left one."""
    contrast: float = 1.0
    """Factor on the differences to the image's mean."""
    blur: float = 0.0
    """Standard deviation of a Gaussian blur [px]."""
    noise: float = 0.0
    """Standard deviation of the noise [grey levels], drawn for each image."""

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if name == "vertical" and not abs(value) <= MAX_VERTICAL:
                raise ValueError(f"vertical must lie in [{-MAX_VERTICAL}, {MAX_VERTICAL}] px, got {value}")
            if name != "vertical" and not 0 <= value <= LARGEST[name]:
                raise ValueError(f"{name} must lie in [0, {LARGEST[name]:g}], got {value:g}")

    @classmethod
    def parse(cls, text: str) -> Degradation:
        """Read text like "contrast=.33,blur=1,noise=2.5"; fields that it lacks keep their default.

        Raises:
            ValueError: A field is unknown, given twice, or its value is no number or out of range; the message names
                it.
        """
        names = {field.name for field in fields(cls)}
        values: dict[str, float] = {}
        for part in filter(None, (p.strip() for p in text.split(","))):
            name, _, value = part.partition("=")
            if name not in names:
                raise ValueError(f"`degrade`: unknown field {name!r}; choose from {', '.join(sorted(names))}")
            if name in values:
                raise ValueError(f"`degrade`: {name} is given twice")
            try:
                values[name] = float(value)
            except ValueError:
                raise ValueError(f"`degrade`: {name} must be a number, got {value!r}") from None
        try:
            return cls(**values)
        except ValueError as error:  # of a value out of its range
            raise ValueError(f"`degrade`: {error}") from None

    def apply(self, left: np.ndarray, right: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Degrade a pair.

        Args:
            left, right: (H, W) or (H, W, 3) uint8.
            rng: Draws the noise.

        Returns:
            Both images, of the same shapes, uint8.
        """
        shifted: np.ndarray = right.astype(np.float32)
        if self.vertical:
            move = np.array([[1, 0, 0], [0, 1, self.vertical]])
            size = (right.shape[1], right.shape[0])
            shifted = cv2.warpAffine(shifted, move, size, flags=cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REFLECT_101)
        return self._worsened(left.astype(np.float32), rng), self._worsened(np.float32(self.gain) * shifted, rng)

    def _worsened(self, out: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Apply contrast, blur and noise to one image, float32, and round it to uint8."""
        if self.contrast != 1:
            mean = out.mean()
            out = mean + np.float32(self.contrast) * (out - mean)
        if self.blur > 0:
            out = cv2.GaussianBlur(out, (0, 0), self.blur, borderType=cv2.BORDER_REFLECT_101)
        if self.noise > 0:
            out = out + self.noise * rng.standard_normal(out.shape, dtype=np.float32)
        return np.clip(np.round(out), 0, 255).astype(np.uint8)
