"""Images made worse on purpose: what dust, bad focus and low light do to a pair."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields

import cv2
import numpy as np


@dataclass(frozen=True)
class Degradation:
    """Applied in this order to both eyes alike, noise drawn for each.

    contrast: factor about the image's mean; blur: standard deviation [px]; noise: standard deviation [grey levels].
    """

    contrast: float = 1.0
    blur: float = 0.0
    noise: float = 0.0

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not (np.isfinite(value) and value >= 0):
                raise ValueError(f"degradation {name} must be a number >= 0, got {value}")

    @classmethod
    def parse(cls, text: str) -> Degradation:
        """Read "contrast=.33,blur=1,noise=2.5"; what is left out stays. Raises ValueError that names a field."""
        known = {field.name for field in fields(cls)}
        values: dict[str, float] = {}
        for part in filter(None, (p.strip() for p in text.split(","))):
            name, _, value = part.partition("=")
            if name not in known:
                raise ValueError(f"degradation: unknown field {name!r}; known are {', '.join(sorted(known))}")
            try:
                values[name] = float(value)
            except ValueError:
                raise ValueError(f"degradation: {name} must be a number, got {value!r}") from None
        return cls(**values)

    def apply(self, image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(H, W) or (H, W, 3) uint8 in, the same out."""
        out: np.ndarray = image.astype(np.float32)
        if self.contrast != 1:
            mean = out.mean()
            out = mean + np.float32(self.contrast) * (out - mean)
        if self.blur > 0:
            out = cv2.GaussianBlur(out, (0, 0), self.blur, borderType=cv2.BORDER_REFLECT_101)
        if self.noise > 0:
            out = out + self.noise * rng.standard_normal(out.shape, dtype=np.float32)
        return np.clip(np.round(out), 0, 255).astype(np.uint8)
